"""Examples for the released network from the published dataset: the simulated images of the authors' split."""

import numpy as np

from millisight.core import printable
from millisight.core.errors import InputError
from millisight.data import Mask, SarImage
from millisight.datasets._dataset import Dataset, Simulation, expect
from millisight.datasets._published import SIMULATED, published_experiment, published_split
from millisight.datasets._scenes import cropped_as_published
from millisight.evaluation import LOW
from millisight.perception.classification import RELEASED_CLASSES, published_scale
from millisight.perception.training import ReleasedExample

_PARTS = ("_specular", "_edges")


def released_examples(dataset: Dataset, *, split: str = "") -> list[ReleasedExample]:
    """Simulated 77 GHz images of a split's training objects, in their masks, as far as the dataset holds them.

    Parameters
    ----------
    dataset : Dataset
    split : name of a published split; "": the newest

    Raises
    ------
    InputError
        The dataset holds none.
    FileError, FormatError, DamagedFileError, UnknownNameError
    """
    chosen = published_split(split)
    found = []
    for one in dataset.objects:
        shape, published = chosen.classes.get(one.folder.name, ""), published_experiment(one.folder.name, 1)
        if shape not in RELEASED_CLASSES or published is None or SIMULATED not in published.available:
            continue
        for simulation in one.simulations:
            if _whole(simulation):
                specular, edges = (_masked(simulation, ext) for ext in _PARTS)
                found.append(ReleasedExample(specular, edges, RELEASED_CLASSES.index(shape)))
    if not found:
        raise InputError(
            f"{printable(dataset.root)} holds no simulated image of a training object with its mask; expected "
            "processed_image_specular, processed_image_edges and radar_masks of both"
        )
    return found


def _whole(simulation: Simulation) -> bool:
    kinds = {(item.kind, item.ext) for item in simulation.items if item.radar == "77_ghz"}
    return {(kind, ext) for kind in ("image", "radar mask") for ext in _PARTS} <= kinds


def _masked(simulation: Simulation, ext: str) -> np.ndarray:
    """(A, B) mean of |I| along z in the published scale, 0 outside the mask."""
    item = simulation.item("image", radar="77_ghz", ext=ext)
    image: SarImage = expect(item.read(), SarImage, item)
    mask: Mask = simulation.mask(ext=ext)
    image = cropped_as_published(image, LOW, published_experiment(simulation.object, 1))
    scale = published_scale(image)
    seen = image.magnitude.mean(axis=2) * mask.inside
    return seen * ((1 / max(seen.max(), 1e-30)) if scale is None else scale)
