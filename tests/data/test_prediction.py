"""Predictions: what is most probable, whether that is sure, and what remains when some classes are ruled out."""

import dataclasses

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


def test_what_is_unlike_the_training_is_no_sure_answer():
    novel = dataclasses.replace(CUP, threshold=0.5, novelty=0.8, novelty_limit=0.7)
    assert (novel.novel, novel.sure, novel.answer) == (True, False, "not sure")
    assert "novel above 0.70" in repr(novel)
    assert novel.among(("cup", "can")).novel
    known = dataclasses.replace(novel, novelty=0.7)
    assert (known.novel, known.answer) == (False, "cup")
    why = dataclasses.replace(novel, reasons=["a lid", "too sparse"])
    assert why.reasons == ("a lid", "too sparse") == why.among(("cup", "can")).reasons
    assert novel.reasons == ()
    assert not CUP.novel  # of a classifier that does not say
    for wrong in ({"novelty": 1.1}, {"novelty_limit": 2.0}):
        with pytest.raises(InputError, match="expected a probability"):
            dataclasses.replace(CUP, **wrong)
