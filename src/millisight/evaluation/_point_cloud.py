"""Point clouds of radar images: the voxels above a threshold; how alike two are (paper Eq. 9-11)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, checked_number, checked_record
from millisight.core.errors import InputError
from millisight.data import PointCloud, SarImage


def point_cloud(image: SarImage, threshold: float = 0.3, *, relative: bool = True, flat: bool = False) -> PointCloud:
    """The centres of the voxels with |I| > tau_P (paper, section "Simulation Accuracy").

    Parameters
    ----------
    image : SarImage
    threshold : tau_P; if `relative`, a share of the largest |I|, else an absolute magnitude
    flat : use the mean of |I| along z, with all points at z = 0, for images without depth resolution

    Returns
    -------
    PointCloud
        Empty if the image is zero, or nowhere above an absolute threshold.

    Raises
    ------
    InputError
        The threshold is negative, or relative and not below 1.
    """
    grid = checked_record(image, SarImage, name="image").grid
    if not flat:
        axes, values = (grid.x, grid.y, grid.z), image.magnitude
    else:
        axes, values = (grid.x, grid.y, np.zeros(1)), image.project("z")[..., None]
    return _cloud(axes, values, threshold, relative)


def _cloud(axes: tuple[np.ndarray, ...], values: np.ndarray, threshold: float, relative: bool) -> PointCloud:
    threshold = checked_number(threshold, name="threshold", minimum=0)
    if relative and not threshold < 1:
        raise InputError(f"threshold is {threshold:g}; expected less than 1, a share of the image's maximum")
    where = np.nonzero(values > (threshold * values.max() if relative else threshold))
    points = np.stack([axis[i] for axis, i in zip(axes, where, strict=True)], axis=-1)
    return PointCloud(points=points, magnitude=values[where])


class FScore(NamedTuple):
    """Shares between 0 and 1.

    Attributes
    ----------
    precision : of the measured points, those with a simulated one near by (paper Eq. 9)
    recall : of the simulated points, those with a measured one near by (paper Eq. 10)
    """

    precision: float
    recall: float

    @property
    def f(self) -> float:
        """2 P R / (P + R), 0 where both are (paper Eq. 11)."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total else 0.0


def f_score(measured: ArrayLike, simulated: ArrayLike, within: float) -> FScore:
    """Precision, recall and F-score of two clouds; 0 where one of them is empty.

    Parameters
    ----------
    measured, simulated : (N, 3) and (M, 3) points [m]
    within : tau_F: points closer than this match [m]

    Raises
    ------
    InputError

    Examples
    --------
    >>> f_score([[0, 0, 0], [0, 0, 1]], [[0, 0, 0.01]], within=0.02)
    FScore(precision=0.5, recall=1.0)
    """
    within = checked_number(within, name="within", unit="m", above=0)
    there, back = (_cloud_points(points, name) for points, name in ((measured, "measured"), (simulated, "simulated")))
    if not len(there) or not len(back):
        return FScore(0.0, 0.0)
    return FScore(_matched(there, back, within), _matched(back, there, within))


def _cloud_points(points: ArrayLike, name: str) -> np.ndarray:
    if isinstance(points, np.ndarray) and points.shape == (0, 3):
        return np.empty((0, 3))
    return checked_array(points, name=name, shape=("N", 3), unit="m")


def _matched(points: np.ndarray, others: np.ndarray, within: float) -> float:
    """The share of `points` with one of `others` nearer than `within`."""
    from scipy.spatial import KDTree

    # The tree finds what is nearer than the bound, and says infinity of the rest.
    far = KDTree(others, balanced_tree=False, compact_nodes=False).query(points, distance_upper_bound=within)[0]
    return float((far < within).mean())
