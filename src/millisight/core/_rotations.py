"""Rotations and the interpolation of poses in time. Frames and axes: docs/explanation/conventions.md."""

import numpy as np
from numpy.typing import ArrayLike

from millisight.core._records import checked_array
from millisight.core.errors import InputError


def rotation_from_euler_deg(angles_deg: ArrayLike) -> np.ndarray:
    """(3, 3) rotation about the fixed x, then y, then z axis by `angles_deg` [degrees]."""
    angles = np.radians(checked_array(angles_deg, name="angles_deg", shape=(3,), unit="deg"))
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def euler_deg_from_rotation(rotation: ArrayLike) -> np.ndarray:
    """(3,) angles [degrees] about the fixed x, then y, then z axis: the inverse of `rotation_from_euler_deg`.

    The angle about y is within 90 degrees; where it is 90, that about z is 0.
    """
    matrix = checked_array(rotation, name="rotation", shape=(3, 3))
    across = np.hypot(matrix[0, 0], matrix[1, 0])
    y = np.arctan2(-matrix[2, 0], across)
    if across > 1e-9:
        x, z = np.arctan2(matrix[2, 1], matrix[2, 2]), np.arctan2(matrix[1, 0], matrix[0, 0])
    else:
        x, z = np.arctan2(-matrix[1, 2], matrix[1, 1]), 0.0
    return np.degrees([x, y, z])


def rotation_from_quaternion(quaternions: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations from unit quaternions (..., 4) in the order x, y, z, w."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions, dtype=float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def turn_between_deg(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """(...,) angle [degrees] of the turn from quaternions `a` (..., 4) to `b` (..., 4); their signs mean nothing."""
    one, other = (np.asarray(q, dtype=float) / np.linalg.norm(q, axis=-1, keepdims=True) for q in (a, b))
    return np.degrees(2 * np.arccos(np.minimum(1.0, np.abs((one * other).sum(axis=-1)))))


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """(..., 3) axis times angle [rad] of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def rotation_from_vector(vectors: ArrayLike) -> np.ndarray:
    """(..., 3, 3) rotations by axis times angle (..., 3) [rad]: the inverse of `rotation_vector`."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).as_matrix()


def interpolate_poses(
    times: np.ndarray, known_times: np.ndarray, positions: np.ndarray, orientations: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (n, 3) [m] and orientations (n, 4) at `times` [s]: cubic spline and spherical interpolation.

    Raises
    ------
    InputError
        A time lies outside the known ones (nothing is extrapolated), or these do not increase.
    """
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, Slerp

    if len(known_times) < 2 or not (np.diff(known_times) > 0).all():
        raise InputError(
            "known times must increase strictly, and there must be at least two; sort them and remove repeats"
        )
    times = checked_array(times, name="times", shape=("n",), unit="s")
    if times.min() < known_times[0] or times.max() > known_times[-1]:
        raise InputError(
            f"times run from {times.min():g} to {times.max():g} s, but the poses are known from "
            f"{known_times[0]:g} to {known_times[-1]:g} s; remove the times outside, poses are not extrapolated"
        )
    turned = None
    if orientations is not None:
        turned = Slerp(known_times, Rotation.from_quat(orientations))(times).as_quat()
    return CubicSpline(known_times, positions)(times), turned
