"""Points in space, how strongly an image answers at each, and which way the surface faces there."""

from dataclasses import field
from typing import Any

import numpy as np

from millisight.core import Metadata, checked_array, checked_metadata, lengths_of, put, record
from millisight.core.errors import InputError

_UNIT = 1e-3  # by which the length of a unit normal may differ from 1


@record
class PointCloud:
    """Points in space, with the image magnitude at each; oriented points of a surface have normals as well.

    Attributes
    ----------
    points : (N, 3) in the image's frame [m]; N may be 0
    magnitude : (N,) |I| there; of points that are of no image, 1
    normals : (N, 3) unit normals of the surface, outward; None: not known
    place_sigma : (N,) standard deviation of each point along its normal [m]; None: not known
    normal_sigma_deg : (N,) standard deviation of each normal, as an angle [degrees]; None: not known
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        The arrays do not belong together, a normal is no unit vector, or a standard deviation is below 0.
    """

    points: np.ndarray
    magnitude: np.ndarray | None = None
    normals: np.ndarray | None = None
    place_sigma: np.ndarray | None = None
    normal_sigma_deg: np.ndarray | None = None
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        count = len(_some(self.points, "points", "N", 3))
        given = np.ones(count, dtype=np.float32) if self.magnitude is None else self.magnitude
        put(
            self,
            points=_some(self.points, "points", count, 3),
            magnitude=_some(given, "magnitude", count, dtype=np.float32),
            metadata=checked_metadata(self.metadata),
        )
        if self.normals is not None:
            normals = _some(self.normals, "normals", count, 3)
            lengths = lengths_of(normals)
            if count and np.abs(lengths - 1).max() > _UNIT:
                raise InputError(
                    f"normals have lengths of {lengths.min():.3g} to {lengths.max():.3g}; expected unit vectors: "
                    "divide each by its length"
                )
            put(self, normals=normals)
        for name in ("place_sigma", "normal_sigma_deg"):
            if getattr(self, name) is not None:
                sigma = _some(getattr(self, name), name, count)
                if count and sigma.min() < 0:
                    raise InputError(f"{name} reaches {sigma.min():.3g}; expected no standard deviation below 0")
                put(self, **{name: sigma})

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"PointCloud({len(self)} points{'' if self.normals is None else ' with normals'})"

    @property
    def power(self) -> np.ndarray:
        """(N,) |I|² at each point."""
        return np.asarray(self.magnitude, dtype=np.float64) ** 2

    def chosen(self, which: np.ndarray) -> "PointCloud":
        """Some of the points: `which` is (N,) bool, or their indices."""

        def some(held: np.ndarray | None) -> np.ndarray | None:
            return None if held is None else held[which]

        return PointCloud(
            points=self.points[which],
            magnitude=some(self.magnitude),
            normals=some(self.normals),
            place_sigma=some(self.place_sigma),
            normal_sigma_deg=some(self.normal_sigma_deg),
            metadata=self.metadata,
        )


def _some(value: Any, name: str, count: int | str, *rest: int, dtype: Any = np.float64) -> np.ndarray:
    """`value` as a read-only array (count, *rest), which may be empty."""
    try:
        none = np.shape(value) == (0, *rest)
    except ValueError:  # of rows that differ
        none = False
    if none and count in (0, "N"):
        empty = np.empty((0, *rest), dtype=dtype)
        empty.flags.writeable = False
        return empty
    return checked_array(value, name=name, shape=(count, *rest), dtype=dtype, unit="m" if rest else "")
