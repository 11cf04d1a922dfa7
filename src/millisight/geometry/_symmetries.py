"""Rotations that leave a mesh as it is, found from the mesh."""

import numpy as np

from millisight.core import checked_number, checked_record, record
from millisight.core.errors import InputError
from millisight.data import TriangleMesh
from millisight.geometry._samples import samples_of
from millisight.geometry._turns import angle_deg, even_directions, turns_about

_SAMPLES = 250
_DENSE = 4000  # samples of the surface that they are compared with
_SHARE = 0.025  # of the mesh's size: how far samples may be off, where nothing else is asked for
_WITHIN = 0.95  # of the samples, which must be so near
_ORDERS = (2, 3, 4, 5, 6, 8)
_PROBED_DEG = (17.0, 41.0, 73.0, 113.0, 151.0)  # no divisors of a turn: what bears them all bears every angle
_AXES = 260  # directions that are tried, about 9 degrees apart
_ROUGH = 0.09  # by how much the nearest of them is off, at the radius of a sample [rad]
_ALIKE_DEG = 8.0  # axes nearer than this are one
_TAKEN_DEG = 12.0  # from an axis that was found: what starts there would end there
_STEPS, _SETTLED = 12, 1e-3  # of a fit; the length of a step after which it ends [rad]
_AWAY_DEG = 15.0  # from the axis that it began at, where it ends as well: another one begins nearer


@record
class Symmetry:
    """Rotations about a mesh's middle that leave it as it is, within a tolerance.

    Attributes
    ----------
    rotations : (S, 3, 3) about `middle`, the identity first; without those about `axes`
    axes : (A, 3) unit axes about which any turn leaves the mesh as it is: none, one, or three of a ball
    middle : (3,) mean of the surface [m]
    tolerance : by how much 95 % of the turned surface lies off the surface, at most [m]
    """

    rotations: np.ndarray
    axes: np.ndarray
    middle: np.ndarray
    tolerance: float

    def __repr__(self) -> str:
        return f"Symmetry({self.about}, within {1e3 * self.tolerance:.2g} mm)"

    @property
    def about(self) -> str:
        """In words."""
        if len(self.axes) > 1:
            return "the same after any turn"
        count = len(self.rotations) - 1
        turns = f"the same after {count} turn{'s' if count > 1 else ''}" if count else ""
        if not len(self.axes):
            return turns or "no symmetry"
        named = ", ".join(f"{one:.2f}" for one in self.axes[0])
        return f"the same after any turn about ({named})" + (f", and {turns}" if turns else "")

    def nearest(self, rotation: np.ndarray, to: np.ndarray) -> np.ndarray:
        """(3, 3) of all rotations of the mesh that look like `rotation`, that one nearest to another rotation."""
        if len(self.axes) > 1:
            return to
        every = rotation @ self.rotations
        if len(self.axes):
            every = np.stack([_turned_towards(one, to, self.axes[0]) for one in every])
        return every[int(np.argmin(angle_deg(every, to)))]


def symmetries(mesh: TriangleMesh, tolerance: float | None = None) -> Symmetry:
    """Find the rotations that leave a mesh as it is: about axes through its middle, by 1/2 to 1/8 turn or any.

    Axes from all directions are tried with each turn; those that nearly fit are fitted by iterated closest points of
    the mesh with itself, and kept where the turned surface lies within `tolerance`. Reflections are no rotations.

    Parameters
    ----------
    mesh : TriangleMesh
    tolerance : how far 95 % of the turned surface may be off [m]; None: 2.5 % of the mesh's size (diagonal)

    Raises
    ------
    InputError, MeshError

    Examples
    --------
    >>> from millisight.meshes import build_object
    >>> found = symmetries(build_object("cracker_box"))
    >>> len(found.rotations), len(found.axes)
    (4, 0)
    """
    checked_record(mesh, TriangleMesh, name="mesh")
    within = _SHARE * float(np.linalg.norm(mesh.extent)) if tolerance is None else tolerance
    within = checked_number(within, name="tolerance", unit="m", above=0)
    if within >= np.linalg.norm(mesh.extent) / 2:
        raise InputError(f"tolerance is {within:g} m; expected under half the mesh's size, or any turn would do")
    own = _Self(mesh, within)
    axes = even_directions(_AXES)
    axes = np.concatenate([own.principal, axes[axes[:, 2] >= 0]])
    whole = own.fitting(axes, _PROBED_DEG, most=2)
    if len(whole) > 1:  # two axes make a ball
        return Symmetry(rotations=np.eye(3)[None], axes=np.eye(3), middle=own.middle, tolerance=within)
    found = [np.eye(3)]
    for order in _ORDERS:
        for axis in own.fitting(axes, (360 / order,)):
            if len(whole) and abs(axis @ whole[0]) > np.cos(np.radians(_ALIKE_DEG)):
                continue
            found += [turns_about(axis, 360 * n / order) for n in range(1, order)]
    kept: list[np.ndarray] = []
    axis = whole[0] if len(whole) else None
    for one in found:
        if axis is not None:
            # Turns over are alike but for turns about the axis: one of them will do.
            if any(one @ axis @ other @ axis > np.cos(np.radians(_ALIKE_DEG)) for other in kept):
                continue
        elif any(angle_deg(one, other) < _ALIKE_DEG for other in kept):
            continue
        kept.append(one)
    rotations = np.stack(kept)
    return Symmetry(rotations=rotations, axes=np.array(whole).reshape(-1, 3), middle=own.middle, tolerance=within)


class _Self:
    """A mesh's samples, to be compared with themselves turned."""

    def __init__(self, mesh: TriangleMesh, tolerance: float):
        from scipy.spatial import KDTree

        samples, dense = samples_of(mesh, _SAMPLES), samples_of(mesh, _DENSE)
        self.middle = samples.middle
        self.points = samples.points - self.middle
        self.dense = dense.points - self.middle
        self.normals = dense.normals
        self.spread = self.dense.T @ self.dense / len(self.dense)
        self.spacing = dense.spacing
        self.tree = KDTree(self.dense)
        self.tolerance = tolerance
        self.principal = np.linalg.svd(self.points, full_matrices=False)[2]

    def off(self, rotation: np.ndarray) -> np.ndarray:
        """(K,) distances of turned samples from the surface [m]."""
        turned = self.points @ rotation.T
        apart, nearest = map(np.asarray, self.tree.query(turned))
        along = ((turned - self.dense[nearest]) * self.normals[nearest]).sum(axis=1)
        # Between samples the surface goes on along their planes, beyond its end it does not.
        across = np.sqrt(np.maximum(apart**2 - along**2, 0))
        return np.hypot(along, np.maximum(across - self.spacing, 0))

    def bears(self, axis: np.ndarray, angles_deg: tuple[float, ...]) -> bool:
        return all(np.quantile(self.off(turns_about(axis, a)), _WITHIN) < self.tolerance for a in angles_deg)

    def fitting(self, axes: np.ndarray, angles_deg: tuple[float, ...], most: int | None = None) -> list[np.ndarray]:
        """Axes near the given ones, none alike, about which these turns leave the samples in place; `most` at most."""
        made: list[np.ndarray] = []
        room = 2 * self.tolerance + _ROUGH * np.linalg.norm(self.points, axis=1)
        size = np.sqrt(np.trace(self.spread))
        for axis in axes:
            if any(abs(axis @ other) > np.cos(np.radians(_TAKEN_DEG)) for other in made):
                continue
            turn = turns_about(axis, angles_deg[0])
            # The second moments first, which cost nothing.
            if np.linalg.norm(turn @ self.spread @ turn.T - self.spread) > 2 * size * (self.tolerance + _ROUGH * size):
                continue
            if np.mean(self.off(turn) < room) < 0.9:
                continue
            fitted = self._fitted(axis, angles_deg[0])
            if fitted is None or any(abs(fitted @ other) > np.cos(np.radians(_ALIKE_DEG)) for other in made):
                continue
            if self.bears(fitted, angles_deg):
                made.append(fitted)
                if len(made) == most:
                    break
        return made

    def _fitted(self, axis: np.ndarray, angle: float) -> np.ndarray | None:
        """The axis that fits best near by: point-to-plane steps over its two tilts; None where they lead away."""
        start = axis
        for _ in range(_STEPS):
            rotation = turns_about(axis, angle)
            turned = self.points @ rotation.T
            nearest = np.asarray(self.tree.query(turned)[1])
            normals = self.normals[nearest]
            across = np.linalg.svd(axis[None])[2][1:]
            tilts = []
            for one in across:
                tilted = axis + 1e-4 * one
                moved = self.points @ turns_about(tilted / np.linalg.norm(tilted), angle).T
                tilts.append(((moved - turned) / 1e-4 * normals).sum(axis=1))
            matrix = np.stack(tilts, axis=1)
            missed = ((self.dense[nearest] - turned) * normals).sum(axis=1)
            step = np.linalg.lstsq(matrix, missed, rcond=1e-6)[0]
            step *= min(1.0, 0.1 / max(float(np.linalg.norm(step)), 1e-12))
            axis = axis + step @ across
            axis = axis / np.linalg.norm(axis)
            if abs(axis @ start) < np.cos(np.radians(_AWAY_DEG)):
                return None
            if np.linalg.norm(step) < _SETTLED:
                break
        return axis


def _turned_towards(rotation: np.ndarray, to: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """`rotation` times that turn about the mesh's `axis` which brings it nearest to another rotation."""
    between = rotation.T @ to
    # trace(R(axis, a)ᵀ between) = cos a (tr - axisᵀ B axis) + sin a (axis · w) + constant, w of the odd part.
    odd = np.array([between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]])
    angle = np.degrees(np.arctan2(axis @ odd, np.trace(between) - axis @ between @ axis))
    return rotation @ turns_about(axis, float(angle))
