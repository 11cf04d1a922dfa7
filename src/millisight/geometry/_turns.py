"""Rotations spread evenly over all of them, less those that a mesh's symmetries make alike."""

import numpy as np
from scipy.spatial.transform import Rotation

from millisight.core import rotation_from_vector

_PSI = 1.533751168755204288118041  # the positive root of x⁴ = x + 4


def even_rotations(count: int) -> np.ndarray:
    """(count, 3, 3) rotations along a super-Fibonacci spiral (Alexa, CVPR 2022), nearly evenly spread."""
    s = np.arange(count) + 0.5
    t = s / count
    one, other = np.sqrt(t), np.sqrt(1 - t)
    alpha, beta = 2 * np.pi * s / np.sqrt(2), 2 * np.pi * s / _PSI
    quaternions = np.stack([one * np.sin(alpha), one * np.cos(alpha), other * np.sin(beta), other * np.cos(beta)], 1)
    return Rotation.from_quat(quaternions).as_matrix()


def even_directions(count: int) -> np.ndarray:
    """(count, 3) unit vectors along a Fibonacci spiral, nearly evenly spread over the sphere."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * k
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def turns_about(axis: np.ndarray, angle_deg: float) -> np.ndarray:
    """(3, 3) rotation about a unit axis."""
    return rotation_from_vector(np.radians(angle_deg) * np.asarray(axis))


def angle_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(...) angle between rotations (..., 3, 3) [degrees]."""
    between = np.swapaxes(one, -1, -2) @ other
    return np.degrees(np.arccos(np.clip((np.trace(between, axis1=-2, axis2=-1) - 1) / 2, -1, 1)))


def reduced_rotations(count: int, symmetric: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Rotations as close as `count` over all would be, less those that a mesh's symmetries make alike.

    Parameters
    ----------
    count : of rotations of a mesh without symmetry
    symmetric : (S, 3, 3) rotations that leave the mesh as it is, the identity first
    axes : (A, 3) axes about which any turn does
    """
    if len(axes) > 1:
        return np.eye(3)[None]
    if len(axes):
        # Where the axis points: as close over the sphere, in angle, as `count` are over all rotations.
        to = even_directions(int(np.ceil(4 * np.pi / (8 * np.pi**2 / count) ** (2 / 3))))
        axis = axes[0]
        if any(one @ axis @ axis < 0 for one in symmetric):
            to = to[to[:, 2] >= 0]
        return np.stack([_taking(axis, one) for one in to])
    every = even_rotations(count)
    traces = np.stack([np.trace(every @ one, axis1=1, axis2=2) for one in symmetric])
    return every[traces[0] >= traces.max(axis=0) - 1e-9]


def _taking(axis: np.ndarray, to: np.ndarray) -> np.ndarray:
    """(3, 3) the smallest rotation that takes one unit vector to another."""
    across = np.cross(axis, to)
    size = float(np.linalg.norm(across))
    if size < 1e-9:
        across, size = np.linalg.svd(axis[None])[2][1], 1.0
    return turns_about(across / size, float(np.degrees(np.arccos(np.clip(axis @ to, -1, 1)))))
