"""How a recipe draws what hides the objects."""

from typing import Any

from millisight.core import checked_integer, checked_number, checked_numbers, put, record
from millisight.core.errors import InputError


@record
class Covers:
    """How what hides the objects is drawn, anew for each experiment, evenly between two ends."""

    cartons: int = 1  # cartons of each object in each pose
    clearance: tuple[float, float] = (0.02, 0.02)  # between the objects and the carton's walls, and its lid [m]
    thickness: tuple[float, float] | None = None  # of the carton's walls [m]; None: as the world's
    turn_deg: float = 0.0  # of the carton about z, at most, either way
    tilt_deg: float = 0.0  # of the carton's lid along x and along y, at most
    gap: tuple[float, float] = (0.002, 0.002)  # below the first layer of cloth [m]
    empty: int = 0  # cartons with nothing in them, besides

    def __post_init__(self) -> None:
        put(
            self,
            cartons=checked_integer(self.cartons, name="cartons"),
            clearance=_ends(self.clearance, "clearance"),
            thickness=None if self.thickness is None else _ends(self.thickness, "thickness"),
            turn_deg=checked_number(self.turn_deg, name="turn_deg", unit="degrees", minimum=0),
            tilt_deg=checked_number(self.tilt_deg, name="tilt_deg", unit="degrees", minimum=0),
            gap=_ends(self.gap, "gap"),
            empty=checked_integer(self.empty, name="empty", minimum=0),
        )


def _ends(value: Any, name: str) -> tuple[float, float]:
    low, high = checked_numbers(value, name=name, count=2, unit="m")
    if not 0 <= low <= high:
        raise InputError(f"{name} is [{low:g}, {high:g}]; expected two lengths, the smaller first [m]")
    return low, high
