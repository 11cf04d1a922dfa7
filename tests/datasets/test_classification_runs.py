"""Classifiers on scenes: what is read of them, what is cached, and what a failure stops."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.small_scenes import BLOCKS, inside, make
from helpers.some_answers import prediction
from helpers.undrawn import undrawn
from millisight.core.errors import DamagedFileError, InputError
from millisight.datasets import DatasetFiles, Manifest, find_scenes, write_manifest
from millisight.datasets._origins import origins
from millisight.evaluation import HIGH, ClassificationTask
from millisight.evaluation.tasks import _candidates as candidates
from millisight.evaluation.tasks import classification


class Fake:
    """Calls everything what its weights are named, and "can" knows no wide block; counts how often it is run."""

    runs = 0

    def __init__(self, weights):
        self.name, self.class_names = Path(weights).name, ("can", "handle", "box", "sphere")
        self.bands = ("77_ghz", "24_ghz")
        self.description = {
            "sha256": f"sum of {self.name}", "objects": {"training": [], "validation": []}, "poses": {}, "seed": 1,
            "physics": "simulator", "parts": "both", "network": "small",
            "classes": {} if self.name == "can" else {"can": ["wide"]},
        }  # fmt: skip

    def classify(self, image, mask, *, other_band=None):
        type(self).runs += 1
        return prediction(self.name, 0.75 if other_band is not None else 0.5, threshold=0.1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole") / "data")


@pytest.fixture
def data(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(candidates, "classifier", Fake)
    monkeypatch.setattr(Fake, "runs", 0)
    candidates._loaded.cache_clear()
    yield Path(shutil.copytree(whole, tmp_path / "data"))
    candidates._loaded.cache_clear()


@pytest.fixture
def untimed(monkeypatch):
    """Nor drawn: what is run and cached is looked at."""
    monkeypatch.setattr(classification, "time_classifiers", lambda weights, sources: {one: [] for one in weights})
    with undrawn():
        yield


def run(data, tmp_path, *weights, **options):
    given = {"output": tmp_path / "out", "method": "classical", "workers": 1, "mistakes": 0, **options}
    return ms.evaluate("classification", data, weights=weights, **given)


def sources(data, *weights):
    dataset = ms.datasets.open(data)
    task = ClassificationTask(weights=weights, method="classical")
    return [item.source for item in task.plan(DatasetFiles(dataset=dataset, scenes=find_scenes(dataset))).items]


@pytest.mark.slow
@pytest.mark.usefixtures("untimed")
def test_every_classifier_is_run_on_every_scene_that_tests_it_in_both_masks(data, tmp_path):
    steps = []
    found = run(data, tmp_path, "box", "can", progress=lambda *step: steps.append(step))
    assert (found.failures, found.cached) == ((), 0)
    assert [(one.variant.name, one.masks) for one in found.rows] == [
        (name, masks) for name in ["box"] * 4 + ["can"] * 2 for masks in ("predicted", "true")
    ]
    for predicted, true in zip(found.rows[::2], found.rows[1::2], strict=True):
        assert predicted.scene == true.scene
        assert predicted.label == true.label == predicted.variant.name
        assert predicted.prediction.confidence == 0.75  # with the other band
        assert 0.3 < predicted.iou <= 1
        assert true.iou == 1
    assert Fake.runs == 12
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.slow
@pytest.mark.usefixtures("untimed")
def test_what_is_done_is_cached_to_the_last_bit(data, tmp_path):
    first = run(data, tmp_path, "box")
    again = run(data, tmp_path, "box", "can")
    assert (first.cached, again.cached, Fake.runs) == (0, 4, 12)
    for one, other in zip(first.rows, again.rows, strict=False):
        assert (one.scene, one.masks, one.iou, one.failure) == (other.scene, other.masks, other.iou, other.failure)
        assert np.array_equal(one.prediction.probabilities, other.prediction.probabilities)
        assert one.prediction.threshold == other.prediction.threshold == 0.1


@pytest.mark.usefixtures("untimed")
def test_copies_of_the_same_weights_share_results(data, tmp_path):
    found = run(data, tmp_path, "a/box", "b/box")
    assert [one.variant.name for one in found.rows] == ["box, both, small, a"] * 8 + ["box, both, small, b"] * 8
    assert Fake.runs == 8


@pytest.mark.slow
@pytest.mark.usefixtures("untimed")
def test_what_has_changed_or_was_damaged_is_done_again(data, tmp_path):
    run(data, tmp_path, "box")
    image = next(data.glob("073*/robot_collected/*/exp1/nlos/processed/radars/24_ghz/processed_image.pkl"))
    image.write_bytes(image.read_bytes() + b" ")
    place = next((tmp_path / "out" / "answers").glob("*074-x_wide*.json"))
    place.write_text(json.dumps({**json.loads(place.read_text()), "result": [{"masks": "predicted"}]}))
    assert run(data, tmp_path, "box").cached == 2
    assert run(data, tmp_path, "box").cached == 4
    assert run(data, tmp_path, "box", seed=1).cached == 0


@pytest.mark.usefixtures("untimed")
def test_a_scene_that_cannot_be_read_stops_no_other(data, tmp_path):
    next(data.glob("073*/robot_collected/*/exp1/los/processed/radars/77_ghz/processed_image.pkl")).unlink()
    next(data.glob("074*/robot_collected/*/exp1/nlos/processed/radars/77_ghz/*image.pkl")).write_bytes(b"none")
    found = run(data, tmp_path, "box")
    assert len({one.scene for one in found.rows}) == 2
    assert [name for name, _ in found.failures] == ["073-a_lego_duplo/0_0_0/exp1/los", "074-x_wide/0_0_0/exp1/nlos"]
    assert "no image at 77 GHz" in found.failures[0][1]


@pytest.mark.slow
@pytest.mark.usefixtures("untimed")
def test_where_no_mask_is_found_only_the_true_one_is_classified(data, tmp_path, monkeypatch):
    def none(*_, **__):
        raise InputError("every mask is too large")

    monkeypatch.setattr(classification, "segment", none)
    found = run(data, tmp_path, "box")
    assert len({one.scene for one in found.rows}) == Fake.runs == 4
    for predicted, true in zip(found.rows[::2], found.rows[1::2], strict=True):
        assert (predicted.prediction, predicted.failure, predicted.iou) == (None, "every mask is too large", 0)
        assert true.label == "box"
    again = run(data, tmp_path, "box")
    assert again.cached == 4
    assert all(one.prediction is None for one in again.rows[::2])


def test_masks_are_of_the_image_that_is_classified(data):
    source = sources(data, "box")[0]
    image, other, truth = source.read()
    mask, why = source.predict(image, other)
    exact = inside(BLOCKS["073-a_lego_duplo"])
    assert why == ""
    assert image.grid.xy.shape == mask.inside.shape == truth.inside.shape
    assert (truth.inside & exact).sum() / (truth.inside | exact).sum() > 0.8
    assert (mask.inside & exact).sum() / (mask.inside | exact).sum() > 0.3
    assert source.scene.images[HIGH].path.exists()


def test_times_are_of_classification_and_segmentation_once_warm(data, monkeypatch):
    ticks = iter(np.arange(100.0) ** 2)
    monkeypatch.setattr(classification, "perf_counter", lambda: next(ticks))
    # Between the ticks n and n + 1 lie 2 n + 1 seconds; the first six are the warm-up's.
    assert classification.time_classifiers(["box", "can"], sources(data, "box")[:2]) == {
        "box": [(17, 13), (29, 25)], "can": [(21, 13), (33, 25)]
    }  # fmt: skip


class TestOrigins:
    def test_of_what_was_not_generated_nothing_is_known(self, data):
        dataset = ms.datasets.open(data)
        found = origins(dataset, find_scenes(dataset))
        assert len(found) == 4
        assert set(found.values()) == {("unknown", frozenset())}
        assert {files.angles for files in find_scenes(dataset)} == {(0, 0, 0)}

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
        dataset = ms.datasets.open(data)
        found = origins(dataset, find_scenes(dataset))
        assert found[f"{folder}/0_0_0/exp1/los"] == (shape, {12, 76})
        assert found[f"{folder}/0_0_0/exp1/nlos"].seeds == {76}

    def test_a_damaged_manifest_is_said(self, data):
        (data / "manifest.jsonl").write_text('{"format": "millisight dataset manifest", "version": 1, "settings": 3}\n')
        dataset = ms.datasets.open(data)
        with pytest.raises(DamagedFileError, match=r"manifest\.jsonl"):
            origins(dataset, find_scenes(dataset))
