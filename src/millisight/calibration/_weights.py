"""Generalised least squares with two kinds of errors: of each corner alone, and of the arm for a whole picture.

The residuals of picture i are r_i = J_i d + D_i e_i + n_i: d what is looked for, e_i the arm's error, n_i the corners'.
Their covariance is s^2 (1 + D_i L D_i^T) with L diagonal, so that all sums follow from small products of J, D and r by
the identity of Woodbury.
"""

from typing import NamedTuple

import numpy as np

_REACH = 14.0  # natural logarithm of the largest share of the arm in the residuals


class Grams(NamedTuple):
    """Products over the residuals of each of N pictures; m unknowns, 6 errors of the arm.

    Attributes
    ----------
    jj : (N, m, m) of J with J
    dj : (N, 6, m) of D with J
    dd : (N, 6, 6) of D with D
    jr : (N, m) of J with r
    dr : (N, 6) of D with r
    rr : (N,) of r with r
    count : number of residuals
    """

    jj: np.ndarray
    dj: np.ndarray
    dd: np.ndarray
    jr: np.ndarray
    dr: np.ndarray
    rr: np.ndarray
    count: int

    @classmethod
    def of(cls, unknown: np.ndarray, random: np.ndarray, residuals: np.ndarray) -> "Grams":
        """From J (N, k, m), D (N, k, 6) and r (N, k)."""
        j, d = np.swapaxes(unknown, 1, 2), np.swapaxes(random, 1, 2)
        r = residuals[..., None]
        return cls(
            jj=j @ unknown,
            dj=d @ unknown,
            dd=d @ random,
            jr=(j @ r)[..., 0],
            dr=(d @ r)[..., 0],
            rr=(residuals**2).sum(axis=1),
            count=residuals.size,
        )


class Weights(NamedTuple):
    """The arm's standard deviations in units of a corner's.

    Attributes
    ----------
    place : of its position along each axis [m per pixel]
    turn : of its turn about each axis [rad per pixel]
    """

    place: float
    turn: float

    def normal(self, grams: Grams) -> np.ndarray:
        """(m, m) J^T V^-1 J."""
        return (grams.jj - np.swapaxes(grams.dj, 1, 2) @ self._less(grams) @ grams.dj).sum(axis=0)

    def gradient(self, grams: Grams) -> np.ndarray:
        """(m,) J^T V^-1 r."""
        told = self._less(grams) @ grams.dr[..., None]
        return (grams.jr - (np.swapaxes(grams.dj, 1, 2) @ told)[..., 0]).sum(axis=0)

    def cost(self, grams: Grams) -> float:
        """r^T V^-1 r."""
        return float((grams.rr - np.einsum("ni,nij,nj->n", grams.dr, self._less(grams), grams.dr)).sum())

    def variance(self, grams: Grams) -> float:
        """s^2, of a corner's column or row [pixels²], where the residuals are of the best fit to first order."""
        gradient, normal = self.gradient(grams), self.normal(grams)
        left = self.cost(grams) - gradient @ np.linalg.solve(normal, gradient)
        return max(float(left), float(np.finfo(float).tiny)) / (grams.count - len(normal))

    def unlikelihood(self, grams: Grams) -> float:
        """-2 log of the restricted likelihood, up to a constant; s^2 is the best one."""
        free = grams.count - len(grams.jr[0])
        spread = np.linalg.slogdet(self._inner(grams))[1].sum()
        return float(free * np.log(self.variance(grams)) + spread + np.linalg.slogdet(self.normal(grams))[1])

    def _inner(self, grams: Grams) -> np.ndarray:
        scale = self._scale
        return np.eye(6) + scale[:, None] * grams.dd * scale

    def _less(self, grams: Grams) -> np.ndarray:
        """(N, 6, 6) what V^-1 has less than 1, between D and D^T."""
        scale = self._scale
        return scale[:, None] * np.linalg.inv(self._inner(grams)) * scale

    @property
    def _scale(self) -> np.ndarray:
        return np.repeat([self.place, self.turn], 3)


def estimate_weights(grams: Grams) -> Weights:
    """The weights of greatest restricted likelihood: Patterson & Thompson, Biometrika 58, 545 (1971)."""
    from scipy.optimize import minimize

    # So that 1 moves a corner by as much as its own error does.
    size = np.sqrt(np.einsum("nii->i", grams.dd).reshape(2, 3).mean(axis=1) / grams.count)

    def weights(logs: np.ndarray) -> Weights:
        place, turn = np.exp(logs) / size
        return Weights(float(place), float(turn))

    best = minimize(
        lambda logs: weights(logs).unlikelihood(grams),
        [0.0, 0.0],
        method="Nelder-Mead",
        bounds=[(-_REACH, _REACH)] * 2,
        options={"initial_simplex": [[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]], "xatol": 1e-4, "fatol": 1e-6},
    )
    return weights(best.x)
