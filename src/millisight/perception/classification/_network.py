"""The classifier "network": a small network, trained on simulated images alone, run by ONNX Runtime.

What it was taught, and how well it does on other images, is in its model card.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.data import Mask, Prediction, SarImage
from millisight.perception import open_network, read_description
from millisight.perception.classification._classification import CLASSIFIERS
from millisight.perception.classification._network_input import (
    CLASSIFIER_CHANNELS,
    classifier_input,
    square_symmetries,
)

CLASSIFIER_WEIGHTS = Path(__file__).with_name("weights") / "classifier.onnx"
"""Shipped; its description lies beside it as .json."""


@CLASSIFIERS.add("network")
class NetworkClassifier:
    """A `Classifier` by a trained network, which ONNX Runtime runs.

    Parameters
    ----------
    weights : ONNX file as `millisight train classifier` writes it, its description beside it; None: the shipped one

    Attributes
    ----------
    name : of the weights
    class_names : (C,) the classes it tells apart
    bands : the images it looks at: "77_ghz" first, and perhaps "24_ghz", without which it works too
    description : what the JSON beside the weights holds: recipe, objects, seed, calibration, SHA-256

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    DamagedFileError, FormatError, FileError
        The weights are damaged, are no classifier's, or cannot be read.
    """

    def __init__(self, weights: str | os.PathLike[str] | None = None):
        path = check_readable(CLASSIFIER_WEIGHTS if weights is None else weights)
        self.description: Mapping[str, Any] = _description(path.with_suffix(".json"))
        self.name: str = self.description["name"]
        self.class_names: tuple[str, ...] = tuple(self.description["class_names"])
        self.bands: tuple[str, ...] = tuple(self.description["bands"])
        self._session = open_network(
            path, self.description["sha256"], needed_by="the classifier", channels=len(CLASSIFIER_CHANNELS)
        )
        outputs = self._session.get_outputs()[0].shape[1:]
        if outputs != [len(self.class_names)]:
            raise FormatError(
                f"{printable(path)} has outputs of shape {outputs} for the {len(self.class_names)} classes that its "
                "description names; copy both again"
            )

    def classify(self, image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> Prediction:
        """The calibrated probability of each class, the mean over the image's eight symmetries.

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
        channels = classifier_input(image, mask, other_band=other_band if len(self.bands) > 1 else None)
        (logits,) = self._session.run(None, {self._session.get_inputs()[0].name: square_symmetries(channels)})
        scaled = logits.mean(axis=0, dtype=np.float64) / self.description["temperature"]
        probabilities = np.exp(scaled - scaled.max())
        return Prediction(
            probabilities=probabilities / probabilities.sum(),
            class_names=self.class_names,
            threshold=self.description["threshold"],
        )


def _description(path: Path) -> dict[str, Any]:
    """What the weights' JSON holds, checked as far as it is used."""
    held = read_description(path, "name", "class_names", "bands", "channels", "temperature", "threshold")
    if held["channels"] != list(CLASSIFIER_CHANNELS):
        raise FormatError(f"{printable(path)} does not describe a classifier of this version; train it again")
    names, bands = held["class_names"], held["bands"]
    if (
        not isinstance(names, list) or len(names) < 2 or not all(isinstance(name, str) for name in names)
        or not isinstance(bands, list) or not bands or not all(isinstance(band, str) for band in bands)
        or not isinstance(held["name"], str)
    ):  # fmt: skip
        raise DamagedFileError(f"{printable(path)}: classes are {names!r} and bands {bands!r}; expected lists of names")
    for key, most in (("temperature", np.inf), ("threshold", 1)):
        value = held[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
            raise DamagedFileError(f"{printable(path)}: {key} is {value!r}; expected a number above 0")
    return held
