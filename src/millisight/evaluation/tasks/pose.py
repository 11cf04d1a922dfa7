"""The task "pose": where objects of known shape lie, against the truth of the virtual rig."""

import math
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from millisight.core import (
    checked_record,
    file_version,
    record,
    rotation_from_euler_deg,
)
from millisight.data import NONE_OF_THEM, Located, Pose, TriangleMesh, VoxelGrid
from millisight.evaluation._pose_truth import LEVEL, PoseScores, score_pose
from millisight.evaluation._scenes import HIGH, SIGHTS
from millisight.evaluation._shape_scenes import (
    check_shape_settings,
    drawn_points,
    plan_of_shapes,
    scenes_of_shapes,
    worst_scene,
)
from millisight.evaluation._sources import EvaluationData, SceneSource
from millisight.evaluation._statistics import bootstrap_interval, wilson_interval
from millisight.evaluation._tables import Table, table_of
from millisight.evaluation._task import TASKS, EvaluationItem, EvaluationSet, ReportFigure, Task
from millisight.geometry import Symmetry, channel_middles, locate, surface_points, symmetries

_FORMAT = 2
_MARGIN = 0.03  # of the voxels around the object [m]
_OFF = 0.01  # by which their box is off the object, at most [m]
OURS, BLIND = "locate", "upright at the brightest place"
POSES = (OURS, BLIND)
"""What is compared: `locate`; and a guess without a search: the object as it stands in the catalogue, its middle at the
strongest point."""
_NEAR, _TURNED_DEG = 0.01, 10.0  # of a success


@record
class PoseTrial:
    """The scores of one pose.

    Attributes
    ----------
    scene, object, sight : of the scene
    method : one of POSES
    scores : PoseScores
    answer : object that was most probable among all, or NONE_OF_THEM; of the baseline the one whose size is nearest to
        that of what was seen; "" where only this one's mesh was given
    probability : of the object itself among all; NaN where only its mesh was given, and of the baseline
    seconds : of processor time: points and pose; NaN of the baseline
    points : (n, 3) some of the points, for a picture [m]
    transform : (4, 4) of the mesh, as it stands in the catalogue, to the world [m]
    """

    scene: str
    object: str
    sight: str
    method: str
    scores: PoseScores
    answer: str
    probability: float
    seconds: float
    points: np.ndarray
    transform: np.ndarray

    @property
    def success(self) -> bool:
        """Within 1 cm and 10 degrees."""
        return self.scores.place <= _NEAR and self.scores.degrees <= _TURNED_DEG


class _Source(NamedTuple):
    scene: SceneSource
    known: SceneSource
    others: Mapping[str, SceneSource]
    spacing: tuple[float, float, float]
    clutter: Mapping[str, str]
    support: float | None


@TASKS.add("pose")
@record
class PoseTask(Task):
    """Compare poses of objects of known shape with the true ones: simulated captures of one object each.

    Meshes are handed over turned at random, by the object's name; and the box in which points are searched is off the
    object by up to a centimetre along each axis, by the scene's.

    Attributes
    ----------
    spacing : of the voxels along x and y, and along z [m]
    clutter : taken off the captures out of sight: "auto", "lid" or "none"; those in line of sight are left as they are
    which : whether the object is also chosen among all of the dataset
    failures : number of worst scenes to plot
    support : see `locate`; of all scenes [m]
    """

    name: ClassVar[str] = "pose"
    title: ClassVar[str] = "Poses"
    cache: ClassVar[str] = "poses"

    spacing: tuple[float, float] = (0.002, 0.004)
    clutter: str = "lid"
    which: bool = False
    failures: int = 4
    support: float | None = None

    def __post_init__(self) -> None:
        check_shape_settings(self.spacing, self.clutter, self.failures, self.support)
        checked_record(self.which, bool, name="which")

    def plan(self, data: EvaluationData) -> EvaluationSet:
        """One item for each scene with a 77 GHz capture and a known shape."""
        across, deep = self.spacing
        clutter = {"los": "none", "nlos": self.clutter}
        there = scenes_of_shapes(data)
        first = {scene.object: scene for scene in reversed(there)}
        others = {name: first[name] for name in sorted(first)} if self.which else {}
        settings = {
            "format": _FORMAT, "spacing": [across, deep], "clutter": clutter, "others": list(others),
        }  # fmt: skip
        if self.support is not None:
            settings["support"] = self.support

        def source_of(scene: SceneSource) -> _Source:
            return _Source(scene, first[scene.object], others, (across, across, deep), clutter, self.support)

        return plan_of_shapes(data, there, source_of, settings, lambda scene: (first[scene.object], *others.values()))

    @staticmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """Both methods on one scene."""
        source: _Source = item.source
        scene = source.scene
        capture, world = scene.read_capture(HIGH), joined(scene.read_shape(HIGH))
        known = _known(_Key(source.known))
        turn = rotation_from_euler_deg(scene.angles)
        middle = world.bounds.mean(axis=0) - known.upright.moved(rotation=turn).bounds.mean(axis=0)
        off = np.random.default_rng(zlib.crc32(scene.name.encode())).uniform(-_OFF, _OFF, 3)
        grid = VoxelGrid.regular(world.bounds[0] - _MARGIN + off, world.bounds[1] + _MARGIN + off, source.spacing)
        start = time.process_time()
        points = surface_points(capture, grid, clutter=source.clutter[scene.sight], support=source.support)
        eyes = channel_middles(capture).reshape(-1, 3)
        found = locate(points, {scene.object: known.mesh}, antennas=eyes, support=source.support)
        seconds = time.process_time() - start
        ours, answer, size, probability = found.poses[0], "", "", None
        if source.others:
            meshes = {name: _known(_Key(other)).mesh for name, other in source.others.items()}
            which = locate(capture, meshes, points=points, clutter=source.clutter[scene.sight], support=source.support)
            answer, probability = which.ranking[0][0], which.probabilities[scene.object]
            size = _nearest_size(points.points, meshes)
        blind = _blind(found, ours, known.mesh, known.turn)
        guesses = {OURS: (ours, answer, probability, seconds), BLIND: (blind, size, None, None)}
        rotation = turn @ known.turn.T
        (part,) = item.parts
        return {
            part: [
                {
                    "scene": scene.name, "object": scene.object, "sight": scene.sight, "method": method,
                    "scores": list(score_pose(pose, known.mesh, known.symmetry, rotation, middle)), "answer": name,
                    "probability": share, "seconds": took,
                    "points": drawn_points(points.points),
                    "transform": (pose.T_world_mesh @ _turned(known.turn)).tolist(),
                }
                for method, (pose, name, share, took) in guesses.items()
            ]
        }  # fmt: skip

    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> list[PoseTrial]:
        """By scene and method."""
        return [
            PoseTrial(**one | {
                "scores": PoseScores(*one["scores"]),
                "points": np.array(one["points"]).reshape(-1, 3),
                **{name: math.nan if one[name] is None else one[name] for name in ("probability", "seconds")},
                "transform": np.array(one["transform"]),
            })
            for trials in results.values() for one in trials
        ]  # fmt: skip

    def describe(self, planned: EvaluationSet, rows: Sequence[PoseTrial]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""
        return planned.data, (
            f"Poses of objects of known shape, of {planned.data}. Meshes are handed over turned at random. The "
            "pictures show the worst scenes: points, and the mesh where it was found."
        )

    def tables(self, planned: EvaluationSet, rows: Sequence[PoseTrial]) -> dict[str, Table]:
        """Medians and shares of each sight, and every scene."""
        there = [sight for sight in SIGHTS if any(one.sight == sight for one in rows)]
        return {
            **{sight: _summary(rows, sight, planned.data) for sight in there},
            "scenes": table_of(
                f"Every scene, {planned.data}",
                ["scene", "method", "ADD [mm]", "ADD-S [mm]", "turn [°]", "place [mm]", "in the 90 % region", "answer",
                 "its probability", "processor time [s]"],
                [
                    (
                        one.scene, one.method, round(1e3 * one.scores.add, 2), round(1e3 * one.scores.add_s, 2),
                        round(one.scores.degrees, 2), round(1e3 * one.scores.place, 2),
                        None if one.method == BLIND else ("yes" if one.scores.covered else "no"), one.answer or None,
                        *(None if math.isnan(value) else round(value, 3) for value in (one.probability, one.seconds)),
                    )
                    for one in rows
                ],
                place="file",
            ),
        }  # fmt: skip

    def figures(self, planned: EvaluationSet, rows: Sequence[PoseTrial]) -> Iterator[ReportFigure]:
        """The worst scenes of `locate`."""
        sources = {item.source.scene.name: item.source for item in planned.items}
        ours = sorted((one for one in rows if one.method == OURS), key=lambda one: -one.scores.add_s)
        for number, one in enumerate(ours[: self.failures], 1):
            mesh = _known(_Key(sources[one.scene].known)).upright
            told = (
                f"ADD-S {1e3 * one.scores.add_s:.1f} mm, {one.scores.degrees:.0f}°, {1e3 * one.scores.place:.1f} mm off"
            )
            placed = mesh.moved(rotation=one.transform[:3, :3], translation=one.transform[:3, 3])
            yield worst_scene(number, one, told, "the mesh where it was found", [placed], {})


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Several meshes as one: their vertices and faces one after the other."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return TriangleMesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )


class _Key:
    """A scene whose object's shape is read once: those of the same files are the same."""

    def __init__(self, scene: SceneSource):
        self.scene, paths = scene, scene.shape_paths(HIGH)
        self.files = paths, tuple(file_version(path.stat()) for path in paths if path.exists())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.files == other.files

    def __hash__(self) -> int:
        return hash(self.files)


class _Known(NamedTuple):
    """An object's mesh.

    Attributes
    ----------
    upright : as it stands in the catalogue
    mesh : as it is handed over, turned at random
    turn : (3, 3) from the one to the other
    symmetry : of `mesh`
    """

    upright: TriangleMesh
    mesh: TriangleMesh
    turn: np.ndarray
    symmetry: Symmetry


@lru_cache(maxsize=100)
def _known(key: _Key) -> _Known:
    scene = key.scene
    world = joined(scene.read_shape(HIGH))
    upright = world.moved(translation=-world.bounds.mean(axis=0))
    upright = upright.moved(rotation=rotation_from_euler_deg(scene.angles).T)
    turn = _any_turn(np.random.default_rng(zlib.crc32(scene.object.encode())))
    mesh = upright.moved(rotation=turn)
    return _Known(upright, mesh, turn, symmetries(mesh))


def _nearest_size(points: np.ndarray, meshes: Mapping[str, TriangleMesh]) -> str:
    """The mesh whose diagonal is nearest to that of the box around most of the points, as a ratio."""
    lower, upper = np.quantile(points, [0.05, 0.95], axis=0)
    seen = np.log(np.linalg.norm(upper - lower))
    return min(meshes, key=lambda name: abs(np.log(np.linalg.norm(meshes[name].extent)) - seen))


def _any_turn(random: np.random.Generator) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(random.normal(size=4)).as_matrix()


def _turned(rotation: np.ndarray) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = rotation
    return made


def _blind(found: Located, ours: Pose, mesh: TriangleMesh, handed: np.ndarray) -> Pose:
    """The object upright, its middle at the strongest point."""
    place = found.points.points[int(np.argmax(found.points.power))]
    middle = mesh.moved(rotation=handed.T).bounds.mean(axis=0)
    return Pose(
        name=ours.name, rotation=handed.T, translation=place - middle, middle=ours.middle, covariance=ours.covariance,
        free_axes=ours.free_axes, score=0.0, explained=0.0, shown=0.0,
    )  # fmt: skip


def _summary(rows: Sequence[PoseTrial], sight: str, data: str) -> Table:
    body = []
    for method in POSES:
        trials = [one for one in rows if one.sight == sight and one.method == method]
        medians = []
        for name, scale in (("add", 1e3), ("add_s", 1e3), ("degrees", 1), ("place", 1e3)):
            values = [scale * getattr(one.scores, name) for one in trials]
            low, high = bootstrap_interval(values)
            medians.append(f"{np.median(values):.1f} ({low:.1f} to {high:.1f})")
        shares = [
            _share([one.success for one in trials]),
            _share([one.scores.add_s <= _NEAR for one in trials]),
            _share([one.scores.covered for one in trials]) if method == OURS else None,
            _share([one.answer == one.object for one in trials]) if all(one.answer for one in trials) else None,
            _share([one.answer == NONE_OF_THEM for one in trials]) if method == OURS and trials[0].answer else None,
            f"{np.median([one.seconds for one in trials]):.1f}" if method == OURS else None,
        ]
        body.append([method, len(trials), *medians, *shares])
    return table_of(
        f"{SIGHTS[sight].capitalize()}: medians over scenes (95 % bootstrap interval), shares (95 % Wilson interval), "
        f"{data}",
        [
            "method", "scenes", "ADD [mm]", "ADD-S [mm]", "turn [°]", "place [mm]", "within 1 cm and 10° [%]",
            "ADD-S within 1 cm [%]", f"truth in the {100 * LEVEL:.0f} % region [%]", "right object [%]",
            f"{NONE_OF_THEM!r} [%]", "processor time [s]",
        ],
        body,
        "Of turns that look the same, the nearest counts, but for ADD-S, which asks for no identity. Right object: the "
        "most probable of all of the dataset's; of the baseline, the one whose size is nearest to that of what was "
        "seen. Processor time of all cores together: points and pose of one mesh.",
        place="summary",
    )  # fmt: skip


def _share(right: Sequence[bool]) -> str:
    low, high = wilson_interval(sum(right), len(right))
    return f"{100 * sum(right) / len(right):.0f} ({100 * low:.0f} to {100 * high:.0f})"
