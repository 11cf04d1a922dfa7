"""Predictions: the probability of each class."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from millisight.core import check_known, checked_array, checked_items, checked_number, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._image import SarImage
from millisight.data._mask import Mask

NOT_SURE = "not sure"


@record
class Prediction:
    """The probability that an object is of each class.

    Attributes
    ----------
    probabilities : (C,) float64, not negative, of sum 1
    class_names : (C,) names
    threshold : the answer is "not sure" if no probability reaches it
    novelty : 0 to 1, how unlike the image is to those that the classifier knows: an empty scene, a lid, a scan too
        sparse; 0 by a classifier that does not say
    novelty_limit : the answer is "not sure" if the novelty is higher
    reasons : why the image is novel, in words, the strongest first; () where it is not
    unproven : why no probability is enough, in words, where the threshold is 1 whatever the classifier's is; "" else
    """

    probabilities: np.ndarray
    class_names: tuple[str, ...]
    threshold: float = 0.0
    novelty: float = 0.0
    novelty_limit: float = 1.0
    reasons: tuple[str, ...] = ()
    unproven: str = ""

    def __post_init__(self) -> None:
        names = checked_items(self.class_names, str, name="a class")
        probabilities = checked_array(self.probabilities, name="probabilities", shape=(len(names),))
        if probabilities.min() < 0 or abs(probabilities.sum() - 1) > 1e-6:
            raise InputError(
                f"probabilities run from {probabilities.min():g} and add up to {probabilities.sum():g}; "
                "expected none below 0 and a sum of 1"
            )
        threshold = checked_number(self.threshold, name="threshold", minimum=0)
        shares = {
            name: checked_number(getattr(self, name), name=name, minimum=0) for name in ("novelty", "novelty_limit")
        }
        for name, share in shares.items():
            if share > 1:
                raise InputError(f"{name} is {share:g}; expected a probability, 0 to 1")
        reasons = checked_items(self.reasons, str, name="a reason")
        checked_record(self.unproven, str, name="unproven")
        put(self, probabilities=probabilities, class_names=names, threshold=threshold, reasons=reasons, **shares)

    def __repr__(self) -> str:
        unsure = f", novel above {self.novelty_limit:.2f}" if self.novel else f", not sure below {self.threshold:.2f}"
        sure = "" if self.sure else unsure
        return f"Prediction({self.label} {self.confidence:.2f} of {len(self.class_names)} classes{sure})"

    @property
    def label(self) -> str:
        """The most probable class."""
        return self.class_names[int(np.argmax(self.probabilities))]

    @property
    def confidence(self) -> float:
        """The probability of the most probable class."""
        return float(self.probabilities.max())

    @property
    def sure(self) -> bool:
        """Whether the confidence reaches the threshold, and the image is not `novel`."""
        return self.confidence >= self.threshold and not self.novel

    @property
    def novel(self) -> bool:
        """Whether the image is unlike what the classifier was trained on: the novelty is above its limit."""
        return self.novelty > self.novelty_limit

    def plot(self, image: SarImage | None = None, mask: Mask | None = None, **settings: Any) -> Any:
        """Plot a bar for each class, and beside them the image with the outline of the mask.

        Parameters
        ----------
        image : that was classified; None: the bars alone
        mask : of the object, on the image's pixels; None: no outline
        settings : of `millisight.viz.plot_prediction`: `dynamic_range_db` of the image, `axes` to draw on

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_prediction")(image, mask, self, **settings)[0].figure

    def among(self, class_names: Sequence[str]) -> "Prediction":
        """The same, where the object is known to be of one of some of the classes.

        Parameters
        ----------
        class_names : at least one of the classes

        Raises
        ------
        UnknownNameError
            One is none of the classes.
        InputError
            There is none, or all have the probability 0.
        """
        for name in class_names:
            check_known("class", name, self.class_names)
        kept = np.array([self.probabilities[self.class_names.index(name)] for name in class_names])
        if not kept.sum() > 0:
            raise InputError(f"{', '.join(class_names) or 'no class'}: together of probability 0; name other classes")
        return dataclasses.replace(self, probabilities=kept / kept.sum(), class_names=tuple(class_names))

    @property
    def answer(self) -> str:
        """The most probable class, or "not sure"."""
        return self.label if self.sure else NOT_SURE
