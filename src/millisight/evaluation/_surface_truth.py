"""The true surface of an object of known shape: what a radar's antennas can see, and what shines back at them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import seed_or_generator
from millisight.core.errors import InputError
from millisight.data import Capture, PointCloud, TriangleMesh
from millisight.meshes import LIFT, RayCaster

_SAMPLES = 20_000  # points on the whole surface
_ANTENNAS = 25  # poses whose lines of sight are looked along
_WITHIN = (0.01, 0.005)  # [m]
_GRAZING = 0.02  # cosine, below which a surface is not seen


class TrueSurface(NamedTuple):
    """Points of an object's surface that a radar sees.

    Attributes
    ----------
    points, normals : (N, 3) places that a pose sees, evenly spread [m], and outward unit normals
    shines : (N,) bool, where the ray along the normal meets the aperture: what reflects like a mirror is seen there
    """

    points: np.ndarray
    normals: np.ndarray
    shines: np.ndarray


def true_surface(
    meshes: Sequence[TriangleMesh], capture: Capture, *, rng: int | np.random.Generator = 0
) -> TrueSurface:
    """Sample the surface that the poses of a capture see.

    Parameters
    ----------
    meshes : of the object's parts, in the capture's frame
    capture : whose poses look down at them, their aperture across z
    rng : seed or generator of the samples

    Raises
    ------
    InputError
        No mesh, or nothing of it is seen.
    """
    if not meshes:
        raise InputError("there is no mesh; expected at least one")
    corners = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
    crosses = np.concatenate([mesh.face_crosses for mesh in meshes])
    areas = np.linalg.norm(crosses, axis=1)
    generator = seed_or_generator(rng)
    face = generator.choice(len(areas), _SAMPLES, p=areas / areas.sum())
    u, v = np.sqrt(generator.random(_SAMPLES)), generator.random(_SAMPLES)
    shares = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    points = np.einsum("ni,nij->nj", shares, corners[face])
    normals = crosses[face] / areas[face, None]
    poses = capture.trajectory.positions
    caster, seen = RayCaster(corners), np.zeros(_SAMPLES, bool)
    for pose in poses[np.linspace(0, len(poses) - 1, _ANTENNAS).astype(int)]:
        ways = pose - points
        facing = np.flatnonzero(((ways * normals).sum(axis=1) > _GRAZING * np.linalg.norm(ways, axis=1)) & ~seen)
        starts = points[facing] + 10 * LIFT * normals[facing]
        seen[facing[~caster.blocked(starts, pose)]] = True
    if not seen.any():
        raise InputError("the antennas see nothing of the object; check the frames of both")
    points, normals = points[seen], normals[seen]
    up = normals[:, 2] > _GRAZING
    meet = points + normals * ((poses[:, 2].mean() - points[:, 2]) / np.where(up, normals[:, 2], 1.0))[:, None]
    within = ((meet >= poses.min(axis=0)) & (meet <= poses.max(axis=0)))[:, :2].all(axis=1)
    return TrueSurface(points, normals, up & within)


class SurfaceScores(NamedTuple):
    """How well points agree with a true surface; shares from 0 to 1, NaN where nothing is defined.

    Attributes
    ----------
    points : their number
    precision, recall, f : within 10 mm, of the whole visible surface
    precision_5mm, recall_5mm, f_5mm : within 5 mm
    recall_shining, f_shining : within 10 mm, recall of what shines alone
    place : median distance of the points from the surface [m]
    normal_deg : median angle between the normals of points within 10 mm and the surface's [degrees], or NaN
    """

    points: int
    precision: float
    recall: float
    f: float
    precision_5mm: float
    recall_5mm: float
    f_5mm: float
    recall_shining: float
    f_shining: float
    place: float
    normal_deg: float


def score_surface(found: PointCloud, truth: TrueSurface) -> SurfaceScores:
    """Score points against the surface that a radar sees, by the nearest points of both (paper Eq. 9 to 11)."""
    from scipy.spatial import KDTree

    if not len(found):
        nothing = dict.fromkeys(SurfaceScores._fields[1:-2], 0.0)
        return SurfaceScores(points=0, **nothing, place=np.nan, normal_deg=np.nan)
    away, nearest = map(np.asarray, KDTree(truth.points).query(found.points))
    back = np.asarray(KDTree(found.points).query(truth.points)[0])
    shining = back[truth.shines]

    def f(precision: float, recall: float) -> float:
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0

    normal_deg = np.nan
    near = away < _WITHIN[0]
    if found.normals is not None and near.any():
        cosines = (found.normals[near] * truth.normals[nearest[near]]).sum(axis=1)
        normal_deg = float(np.degrees(np.median(np.arccos(np.clip(cosines, -1, 1)))))
    shares = []
    for within in _WITHIN:
        precision, recall = float((away < within).mean()), float((back < within).mean())
        shares.append((precision, recall, f(precision, recall)))
    shone = float((shining < _WITHIN[0]).mean()) if len(shining) else np.nan
    return SurfaceScores(
        len(found),
        *shares[0],
        *shares[1],
        recall_shining=shone,
        f_shining=f(shares[0][0], shone) if len(shining) else np.nan,
        place=float(np.median(away)),
        normal_deg=normal_deg,
    )
