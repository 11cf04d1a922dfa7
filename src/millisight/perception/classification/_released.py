"""The classifier "released": the paper's network with its published weights, on the input that it was trained with.

The input keeps what the published code does: the mean of |I| along z in the published scale and in 256 steps, the
middle 224 x 224 pixels, a blur, values clipped at 80 % of the maximum and scaled to -0.5 to 0.5.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_readable, checked_record
from millisight.core.errors import InputError
from millisight.data import Mask, Prediction, SarImage
from millisight.perception import check_mask_of
from millisight.perception.classification._classification import CLASSIFIERS

RELEASED_CLASSES = ("can", "handle", "box", "sphere")
RELEASED_SIDE = 224
TEST_BLUR = 3.0
"""Sigma of the blur of test images [pixels]; in training it is drawn from 0.1 to 4."""

_KERNEL = 11  # pixels
_CLIPPED = 0.8  # of the maximum
_SIMULATED = 230 * 550 * 300  # that published simulated images are larger by
_SECOND = 10.0  # that images of experiment 2 are weaker by
_STEPS = 255


@CLASSIFIERS.add("released")
class ReleasedClassifier:
    """A `Classifier` by the paper's network with published weights, which torch runs.

    Parameters
    ----------
    weights : a torch state dict, such as `final_weights.h5` of the authors; nothing in it is run

    Attributes
    ----------
    name : the file's name, with the folder of its training where it has the authors' form
    class_names : (4,) can, handle, box, sphere
    bands : "77_ghz"
    description : network, parts of the simulation that it was trained with, SHA-256 of the file

    Raises
    ------
    ImportError
        torch is not installed.
    FileError, FormatError, DamagedFileError
        The weights cannot be read, or are not this network's.
    """

    def __init__(self, weights: str | os.PathLike[str]):
        path = check_readable(weights)
        try:
            from millisight.perception.training.networks import read_released
        except ImportError as error:
            raise ImportError('the released network runs by torch: pip install "millisight[train]"') from error
        self._network = read_released(path, len(RELEASED_CLASSES))
        told = _training_of(path)
        self.name: str = f"{told}, {path.stem}" if told else path.stem
        self.class_names: tuple[str, ...] = RELEASED_CLASSES
        self.bands: tuple[str, ...] = ("77_ghz",)
        parts = "edge" if told.endswith("_edge") else "specular" if told.endswith("_spec") else "both"
        self.description: Mapping[str, Any] = {
            "network": "released",
            "parts": parts,
            "sha256": self._network.sha256,
            "physics": "published simulator: specular and edge reflections of vertices",
        }

    def classify(self, image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> Prediction:
        """The probability of each class, as the network gives it.

        Parameters
        ----------
        image : of 77 GHz
        mask : on the image's pixels
        other_band : not looked at

        Raises
        ------
        InputError
            The mask is empty or on other pixels than the image, or the image is 0 under the mask.
        """
        return Prediction(
            probabilities=self._network.probabilities(released_input(image, mask)), class_names=self.class_names
        )


def _training_of(path: Path) -> str:
    """Name of the training, of `<training>/models/<weights>`; "" of other places."""
    folders = path.resolve().parts[-3:-1]
    return folders[0] if len(folders) == 2 and folders[1] == "models" else ""


def released_input(image: SarImage, mask: Mask, *, blur: float = TEST_BLUR) -> np.ndarray:
    """(1, 224, 224) float32, from -0.5 to 0.5: the input of the released network, as its test makes it.

    Published images keep their own scale, in which the network's input has 256 steps; of others the maximum under the
    mask takes the place of that scale.

    Parameters
    ----------
    image : at 77 GHz
    mask : on the image's pixels
    blur : sigma [pixels]

    Raises
    ------
    InputError
        The mask is empty or on other pixels than the image, or the image is 0 under the mask.
    """
    checked_record(image, SarImage, name="image")
    check_mask_of(checked_record(mask, Mask, name="mask"), image)
    seen = image.magnitude.mean(axis=2, dtype=np.float64) * mask.inside
    scale = published_scale(image)
    if scale is None:
        scale = 1 / seen.max() if seen.any() else 1.0
    levels = np.minimum(np.floor(_STEPS * scale * seen), _STEPS)
    values = clipped(blurred_levels(middle(levels), blur) / _STEPS)
    if values is None:
        raise InputError("the image is 0 under the mask, in the 256 steps of the network's input; segment it again")
    return values[None].astype(np.float32)


def published_scale(image: SarImage) -> float | None:
    """What the published code multiplies an image's magnitude with; None of an image that is not published."""
    steps = image.metadata.get("history", ())
    files = [str(step.get("file", "")) for step in steps if step.get("step") == "read_published"]
    if not files:
        return None
    if "/simulation/" in files[-1]:
        return 1 / _SIMULATED
    return _SECOND if "/exp2/" in files[-1] else 1.0


def middle(values: np.ndarray, side: int = RELEASED_SIDE) -> np.ndarray:
    """(side, side) the middle of a picture (A, B), with zeros around one that is smaller."""
    short = [max(side - size, 0) for size in values.shape]
    values = np.pad(values, [(gap // 2, (gap + 1) // 2) for gap in short])
    a, b = (round((size - side) / 2) for size in values.shape)
    return values[a : a + side, b : b + side]


def blurred_levels(levels: np.ndarray, sigma: float) -> np.ndarray:
    """Levels (A, B) blurred by a Gaussian of 11 x 11 pixels, mirrored at the border, in whole steps again."""
    from scipy.ndimage import convolve1d

    places = np.arange(_KERNEL) - _KERNEL // 2
    kernel = np.exp(-0.5 * (places / sigma) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        levels = convolve1d(levels, kernel, axis=axis, mode="mirror")
    return np.rint(levels)


def clipped(values: np.ndarray) -> np.ndarray | None:
    """Values from -0.5 to 0.5, where 0.5 is 80 % of the maximum and above; None where all are 0."""
    peak = _CLIPPED * values.max()
    return None if not peak > 0 else np.minimum(values, peak) / peak - 0.5
