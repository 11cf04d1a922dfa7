"""Reference targets: small reflectors whose place is known, and the way of a wave by them."""

from typing import NamedTuple

import numpy as np

from millisight.core import check_known, checked_array, checked_number, put, record
from millisight.core.errors import InputError

TARGETS = ("point", "sphere", "corner")
"""Kinds of reference targets."""


@record
class ReferenceTarget:
    """A reflector to calibrate a radar with, alone or by far the brightest where it is.

    Attributes
    ----------
    position : (3,) of its reference point in the world frame [m]: the middle of a sphere, or the apex of a trihedral
        corner reflector
    uncertainty : standard deviation of each coordinate of `position` [m]; 0: it is exact
    kind : "point": what is small against a wavelength; "sphere": of metal, at least a wavelength across; "corner": a
        trihedral corner reflector
    radius : of the sphere [m]

    Raises
    ------
    InputError, UnknownNameError
        A sphere has no radius, or another kind has one.
    """

    position: np.ndarray
    uncertainty: float = 1e-3
    kind: str = "point"
    radius: float = 0.0

    def __post_init__(self) -> None:
        check_known("kind of target", self.kind, TARGETS)
        put(
            self,
            position=checked_array(self.position, name="position", shape=(3,), unit="m"),
            uncertainty=checked_number(self.uncertainty, name="uncertainty", unit="m", minimum=0),
            radius=checked_number(self.radius, name="radius", unit="m", minimum=0),
        )
        if (self.kind == "sphere") != (self.radius > 0):
            raise InputError(f"a {self.kind} has the radius {self.radius:g} m; expected one above 0 of a sphere, alone")

    def __repr__(self) -> str:
        size = f" of {1e3 * self.radius:.4g} mm" if self.radius else ""
        place = ", ".join(f"{value:.4g}" for value in self.position)
        return f"ReferenceTarget({self.kind}{size} at {place} m, ± {1e3 * self.uncertainty:.3g} mm)"

    def paths(self, tx: np.ndarray, rx: np.ndarray, position: np.ndarray | None = None) -> "TargetPaths":
        """The ways from transmitters (P, T, 3) over the target to receivers (P, R, 3), all in the world frame [m].

        A sphere is taken to reflect where its normal halves the angle between the antennas. The error of that enters
        the length in second order alone, since the true way is the shortest. A trihedral corner is a mirror in each of
        its three planes, which together invert space in its apex a: the length is |tx + rx - 2 a|.

        Parameters
        ----------
        position : of the target [m]; None: its own
        """
        place = self.position if position is None else position
        to, back = np.broadcast_arrays(tx[:, :, None] - place, rx[:, None] - place)
        if self.kind == "corner":
            along = to + back
            length = np.linalg.norm(along, axis=-1)
            unit = along / length[..., None]
            return TargetPaths(length, unit, unit)
        if self.kind == "sphere":
            normal = _unit(_unit(to) + _unit(back))
            to, back = to - self.radius * normal, back - self.radius * normal
        far, near = np.linalg.norm(to, axis=-1), np.linalg.norm(back, axis=-1)
        return TargetPaths(far + near, to / far[..., None], back / near[..., None])


class TargetPaths(NamedTuple):
    """Ways over a target, and how they change.

    Attributes
    ----------
    lengths : (P, T, R) [m]
    by_tx, by_rx : (P, T, R, 3) their gradients by the place of the transmitter, and of the receiver; the gradient by
        the place of the target is minus their sum
    """

    lengths: np.ndarray
    by_tx: np.ndarray
    by_rx: np.ndarray


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
