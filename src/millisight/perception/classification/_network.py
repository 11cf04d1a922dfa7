"""The classifier "network": a small network, trained on simulated images alone, run by ONNX Runtime.

What it was taught, and how well it does on other images, is in its model card.
"""

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_known, check_readable, checked_number, checked_record, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError, MillisightError
from millisight.data import Mask, Prediction, SarImage
from millisight.perception import (
    HIGH_BAND,
    LOW_BAND,
    canvas_axes,
    canvas_power,
    check_mask_of,
    open_network,
    power_levels,
    projected_levels,
    read_description,
    resampling_weights,
    run_network,
    taken_db,
    without_sheets,
)
from millisight.perception.classification._classification import CLASSIFIERS
from millisight.perception.classification._forms import form_odds
from millisight.perception.classification._novelty import novelty

CLASSIFIER_SIDE = 80
"""Pixels along x and y, 4 mm each: 32 cm."""
SLICES = 8
THICKNESS = 0.02
"""Of a slice along z [m]; together they reach 8 cm above and below the middle of the masked power."""
CLASSIFIER_CHANNELS = ("mask", "magnitude", "level", *(f"slice {i}" for i in range(SLICES)), "other", "has other")

MAGNITUDE = CLASSIFIER_CHANNELS.index("magnitude")
"""Of the paper's one channel: the mean of |I| along z, 1 from 80 % of its maximum on."""

_OTHER = CLASSIFIER_CHANNELS.index("other")
_CLIPPED = 0.8  # of the maximum
_LEAST = 1e-30  # power above 0
_QUARTERS = 4
_LEAST_TAKEN_DB = -0.1
_APART = 1e6  # numbers of a prior, at most
_BAND_RATIO = 1.15  # of a band's middle to that which was trained on


def classifier_input(image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> np.ndarray:
    """(C, CLASSIFIER_SIDE, CLASSIFIER_SIDE) float32 channels, as `CLASSIFIER_CHANNELS`, of an image under a mask.

    Parameters
    ----------
    image : of 77 GHz, as a rule
    mask : on the image's pixels
    other_band : an image of the same place by the other radar; None: there is none

    Raises
    ------
    InputError
        The mask is empty or on other pixels than the image, or an image is 0 under the mask.
    """
    checked_record(image, SarImage, name="image")
    checked_record(mask, Mask, name="mask")
    check_mask_of(mask, image)
    grid = image.grid.xy
    if not mask.inside.any():
        raise InputError("the mask is empty: nothing was found, or marked, that could be classified")
    x, y = canvas_axes(grid)
    along_x, along_y = resampling_weights(grid.x, x), resampling_weights(grid.y, y)
    inside = along_x @ mask.inside.astype(np.float32) @ along_y.T
    power = canvas_power(image, x, y)
    if not (power * inside[..., None]).any():
        raise InputError("the image is 0 everywhere under the mask; check how it was formed")
    other = None if other_band is None else canvas_power(other_band, x, y)
    if other is not None and not (other * inside[..., None]).any():
        raise InputError(
            "the other band is 0 under the mask, or on another grid; image both bands over the same area, or leave it "
            "out"
        )
    return masked_channels(power, image.grid.z, inside, other)


def square_symmetries(channels: np.ndarray) -> np.ndarray:
    """(8, C, S, S) the channels (C, S, S) turned by right angles, and mirrored."""
    turned = [np.rot90(channels, k, axes=(1, 2)) for k in range(_QUARTERS)]
    return np.ascontiguousarray(np.stack(turned + [one[:, ::-1] for one in turned]))


def views_of(channels: np.ndarray) -> np.ndarray:
    """(8, C, S, S) what a classifier's network sees of channels (C, S, S): `square_symmetries`, half of 77 GHz alone.

    The other band is blurred, and misleads as often as it helps: every second view is without it.
    """
    views = square_symmetries(channels)
    views[1::2, _OTHER:] = 0
    return views


def masked_channels(
    power: np.ndarray, z: np.ndarray, inside: np.ndarray, other: np.ndarray | None = None
) -> np.ndarray:
    """A classifier's input of one object.

    Parameters
    ----------
    power : (A, B, Z) of the image on the canvas's pixels
    z : (Z,) of its voxels [m], ascending
    inside : (A, B) share of each pixel that the mask covers, 0 to 1, not 0 throughout
    other : (A, B, Z') power of the other band on the same pixels; None: there is none

    Returns
    -------
    (C, CLASSIFIER_SIDE, CLASSIFIER_SIDE) float32, channels as `CLASSIFIER_CHANNELS`, 0 outside the mask;
    of an object wider than 32 cm its middle
    """
    window = tuple(_window(inside.sum(axis=1 - axis)) for axis in (0, 1))
    inside = _cut(inside, window)
    seen = _cut(power, window) * inside[..., None]
    channels = np.zeros((len(CLASSIFIER_CHANNELS), CLASSIFIER_SIDE, CLASSIFIER_SIDE), np.float32)
    channels[0] = inside
    flat = np.sqrt(seen).mean(axis=2)
    channels[MAGNITUDE] = np.minimum(flat / max(_CLIPPED * flat.max(), np.sqrt(_LEAST)), 1)
    channels[2] = projected_levels(seen)
    channels[3 : 3 + SLICES] = power_levels(_slices(seen, z))
    if other is not None:
        channels[3 + SLICES] = projected_levels(_cut(other, window) * inside[..., None])
        channels[4 + SLICES] = inside
    return channels


def _window(weights: np.ndarray) -> int:
    """Where the pixels begin, `CLASSIFIER_SIDE` of them about the middle of what is weighed; perhaps below 0."""
    middle = float(np.arange(len(weights)) @ weights / weights.sum())
    return round(middle - (CLASSIFIER_SIDE - 1) / 2)


def _cut(values: np.ndarray, starts: tuple[int, ...]) -> np.ndarray:
    """(CLASSIFIER_SIDE, CLASSIFIER_SIDE, ...) of values from these indices on, 0 where there are none."""
    cut = np.zeros((CLASSIFIER_SIDE, CLASSIFIER_SIDE, *values.shape[2:]), np.float32)
    places = [start + np.arange(CLASSIFIER_SIDE) for start in starts]
    there = [(place >= 0) & (place < size) for place, size in zip(places, values.shape[:2], strict=True)]
    cut[np.ix_(*there)] = values[np.ix_(*(place[here] for place, here in zip(places, there, strict=True)))]
    return cut


def _slices(power: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(SLICES, A, B) power at depths `THICKNESS` apart about the middle of all power."""
    profile = power.sum(axis=(0, 1), dtype=np.float64)
    middle = float(z @ profile / max(profile.sum(), _LEAST)) if profile.any() else float(z.mean())
    depths = middle + THICKNESS * (np.arange(SLICES) - (SLICES - 1) / 2)
    return np.moveaxis(power @ resampling_weights(z, depths).T, -1, 0)


def prior_shares(prior: Mapping[str, float], class_names: Collection[str]) -> np.ndarray:
    """(C,) how often each class occurs, 1 in all; each as often where `prior` is empty.

    Raises
    ------
    UnknownNameError, InputError
        It names another class, lacks one, is no positive number for one, or numbers are a million times apart.
    """
    for name in prior:
        check_known("class", name, class_names)
    missing = [name for name in class_names if prior and name not in prior]
    if missing:
        raise InputError(f"prior lacks {', '.join(missing)}; expected a number for each of {', '.join(class_names)}")
    shares = [checked_number(prior.get(name, 1.0), name=f"prior of {name}", above=0) for name in class_names]
    least, most = min(shares), max(shares)
    if most > least * _APART:
        raise InputError(f"prior goes from {least:g} to {most:g}; expected no more than a factor of {_APART:g} between")
    return np.array(shares) / most / sum(share / most for share in shares)


def novelty_of(logits: np.ndarray) -> np.ndarray:
    """(N,) probability of the last of the classes, what is of none, of logits (N, C + 1)."""
    return np.exp(logits[..., -1] - np.logaddexp.reduce(logits, axis=-1))


def sheet_was_brightest(taken: float) -> bool:
    """Whether the brightest voxel went with the sheets, by the maximum without them over that with them [dB]."""
    return taken < _LEAST_TAKEN_DB


CLASSIFIER_WEIGHTS = Path(__file__).with_name("weights") / "classifier.onnx"
"""Shipped; its description lies beside it as .json."""


@CLASSIFIERS.add("network")
class NetworkClassifier:
    """A `Classifier` by a trained network, which ONNX Runtime runs.

    Parameters
    ----------
    weights : ONNX file as `millisight train classifier` writes it, its description beside it; None: the shipped one
    prior : how often each class occurs where it is used, in any unit, for each of the classes; empty: each as
        often; None: as the description says, the shipped one's as in the published list of objects. The thresholds of
        sure answers stay as they are

    Attributes
    ----------
    name : of the weights
    class_names : (C,) the classes it tells apart
    bands : the images it looks at: "77_ghz" first, and perhaps "24_ghz", without which it works too
    description : what the JSON beside the weights holds: recipe, objects, seed, calibration, SHA-256
    takes_sheets_off : True: it looks at images without their sheets

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    DamagedFileError, FormatError, FileError
        The weights are damaged, are no classifier's, or cannot be read.
    UnknownNameError, InputError
        `prior` cannot be right, see `prior_shares`.
    """

    takes_sheets_off = True

    def __init__(
        self, weights: str | os.PathLike[str] | None = None, *, prior: Mapping[str, float] | None = None
    ) -> None:
        path = check_readable(CLASSIFIER_WEIGHTS if weights is None else weights)
        self.description: Mapping[str, Any] = _description(path.with_suffix(".json"))
        self.name: str = self.description["name"]
        self.class_names: tuple[str, ...] = tuple(self.description["class_names"])
        self.bands: tuple[str, ...] = tuple(self.description["bands"])
        self._session = open_network(
            path, self.description["sha256"], needed_by="the classifier", channels=len(CLASSIFIER_CHANNELS)
        )
        own = self.description.get("prior") if prior is None else checked_record(prior, Mapping, name="prior")
        self._added: np.ndarray = np.log(prior_shares(own or {}, self.class_names))
        self._limit: float | None = self.description.get("novelty", {}).get("limit")
        outputs, expected = self._session.get_outputs()[0].shape[1:], len(self.class_names) + (self._limit is not None)
        if outputs != [expected]:
            raise FormatError(
                f"{printable(path)} has outputs of shape {outputs} for the {expected} classes that its description "
                "names; copy both again"
            )

    def classify(self, image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> Prediction:
        """The calibrated probability of each class, the mean over the image's eight symmetries, sheets taken off.

        Of two bands, every second of the eight shows 77 GHz alone. What was under a sheet has a calibration of its own.
        The prediction's novelty is the score of `novelty`, of all that is known of the image: that it shows what is of
        no class, a scan too sparse, or a lid. No answer is sure of a class that was learned from random shapes alone:
        the threshold is then 1, since no object of that class has calibrated it.

        Where the image's phases tell that most of the object is a ball, a thick or short cylinder, a flat rectangle or
        ellipse, or a floor below a rim, classes count with how often they are so (`FORM_SHARES`). No answer becomes
        sure by that: the network must be sure of it alone.

        Parameters
        ----------
        image : of 77 GHz, as a rule
        mask : on the image's pixels
        other_band : an image of the same place by the other radar; not looked at by a network of one band

        Raises
        ------
        InputError
            The mask is empty or on other pixels than the image, an image is 0 under the mask, or an image is of another
            band than those that it learned from.
        """
        from scipy.special import softmax

        _check_bands(image, other_band)
        if other_band is not None:
            other_band = without_sheets(other_band, frequency=LOW_BAND) if len(self.bands) > 1 else None
        cleaned = without_sheets(image, frequency=HIGH_BAND)
        channels = classifier_input(cleaned, mask, other_band=other_band)
        logits = run_network(self._session, views_of(channels)).mean(axis=0, dtype=np.float64)
        covered = sheet_was_brightest(taken_db(cleaned))
        how = self.description.get("calibration", {}).get("covered" if covered else "open", self.description)
        scaled = logits[: len(self.class_names)] / how["temperature"] + self._added
        odds = form_odds(mask, image, self.class_names)
        probabilities = softmax(scaled + odds)
        best = int(probabilities.argmax())
        unproven = ""
        if self.class_names[best] in self.description.get("never_sure", ()):
            unproven = f"of {self.class_names[best]} it saw drawn shapes alone"
        elif odds.any() and softmax(scaled)[best] < how["threshold"]:
            # The threshold was chosen for what the network says alone.
            unproven = "the object's form made it so probable, and the network alone is not sure"
        novel: dict[str, Any] = {}
        if self._limit is not None:
            score, reasons = novelty(
                image, mask, other_band=other_band, cleaned=cleaned, by_network=float(novelty_of(logits)),
                limit=self._limit,
            )  # fmt: skip
            novel = {"novelty": score, "novelty_limit": self._limit, "reasons": reasons}
        return Prediction(
            probabilities=probabilities,
            class_names=self.class_names,
            threshold=1.0 if unproven else how["threshold"],
            unproven=unproven,
            **novel,
        )


def _check_bands(image: SarImage, other_band: SarImage | None) -> None:
    """Refuse bands that no network was trained on, as far as the images tell theirs."""
    for name, one, middle in (("the image", image, HIGH_BAND), ("other_band", other_band, LOW_BAND)):
        known = None if one is None else one.frequency
        if known is not None and not 1 / _BAND_RATIO < known / middle < _BAND_RATIO:
            raise InputError(
                f"{name} is of {known / 1e9:.3g} GHz, and the classifier was trained on {HIGH_BAND / 1e9:.0f} GHz, "
                f"with or without {LOW_BAND / 1e9:.0f} GHz as the other band; pass an image of that"
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
    apart = held.get("calibration", {})
    if not isinstance(apart, dict) or not all(isinstance(how, dict) for how in apart.values()):
        raise DamagedFileError(f"{printable(path)}: calibration is {apart!r}; expected tables of numbers")
    unproven = held.get("never_sure", [])
    if not isinstance(unproven, list) or not all(name in names for name in unproven):
        raise DamagedFileError(f"{printable(path)}: never_sure is {unproven!r}; expected a list of classes")
    try:
        prior_shares(checked_record(held.get("prior", {}), dict, name="prior"), names)
    except MillisightError as error:
        raise DamagedFileError(f"{printable(path)}: {error}") from error
    novelty = held.get("novelty", {})
    limit = novelty.get("limit", 0.5) if isinstance(novelty, dict) else None
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not 0 < limit <= 1:
        raise DamagedFileError(f"{printable(path)}: novelty is {novelty!r}; expected a table with a limit of 0 to 1")
    for how in (held, *apart.values()):
        for key, least, most in (("temperature", 1e-6, 1e6), ("threshold", 0, 1)):
            value = how.get(key)
            if isinstance(value, bool) or not isinstance(value, int | float) or not least < value <= most:
                raise DamagedFileError(
                    f"{printable(path)}: {key} is {value!r}; expected a number above {least:g}, at most {most:g}"
                )
    return held
