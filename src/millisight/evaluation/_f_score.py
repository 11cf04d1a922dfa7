"""How alike two point clouds are: precision, recall and F-score within a distance (paper Eq. 9-11)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, checked_number


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
    within : tau_F: points nearer than this match [m]

    Raises
    ------
    InputError

    Examples
    --------
    >>> f_score([[0, 0, 0], [0, 0, 1]], [[0, 0, 0.01]], within=0.02)
    FScore(precision=0.5, recall=1.0)
    """
    within = checked_number(within, name="within", unit="m", above=0)
    there, back = (_checked(points, name) for points, name in ((measured, "measured"), (simulated, "simulated")))
    if not len(there) or not len(back):
        return FScore(0.0, 0.0)
    return FScore(_share(there, back, within), _share(back, there, within))


def _checked(points: ArrayLike, name: str) -> np.ndarray:
    if np.shape(points) == (0, 3):
        return np.empty((0, 3))
    return checked_array(points, name=name, shape=("N", 3), unit="m")


def _share(points: np.ndarray, others: np.ndarray, within: float) -> float:
    """The share of `points` with one of `others` nearer than `within`."""
    from scipy.spatial import KDTree

    # The tree finds what is nearer than the bound, and says infinity of the rest.
    far = KDTree(others, balanced_tree=False, compact_nodes=False).query(points, distance_upper_bound=within)[0]
    return float((far < within).mean())
