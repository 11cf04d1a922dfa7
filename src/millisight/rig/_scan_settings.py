"""The aperture of a scan as a world file or a rig file describes it, and its rows."""

import numpy as np

from millisight.core import check_known, checked_number, checked_numbers, put, record
from millisight.core.errors import InputError
from millisight.rig._protocols import ArmPose

PATTERNS = ("serpentine", "one-way")


@record
class ScanSettings:
    """The aperture: rows along y at z = 0, one beside the other along x.

    Attributes
    ----------
    size : along x and y [m]; published: (0.22, 0.55) to (0.45, 0.60)
    corner : x and y where it begins [m]
    row_spacing : [m]
    pattern : "serpentine", or "one-way" with the arm returning between rows
    """

    size: tuple[float, float] = (0.22, 0.55)
    corner: tuple[float, float] = (0.0, 0.0)
    row_spacing: float = 0.0022
    pattern: str = "serpentine"

    def __post_init__(self) -> None:
        check_known("pattern", self.pattern, PATTERNS)
        size = checked_numbers(self.size, name="size", count=2, unit="m", above=0)
        spacing = checked_number(self.row_spacing, name="row_spacing", unit="m", above=0)
        if not 1 <= size[0] / spacing <= 1e5:
            raise InputError(f"row_spacing is {spacing:g} m and size {size[0]:g} m along x; expected 2 to 100000 rows")
        put(self, size=size, row_spacing=spacing, corner=checked_numbers(self.corner, name="corner", count=2, unit="m"))

    @property
    def middle(self) -> np.ndarray:
        """(2,) x and y of the aperture's middle [m]."""
        return np.add(self.corner, np.divide(self.size, 2))

    @property
    def row_places(self) -> np.ndarray:
        """x of every row [m]."""
        rows = int(self.size[0] / self.row_spacing * (1 + 1e-9)) + 1
        return self.corner[0] + self.row_spacing * np.arange(rows)

    def rows(self, origin: tuple[float, float, float]) -> tuple[tuple[ArmPose, ArmPose], ...]:
        """Start and end of every row in the base frame; `origin` is the image frame's origin there (3,) [m]."""
        low, high = self.corner[1], self.corner[1] + self.size[1]
        rows = [
            (ArmPose(position=np.add(origin, (x, low, 0.0))), ArmPose(position=np.add(origin, (x, high, 0.0))))
            for x in self.row_places
        ]
        if self.pattern == "serpentine":
            rows[1::2] = [(end, start) for start, end in rows[1::2]]
        return tuple(rows)
