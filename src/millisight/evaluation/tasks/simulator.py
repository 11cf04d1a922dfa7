"""The task "simulator": 3D F-scores of simulated images against measured ones (paper Table 1)."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from millisight.core import check_known, check_writable, checked_integer, make_folder, put, record, write_text
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import PointCloud, SarImage
from millisight.evaluation._point_cloud import FScore
from millisight.evaluation._scenes import LOW, SIGHTS
from millisight.evaluation._simulator import (
    CloudSettings,
    SimulatorComparison,
    WeightTrial,
    aligned,
    compare,
    sensitivity,
)
from millisight.evaluation._sources import EvaluationData, SceneSource, SimulationSource
from millisight.evaluation._tables import Table
from millisight.evaluation._task import TASKS, EvaluationItem, EvaluationSet, ReportFigure, Task
from millisight.evaluation.tasks._simulator_tables import (
    DISTANCES,
    THRESHOLDS,
    ImagePair,
    all_tables,
    data_of,
    fitted_toml,
)
from millisight.imaging import combine
from millisight.io import CLOUD_SUFFIXES, write_point_cloud
from millisight.io.mito import checked_radar
from millisight.perception import HIGH_BAND, LOW_BAND, without_sheets

_FORMAT = 1


class _PairSource(NamedTuple):
    """A measured image, and the simulated ones of the object at the same angles."""

    scene: SceneSource
    simulation: SimulationSource
    band: str
    settings: CloudSettings
    crop: tuple[int, int] | None
    clutter: str

    def measured(self) -> tuple[SarImage, str]:
        """The measured image without the slices and the sheets that are left out, and what made it."""
        image, made_by = self.scene.read_image(self.band, crop=self.crop)
        if self.clutter == "none":
            return image, made_by
        return without_sheets(image, frequency=LOW_BAND if self.band == LOW else HIGH_BAND), made_by

    def clouds(self, weights: tuple[float, float]) -> tuple[SarImage, SarImage, np.ndarray, np.ndarray]:
        """Measured and combined image, and their points, the latter moved onto the former [m]."""
        measured = self.measured()[0]
        parts = [self.simulation.read_image(self.band, part)[0] for part in ("specular", "edges")]
        combined = combine(parts[0], parts[1], weights)
        clouds = [self.settings.cloud(image) for image in (measured, combined)]
        try:
            moved = aligned(clouds[1], clouds[0], self.settings.mode).apply(clouds[1].points)
        except InputError:  # too few points: shown where they are
            moved = clouds[1].points
        return measured, combined, clouds[0].points, moved


@TASKS.add("simulator")
@record
class SimulatorTask(Task):
    """Compare simulated with measured images: points of both, aligned, by their F-score.

    Attributes
    ----------
    simulated : dataset with the simulated images; None: the same
    radar : "77_ghz" or "24_ghz"
    flat : whether to compare means along z; None: at 24 GHz, which does not resolve depth
    threshold : tau_P, a share of the image's maximum; `absolute`: in the unit of the images
    absolute : what `threshold` is
    within : tau_F: points nearer than this match [m]
    mode : of the alignment, "translation" or "rigid"
    crop : number of the lowest and of the highest slices of measured 77 GHz images to leave out; None: as published of
        the published dataset, and none of others
    clutter : "lid" to take sheets off the measured images (`remove_sheets`) before they are compared; "none"
    fit : TOML file for the weights that fit each object best; None: none
    clouds : "ply" or "pcd", to write the compared clouds; None: not
    pictures : number of best and worst pairs to plot
    """

    name: ClassVar[str] = "simulator"
    title: ClassVar[str] = "Simulated and measured images compared"
    cache: ClassVar[str] = "pairs"
    datasets: ClassVar[tuple[str, ...]] = ("simulated",)

    simulated: EvaluationData | None = None
    radar: str = "77_ghz"
    flat: bool | None = None
    threshold: float = 0.3
    absolute: bool = False
    within: float = 0.01
    mode: str = "translation"
    crop: tuple[int, int] | None = None
    clutter: str = "none"
    fit: Path | str | None = None
    clouds: str | None = None
    pictures: int = 3

    def __post_init__(self) -> None:
        if self.clouds is not None and f".{self.clouds.lstrip('.')}" not in CLOUD_SUFFIXES:
            raise UnknownNameError("point cloud format", self.clouds, CLOUD_SUFFIXES)
        checked_integer(self.pictures, name="pictures", minimum=0)
        check_known("kind of clutter", self.clutter, ("lid", "none"))
        put(self, radar=checked_radar(self.radar))
        if self.crop is not None:
            put(self, crop=tuple(self.crop))
        _ = self.settings  # checks the rest

    @property
    def settings(self) -> CloudSettings:
        """How clouds are made, aligned and compared."""
        flat = self.radar == "24_ghz" if self.flat is None else self.flat
        return CloudSettings(
            threshold=self.threshold, relative=not self.absolute, within=self.within, mode=self.mode, flat=flat
        )

    def plan(self, data: EvaluationData) -> EvaluationSet:
        """One item for each measured image that has simulated ones."""
        against = data if self.simulated is None else self.simulated
        band = self.radar.replace("_ghz", " GHz")
        simulations = against.simulations(band)
        settings = self.settings
        plain = {"format": _FORMAT, "threshold": settings.threshold, "relative": settings.relative,
                 "within": settings.within, "mode": settings.mode, "flat": settings.flat, "weights": settings.weights,
                 "band": band, "crop": self.crop, "clutter": self.clutter,
                 "thresholds": THRESHOLDS, "distances": DISTANCES}  # fmt: skip
        items, alone, otherwise = [], [], []
        for scene in data.scenes:
            if band not in scene.bands:
                continue
            simulation = simulations.get((scene.folder, scene.angles))
            if simulation is None and (pair := _turned_alike(scene, simulations)) is not None:
                simulation = simulations[pair]
                otherwise.append(scene.name)
            if simulation is None:
                alone.append(scene.name)
                continue
            items.append(
                EvaluationItem(
                    name=scene.name,
                    source=_PairSource(scene, simulation, band, settings, self.crop, self.clutter),
                    parts={scene.name.replace("/", "."): plain},
                    paths=(*scene.paths, *simulation.paths),
                )
            )
        if not items:
            raise InputError(self._nothing(data.path, against.path, alone))
        if self.fit is not None:
            check_writable(self.fit)
        notes = tuple(f"{name}: no simulated images of this object at the same angles" for name in alone)
        if otherwise:
            notes += (
                f"{len(otherwise)} images are compared with simulated ones in a folder of other angles, as published: "
                f"the meshes were turned as the objects lay; the first is {otherwise[0]}",
            )
        names = (data.path.resolve().name, against.path.resolve().name)
        return EvaluationSet(items=tuple(items), notes=notes, context=names)

    def _nothing(self, measured: Path, simulated: Path, alone: list[str]) -> str:
        """Why there is no pair."""
        if alone:
            return (
                f"no pairs: {simulated} holds no {self.radar} processed_image_specular and processed_image_edges of "
                f"the {len(alone)} measured images in {measured}, of the same object and angles; the first is "
                f"{alone[0]}"
            )
        return (
            f"no pairs: {measured} holds no {self.radar} image of an object; expected processed_image.pkl of "
            "experiments under robot_collected"
        )

    @staticmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """Compare one pair."""
        source: _PairSource = item.source
        scene, settings = source.scene, source.settings
        measured, measured_by = source.measured()
        specular, simulated_by = source.simulation.read_image(source.band, "specular")
        edge, _ = source.simulation.read_image(source.band, "edges")
        comparison = compare(measured, specular, edge, settings)
        surface = None
        if settings.relative:
            best = combine(specular, edge, comparison.best.weights)
            surface = sensitivity(measured, best, settings, thresholds=THRESHOLDS, distances=DISTANCES).tolist()
        (part,) = item.parts
        return {
            part: {
                "object": scene.folder,
                "pose": "_".join(map(str, scene.angles)),
                "number": scene.number,
                "sight": scene.sight,
                "comparison": {"points": comparison.points, "trials": [one._asdict() for one in comparison.trials]},
                "sensitivity": surface,
                "measured_by": measured_by,
                "simulated_by": simulated_by,
            }
        }

    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> list[ImagePair]:
        """By sight, object, pose and experiment."""
        pairs = []
        for one in results.values():
            trials = tuple(
                WeightTrial(
                    **trial | {"weights": tuple(trial["weights"]), "score": FScore(*map(float, trial["score"]))}
                )
                for trial in one["comparison"]["trials"]
            )
            comparison = SimulatorComparison(one["comparison"]["points"], trials)
            surface = None if one["sensitivity"] is None else np.array(one["sensitivity"])
            pairs.append(ImagePair(**one | {"comparison": comparison, "sensitivity": surface}))
        return sorted(pairs, key=lambda pair: (pair.sight, pair.object, pair.pose, pair.number))

    def describe(self, planned: EvaluationSet, rows: Sequence[ImagePair]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""
        measured, simulated = planned.context
        data = data_of(measured, simulated, rows)
        return data, f"Compared: {data}."

    def tables(self, planned: EvaluationSet, rows: Sequence[ImagePair]) -> dict[str, Table]:
        """Quartiles, classes, weights held out, and every pair."""
        data, _ = self.describe(planned, rows)
        return all_tables(rows, data=data, settings=self.settings, radar=self.radar)

    def figures(self, planned: EvaluationSet, rows: Sequence[ImagePair]) -> Iterator[ReportFigure]:
        """The scores, their sensitivity to the thresholds, and the best and the worst pairs."""
        yield ReportFigure(
            name="scores",
            heading="Scores",
            caption="F-scores of all pairs, sorted. Farther right is better.",
            plot="plot_scores",
            arguments={"pairs": rows},
        )
        if all(pair.sensitivity is not None for pair in rows):
            yield ReportFigure(
                name="sensitivity",
                heading="Sensitivity to tau_P and tau_F",
                caption="Scores for other thresholds. The weights were fitted at the framed thresholds; the point "
                "clouds are aligned again for each tau_P.",
                plot="plot_sensitivity",
                arguments={
                    "pairs": rows,
                    "settings": self.settings,
                    "title": "Median F [%] of the best combination",
                },
            )
        ranked = sorted(rows, key=lambda pair: -pair.comparison.best.score.f)
        count = min(self.pictures, (len(ranked) + 1) // 2)
        shown = [("best", pair) for pair in ranked[:count]] + [("worst", pair) for pair in ranked[::-1][:count]]
        sources = _sources(planned)
        for number, (kind, pair) in enumerate(shown, 1):
            score, (a1, a2) = pair.comparison.best.score, pair.comparison.best.weights
            heading = (
                f"{pair.object}, {SIGHTS[pair.sight]}: F {100 * score.f:.0f} %, precision "
                f"{100 * score.precision:.0f} %, recall {100 * score.recall:.0f} %, weights {a1:.2f} and {a2:.2f}"
            )
            images = ("measured", "simulated", "measured_points", "simulated_points")
            found = sources[pair.key].clouds(pair.comparison.best.weights)
            notes = pair.comparison.notes
            yield ReportFigure(
                name=f"{kind}-{number:02d}",
                heading=heading,
                caption=f"One of the {kind} pairs. Each image is relative to its own maximum.",
                plot="plot_pair",
                arguments={**dict(zip(images, found, strict=True)), "title": heading},
                facts={"notes": "; ".join(notes)} if notes else {},
                dpi=90,
            )

    def write_files(self, planned: EvaluationSet, rows: Sequence[ImagePair], folder: Path) -> None:
        """The fitted weights and the compared clouds, where they were asked for."""
        if self.fit is not None:
            write_text(self.fit, fitted_toml(rows, data=self.describe(planned, rows)[0]))
        if self.clouds is None:
            return
        suffix, place, sources = self.clouds.lstrip("."), make_folder(folder / "clouds"), _sources(planned)
        for pair in rows:
            *_, there, moved = sources[pair.key].clouds(pair.comparison.best.weights)
            stem = "-".join(map(str, pair.key))
            write_point_cloud(place / f"{stem}-measured.{suffix}", PointCloud(points=there))
            write_point_cloud(place / f"{stem}-simulated.{suffix}", PointCloud(points=moved))


def _turned_alike(
    scene: SceneSource, simulations: Mapping[tuple[str, tuple[int, int, int]], SimulationSource]
) -> tuple[str, tuple[int, int, int]] | None:
    """Which simulation at other angles is of a measured object: that at 0_0_0, as published, or the only one."""
    there = [key for key in simulations if key[0] == scene.folder]
    found = [key for key in there if key[1] == (0, 0, 0)] or (there if len(there) == 1 else [])
    return found[0] if found and not scene.physics() else None


def _sources(planned: EvaluationSet) -> dict[tuple[str, str, int, str], _PairSource]:
    """By the key of the pair."""
    scenes = ((item.source.scene, item.source) for item in planned.items)
    return {(one.folder, "_".join(map(str, one.angles)), one.number, one.sight): source for one, source in scenes}
