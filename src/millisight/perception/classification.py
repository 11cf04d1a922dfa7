"""Predictions: what an object may be, and how probable that is; and the networks that say so.

A classifier looks at a masked image, both bands where there are both. It learned from simulated images alone: what it
was taught, and what it is worth on other images, is told in its model card.
"""

import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from millisight.errors import DamagedFileError, FormatError, InputError
from millisight.files import check_readable, printable
from millisight.imaging.image import SarImage
from millisight.perception import classifier_features, wave_features
from millisight.perception.networks import open_network, read_description
from millisight.perception.segmentation import Mask
from millisight.records import checked_array, checked_number, checked_record, put, record

WEIGHTS = Path(__file__).with_name("weights") / "classifier.onnx"
"""Shipped; its description lies beside it as .json."""

NOT_SURE = "not sure"

_WAYS = 8  # to lay a square onto itself


@record
class Prediction:
    """Probabilities of the classes.

    Attributes
    ----------
    probabilities : (C,) float64, not negative, of sum 1
    class_names : (C,) names
    threshold : the answer is "not sure" where no probability reaches it
    """

    probabilities: np.ndarray
    class_names: tuple[str, ...]
    threshold: float = 0.0

    def __post_init__(self) -> None:
        names = tuple(str(name) for name in self.class_names)
        probabilities = checked_array(self.probabilities, name="probabilities", shape=(len(names),))
        if probabilities.min() < 0 or abs(probabilities.sum() - 1) > 1e-6:
            raise InputError(
                f"probabilities run from {probabilities.min():g} and add up to {probabilities.sum():g}; "
                "expected none below 0 and a sum of 1"
            )
        threshold = checked_number(self.threshold, name="threshold", minimum=0)
        put(self, probabilities=probabilities, class_names=names, threshold=threshold)

    @property
    def label(self) -> str:
        """The most probable class."""
        return self.class_names[int(np.argmax(self.probabilities))]

    @property
    def confidence(self) -> float:
        """Its probability."""
        return float(self.probabilities.max())

    @property
    def sure(self) -> bool:
        """Whether that reaches the threshold."""
        return self.confidence >= self.threshold

    @property
    def answer(self) -> str:
        """The most probable class, or "not sure"."""
        return self.label if self.sure else NOT_SURE


class Classifier:
    """Predictions by a trained network, which ONNX Runtime runs.

    Parameters
    ----------
    weights : ONNX file as `millisight train classifier` writes it, its description beside it; None: the shipped one

    Attributes
    ----------
    name : of the weights
    class_names : (C,) what it tells apart
    bands : which images it looks at: "77_ghz" first, and perhaps "24_ghz", without which it works too
    description : what is told of its training

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    DamagedFileError, FormatError, FileError
        The weights are damaged, are no classifier's, or cannot be read.
    """

    def __init__(self, weights: str | os.PathLike[str] | None = None):
        path = check_readable(WEIGHTS if weights is None else weights)
        self.description: Mapping[str, Any] = _description(path.with_suffix(".json"))
        self.name: str = self.description["name"]
        self.class_names: tuple[str, ...] = tuple(self.description["class_names"])
        self.bands: tuple[str, ...] = tuple(self.description["bands"])
        self._session = open_network(
            path, self.description["sha256"], needed_by="the classifier", channels=len(classifier_features.CHANNELS)
        )
        if self._session.get_outputs()[0].shape[1:] != [len(self.class_names)]:
            raise FormatError(
                f"{printable(path)} answers {self._session.get_outputs()[0].shape[1:]} figures for the "
                f"{len(self.class_names)} classes that its description names; copy both anew"
            )

    def classify(self, image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> Prediction:
        """What the object under a mask is.

        Parameters
        ----------
        image : of 77 GHz, as a rule
        mask : on the image's pixels
        other_band : an image of the same place by the other radar; not looked at by a network of one band

        Raises
        ------
        InputError
            The mask is empty or on other pixels than the image, or an image is 0 under the mask.
        """
        channels = seen_by_classifiers(image, mask, other_band=other_band if len(self.bands) > 1 else None)
        (logits,) = self._session.run(None, {self._session.get_inputs()[0].name: turned_all_ways(channels)})
        scaled = logits.mean(axis=0, dtype=np.float64) / self.description["temperature"]
        probabilities = np.exp(scaled - scaled.max())
        return Prediction(
            probabilities=probabilities / probabilities.sum(),
            class_names=self.class_names,
            threshold=self.description["threshold"],
        )


def classify(
    image: SarImage,
    mask: Mask,
    *,
    other_band: SarImage | None = None,
    weights: str | os.PathLike[str] | None = None,
) -> Prediction:
    """What the object under a mask is, by the shipped classifier or by other weights.

    Parameters
    ----------
    image : of 77 GHz, as a rule
    mask : on the image's pixels, as from `segment`
    other_band : an image of the same place by the other radar; None: there is none
    weights : see Classifier

    Returns
    -------
    Prediction

    Raises
    ------
    InputError, ImportError, DamagedFileError, FormatError, FileError
        See Classifier.
    """
    return _classifier(None if weights is None else os.path.abspath(weights)).classify(
        image, mask, other_band=other_band
    )


@lru_cache(maxsize=2)
def _classifier(weights: str | None) -> Classifier:
    return Classifier(weights)


def seen_by_classifiers(image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> np.ndarray:
    """(C, SIDE, SIDE) float32 channels of `classifier_features` of an image under a mask.

    Raises
    ------
    InputError
        See `Classifier.classify`.
    """
    checked_record(image, SarImage, name="image")
    checked_record(mask, Mask, name="mask")
    grid = image.grid.xy
    if not _same(mask.grid_xy.x, grid.x) or not _same(mask.grid_xy.y, grid.y):
        raise InputError(
            f"the mask is on {mask.grid_xy!r}, the image on {grid!r}; expected one grid: make the mask of this image"
        )
    if not mask.inside.any():
        raise InputError("the mask is empty, and there is nothing to classify; segment the image anew")
    x, y = wave_features.canvas_of(grid)
    along_x, along_y = wave_features.resampling(grid.x, x), wave_features.resampling(grid.y, y)
    inside = along_x @ mask.inside.astype(np.float32) @ along_y.T
    power = wave_features.canvas_power(image, x, y)
    if not (power * inside[..., None]).any():
        raise InputError("the image is 0 everywhere under the mask; check how it was formed")
    other = None if other_band is None else wave_features.canvas_power(other_band, x, y)
    if other is not None and not (other * inside[..., None]).any():
        raise InputError(
            "the other band is 0 under the mask, or on another grid; image both bands over one place, or leave it out"
        )
    return classifier_features.masked_channels(power, image.grid.z, inside, other)


def turned_all_ways(channels: np.ndarray) -> np.ndarray:
    """(8, C, S, S) the channels laid onto themselves in each way: turned by right angles, and mirrored."""
    quarter = [np.rot90(channels, k, axes=(1, 2)) for k in range(_WAYS // 2)]
    return np.ascontiguousarray(np.stack(quarter + [one[:, ::-1] for one in quarter]))


def _same(ours: np.ndarray, theirs: np.ndarray) -> bool:
    return ours.shape == theirs.shape and np.allclose(ours, theirs, rtol=0, atol=1e-6)


def _description(path: Path) -> dict[str, Any]:
    """What the weights' JSON tells, checked as far as it is used."""
    told = read_description(path, "name", "class_names", "bands", "channels", "temperature", "threshold")
    if told["channels"] != list(classifier_features.CHANNELS):
        raise FormatError(f"{printable(path)} is of no classifier, or of another version of it; train anew")
    names, bands = told["class_names"], told["bands"]
    if (
        not isinstance(names, list) or len(names) < 2 or not all(isinstance(name, str) for name in names)
        or not isinstance(bands, list) or not bands or not all(isinstance(band, str) for band in bands)
        or not isinstance(told["name"], str)
    ):  # fmt: skip
        raise DamagedFileError(f"{printable(path)}: classes are {names!r} and bands {bands!r}; expected lists of names")
    for key, most in (("temperature", np.inf), ("threshold", 1)):
        value = told[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
            raise DamagedFileError(f"{printable(path)}: {key} is {value!r}; expected a number above 0")
    return told
