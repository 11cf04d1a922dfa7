"""Where objects of known shapes lie: poses of meshes that agree with the oriented points of a capture."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from hashlib import blake2b
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    checked_array,
    checked_integer,
    checked_number,
    checked_record,
    rotation_vector,
    share_of,
    with_step,
)
from millisight.core.errors import CoverageError, InputError, MeshError
from millisight.data import NONE_OF_THEM, Capture, Located, PointCloud, Pose, TriangleMesh, VoxelGrid
from millisight.geometry._appearance import agreements, appearance, can_be_simulated, check_simulated
from millisight.geometry._moments import channel_middles
from millisight.geometry._points import FALSE_ALARMS, above, surface_points
from millisight.geometry._registration import CLIMBERS, Fit, Seen, curvature, register, rescored, seen_by
from millisight.geometry._samples import MeshSamples, samples_of
from millisight.geometry._symmetries import Symmetry, symmetries
from millisight.geometry._turns import reduced_rotations

_LEAST = 12  # points
_SAMPLES = 350
_THINNED, _MOST = 0.004, 300  # spacing [m] and number of the points that are compared
_TURNS = 3000
_MANY, _KEPT = 3, 6  # of more meshes all are tried roughly, and so many of them are searched for fully
_ROUGHLY = (0.006, 100, 700, 20)  # then: spacing [m] and number of points, turns, and poses that are fitted
_DENSE = 1200  # samples by which meshes are compared: those of large ones are not coarser
_LARGER = 12.0  # than the points' extent, or smaller: what no object of that size shows
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}

# Chosen on development objects alone (examples/objects.toml): see docs/how-to/locate.md.
_WEIGHT = 0.03  # difference of scores by which a pose is e times as probable as another
_CURVED = 60.0  # observations that a score is worth
_WITHOUT = 1.35  # how many times better a mesh agrees without its edges, where these are not seen
_WHICH, _NOTHING = 0.03, 0.15  # the same between meshes, and the score of "none of them"
_LOOKED = 8  # meshes, the likeliest of several, whose images are simulated
_LOOKS, _UNLIKE = 0.75, 0.65  # how much the agreement of images counts beside the score, and the one that tells nothing
_NOTHING_ALIKE = 0.28  # the score of "none of them" then
_FARTHEST, _ANY_TURN = 0.03, np.pi / np.sqrt(3)  # standard deviations where nothing is known [m], [rad]


def locate(
    source: Capture | PointCloud,
    meshes: TriangleMesh | Mapping[str, TriangleMesh],
    grid: VoxelGrid | None = None,
    *,
    points: PointCloud | None = None,
    antennas: ArrayLike | None = None,
    clutter: Literal["none", "lid", "auto"] | str = "none",
    false_alarms: float = FALSE_ALARMS,
    support: float | None = None,
    turns: int = _TURNS,
    materials: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Located:
    """Find the pose of an object of known shape, in six degrees of freedom, and which of several it is (primer 25, 26).

    Oriented points of the capture are compared with what of the mesh, in a pose, mirrors some antenna to itself.
    Rotations spread over all there are, less those that the mesh's symmetries make alike, are tried; pairs of points
    and samples with like normals vote for the translation; the best are fitted by iterated closest points, both ways.
    The score is the harmonic mean of the share of the points that the mesh explains, and of the share of what should
    shine of the mesh that was found. The covariance is that of the curvature of the score, and of other poses whose
    scores are near. Of several meshes the likeliest are simulated in their poses as well, where a capture is given: how
    well their images agree with the measured one is added to the score.

    Parameters
    ----------
    source : Capture; or oriented points, as of `surface_points`
    meshes : in metres; several by name
    grid : of a capture: voxels in which surfaces are searched, as for `surface_points`; None: around its scene
    points : what `surface_points` found in the capture, where it is known already
    antennas : (n, 3) antennas that saw the points [m]; of a capture its own
    clutter : "lid" or "auto" to take lids and other sheets off before; of a capture
    false_alarms : see `surface_points`; of a capture
    support : height of what the object lies on [m]: points under 2 mm above it are left out, and poses rest on it: the
        lowest point of the mesh lies from 2 mm below to 6 mm above; None: unknown
    turns : rotations that are tried of a mesh without symmetry; 3000 are 15 degrees apart
    materials : whether the weights of the best mesh's echoes are fitted, and how well its image agrees
        (`millisight.geometry.appearance`); of a capture. Where they cannot be, as with an antenna within the mesh, the
        history says why
    progress : called with (done, total)

    Returns
    -------
    Located
        The best pose of each mesh, and the probability that it is this one, or none of them. Nothing is drawn by
        chance: the same points give the same poses.

    Raises
    ------
    InputError
        Fewer than 12 oriented points; points without normals or antennas; what `surface_points` refuses.
    MeshError
        Every mesh is more than 12 times larger or smaller than what was seen: it is in another unit.

    Examples
    --------
    >>> from millisight.data import Radar, Scene, Trajectory
    >>> from millisight.meshes import build_object
    >>> from millisight.simulation import simulate
    >>> mesh = build_object("golf_ball")
    >>> capture = simulate(Scene.from_mesh(mesh, vertices=3000), Radar.preset("mito-sim-77ghz"),
    ...                    Trajectory.raster(size=(0.06, 0.06), step=0.002))
    >>> found = locate(capture, mesh, VoxelGrid.regular((-0.03, -0.03, -0.02), (0.03, 0.03, 0.02), 0.002), turns=400)
    >>> bool(np.linalg.norm(found.poses[0].place) < 0.01)
    True
    """
    from scipy.special import softmax

    named = {"mesh": meshes} if isinstance(meshes, TriangleMesh) else dict(_by_name(meshes))
    if not named or NONE_OF_THEM in named:
        raise InputError(f"there are {len(named)} meshes; expected at least one, none of them called {NONE_OF_THEM!r}")
    turns = checked_integer(turns, name="turns", minimum=100)
    checked_record(materials, bool, name="materials")
    settings: dict[str, Any] = {"meshes": list(named), "turns": turns, **({"materials": True} if materials else {})}
    if support is not None:
        settings["support"] = support = checked_number(support, name="support", unit="m")
    total = len(named) + 2 + materials

    if isinstance(source, PointCloud):
        if grid is not None or clutter != "none" or materials or points is not None:
            raise InputError("points were found already; leave grid, points, clutter and materials out")
        if antennas is None:
            raise InputError("points do not tell who saw them; pass antennas, (n, 3) in metres")
        capture, points = None, source
        seen_from = checked_array(antennas, name="antennas", shape=("n", 3), unit="m")
    else:
        capture = checked_record(source, Capture, name="source")
        if antennas is not None:
            raise InputError("a capture states its own antennas; leave antennas out")
        if materials:
            check_simulated(capture)
        if points is None:
            points = surface_points(capture, grid, clutter=clutter, false_alarms=false_alarms)
        elif grid is not None:
            raise InputError("points were found already; leave grid out")
        checked_record(points, PointCloud, name="points")
        seen_from = channel_middles(capture).reshape(-1, 3)
    if support is not None:
        points = above(points, support)
    normals = points.normals
    if normals is None:
        raise InputError("the points have no normals, by which poses are found; pass those of surface_points")
    if len(points) < _LEAST:
        raise InputError(
            f"{len(points)} oriented points were found; expected at least {_LEAST}: nothing is in view, or the grid "
            "does not hold it"
        )
    if progress is not None:
        progress(1, total)
    seen = seen_by(points, normals, seen_from, spacing=_THINNED, most=_MOST, support=support)
    odd = {name: why for name, mesh in named.items() if (why := _odd_size(name, mesh, seen.points))}
    if len(odd) == len(named):
        raise MeshError("; ".join(odd.values()))
    there = {name: mesh for name, mesh in named.items() if name not in odd}
    done, fits = 1 + len(odd), dict[str, list[Fit]]()
    shapes = {name: _shape_of(mesh).samples for name, mesh in there.items()}
    if len(there) > _MANY:
        spacing, most, rough_turns, climbers = _ROUGHLY
        few = seen_by(points, normals, seen_from, spacing=spacing, most=most, support=support)
        for name, mesh in there.items():
            found = _fits(mesh, few, min(rough_turns, turns), climbers)
            fits[name] = rescored(_shape_of(mesh).samples, found, seen)
            if progress is not None:
                progress(done := done + 1, total + _KEPT)
        total += _KEPT
    for name in sorted(there, key=lambda one: -fits[one][0].score if fits else 0.0)[: _KEPT if fits else None]:
        fits[name], shapes[name] = _fits_with_or_without_edges(there[name], seen, turns)
        if progress is not None:
            progress(done := done + 1, total)
    poses = {name: _pose(name, mesh, fits[name], shapes[name], seen) for name, mesh in there.items()}
    evidence = {name: rescored(_shape_of(mesh).dense, fits[name], seen)[0].score for name, mesh in there.items()}
    nothing = _NOTHING
    if capture is not None and len(there) > 1 and can_be_simulated(capture):
        likely = sorted(evidence, key=lambda one: -evidence[one])[:_LOOKED]
        placed = {name: poses[name].placed(there[name]) for name in likely}
        step = share_of(progress, total - 1 - materials, total)
        looks = agreements(capture, placed, points.points, clutter=clutter, progress=step)
        if looks:
            settings["agreements"] = {name: round(one, 3) for name, one in looks.items()}
            evidence = {name: one + _LOOKS * (looks.get(name, 0.0) - _UNLIKE) for name, one in evidence.items()}
            nothing = _NOTHING_ALIKE
    shares = softmax(np.array([*evidence.values(), nothing]) / _WHICH)
    probabilities = dict.fromkeys(named, 0.0) | dict(zip([*evidence, NONE_OF_THEM], shares.tolist(), strict=True))
    ordered = [poses[name] for name in sorted(evidence, key=lambda one: -evidence[one])]
    if materials:
        best, measured = ordered[0], checked_record(capture, Capture, name="source")
        try:
            fitted = appearance(
                measured, best.placed(there[best.name]), clutter=clutter, progress=share_of(progress, total - 1, total)
            )
        except (CoverageError, InputError, MeshError) as error:  # the pose stays, for which nobody wants to wait again
            settings["materials"] = f"not fitted: {error}"
        else:
            ordered[0] = replace(best, **fitted._asdict())
    metadata = with_step(points.metadata, "locate", **settings)
    if progress is not None:
        progress(total, total)
    return Located(poses=tuple(ordered), probabilities=probabilities, points=points, metadata=metadata)


def _by_name(meshes: Mapping[str, TriangleMesh]) -> Mapping[str, TriangleMesh]:
    for name, mesh in checked_record(meshes, Mapping, name="meshes").items():
        checked_record(mesh, TriangleMesh, name=f"mesh {name!r}")
    return meshes


def _odd_size(name: str, mesh: TriangleMesh, points: np.ndarray) -> str:
    """What is wrong with the size of a mesh, beside that of what was seen; "" if nothing."""
    lower, upper = np.quantile(points, [0.1, 0.9], axis=0)
    seen, size = float(np.linalg.norm(upper - lower)), float(np.linalg.norm(mesh.extent))

    def fits(scale: float) -> bool:
        return seen / _LARGER < size * scale < seen * _LARGER

    if fits(1.0):
        return ""
    guesses = [f"{unit} ({size * scale:.2g} m)" for unit, scale in _UNITS.items() if fits(scale)]
    guesses += [f"metres, told as {unit} ({size / scale:.2g} m)" for unit, scale in _UNITS.items() if fits(1 / scale)]
    advice = f"did you mean {' or '.join(guesses)}? Load it with its unit" if guesses else "check its unit"
    return f"{name} is {size:.3g} m large, but what was seen {seen:.2g} m; {advice}"


class _Known(NamedTuple):
    """What of a mesh is the same for all captures: half of the time of a search."""

    samples: MeshSamples
    dense: MeshSamples
    symmetry: Symmetry


class _Content:
    """A mesh that is the same as another one with the same vertices and faces, such as its file read again."""

    def __init__(self, mesh: TriangleMesh):
        self.mesh = mesh
        self._bytes = blake2b(mesh.vertices.tobytes() + mesh.faces.tobytes()).digest()

    def __hash__(self) -> int:
        return hash(self._bytes)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Content) and self._bytes == other._bytes


def _shape_of(mesh: TriangleMesh) -> _Known:
    return _known(_Content(mesh))


@lru_cache(maxsize=64)
def _known(content: _Content) -> _Known:
    mesh = content.mesh
    samples = samples_of(mesh, _SAMPLES, edges=True)
    # Poses are about the middle of the samples that they were found by.
    dense = samples_of(mesh, _DENSE, edges=True)._replace(middle=samples.middle)
    return _Known(samples, dense, symmetries(mesh))


def _fits(mesh: TriangleMesh, seen: Seen, turns: int, climbers: int = CLIMBERS) -> list[Fit]:
    shape = _shape_of(mesh)
    return register(shape.samples, _rotations(shape, turns), seen, climbers=climbers)


def _fits_with_or_without_edges(mesh: TriangleMesh, seen: Seen, turns: int) -> tuple[list[Fit], MeshSamples]:
    """Poses, and the samples that they were found by: without edges where the mesh agrees much better so."""
    shape = _shape_of(mesh)
    fits = _fits(mesh, seen, turns)
    if _WITHOUT * fits[0].score >= 1:  # no score is larger
        return fits, shape.samples
    faces = shape.samples.without_edges()
    plain = register(faces, _rotations(shape, turns), seen)
    return (plain, faces) if plain[0].score > _WITHOUT * fits[0].score else (fits, shape.samples)


def _rotations(shape: _Known, turns: int) -> np.ndarray:
    return reduced_rotations(turns, shape.symmetry.rotations, shape.symmetry.axes)


def _pose(name: str, mesh: TriangleMesh, fits: list[Fit], shape: MeshSamples, seen: Seen) -> Pose:
    """The best pose of a mesh, of those that were found by these samples."""
    from scipy.special import softmax

    symmetry = _shape_of(mesh).symmetry
    best = fits[0]
    weights = softmax(np.array([one.score for one in fits]) / _WEIGHT)
    free = (best.rotation @ symmetry.axes.T).T
    return Pose(
        name=name,
        rotation=best.rotation,
        translation=best.translation - best.rotation @ shape.middle,
        middle=shape.middle,
        covariance=_covariance(fits, weights, shape, symmetry, seen, free),
        free_axes=free,
        score=best.score,
        explained=best.explained,
        shown=best.shown,
        weight=float(weights[0]),
        symmetry=symmetry.about,
    )


def _covariance(
    fits: list[Fit], weights: np.ndarray, shape: MeshSamples, symmetry: Symmetry, seen: Seen, free: np.ndarray
) -> np.ndarray:
    """(6, 6) of the best pose: by the curvature of its score, and by the other poses, as a mixture (primer 26)."""
    best = fits[0]
    known = np.diag([_FARTHEST**-2] * 3 + [_ANY_TURN**-2] * 3)
    values, vectors = np.linalg.eigh(curvature(shape, best, seen))
    precision = known + _CURVED * (vectors * np.maximum(values, 0)) @ vectors.T
    made = np.linalg.inv(precision)
    for one, weight in zip(fits[1:], weights[1:], strict=True):
        nearest = symmetry.nearest(one.rotation, best.rotation)
        turn = rotation_vector(nearest @ best.rotation.T)
        off = np.concatenate([one.translation - best.translation, turn])
        made += weight * np.outer(off, off)
    for axis in free:
        # Any turn about the axis, and its share of all else.
        made[:, 3:] -= np.outer(made[:, 3:] @ axis, axis)
        made[3:] -= np.outer(axis, axis @ made[3:])
        made[3:, 3:] += _ANY_TURN**2 * np.outer(axis, axis)
    return (made + made.T) / 2
