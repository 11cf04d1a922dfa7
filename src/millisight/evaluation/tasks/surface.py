"""The task "surface": oriented points of captures against the true surface of objects of known shape."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from millisight.core import record
from millisight.core.errors import InputError
from millisight.data import Capture, PointCloud, SarImage, VoxelGrid
from millisight.evaluation._point_cloud import point_cloud
from millisight.evaluation._scenes import HIGH, SIGHTS
from millisight.evaluation._shape_scenes import (
    check_shape_settings,
    drawn_points,
    plan_of_shapes,
    scenes_of_shapes,
    worst_scene,
)
from millisight.evaluation._sources import EvaluationData, SceneSource
from millisight.evaluation._statistics import bootstrap_interval
from millisight.evaluation._surface_truth import SurfaceScores, score_surface, true_surface
from millisight.evaluation._tables import Table, table_of
from millisight.evaluation._task import TASKS, EvaluationItem, EvaluationSet, ReportFigure, Task
from millisight.geometry import (
    FALSE_ALARMS,
    LEAST_POINTS,
    channel_middles,
    checked_false_alarms,
    complete,
    surface,
    surface_points,
)
from millisight.imaging import form_image, remove_sheets

_FORMAT = 2
_MARGIN = 0.02  # of the voxels around the object [m]
_THRESHOLD = 0.3  # of the baselines, a share of the image's maximum: as in the evaluation of the simulator
OURS, COMPLETED, THRESHOLDED, DEEPEST = "surface_points", "and guessed", "thresholded voxels", "maximum along z"
METHODS = (OURS, COMPLETED, THRESHOLDED, DEEPEST)
"""What is compared: `surface_points`; these and what `complete` guesses of what was not seen; the paper's points,
voxels above 0.3 of the maximum; and of each column of voxels
that one where |I| is largest, if it is above 0.3 of the maximum."""


@record
class SurfaceTrial:
    """The scores of one method on one scene.

    Attributes
    ----------
    scene, object, sight : of the scene
    metal : whether most of the object's surface is metal
    method : one of METHODS
    scores : SurfaceScores
    points : (n, 3) some of the points, for a picture [m]
    """

    scene: str
    object: str
    sight: str
    metal: bool
    method: str
    scores: SurfaceScores
    points: np.ndarray


class _Source(NamedTuple):
    scene: SceneSource
    spacing: tuple[float, float, float]
    clutter: Mapping[str, str]
    false_alarms: float
    support: float | None


@TASKS.add("surface")
@record
class SurfaceTask(Task):
    """Compare oriented points with the true surface: simulated captures alone, whose objects' shapes are known.

    Attributes
    ----------
    spacing : of the voxels along x and y, and along z [m]
    clutter : taken off the captures out of sight: "auto", "lid" or "none"; those in line of sight are left as they are
    false_alarms : see `surface_points`
    failures : number of worst scenes to plot
    support : see `surface_points`; of all scenes [m]. The baselines are not told
    """

    name: ClassVar[str] = "surface"
    title: ClassVar[str] = "Surfaces"
    cache: ClassVar[str] = "surfaces"

    spacing: tuple[float, float] = (0.002, 0.004)
    clutter: str = "lid"
    false_alarms: float = FALSE_ALARMS
    failures: int = 4
    support: float | None = None

    def __post_init__(self) -> None:
        check_shape_settings(self.spacing, self.clutter, self.failures, self.support)
        checked_false_alarms(self.false_alarms)

    def plan(self, data: EvaluationData) -> EvaluationSet:
        """One item for each scene with a 77 GHz capture and a known shape."""
        across, deep = self.spacing
        clutter = {"los": "none", "nlos": self.clutter}
        settings = {"format": _FORMAT, "spacing": [across, deep], "clutter": clutter, "false_alarms": self.false_alarms}
        if self.support is not None:
            settings["support"] = self.support

        def source_of(scene: SceneSource) -> _Source:
            return _Source(scene, (across, across, deep), clutter, self.false_alarms, self.support)

        return plan_of_shapes(data, scenes_of_shapes(data), source_of, settings)

    @staticmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """All methods on one scene."""
        source: _Source = item.source
        scene = source.scene
        capture, meshes = scene.read_capture(HIGH), scene.read_shape(HIGH)
        bounds = np.array([mesh.bounds for mesh in meshes])
        lower, upper = bounds[:, 0].min(axis=0) - _MARGIN, bounds[:, 1].max(axis=0) + _MARGIN
        grid = VoxelGrid.regular(lower, upper, source.spacing)
        truth = true_surface(meshes, capture)
        capture = remove_sheets(capture, clutter=source.clutter[scene.sight], grid=grid).result
        points = surface_points(capture, grid, false_alarms=source.false_alarms, support=source.support)
        found = {OURS: points, COMPLETED: _with_guesses(points, capture)}
        image = form_image(capture, grid)
        found[THRESHOLDED], found[DEEPEST] = point_cloud(image, _THRESHOLD), _deepest(image)
        metal = scene.metal(HIGH)
        (part,) = item.parts
        return {
            part: [
                {
                    "scene": scene.name, "object": scene.object, "sight": scene.sight, "metal": metal, "method": method,
                    "scores": [_known(one) for one in score_surface(cloud, truth)],
                    "points": drawn_points(cloud.points),
                }
                for method, cloud in found.items()
            ]
        }  # fmt: skip

    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> list[SurfaceTrial]:
        """By scene and method."""
        return [
            SurfaceTrial(**one | {
                "scores": _scores(one["scores"]),
                "points": np.array(one["points"]).reshape(-1, 3),
            })
            for trials in results.values() for one in trials
        ]  # fmt: skip

    def describe(self, planned: EvaluationSet, rows: Sequence[SurfaceTrial]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""
        return planned.data, (
            f"Points on surfaces, of {planned.data}. Compared with all of the object's surface that some antenna sees, "
            "and with the part of it that shines: whose normal meets the aperture. The pictures show the worst scenes."
        )

    def tables(self, planned: EvaluationSet, rows: Sequence[SurfaceTrial]) -> dict[str, Table]:
        """Medians of each sight, and every scene."""
        there = [sight for sight in SIGHTS if any(one.sight == sight for one in rows)]
        return {
            **{sight: _medians(rows, sight, planned.data) for sight in there},
            **{f"{sight}-by-material": _by_material(rows, sight, planned.data) for sight in there},
            "scenes": table_of(
                f"Every scene, {planned.data}",
                ["scene", "metal", "method", *SurfaceScores._fields],
                [(one.scene, "yes" if one.metal else "no", one.method, *map(_known, one.scores)) for one in rows],
                place="file",
            ),
        }

    def figures(self, planned: EvaluationSet, rows: Sequence[SurfaceTrial]) -> Iterator[ReportFigure]:
        """The worst scenes of `surface_points`."""
        sources = {item.source.scene.name: item.source.scene for item in planned.items}
        ours = sorted((one for one in rows if one.method == OURS), key=lambda one: one.scores.f)
        for number, one in enumerate(ours[: self.failures], 1):
            told = (
                f"F {100 * one.scores.f:.0f} %, precision {100 * one.scores.precision:.0f} %, recall "
                f"{100 * one.scores.recall:.0f} % within 10 mm"
            )
            truth = sources[one.scene].read_shape(HIGH)
            yield worst_scene(number, one, told, "the object", truth, {"points": one.scores.points})


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _scores(values: Sequence[float | None]) -> SurfaceScores:
    """The scores of what JSON holds, which has no NaN."""
    points, *rest = (math.nan if value is None else value for value in values)
    return SurfaceScores(int(points), *rest)


def _with_guesses(points: PointCloud, capture: Capture) -> PointCloud:
    """The points, and vertices of what is guessed of round things."""
    if len(points) < LEAST_POINTS:
        return points
    antennas = channel_middles(capture).reshape(-1, 3)
    try:
        made = complete(surface(points), points, antennas)
    except InputError:  # no points hang together
        return points
    count = made.metadata["seen_vertices"]
    if len(made.mesh.vertices) == count:
        return points
    return PointCloud(
        points=np.concatenate([points.points, made.mesh.vertices[count:]]),
        normals=np.concatenate([np.asarray(points.normals), made.mesh.vertex_normals[count:]]),
    )


def _deepest(image: SarImage) -> PointCloud:
    """Of each column of voxels the one with the largest |I|, if it is above the threshold."""
    magnitude = image.magnitude
    where = magnitude.argmax(axis=2)
    highest = magnitude.max(axis=2)
    i, j = np.nonzero(highest > _THRESHOLD * highest.max())
    points = np.stack([image.grid.x[i], image.grid.y[j], image.grid.z[where[i, j]]], axis=1)
    return PointCloud(points=points, magnitude=highest[i, j])


_COLUMNS = (
    ("F 10 mm", "f", 100), ("precision", "precision", 100), ("recall", "recall", 100), ("F 5 mm", "f_5mm", 100),
    ("F 10 mm, shining", "f_shining", 100), ("recall, shining", "recall_shining", 100),
    ("place [mm]", "place", 1000), ("normal [°]", "normal_deg", 1),
)  # fmt: skip
_HEAD = ["method", "scenes", *(f"{name} [%]" if scale == 100 else name for name, _, scale in _COLUMNS)]


def _cells(method: str, trials: Sequence[SurfaceTrial]) -> list[Any]:
    """A row of medians and their intervals."""
    cells: list[Any] = [method, len(trials)]
    for _, name, scale in _COLUMNS:
        values = [scale * value for one in trials if not math.isnan(value := getattr(one.scores, name))]
        if not values:
            cells.append(None)
            continue
        low, high = bootstrap_interval(values)
        cells.append(f"{np.median(values):.1f} ({low:.1f} to {high:.1f})")
    return cells


def _by_material(rows: Sequence[SurfaceTrial], sight: str, data: str) -> Table:
    body = []
    for metal, material in ((True, "metal"), (False, "plastics and other")):
        for method in METHODS:
            trials = [one for one in rows if (one.sight, one.method, one.metal) == (sight, method, metal)]
            if trials:
                body.append([material, *_cells(method, trials)])
    return table_of(
        f"{SIGHTS[sight].capitalize()}, by the material of most of the surface: medians over scenes (95 % bootstrap "
        f"interval), {data}",
        ["material", *_HEAD],
        body,
        place="page",
    )


def _medians(rows: Sequence[SurfaceTrial], sight: str, data: str) -> Table:
    body = [_cells(method, [one for one in rows if (one.sight, one.method) == (sight, method)]) for method in METHODS]
    return table_of(
        f"{SIGHTS[sight].capitalize()}: medians over scenes (95 % bootstrap interval), {data}",
        _HEAD,
        body,
        'Precision and recall within 10 mm, of all that some antenna sees of the object; "shining": recall of what '
        "reflects towards the aperture. Places and normals: median distance, and median angle of points within 10 mm.",
        "For comparison, real data of others, not these: mmNorm (Dodds et al., MobiSys 2025) states an F-score of 96 % "
        "against 78 % of the best method before.",
        place="summary",
    )
