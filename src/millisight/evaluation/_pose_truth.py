"""How far a found pose is from the true one: ADD, ADD-S, turn and place."""

from typing import NamedTuple

import numpy as np

from millisight.core import rotation_vector
from millisight.data import Pose, TriangleMesh
from millisight.geometry import Symmetry

_SAMPLES = 2000  # vertices that are compared
LEVEL = 0.9
"""Probability of the region whose coverage is counted."""


class PoseScores(NamedTuple):
    """Errors of a pose; the rotation that is compared is, of those that look the same, the nearest.

    Attributes
    ----------
    add : mean distance of the mesh's vertices from their true places (Hinterstoisser et al. 2012) [m]
    add_s : mean distance from the nearest vertex in its true place, which asks for no identity [m]
    degrees : angle between the rotations, 0 of a ball [degrees]
    place : distance of the mesh's middle from its true place [m]
    covered : whether the true pose lies in the region of 90 % that the covariance states
    """

    add: float
    add_s: float
    degrees: float
    place: float
    covered: bool


def score_pose(
    pose: Pose, mesh: TriangleMesh, symmetry: Symmetry, rotation: np.ndarray, translation: np.ndarray
) -> PoseScores:
    """Compare a pose of a mesh with the true one.

    Parameters
    ----------
    pose : that was found
    mesh : in its own frame
    symmetry : of the mesh, as of `symmetries`
    rotation, translation : (3, 3), (3,) true ones [m]
    """
    from scipy.spatial import KDTree
    from scipy.stats import chi2

    vertices = mesh.vertices[np.unique(mesh.faces)]
    vertices = vertices[:: max(1, len(vertices) // _SAMPLES)]
    nearest = symmetry.nearest(rotation, pose.rotation)
    found = vertices @ pose.rotation.T + pose.translation
    true = vertices @ rotation.T + translation
    alike = (vertices - symmetry.middle) @ nearest.T + rotation @ symmetry.middle + translation
    place = rotation @ pose.middle + translation
    turn = np.linalg.norm(rotation_vector(nearest @ pose.rotation.T))
    known = 6 - len(pose.free_axes)
    return PoseScores(
        add=float(np.linalg.norm(found - alike, axis=1).mean()),
        add_s=float(np.asarray(KDTree(true).query(found)[0]).mean()),
        degrees=float(np.degrees(turn)),
        place=float(np.linalg.norm(place - pose.place)),
        covered=bool(pose.distance(place, nearest) ** 2 <= chi2.ppf(LEVEL, known)),
    )
