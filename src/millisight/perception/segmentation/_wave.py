"""The segmenter "wave": a small network of our own, trained on simulated images alone, run by ONNX Runtime.

It looks at the image, not at its coloured picture: both bands where there are both, in slices along z. Prompts are not
needed; a user's points are taken into account. Its model card says what it learned from.
"""

import dataclasses
import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from millisight.core import SPEED_OF_LIGHT, check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.data import Picture, PixelGrid, Prompts, SarImage
from millisight.perception import (
    HIGH_BAND,
    SPACING,
    open_network,
    read_description,
    resampling_weights,
    run_network,
    weights_version,
    without_sheets,
)
from millisight.perception.segmentation._arms import arms_of
from millisight.perception.segmentation._borders import with_borders
from millisight.perception.segmentation._edges import shining
from millisight.perception.segmentation._ghosts import without_ghosts
from millisight.perception.segmentation._heights import (
    beneath,
    between,
    lid_over,
    pixel_sides,
    tells_depths,
    tells_height,
)
from millisight.perception.segmentation._parts import judged_apart, parts_of
from millisight.perception.segmentation._segmentation import SEGMENTERS, Candidates
from millisight.perception.segmentation._wave_input import WAVE_CHANNELS, channels_of, wave_input

WAVE_WEIGHTS = Path(__file__).with_name("weights") / "wave.onnx"
"""Shipped; its description lies beside it as .json."""
PRESENCE_WEIGHTS = WAVE_WEIGHTS.with_name("presence.onnx")
"""Of a second network of the same kind, which judges whether anything is there; shipped."""

_OBJECT_PIXELS = 16
_STEPS = (0.0, 0.15, -0.15, 0.3)  # from the description's cut: one mask each
_PARTING = (0.55, 0.7, 0.85)  # further ones, at which an object and its lid's edge may be apart
_SMALLEST_PART = 0.1  # of a mask, as a share of its largest part
_LEAST_AREA = 5e-5  # of what is left of a mask [m²]

_THERE = 0.24  # presence, by the second network, on average over the views of a covered scene; below, it is empty
_SURELY_THERE = 0.9  # the same, from which on something lies in a scene in sight, whatever the first network says
_VIEWS = 8  # rotations and reflections
# Unless the first network is so sure of what shines over so large an area, to so much of the mask's highest power: flat
# things pass for a floor or a stand, but a tripod's plate of 2 cm fills no more than 8 cm².
_SURE, _SURE_AREA, _SHINES = 0.8, 10.5e-4, 0.08  # mean probability, area [m²], share of the power


def presence(probability: np.ndarray) -> float:
    """How sure it is that there is an object at all: the mean of the 16 highest probabilities."""
    highest = np.sort(probability, axis=None)[-_OBJECT_PIXELS:]
    return float(highest.mean())


@SEGMENTERS.add("wave")
class WaveSegmenter:
    """Masks by the `wave` network.

    Parameters
    ----------
    weights : ONNX file as `millisight train segmenter` writes it, its description beside it; None: the shipped one
    presence : such a file of a second network, which judges whether a covered scene is empty, and in sight whether a
        flat top fills the image; None: the shipped one where the weights are the shipped ones, else `weights` alone
        decide

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    DamagedFileError, FormatError, FileError
        The weights are damaged, are no weights of this network, or cannot be read.
    """

    name = "wave"
    needs_prompts = False

    def __init__(
        self, weights: str | os.PathLike[str] | None = None, *, presence: str | os.PathLike[str] | None = None
    ):
        self.description, self._session = _network_of(WAVE_WEIGHTS if weights is None else weights)
        second = PRESENCE_WEIGHTS if weights is None and presence is None else presence
        self._judge: Any = None if second is None else _network_of(second)[1]

    def probability(self, picture: Picture, prompts: Prompts | None = None) -> np.ndarray:
        """(A, B) float32, how probable it is that the object lies over each pixel of the picture.

        Raises
        ------
        InputError
            The picture is a photo or blank, or the other band has no place in common with it.
        """
        channels, x, y = channels_of(picture, prompts)
        grid = cast("PixelGrid", picture.grid_xy)  # pictures that have none are refused
        inner = self._logits(channels)[: len(x), : len(y)]
        fine = resampling_weights(x, grid.x) @ inner @ resampling_weights(y, grid.y).T
        return 1 / (1 + np.exp(-fine))

    def empty(self, picture: Picture) -> bool:
        """Whether nothing lies in a covered scene, by all views of its image, with the other band and without it.

        It is the second network's word, which marks objects less well. In sight it takes a lone ball's glint for the
        floor's, and is not asked this; nor where an echo is long along z, as at 24 GHz alone.

        Raises
        ------
        InputError
            As `probability`.
        """
        if self._judge is None or not picture.covered or picture.image is None:
            return False
        cleaned = without_sheets(picture.image, frequency=HIGH_BAND, covered=True)
        if not tells_depths(picture.image, cleaned):
            return False
        # Where the other band takes a flat top for a sheet, the image alone may show it.
        alone = dataclasses.replace(picture, other_band=None)
        seen = (alone,) if picture.other_band is None else (alone, picture)
        return not any(self._judged_there(one, _THERE) for one in seen)

    def _judged_there(self, picture: Picture, least: float) -> bool:
        """Whether the second network's presence reaches so much, on average over the views of an image."""
        (channels, x, y), total = channels_of(picture, None), 0.0
        for mirrored in (False, True):
            for quarters in range(4):
                turned = np.rot90(channels[:, ::-1] if mirrored else channels, quarters, axes=(1, 2))
                logits = np.rot90(run_network(self._judge, np.ascontiguousarray(turned)[None])[0], -quarters)
                inner = (logits[::-1] if mirrored else logits)[: len(x), : len(y)]
                total += presence(1 / (1 + np.exp(-inner)))
                if total >= least * _VIEWS:  # whatever the others say
                    return True
        return False

    def _fills(self, picture: Picture) -> bool:
        """Whether the second network is sure of an object in sight: it knows flat tops that fill an image better."""
        alone = dataclasses.replace(picture, other_band=None)  # at 24 GHz they pass for sheets
        return self._judge is not None and not picture.covered and self._judged_there(alone, _SURELY_THERE)

    def canvas_mask(
        self,
        power: np.ndarray,
        other: np.ndarray | None,
        *,
        before: np.ndarray | None = None,
        taken_db: float = 0.0,
    ) -> np.ndarray:
        """(A, B) bool, its best mask on the canvas's own pixels, to train classifiers with; see `wave_input`.

        As `segment` makes it, but for what heights and the image's edges tell.
        """
        logits = self._logits(wave_input(power, other, before=before, taken_db=taken_db))
        probability = 1 / (1 + np.exp(-logits[: power.shape[0], : power.shape[1]]))
        cut = min(self.description["cut"], 0.9 * float(probability.max()))
        return _without_small_parts(probability > cut)

    def _logits(self, channels: np.ndarray) -> np.ndarray:
        """(A', B') of channels as of `wave_input`."""
        return run_network(self._session, channels[None])[0]

    def segment(self, picture: Picture, prompts: Prompts | None = None) -> Candidates:
        """Masks that begin at several probabilities, the one that did best on the validation scenes first.

        Parts that are ghosts of a scan's steps, or lie no higher than the picture's support, are left out. Of a scene
        that is known to be covered, parts that lie no lower than the lid or beside it are left out, too: what is left
        of the lid's edges, the walls below them, and grating lobes. Where an object and such an edge are one part,
        higher probabilities part them.

        Where an echo is short along z, as at 77 GHz, the borders of what is left then follow the image's edges and
        phases, see `with_borders`: balls and cylinders get their outlines. Where an image at 77 GHz shows too little
        above and below a thin thing to tell, they follow its edges alone. Arms that stick out are added, see
        `arms_of`. At 24 GHz the image is no finer than the network's pixels.

        Where nothing is found the only mask is empty: the mean of the 16 highest probabilities is less than that of
        99 % of the validation scenes with an object, with the other band and without it, and in sight the second
        network is not sure that something is there; or a covered scene is `empty`, nothing in it is round or flat, and
        what shines in the mask, to a twelfth of its highest power, is smaller than 10.5 cm² or its mean probability
        below 0.8.

        A mask's score is the intersection over union that the probabilities let expect of it; the first one's is at
        least as high as the others'.

        Raises
        ------
        InputError
            As `probability`.
        """
        nothing = Candidates(masks=np.zeros((1, *picture.shape), bool), scores=np.ones(1))
        probability = self.probability(picture, prompts)
        least = self.description.get("least", self.description["cut"])
        if presence(probability) < least and picture.other_band is not None:
            # A flat top that fills the image passes for a sheet, more often at 24 GHz, and is taken off there.
            probability = self.probability(dataclasses.replace(picture, other_band=None), prompts)
        if presence(probability) < least and (prompts is not None or not self._fills(picture)):
            return nothing
        cut = min(self.description["cut"], 0.9 * float(probability.max()))
        cuts = [cut, *(cut + step for step in _STEPS[1:] if 0.05 < cut + step < probability.max())]
        likely = [probability > c for c in cuts]
        image = cast("SarImage", picture.image)  # `probability` refuses pictures that have none
        cleaned = without_sheets(image, frequency=HIGH_BAND, covered=picture.covered)
        if picture.covered:
            further = [probability > c for c in _PARTING]
            placed = judged_apart(likely, further, lambda masks: _placed(masks, picture))
        else:
            placed = _placed(likely, picture)
        placed = [_without_small_parts(mask) for mask in placed]
        wide, shaped = placed[0], False
        heights = tells_height(wide, cleaned)
        # Around a thin thing an image may show too little above and below to tell heights; its edges are as fine.
        if heights or _is_fine(cleaned):
            placed, shaped = with_borders(placed, probability, cuts, cleaned, covered=picture.covered, heights=heights)
            placed = [_without_small_parts(mask) for mask in placed]
            arms = _placed(arms_of(placed, cleaned), picture)
            placed = [mask | arm for mask, arm in zip(placed, arms, strict=True)]
        masks = np.stack(placed)
        if not masks[0].any():
            return nothing
        asked = picture.covered and prompts is None and not shaped
        if asked and not _surely(wide, probability, cleaned) and self.empty(picture):
            return nothing
        scores = np.array([_expected_iou(mask, probability) for mask in masks])
        scores[0] = scores.max()
        order = np.argsort(-scores, kind="stable")
        return Candidates(masks=masks[order], scores=scores[order])


def _network_of(weights: str | os.PathLike[str]) -> tuple[dict[str, Any], Any]:
    """A network's description and session, which are kept until either of its files is written anew."""
    path = check_readable(weights)
    return _opened(path, weights_version(path))


@lru_cache(maxsize=4)
def _opened(path: Path, version: tuple[int, ...]) -> tuple[dict[str, Any], Any]:
    description = _read_description(path.with_suffix(".json"))
    return description, open_network(path, description["sha256"], needed_by="wave", channels=len(WAVE_CHANNELS))


def _is_fine(image: SarImage) -> bool:
    """Whether an image is known to be finer than the network's pixels, as at 77 GHz: half a wavelength is shorter."""
    return image.frequency is not None and SPEED_OF_LIGHT / (2 * image.frequency) < SPACING


def _surely(mask: np.ndarray, probability: np.ndarray, image: SarImage) -> bool:
    """Whether what shines in a mask that is not empty is so large, and its probability so high, that no second network
    is asked; by the mean magnitude along z of an image without sheets."""
    core = shining(mask, image.magnitude.mean(axis=2), _SHINES)
    return bool(core.sum() * np.prod(pixel_sides(image)) >= _SURE_AREA and probability[core].mean() >= _SURE)


def _placed(masks: Sequence[np.ndarray], picture: Picture) -> list[np.ndarray]:
    """The parts of masks (A, B) that lie where an object may."""
    image, lid, taken = picture.image, None, None
    if image is None:
        return list(masks)
    cleaned = without_sheets(image, frequency=HIGH_BAND, covered=picture.covered)
    if picture.covered:
        taken, lid = lid_over(image, cleaned)
    real = without_ghosts(masks, cleaned, covered=picture.covered)
    # One after the other: where nothing is left below the lid, what lies above the support stays.
    kept = [between(between(mask, cleaned, support=picture.support), cleaned, lid=lid) for mask in real]
    if taken is not None and taken.sheets:
        kept = [beneath(mask, image, taken, surely=picture.support is not None) for mask in kept]
    rests = [
        some.sum() < mask.sum() and some.sum() * np.prod(pixel_sides(image)) < _LEAST_AREA
        for some, mask in zip(kept, masks, strict=True)
    ]
    return [np.zeros_like(some) if rest else some for some, rest in zip(kept, rests, strict=True)]


def _without_small_parts(mask: np.ndarray) -> np.ndarray:
    """The mask without its parts that are much smaller than its largest."""
    parts, _ = parts_of(mask)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return mask & (sizes >= _SMALLEST_PART * sizes.max())[parts]


def _expected_iou(mask: np.ndarray, probability: np.ndarray) -> float:
    """Of a mask, by expected intersection and union: sum of p inside over inside plus the sum of p outside."""
    return float(probability[mask].sum() / (mask.sum() + probability[~mask].sum()))


def _read_description(path: Path) -> dict[str, Any]:
    """What the weights' JSON holds, checked as far as it is used."""
    held = read_description(path, "cut", "channels")
    if held["channels"] != list(WAVE_CHANNELS) or held.get("spacing") != SPACING:
        raise FormatError(f"{printable(path)}: the weights belong to another version of the network; train again")
    for name in ("cut", "least"):
        value = held.get(name, 0.5)
        if not isinstance(value, float) or not 0 < value < 1:
            raise DamagedFileError(f"{printable(path)}: {name} is {value!r}; expected a number between 0 and 1")
    return held
