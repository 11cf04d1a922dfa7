"""Predictions: what an object may be, and how probable that is."""

import numpy as np

from millisight.errors import InputError
from millisight.records import checked_array, put, record


@record
class Prediction:
    """Probabilities of the classes.

    Attributes
    ----------
    probabilities : (C,) float64, not negative, of sum 1
    class_names : (C,) names
    """

    probabilities: np.ndarray
    class_names: tuple[str, ...]

    def __post_init__(self) -> None:
        names = tuple(str(name) for name in self.class_names)
        probabilities = checked_array(self.probabilities, name="probabilities", shape=(len(names),))
        if probabilities.min() < 0 or abs(probabilities.sum() - 1) > 1e-6:
            raise InputError(
                f"probabilities run from {probabilities.min():g} and add up to {probabilities.sum():g}; "
                "expected none below 0 and a sum of 1"
            )
        put(self, probabilities=probabilities, class_names=names)

    @property
    def label(self) -> str:
        """The most probable class."""
        return self.class_names[int(np.argmax(self.probabilities))]
