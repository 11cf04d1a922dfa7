"""Points in space, and how strongly an image answers at each."""

import numpy as np

from millisight.core import checked_array, put, record


@record
class PointCloud:
    """Points in space, with the image magnitude at each.

    Attributes
    ----------
    points : (N, 3) in the image's frame [m]; N may be 0
    magnitude : (N,) |I| there; of points that are of no image, 1
    """

    points: np.ndarray
    magnitude: np.ndarray | None = None

    def __post_init__(self) -> None:
        if np.shape(self.points) == (0, 3):
            points, magnitude = np.empty((0, 3)), np.empty(0, dtype=np.float32)
            points.flags.writeable = magnitude.flags.writeable = False
        else:
            points = checked_array(self.points, name="points", shape=("N", 3), unit="m")
            given = np.ones(len(points), dtype=np.float32) if self.magnitude is None else self.magnitude
            magnitude = checked_array(given, name="magnitude", shape=(len(points),), dtype=np.float32)
        put(self, points=points, magnitude=magnitude)

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"PointCloud({len(self)} points)"
