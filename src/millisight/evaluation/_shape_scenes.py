"""Scenes of the virtual rig with captures of objects of known shape: what the tasks "surface" and "pose" share."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from millisight.core import check_known, checked_integer, checked_number
from millisight.core.errors import InputError
from millisight.data import PointCloud, TriangleMesh
from millisight.evaluation._scenes import HIGH, SIGHTS
from millisight.evaluation._sources import EvaluationData, SceneSource
from millisight.evaluation._task import EvaluationItem, EvaluationSet, ReportFigure
from millisight.imaging import CLUTTER

_DRAWN = 1500  # points that a result keeps for its picture


class ShapeTrial(Protocol):
    """What a picture of a trial needs of it."""

    @property
    def scene(self) -> str: ...
    @property
    def object(self) -> str: ...
    @property
    def sight(self) -> str: ...
    @property
    def points(self) -> np.ndarray: ...


def check_shape_settings(spacing: Sequence[float], clutter: str, failures: int, support: float | None) -> None:
    """Raises InputError, UnknownNameError."""
    check_known("clutter", clutter, CLUTTER)
    for one in spacing:
        checked_number(one, name="spacing", unit="m", above=0)
    checked_integer(failures, name="failures", minimum=0)
    if support is not None:
        checked_number(support, name="support", unit="m")


def scenes_of_shapes(data: EvaluationData) -> list[SceneSource]:
    """Those with a 77 GHz capture and a known shape.

    Raises
    ------
    InputError
        There is none.
    """
    found = [scene for scene in data.scenes if scene.shape_paths(HIGH)]
    if not found:
        raise InputError(
            f"{data.path} holds no 77 GHz capture of an object of known shape; expected scenes of the virtual rig "
            'made with keep = "captures" or "raw": see `millisight generate`'
        )
    return found


def plan_of_shapes(
    data: EvaluationData,
    scenes: Sequence[SceneSource],
    source_of: Callable[[SceneSource], Any],
    settings: Mapping[str, Any],
    asked: Callable[[SceneSource], Iterable[SceneSource]] = lambda _: (),
) -> EvaluationSet:
    """One item for each of the `scenes`; its result depends on `settings`, and on the shapes of the scenes `asked`."""

    def paths_of(scene: SceneSource) -> tuple[Path, ...]:
        shapes = (path for one in asked(scene) for path in one.shape_paths(HIGH)[1:])
        return tuple(dict.fromkeys((*scene.paths, *scene.shape_paths(HIGH), *shapes)))

    items = tuple(
        EvaluationItem(
            name=scene.name,
            source=source_of(scene),
            parts={scene.name.replace("/", "."): dict(settings)},
            paths=paths_of(scene),
        )
        for scene in scenes
    )
    without = [scene.name for scene in data.scenes if not scene.shape_paths(HIGH)]
    notes = (f"{len(without)} scenes have no capture or no known shape; the first is {without[0]}",) if without else ()
    told = f"{data.path.resolve().name} (virtual rig; simulated, not real data)"
    return EvaluationSet(items=items, data=told, notes=notes)


def drawn_points(points: np.ndarray) -> list[list[float]]:
    """Some of the points (n, 3), for a picture [m]."""
    return np.round(points[:: max(1, -(-len(points) // _DRAWN))], 5).tolist()


def worst_scene(
    number: int, trial: ShapeTrial, told: str, grey: str, truth: Sequence[TriangleMesh], facts: Mapping[str, Any]
) -> ReportFigure:
    """The picture of one of the worst scenes: its points over the meshes `truth`, which are `grey`."""
    what = f"{trial.object}, {SIGHTS[trial.sight]}"
    return ReportFigure(
        name=f"worst-{number:02d}",
        heading=what,
        caption=f"{told}. Grey: {grey}.",
        plot="plot_points",
        arguments={"cloud": PointCloud(points=trial.points), "truth": truth, "title": f"{what}: {told}"},
        facts={"scene": trial.scene, **facts},
        dpi=90,
    )
