"""Predictions: what is most probable, whether that is sure, and what remains when some classes are ruled out."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError

CUP = ms.Prediction(
    probabilities=np.array([0.1, 0.3, 0.6, 0.0]), class_names=("can", "box", "cup", "clamp"), threshold=0.7
)


def test_among_some_classes_the_probabilities_add_up_to_one():
    among = CUP.among(("box", "can"))
    assert among.class_names == ("box", "can")
    np.testing.assert_allclose(among.probabilities, [0.75, 0.25])
    assert (CUP.answer, among.answer) == ("not sure", "box")
    assert among.threshold == CUP.threshold


def test_classes_that_it_does_not_know_and_impossible_ones_are_refused():
    with pytest.raises(UnknownNameError, match="mug"):
        CUP.among(("mug", "can"))
    for names in ((), ("clamp",)):
        with pytest.raises(InputError, match="together of probability 0"):
            CUP.among(names)
