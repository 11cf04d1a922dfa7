"""The scenes of a dataset, found by names alone, and the dataset as tasks of `ms.evaluate` see it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from millisight.core import check_known, record
from millisight.datasets._dataset import Dataset, Experiment, Item
from millisight.datasets._origins import origins
from millisight.datasets._published import SplitImage, published_experiment, published_split
from millisight.datasets._scenes import BANDS, SceneFiles, SimulationFiles
from millisight.evaluation import HIGH, PUBLISHED, Origin, TestSplit
from millisight.io import mito
from millisight.meshes import object_name


@record
class DatasetFiles:
    """A dataset as tasks of `ms.evaluate` see it.

    Attributes
    ----------
    dataset : Dataset
    scenes : those to be evaluated
    notes : what is to be said of them
    empties : scenes with no object, of which there are 77 GHz images
    """

    dataset: Dataset
    scenes: tuple[SceneFiles, ...]
    empties: tuple[SceneFiles, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """Of the dataset."""
        return self.dataset.root

    def origins(self) -> dict[str, Origin]:
        """Where the scenes come from."""
        return origins(self.dataset, self.scenes)

    def split(self, name: str) -> TestSplit:
        """A published split, with the catalogue's names of objects.

        Raises
        ------
        UnknownNameError
        """
        found = published_split("" if name == PUBLISHED else name)

        def objects(images: tuple[SplitImage, ...]) -> frozenset[str]:
            return frozenset(map(object_name, {one.folder for one in images}))

        return TestSplit(
            name=found.name,
            test=frozenset((one.folder, one.experiment, one.sight) for one in found.test if not one.simulated),
            classes=found.classes,
            training=objects(found.training),
            validation=objects(found.validation),
        )

    def simulations(self, band: str) -> dict[tuple[str, tuple[int, int, int]], SimulationFiles]:
        """Simulated images of a band, by folder and angles of the object; where there are both parts."""
        found = {}
        for one in (part for entry in self.dataset.objects for part in entry.simulations):
            images = [item for item in one.items if (item.kind, item.radar) == (mito.IMAGE, BANDS[band])]
            items = {(band, item.ext[1:]): item for item in images if item.ext in ("_specular", "_edges")}
            if len(items) == 2:
                published = published_experiment(one.object, 1)
                found[one.object, one.angles] = SimulationFiles(items=items, published=published)
        return found


def find_scenes(
    dataset: Dataset, *, sight: str | None = None, experiment: int | None = None, within: Dataset | None = None
) -> tuple[SceneFiles, ...]:
    """The scenes of a dataset that have radar images, by names alone.

    Parameters
    ----------
    dataset : Dataset
    sight : those of this sight alone
    experiment : those of this number alone
    within : the dataset that holds the empty scenes; None: this one

    Returns
    -------
    SceneFiles. Out of sight the camera's mask is that of the same experiment in line of sight; of simulated ones, where
    the object was not moved between experiments, also that of the first of the object so turned.

    Raises
    ------
    UnknownNameError
        No such sight.
    """
    if sight is not None:
        check_known("sight", sight, mito.SIGHTS)
    found = []
    empties = _empty_images(dataset if within is None else within)
    for one in dataset.objects:
        if one.role == "object":
            name = object_name(one.folder.name)
            found += [_files(each, name, one.experiments, empties) for each in one.experiments]
    return tuple(
        files for files in found if files.images and sight in (None, files.sight) and experiment in (None, files.number)
    )


def find_empties(dataset: Dataset) -> tuple[SceneFiles, ...]:
    """The scenes with no object, which test what finds objects: empty cartons. Published ones have no 77 GHz image."""
    found = [
        replace(_files(each, one.folder.name, one.experiments, {}), hollow=True)
        for one in dataset.objects
        if one.role == "empty"
        for each in one.experiments
    ]
    return tuple(files for files in found if HIGH in files.images)


def _empty_images(dataset: Dataset) -> dict[tuple[str, int], Item]:
    """24 GHz images of empty scenes, by their id and the experiment's number."""
    return {
        (one.id, experiment.number): item
        for one in dataset.objects
        if one.role == "empty"
        for experiment in one.experiments
        for item in experiment.items
        if (item.kind, item.radar, item.ext) == (mito.IMAGE, "24_ghz", "")
    }


def _files(
    experiment: Experiment, name: str, others: tuple[Experiment, ...], empties: Mapping[tuple[str, int], Item]
) -> SceneFiles:
    angles = "_".join(map(str, experiment.angles))
    open_view = [e for e in others if e.sight == "los" and e.angles == experiment.angles]
    open_view.sort(key=lambda e: (e.number != experiment.number, e.number))
    masks = [(item, e.number) for e in open_view for item in e.items if item.kind == mito.CAMERA_MASK]
    camera_mask, camera_number = masks[0] if masks else (None, experiment.number)

    def by_band(kind: str) -> dict[str, Item]:
        items = {item.radar: item for item in experiment.items if item.kind == kind and item.ext == ""}
        return {band: items[radar] for band, radar in BANDS.items() if radar in items}

    def first(kind: str) -> Item | None:
        return next((item for item in experiment.items if item.kind == kind), None)

    images, published = by_band(mito.IMAGE), published_experiment(experiment.object, experiment.number)
    empty = "" if published is None else published.empty.get(experiment.sight, "")
    logs = [item for item in experiment.items if item.kind in (mito.RAW, mito.LOG) and item.radar == BANDS[HIGH]]
    return SceneFiles(
        name=f"{experiment.object}/{angles}/exp{experiment.number}/{experiment.sight}",
        object=name,
        folder=experiment.object,
        angles=experiment.angles,
        number=experiment.number,
        sight=experiment.sight,
        images=images,
        masks=by_band(mito.RADAR_MASK),
        camera_mask=camera_mask,
        camera_number=camera_number,
        frame=first(mito.CAMERA_FRAME),
        info=first(mito.INFO),
        turns=(*([images[HIGH]] if HIGH in images else []), *logs),
        published=published,
        empty=empties.get((empty, experiment.number)),
    )
