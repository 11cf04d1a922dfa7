"""The classifier protocol, classifiers by name, and `classify`."""

import os
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from millisight.core import Registry, check_known, checked_path, checked_record
from millisight.core.errors import InputError
from millisight.data import Mask, Prediction, SarImage
from millisight.perception import HIGH_BAND, LOW_BAND, Condition, check_weights, weights_version, without_sheets


@runtime_checkable
class Classifier(Protocol):
    """Protocol of classifiers of the object under a mask.

    A class of your own needs these attributes and this method, and nothing else of millisight. To give it a name, add
    it to `CLASSIFIERS`, or to the entry points "millisight.classifiers" of your package.

    Attributes
    ----------
    name : of the classifier, or of its weights
    class_names : (C,) its classes
    bands : its input images: "77_ghz" first, and perhaps "24_ghz", which may be missing
    description : facts about its training; may be empty
    """

    name: str
    class_names: tuple[str, ...]
    bands: tuple[str, ...]
    description: Mapping[str, Any]

    def classify(self, image: SarImage, mask: Mask, *, other_band: SarImage | None = None) -> Prediction:
        """The probability of each class, (C,).

        Parameters
        ----------
        image : (X, Y, Z) values, at 77 GHz as a rule
        mask : (X, Y), on the image's grid seen along z
        other_band : the same scene at the radar's other frequency, on a grid of its own; None: there is none

        Raises
        ------
        InputError
            The image or the mask is not what it can work with.
        """
        ...


Method = Literal["network", "released"]

TORCH_SUFFIXES = (".h5", ".pt", ".pth")
"""Of weights that torch saved."""

CLASSIFIERS: Registry[Any] = Registry(
    "classifier", "millisight.classifiers", package="millisight.perception.classification"
)
"""What makes a `Classifier`, by name: a class, or a function with the options as its arguments."""


def classifier(method: Method | str = "network", **options: Any) -> Classifier:
    """Create a classifier by name, with options.

    Parameters
    ----------
    method : a name in `CLASSIFIERS`; "network" is the one of this package, "released" the paper's
    options : of the classifier, such as `weights` of "network": an ONNX file; weights that torch saved (.h5, .pt, .pth)
        are taken for those of "released"

    Raises
    ------
    UnknownNameError
        There is no such classifier, or the suffix of the weights is not that of any.
    InputError
        A plug-in's is no `Classifier`.
    FormatError
        The weights are an HDF5 file, as images and masks are.
    """
    weights = options.get("weights")
    if weights is not None and method in get_args(Method):
        check_weights(weights, TORCH_SUFFIXES)
    if (
        isinstance(method, str)
        and method == "network"
        and os.fspath(options.get("weights") or "").endswith(TORCH_SUFFIXES)
    ):
        method = "released"
    return _checked(CLASSIFIERS[method](**options))


def classify(
    image: SarImage,
    mask: Mask | None = None,
    *,
    other_band: SarImage | None = None,
    condition: Condition | str = "los",
    method: Method | str | Classifier = "network",
    weights: str | os.PathLike[str] | None = None,
) -> Prediction:
    """Classify the object under a mask, or the object that is found.

    Parameters
    ----------
    image : usually at 77 GHz
    mask : on the pixels of the image, as from `segment`; None: the one that `segment` finds with "wave", with the other
        band if there is one, and under the same condition
    other_band : image of the same scene at the other frequency, or None
    condition : "nlos" where something is known to cover the scene: a lid that ends within it is then taken off, too;
        else "los"
    method : name of a classifier, or a classifier
    weights : file of a trained network, for "network"; None: the shipped one; see `classifier`

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        The mask is empty or on another grid, nothing is found, an image is 0 under the mask, or `weights` are given
        with a classifier.
    UnknownNameError
        No such method or condition.
    ImportError, DamagedFileError, FormatError, FileError
        See NetworkClassifier.
    """
    checked_record(image, SarImage, name="image")
    if mask is not None:
        checked_record(mask, Mask, name="mask")
    if other_band is not None:
        checked_record(other_band, SarImage, name="other_band")
    check_known("condition", condition, get_args(Condition))
    if isinstance(method, str):
        path = None if weights is None else os.path.abspath(checked_path(weights))
        by = _by_name(method, path, weights_version(path))
    elif weights is not None:
        raise InputError("weights go with a method's name; make the classifier with its weights, or pass its name")
    else:
        by = _checked(method)
    if mask is None:
        # A classifier may be used without any segmenter.
        from millisight.perception.segmentation import segment

        mask = segment(image, other_band=other_band, condition=condition)
        if not mask.inside.any():
            raise InputError("nothing was found in the image that could be classified; pass a mask where something is")
    if condition == "nlos" and getattr(by, "takes_sheets_off", False):
        image = without_sheets(image, frequency=HIGH_BAND, covered=True)
        other_band = None if other_band is None else without_sheets(other_band, frequency=LOW_BAND, covered=True)
    return by.classify(image, mask, other_band=other_band)


@lru_cache(maxsize=2)
def _by_name(method: str, weights: str | None, version: tuple[Any, ...]) -> Classifier:
    """A classifier of that name, kept as long as its files are of that `version`."""
    return classifier(method, **({} if weights is None else {"weights": weights}))


def _checked(by: Any) -> Classifier:
    if isinstance(by, type) or not isinstance(by, Classifier):
        raise InputError(
            f"method is of type {type(by).__name__}; expected a classifier's name, or an object with name, "
            "class_names, bands, description and classify(image, mask, other_band=...)"
        )
    return by
