"""How often classes occur: what it changes in a classifier's answers, and in their calibration."""

import json

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import DamagedFileError, InputError, UnknownNameError
from millisight.data import Mask, SarImage, VoxelGrid
from millisight.perception.classification import CLASSIFIER_WEIGHTS, NetworkClassifier, prior_shares
from millisight.perception.training import ClassifierRecipe

CLASSES = "can", "handle", "box", "sphere", "cup", "clamp", "other"


@pytest.fixture(scope="module")
def seen():
    grid = VoxelGrid(x=0.004 * np.arange(30), y=0.004 * np.arange(30), z=0.0125 * np.arange(6))
    values = np.zeros(grid.shape, np.complex64)
    values[10:20, 8:22, 2] = 1
    return SarImage(grid=grid, values=values), Mask(grid_xy=grid.xy, inside=abs(values).max(axis=2) > 0)


def test_probabilities_follow_how_often_classes_occur(seen):
    pytest.importorskip("onnxruntime")
    prior = {name: 1.0 + number for number, name in enumerate(CLASSES)}
    even, other = (ms.classifier("network", prior=one).classify(*seen) for one in (dict.fromkeys(CLASSES, 3), prior))
    expected = even.probabilities * np.arange(1, 8)
    np.testing.assert_allclose(other.probabilities, expected / expected.sum(), rtol=1e-9)
    own = NetworkClassifier().description.get("prior", dict.fromkeys(CLASSES, 1))
    again = NetworkClassifier(prior=own).classify(*seen)
    np.testing.assert_array_equal(again.probabilities, NetworkClassifier().classify(*seen).probabilities)


def test_a_prior_is_a_positive_number_for_each_class(tmp_path):
    np.testing.assert_allclose(prior_shares({"can": 1, "box": 3}, ("can", "box")), [0.25, 0.75])
    np.testing.assert_allclose(prior_shares({}, ("can", "box")), [0.5, 0.5])
    with pytest.raises(UnknownNameError, match="unknown class 'pen'"):
        prior_shares({"pen": 1}, CLASSES)
    with pytest.raises(InputError, match="prior lacks handle, box, .*a number for each of can, handle"):
        prior_shares({"can": 1}, CLASSES)
    np.testing.assert_allclose(prior_shares({"can": 1e308, "box": 1e308}, ("can", "box")), [0.5, 0.5])
    with pytest.raises(InputError, match="prior goes from 1e-300 to 1; expected no more than a factor of 1e"):
        prior_shares({"can": 1, "box": 1e-300}, ("can", "box"))
    with pytest.raises(InputError, match="prior of box is 0; expected more than 0"):
        ClassifierRecipe(classes={"can": ("chips_can",), "box": ("dice",)}, prior={"can": 1, "box": 0})
    recipe = ClassifierRecipe(classes={"can": ("chips_can",), "box": ("dice",)}, prior={"can": 1, "box": 4})
    np.testing.assert_allclose(recipe.shares, [0.2, 0.8])
    assert ClassifierRecipe(classes={"can": ("chips_can",), "box": ("dice",)}).shares is None
    pytest.importorskip("onnxruntime")
    told = json.loads(CLASSIFIER_WEIGHTS.with_suffix(".json").read_text())
    (tmp_path / "one.onnx").write_bytes(CLASSIFIER_WEIGHTS.read_bytes())
    for prior, message in (({"pen": 1}, "unknown class 'pen'"), ([1, 2], "prior"), ({"can": 1}, "prior lacks")):
        (tmp_path / "one.json").write_text(json.dumps(told | {"prior": prior}))
        with pytest.raises(DamagedFileError, match=message):
            NetworkClassifier(tmp_path / "one.onnx")
