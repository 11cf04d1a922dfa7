"""Scenes named by classifiers: what is read of them, what is kept, and what a failure stops."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from millisight.datasets import classified
from millisight.datasets.classified import ask, clocked, masked, origins
from millisight.datasets.judging import Settings
from millisight.datasets.manifest import Manifest, write_manifest
from millisight.datasets.mito import find
from millisight.datasets.scenes import find_scenes
from millisight.errors import DamagedFileError, InputError
from millisight.evaluation.segmentation import HIGH
from small_scenes import BLOCKS, inside, make
from some_answers import prediction

SETTINGS = Settings(seeds=(0,))


class Fake:
    """Calls everything what its weights are named; counts what it was asked."""

    asked = 0

    def __init__(self, weights):
        self.name, self.class_names = str(weights), ("can", "handle", "box", "sphere")
        self.description = {"sha256": f"sum of {weights}"}

    def classify(self, image, mask, *, other_band=None):
        type(self).asked += 1
        return prediction(self.name, 0.75 if other_band is not None else 0.5, threshold=0.1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole") / "data")


@pytest.fixture
def data(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(classified.classification, "Classifier", Fake)
    monkeypatch.setattr(Fake, "asked", 0)
    classified.classifier.cache_clear()
    yield Path(shutil.copytree(whole, tmp_path / "data"))
    classified.classifier.cache_clear()


def heard(data, tmp_path, *weights, settings=SETTINGS):
    scenes = find_scenes(find(data))
    return ask(dict.fromkeys(weights, scenes), tmp_path / "kept", settings, method="classical", workers=1)


def test_every_classifier_is_asked_about_every_scene_in_both_masks(data, tmp_path):
    steps = []
    scenes = find_scenes(find(data))
    found = ask({"box": scenes, "can": scenes[:1]}, tmp_path / "kept", SETTINGS, method="classical", workers=1,
                progress=lambda *step: steps.append(step))  # fmt: skip
    assert (found.failures, found.kept) == ([], 0)
    assert {weights for weights, _ in found.said} == {"box", "can"}
    assert len(found.said) == 5
    for (weights, _), (predicted, true) in found.said.items():
        assert (predicted.masks, true.masks) == ("predicted", "true")
        assert predicted.prediction.label == true.prediction.label == weights
        assert predicted.prediction.confidence == 0.75  # with the other band
        assert 0.3 < predicted.iou <= 1
        assert true.iou == 1
    assert Fake.asked == 10
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_what_is_done_is_kept_to_the_last_bit(data, tmp_path):
    first = heard(data, tmp_path, "box")
    again = heard(data, tmp_path, "box", "can")
    assert (first.kept, again.kept, Fake.asked) == (0, 4, 16)
    for key, said in first.said.items():
        for one, other in zip(said, again.said[key], strict=True):
            assert np.array_equal(one.prediction.probabilities, other.prediction.probabilities)
            assert one.prediction.threshold == other.prediction.threshold == 0.1
            assert one._replace(prediction=None) == other._replace(prediction=None)


def test_what_has_changed_or_was_damaged_is_done_again(data, tmp_path):
    heard(data, tmp_path, "box")
    image = next(data.glob("073*/robot_collected/*/exp1/nlos/processed/radars/24_ghz/processed_image.pkl"))
    image.write_bytes(image.read_bytes() + b" ")
    place = next((tmp_path / "kept").glob("*074-x_wide*.json"))
    place.write_text(json.dumps({**json.loads(place.read_text()), "said": [{"masks": "predicted"}]}))
    assert heard(data, tmp_path, "box").kept == 2
    assert heard(data, tmp_path, "box").kept == 4
    assert heard(data, tmp_path, "box", settings=Settings(seeds=(1,))).kept == 0


def test_a_scene_that_cannot_be_read_stops_no_other(data, tmp_path):
    next(data.glob("073*/robot_collected/*/exp1/los/processed/radars/77_ghz/processed_image.pkl")).unlink()
    next(data.glob("074*/robot_collected/*/exp1/nlos/processed/radars/77_ghz/*image.pkl")).write_bytes(b"none")
    found = heard(data, tmp_path, "box")
    assert len(found.said) == 2
    assert [scene for scene, _ in found.failures] == ["073-a_lego_duplo/0_0_0/exp1/los", "074-x_wide/0_0_0/exp1/nlos"]
    assert "no image at 77 GHz" in found.failures[0][1]


def test_where_no_mask_is_found_nothing_is_asked_but_in_the_true_one(data, tmp_path, monkeypatch):
    def none(*_, **__):
        raise InputError("every mask is too large")

    monkeypatch.setattr(classified, "segment", none)
    found = heard(data, tmp_path, "box")
    assert len(found.said) == Fake.asked == 4
    for predicted, true in found.said.values():
        assert (predicted.prediction, predicted.failure, predicted.iou) == (None, "every mask is too large", 0)
        assert true.prediction.label == "box"
    again = heard(data, tmp_path, "box")
    assert again.kept == 4
    assert all(predicted.prediction is None for predicted, _ in again.said.values())


def test_masked_has_what_was_classified(data):
    files = find_scenes(find(data))[0]
    image, mask, truth = masked(files, SETTINGS, "classical")
    u, v, a, b = BLOCKS["073-a_lego_duplo"]
    exact = inside((u, v, a, b))
    assert image.grid.xy.shape == mask.inside.shape == truth.inside.shape
    assert (truth.inside & exact).sum() / (truth.inside | exact).sum() > 0.8
    assert (mask.inside & exact).sum() / (mask.inside | exact).sum() > 0.3
    assert files.images[HIGH].path.exists()


def test_clocked_are_classification_and_segmentation_once_warm(data, monkeypatch):
    ticks = iter(np.arange(100.0) ** 2)
    monkeypatch.setattr(classified, "perf_counter", lambda: next(ticks))
    scenes = find_scenes(find(data))[:2]
    # Between the ticks n and n + 1 lie 2 n + 1 seconds; the first six are the warm-up's.
    assert clocked(["box", "can"], scenes, SETTINGS, "classical") == {
        "box": [(17, 13), (29, 25)], "can": [(21, 13), (33, 25)]
    }  # fmt: skip


class TestOrigins:
    def test_of_what_was_not_generated_nothing_is_known_but_the_pose(self, data):
        dataset = find(data)
        found = origins(dataset, find_scenes(dataset))
        assert len(found) == 4
        assert {(one.angles, one.shape, one.seeds) for one in found.values()} == {((0, 0, 0), "unknown", frozenset())}

    @pytest.mark.parametrize(
        ("world", "folder", "shape"),
        [
            ('[[objects]]\nobject = "dice"', "073-a_lego_duplo", "built"),
            ('[[objects]]\nmesh = "a.stl"', "073-a_lego_duplo", "scan"),
            ('[[objects]]\nmesh = "a.stl"', "074-x_wide", "file"),
            ("objects = []", "074-x_wide", "file"),
            ("objects = 3", "074-x_wide", "unknown"),
        ],
    )
    def test_of_generated_scenes_where_shapes_are_from_and_every_seed(self, data, world, folder, shape):
        place = data / "truth" / folder / "robot_collected/0_0_0/exp1/los/77_ghz/world.toml"
        place.parent.mkdir(parents=True)
        place.write_text(f"seed = 12\n{world}\n")
        write_manifest(data, Manifest(settings={"seed": 76}, entries={}))
        dataset = find(data)
        found = origins(dataset, find_scenes(dataset))
        one = found[f"{folder}/0_0_0/exp1/los"]
        assert (one.shape, one.seeds) == (shape, {12, 76})
        assert found[f"{folder}/0_0_0/exp1/nlos"].seeds == {76}

    def test_a_damaged_manifest_is_said(self, data):
        (data / "manifest.jsonl").write_text('{"format": "millisight dataset manifest", "version": 1, "settings": 3}\n')
        dataset = find(data)
        with pytest.raises(DamagedFileError, match=r"manifest\.jsonl"):
            origins(dataset, find_scenes(dataset))
