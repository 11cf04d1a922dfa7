"""Guesses about what was not seen: balls, cylinders and cones carried on beyond what shone of them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import PointCloud, Surface, TriangleMesh
from millisight.geometry._registration import seen_by, some_antennas
from millisight.geometry._shapes import Shape, shape_of

_LEAST = 14  # points
_THINNED, _MOST = 0.004, 600  # spacing [m] and number of the points that shapes are fitted to
_SHAPES = 3  # at most
_SPACING = 0.003  # of what is guessed [m]
_MIRRORS_DEG = 4.0  # from the direction to the nearest of some antennas: what should have shone
_SHOWN = 0.6  # of what should have shone, which must have been seen
_GAP = 0.006  # nearer to a point, a place was seen [m]
_OPPOSED = 0.0  # cosine to the direction of an antenna, below which it does not see a place


def complete(seen: Surface, points: PointCloud, antennas: ArrayLike) -> Surface:
    """Carry on what was seen of round things: a guess, marked as such, and nothing where no shape fits.

    A round body shines only where its normal meets the aperture; its surface goes on beyond. To each patch of points a
    ball, and a cylinder or cone, are fitted. One that agrees with places and normals of the patch, and of which nothing
    is missing that should have shone, is carried on as far as some antenna would see it; a cylinder not beyond the ends
    that were seen. Flat patches end where they end, and hollow ones, as the inside of a bowl, are left open.

    Parameters
    ----------
    seen : Surface, as of `surface`
    points : oriented points that it was made of
    antennas : (n, 3) that saw them [m]

    Returns
    -------
    Surface
        `metadata["seen_vertices"]` counts those that were seen; they come first. `sigma` of the others is their
        distance from what was seen. `metadata["shapes"]` says of each guess what was fitted; it is empty where nothing
        fits, and the surface then is as it was.

    Raises
    ------
    InputError
        The points have no normals.

    Examples
    --------
    >>> directions = np.random.default_rng(0).normal(size=(4000, 3))
    >>> normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    >>> cap = PointCloud(points=0.04 * normals[normals[:, 2] > 0.9], normals=normals[normals[:, 2] > 0.9])
    >>> from millisight.geometry import surface
    >>> antennas = [[x, y, 0.3] for x in (-0.1, -0.05, 0, 0.05, 0.1) for y in (-0.1, -0.05, 0, 0.05, 0.1)]
    >>> made = complete(surface(cap), cap, antennas)
    >>> [(one["shape"], round(one["radius"], 3)) for one in made.metadata["shapes"]]
    [('ball', 0.04)]
    """
    checked_record(seen, Surface, name="seen")
    cloud = checked_record(points, PointCloud, name="points")
    if cloud.normals is None:
        raise InputError("the points have no normals, by which shapes are fitted; pass those of surface_points")
    eyes = some_antennas(checked_array(antennas, name="antennas", shape=("n", 3), unit="m"))
    guesses = guessed(cloud, eyes) if len(cloud) >= _LEAST else []
    count = len(seen.mesh.vertices)
    told = {"seen_vertices": count, "shapes": [one.told for one in guesses]}
    metadata = with_step(seen.metadata, "complete") | told
    if not guesses:
        return Surface(mesh=seen.mesh, sigma=seen.sigma, metadata=metadata)
    starts = np.cumsum([count, *(len(one.vertices) for one in guesses[:-1])])
    vertices = np.concatenate([seen.mesh.vertices, *(one.vertices for one in guesses)])
    faces = np.concatenate([seen.mesh.faces, *(one.faces + k for one, k in zip(guesses, starts, strict=True))])
    sigma = np.concatenate([seen.sigma, *(one.away for one in guesses)])
    return Surface(mesh=TriangleMesh(vertices=vertices, faces=faces), sigma=sigma, metadata=metadata)


class Guess(NamedTuple):
    """What was not seen of a shape.

    Attributes
    ----------
    vertices, normals : (V, 3) [m], and outward unit normals
    faces : (F, 3) counter-clockwise seen from outside
    away : (V,) distances from the nearest point that was seen [m]
    told : what was fitted; what JSON can hold
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    away: np.ndarray
    told: dict[str, Any]


def guessed(cloud: PointCloud, antennas: np.ndarray) -> list[Guess]:
    """What some antenna (A, 3) would see, but that mirrors nothing to any, of the shapes that points agree with."""
    seen = seen_by(cloud, np.asarray(cloud.normals), antennas, spacing=_THINNED, most=_MOST)
    points, normals, made = seen.points, seen.normals, list[Guess]()
    for _ in range(_SHAPES):
        if len(points) < _LEAST or (shape := shape_of(points, normals)) is None:
            break
        if (one := _beyond(shape, points[shape.agreeing], seen.points, antennas)) is not None:
            made.append(one)
        points, normals = points[~shape.agreeing], normals[~shape.agreeing]
    return made


def _beyond(shape: Shape, agreeing: np.ndarray, found: np.ndarray, antennas: np.ndarray) -> Guess | None:
    """What was not seen of one shape; None where more is missing than that, or nothing is."""
    from scipy.spatial import KDTree

    places, normals = shape.lattice(_SPACING)
    flat, facing = places.reshape(-1, 3), normals.reshape(-1, 3)
    ways = antennas[None] - flat[:, None]
    cosines = np.einsum("nai,ni->na", ways, facing) / np.linalg.norm(ways, axis=2)
    best = cosines.max(axis=1)
    shown, mirrors = np.asarray(KDTree(agreeing).query(flat)[0]) < _GAP, best > np.cos(np.radians(_MIRRORS_DEG))
    # Places of a ball's lattice crowd at its pole.
    area = np.sqrt(np.maximum(1 - (facing @ shape.axis) ** 2, 1e-9))
    share = float((area * shown)[mirrors].sum() / max(area[mirrors].sum(), 1e-9))
    if share < _SHOWN:
        return None
    away = np.asarray(KDTree(found).query(flat)[0])
    was_seen = away < _GAP
    kept = ((best > _OPPOSED) & ~was_seen & ~mirrors).reshape(places.shape[:2])
    number = np.full(kept.shape, -1)
    number[kept] = np.arange(kept.sum())
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    corners = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])
    corners = corners[(corners >= 0).all(axis=1)]
    if not len(corners):
        return None
    used, faces = np.unique(corners, return_inverse=True)
    chosen = np.flatnonzero(kept.ravel())[used]
    faces, vertices, outward = faces.reshape(-1, 3), flat[chosen], facing[chosen]
    crosses = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    inward = (crosses * outward[faces[:, 0]]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    told = shape.told | {"vertices": len(vertices), "points": len(agreeing), "shown": share}
    return Guess(vertices, outward, faces, away[chosen], told)
