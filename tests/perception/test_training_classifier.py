"""Classifiers from recipes: what is trained on and what not, the same weights again, calibrated answers."""

import dataclasses
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from helpers.whole_scenes import PLAIN
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError, UnknownNameError
from millisight.data import Mask, SarImage, VoxelGrid
from millisight.meshes import CATALOGUE, PUBLISHED_CLASSES
from millisight.perception import read_description
from millisight.perception.classification import CLASSIFIER_CHANNELS, CLASSIFIER_WEIGHTS, NetworkClassifier
from millisight.perception.training import ClassifierRecipe, Schedule, TrainingScene, make_scenes, train
from millisight.perception.training._calibration import (
    answer_scores,
    area_under_curve,
    best_temperature,
    best_threshold,
    calibration_of,
    cross_entropy,
    novelty_scores,
    scaled,
    weights_of,
)
from millisight.perception.training._classifier_examples import balanced, example_aside, example_of

EXAMPLES = Path(__file__).parents[2] / "examples"

COARSE = {"vertices": 200, "positions": 400, "scenes": 2, "whole": PLAIN}
TWO = {"box": ("dice",), "sphere": ("golf_ball",)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def recipe():
    return ClassifierRecipe(classes=TWO, batch=2, examples=6, schedule=Schedule(epochs=2, seed=1), **COARSE)


@pytest.fixture(scope="module")
def examples(recipe, folder):
    return make_scenes(recipe, folder)


@pytest.mark.slow
def test_processes_make_the_same_scenes_and_raise_the_same_errors(recipe, examples, folder, tmp_path):
    made = make_scenes(recipe, tmp_path, workers=2)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {
        path.name: path.read_bytes() for path in folder.iterdir()
    }
    for one, other in zip(made["training"], examples["training"], strict=True):
        assert (one.name, one.label) == (other.name, other.label)
        assert np.array_equal(one.whole.objects, other.whole.objects)
    for path in tmp_path.glob("dice-*"):
        path.write_bytes(b"half")
    with pytest.raises(DamagedFileError, match="dice-"):
        make_scenes(recipe, tmp_path, workers=2)
    with pytest.raises(InputError, match="workers"):
        make_scenes(recipe, tmp_path, workers=0)


def test_classes_are_the_papers_four_without_what_is_left_out():
    recipe = ClassifierRecipe(without=("dice", "apple"))
    assert list(recipe.objects) == ["can", "handle", "box", "sphere"]
    named = [name for names in recipe.objects.values() for name in names]
    assert len(named) == 42 == len(set(named))
    assert {CATALOGUE[name].shape_class for name in named} == set(recipe.objects)
    assert not {"dice", "apple"} & set(named)
    scenes = recipe.scene_settings("can")
    assert (len(scenes), {how.poses for how in scenes.values()}) == (5, {20})  # 5 cans share 96 scenes
    assert {how.stretch for how in scenes.values()} == {0.25}
    drawn = ClassifierRecipe(without=("dice", "apple"), drawn=7).scene_settings("can")
    assert set(drawn) - set(scenes) == {"any_can"}
    assert (drawn["any_can"].poses, drawn["any_can"].stretch) == (7, 0)
    things = ClassifierRecipe(without=("dice", "apple"), household=9).scene_settings("can")
    assert set(things) - set(scenes) == {"household_can"}
    assert (things["household_can"].poses, things["household_can"].stretch) == (9, 0)


def test_the_page_names_every_key_of_a_recipe():
    page = (EXAMPLES.parent / "docs/how-to/train-classifier.md").read_text(encoding="utf-8")
    keys = {one.name for one in dataclasses.fields(ClassifierRecipe)}
    assert {key for key in keys if not re.search(rf"^\|.*`{key}[`.]", page, re.MULTILINE)} == set()


def test_shapes_that_judge_are_for_validation_alone():
    recipe = ClassifierRecipe(classes={"sphere": ("apple",), "other": ("bowl",)}, scenes=6, drawn=6, odd=6, judged=3)

    def asked(recipe):
        return [(one.side, one.name, one.number) for one in recipe.scene_requests()]

    without = asked(dataclasses.replace(recipe, judged=0))
    assert [one for one in asked(recipe) if one not in without] == [
        ("validation", name, number) for name in ("any_sphere", "any_other", "any_odd") for number in (6, 7, 8)
    ]
    assert [one for one in asked(recipe) if one in without] == without
    things = dataclasses.replace(recipe, drawn=0, odd=0, household=4)
    assert [one for one in asked(things) if one[1].startswith("household")] == [
        (side, name, number)
        for name in ("household_sphere", "household_other")
        for number, side in enumerate(["training", "validation", "training", "training", *["validation"] * 3])
    ]


def test_odd_shapes_are_further_scenes_of_the_class_other():
    recipe = ClassifierRecipe(classes={"sphere": ("apple", "plum"), "other": ("bowl",)}, drawn=2, odd=12)
    assert set(recipe.scene_settings("sphere")) == {"apple", "plum", "any_sphere"}
    odd = recipe.scene_settings("other")
    assert (odd["any_other"].poses, odd["any_odd"].poses, odd["any_odd"].stretch) == (2, 12, 0)
    requests = [one for one in recipe.scene_requests() if one.name == "any_odd"]
    assert {one.label for one in requests} == {1}
    assert sum(one.side == "validation" for one in requests) == 2


@pytest.mark.parametrize(
    ("wrong", "kind", "told"),
    [
        ({"classes": {"box": ("dice",)}}, InputError, "at least two"),
        ({"classes": {"box": ("dice",), "sphere": ()}}, InputError, "no object is left for the class 'sphere'"),
        ({"classes": TWO, "without": ("dice",)}, InputError, "no object is left for the class 'box'"),
        ({"classes": {"box": ("dice",), "cube": ("dice",)}}, InputError, "dice is named more than once"),
        ({"classes": {"box": "dice", "sphere": ("plum",)}}, InputError, "box is 'dice'; expected a list"),
        ({"classes": {"box": ("dicee",), "sphere": ("plum",)}}, UnknownNameError, "dicee"),
        ({"without": ("dicee",)}, UnknownNameError, "dicee"),
        ({"parts": "diffuse"}, UnknownNameError, "diffuse"),
        ({"network": "large"}, UnknownNameError, "large"),
        ({"scenes": 0}, InputError, "scenes is 0"),
        ({"drawn": -1}, InputError, "drawn is -1"),
        ({"household": -1}, InputError, "household is -1"),
        ({"odd": -1}, InputError, "odd is -1"),
        ({"normalisation": "layer"}, UnknownNameError, "layer"),
        ({"renewed": 1}, InputError, "renewed is of type int; expected bool"),
        ({"judged": -1}, InputError, "judged is -1"),
        ({"odd": 1}, InputError, "odd is 1, and odd shapes are of the class 'other', which classes lacks; add it"),
        ({"classes": {"cube": ("dice",), "sphere": ("plum",)}, "drawn": 1}, InputError, "'cube' is none"),
    ],
)
def test_recipes_that_cannot_be(wrong, kind, told):
    with pytest.raises(kind, match=told):
        ClassifierRecipe(**wrong)


@pytest.mark.slow
def test_some_scenes_of_each_object_are_held_back(examples):
    assert {side: [(one.name, one.label) for one in some] for side, some in examples.items()} == {
        side: [("dice", 0), ("golf_ball", 1)] for side in ("training", "validation")
    }


def test_an_example_follows_from_its_generator_and_from_the_parts(examples, recipe):
    scene = examples["training"][0].whole
    made = example_of(scene, np.random.default_rng(4))
    np.testing.assert_array_equal(made, example_of(scene, np.random.default_rng(4)))
    assert made.shape == (13, 80, 80)
    shown = [example_of(scene, np.random.default_rng(seed))[-1].any() for seed in range(30)]
    assert 10 < sum(shown) < 30  # of some there is no other band


@pytest.mark.slow
def test_masks_that_the_segmenter_finds_are_learned_from(recipe, examples):
    pytest.importorskip("onnxruntime")
    asked = []

    def by(scene, *, both):
        asked.append(both)
        return None if len(asked) % 2 else np.roll(scene.objects > 0, 3, axis=0)

    scene = examples["training"][0].whole
    made = [example_of(scene, np.random.default_rng(seed), by) for seed in range(40)]
    assert 15 < len(asked) < 35
    assert set(asked) == {False, True}
    assert len({one[0].tobytes() for one in made}) > 30
    lesson = dataclasses.replace(recipe, masks="shipped").lesson(examples)
    again = dataclasses.replace(recipe, masks="shipped").lesson(examples)
    assert all((a.channels == b.channels).all() for a, b in zip(lesson.pool(0), again.pool(0), strict=True))
    plain = recipe.lesson(examples)
    assert any((a.channels != b.channels).any() for a, b in zip(lesson.pool(0), plain.pool(0), strict=True))


@pytest.mark.slow
def test_every_epoch_has_the_same_examples_or_new_ones(recipe, examples):
    kept, renewed = recipe.lesson(examples), dataclasses.replace(recipe, renewed=True).lesson(examples)
    assert kept.pool(1) is kept.pool(0)
    first, second = ([one.channels.tobytes() for one in renewed.pool(epoch)] for epoch in (0, 1))
    assert not set(first) & set(second)
    assert [one.channels.tobytes() for one in renewed.pool(0)] == first


def test_images_of_other_bands_are_refused_where_they_tell_theirs():
    pytest.importorskip("onnxruntime")
    grid = VoxelGrid(x=0.004 * np.arange(30), y=0.004 * np.arange(30), z=0.0125 * np.arange(6))
    values = np.zeros(grid.shape, np.complex64)
    values[10:20, 10:20, 2] = 1
    mask, by = Mask(grid_xy=grid.xy, inside=abs(values).max(axis=2) > 0), NetworkClassifier()

    def of(frequency):
        history = [{"step": "form_image", "frequency": frequency}] if frequency else []
        return SarImage(grid=grid, values=values, metadata={"history": history})

    for frequency, other in ((None, None), (79e9, 24.1e9), (77.5e9, None)):
        assert by.classify(of(frequency), mask, other_band=other and of(other)).class_names
    with pytest.raises(InputError, match=r"the image is of 24.1 GHz.*trained on 79 GHz, with or without 24 GHz"):
        by.classify(of(24.1e9), mask)
    with pytest.raises(InputError, match=r"other_band is of 79 GHz"):
        by.classify(of(79e9), mask, other_band=of(79e9))


def test_every_class_has_its_turn_and_so_has_every_scene():
    drawn = [
        TrainingScene(name, label, np.zeros(3), None)
        for name, label in (("a", 0), ("b", 0), ("c", 0), ("d", 1), ("any_box", 1))
    ]
    order = balanced(drawn, 40, np.random.default_rng(0))
    counts = [order.count(i) for i in range(len(drawn))]
    assert (sum(counts[:3]), counts[3:]) == (20, [10, 10])
    assert set(counts[:3]) == {6, 7}


@pytest.mark.slow
def test_shapes_drawn_at_random_are_scenes_of_their_own_and_no_objects(recipe, folder, tmp_path):
    pytest.importorskip("torch")
    drawn = dataclasses.replace(recipe, drawn=2)
    examples = make_scenes(drawn, folder)
    assert [one.name for one in examples["training"]] == ["dice", "any_box", "golf_ball", "any_sphere"]
    assert [one.label for one in examples["training"]] == [0, 0, 1, 1]
    sizes = [(one.whole.objects > 0).sum() for some in examples.values() for one in some if one.name == "any_box"]
    assert sizes[0] != sizes[1]
    told = train(drawn, examples, tmp_path).description
    assert told["objects"]["training"] == ["dice", "golf_ball"] == list(told["poses"])
    assert (told["scenes"], told["drawn"]) == ({"training": 4, "validation": 4}, {"training": 2, "validation": 2})


@pytest.mark.slow
def test_what_is_of_no_class_is_learned_as_one_class_more(recipe, folder, tmp_path):
    pytest.importorskip("torch")
    novel = dataclasses.replace(recipe, novel=8)
    requests = [one for one in novel.scene_requests() if one.label == 2]
    assert {(one.side, one.name) for one in requests} == {
        (side, name) for side in ("training", "validation") for name in ("nothing there", "sparse scan")
    }
    sparse = {one.settings.positions for one in requests if one.name == "sparse scan"}
    assert sparse == {400, 250}  # the recipe's own are few
    examples = make_scenes(novel, folder)
    for some in examples.values():
        seen = {one.name: one.whole.objects.any() for one in some}
        assert (seen["nothing there"], seen["sparse scan"]) == (False, True)
    trained = train(novel, examples, tmp_path)
    told = trained.description
    assert told["class_names"] == ["box", "sphere"]
    assert told["novel"] == {"training": 6, "validation": 2}
    assert set(told["novelty"]["auroc"]) == {"nothing there", "sparse scan", "mask beside the object"}
    assert told["objects"]["training"] == ["dice", "golf_ball"] == list(told["poses"])
    pytest.importorskip("onnxruntime")
    by = NetworkClassifier(trained.weights)
    grid = VoxelGrid(x=0.004 * np.arange(30), y=0.004 * np.arange(30), z=0.0125 * np.arange(6))
    values = np.zeros(grid.shape, np.complex64)
    values[10:20, 10:20, 2] = 1
    image = SarImage(grid=grid, values=values)
    mask = Mask(grid_xy=grid.xy, inside=abs(values).max(axis=2) > 0)
    answer = by.classify(image, mask)
    assert len(answer.probabilities) == 2
    assert 0 < answer.novelty < 1
    assert answer.novelty_limit == told["novelty"]["limit"]
    assert told["never_sure"] == []
    assert answer.threshold < 1
    told = {**told, "sha256": by.description["sha256"]}
    (tmp_path / "classifier.json").write_text(json.dumps({**told, "never_sure": [answer.label]}))
    unproven = NetworkClassifier(trained.weights).classify(image, mask)
    assert (unproven.label, unproven.threshold, unproven.sure) == (answer.label, 1, False)
    damaged = {**told, "novelty": {"limit": 3}}
    (tmp_path / "classifier.json").write_text(json.dumps(damaged))
    with pytest.raises(DamagedFileError, match="expected a table with a limit"):
        NetworkClassifier(trained.weights)


def test_a_mask_set_aside_covers_no_object(examples):
    scene = examples["training"][0].whole
    made = example_aside(scene, np.random.default_rng(4))
    np.testing.assert_array_equal(made, example_aside(scene, np.random.default_rng(4)))
    true = example_of(scene, np.random.default_rng(4))
    assert made[0].any()
    assert not np.array_equal(made[1], true[1])


def test_the_area_under_the_curve_counts_pairs():
    rng = np.random.default_rng(0)
    low, high = rng.integers(0, 9, 40) / 9.0, rng.integers(3, 12, 30) / 9.0
    pairs = [(a < b) + (a == b) / 2 for a in low for b in high]
    assert area_under_curve(low, high) == pytest.approx(np.mean(pairs), rel=1e-12)
    shown = ["dice"] * 40 + ["nothing there"] * 30
    told = novelty_scores(np.concatenate([low, high]), shown, np.arange(70) < 40)
    assert told["auroc"] == {"nothing there": pytest.approx(np.mean(pairs), abs=1e-4)}
    assert (low <= told["limit"]).mean() >= 0.95
    assert told["refused"]["nothing there"] == pytest.approx((high > told["limit"]).mean(), abs=1e-4)


def test_temperature_makes_confidence_honest():
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 2, (4000, 3))
    probabilities = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    labels = np.array([rng.choice(3, p=p) for p in probabilities])
    assert best_temperature(logits, labels) == pytest.approx(1, abs=0.06)
    assert best_temperature(5 * logits, labels) == pytest.approx(5, rel=0.06)
    assert cross_entropy(logits, labels).mean() == pytest.approx(
        -np.log(probabilities[np.arange(4000), labels]).mean(), rel=1e-9
    )


def test_from_the_threshold_on_answers_are_right():
    confidence = np.array([0.99, 0.97, 0.9, 0.8, 0.7, 0.6])
    logits = np.log(np.stack([confidence, 1 - confidence], axis=1))
    assert best_threshold(logits, np.zeros(6, int)) == pytest.approx(0.6)
    assert best_threshold(logits, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(0.9)
    assert best_threshold(logits, np.array([1, 1, 1, 1, 1, 1])) == pytest.approx(0.99)


def test_what_lay_under_sheets_is_calibrated_apart():
    rng = np.random.default_rng(1)
    covered = np.arange(400) < 200
    labels = rng.integers(0, 2, 400)
    right = np.where(covered, rng.random(400) < 0.7, rng.random(400) < 0.95)
    logits = 2.0 * (np.eye(2)[np.where(right, labels, 1 - labels)])
    apart = calibration_of(logits, labels, covered, np.arange(400))
    assert set(apart) == {"open", "covered"}
    assert apart["covered"]["temperature"] > 1.5 * apart["open"]["temperature"]
    assert set(calibration_of(logits, labels, np.arange(400) < 99, np.arange(400))) == {
        "open"
    }  # too few for one of their own


def test_answers_count_as_often_as_their_class_occurs():
    labels = np.array([0, 0, 0, 1])
    prior = np.array([0.2, 0.8])
    np.testing.assert_allclose(weights_of(labels, prior), [0.2 / 3, 0.2 / 3, 0.2 / 3, 0.8])
    np.testing.assert_array_equal(weights_of(labels, None), np.ones(4))
    logits = np.log([[0.9, 0.1], [0.9, 0.1], [0.1, 0.9], [0.1, 0.9]])
    assert answer_scores(logits, labels)["accuracy"] == 0.75
    assert answer_scores(logits, labels, weights_of(labels, prior))["accuracy"] == pytest.approx(
        0.4 / 3 + 0.8, abs=1e-4
    )


def test_what_is_calibrated_for_a_prior_holds_where_classes_occur_so():
    rng = np.random.default_rng(3)
    prior = np.array([0.1, 0.9])
    # One feature, a unit normal about +1 or -1 by class: its log likelihood ratio is 2 x.
    labels = rng.integers(0, 2, 20_000)
    logits = 3.0 * np.stack([rng.normal(np.where(labels == 0, 1.0, -1.0)) * 2, np.zeros(20_000)], axis=1)
    temperature = best_temperature(logits, labels, prior)
    assert temperature == pytest.approx(3, rel=0.05)
    answers, weights = scaled(logits, temperature, prior), weights_of(labels, prior)
    threshold = best_threshold(answers, labels, weights=weights)
    probabilities = np.exp(answers - np.logaddexp.reduce(answers, axis=1, keepdims=True))
    sure = probabilities.max(axis=1) >= threshold
    right = probabilities.argmax(axis=1) == labels
    assert np.average(right[sure], weights=weights[sure]) == pytest.approx(0.95, abs=0.01)
    apart = calibration_of(logits, labels, np.arange(20_000) % 2 == 0, np.arange(20_000), prior)
    assert {kind: one["temperature"] for kind, one in apart.items()} == pytest.approx(
        {"open": temperature, "covered": temperature}, rel=0.06
    )


def test_an_image_whose_lid_was_brightest_has_the_calibration_of_such(monkeypatch):
    pytest.importorskip("onnxruntime")
    grid = VoxelGrid(x=0.004 * np.arange(30), y=0.004 * np.arange(30), z=0.0125 * np.arange(6))
    values = np.zeros(grid.shape, np.complex64)
    values[10:20, 10:20, 2] = 1
    lid = values.copy()
    lid[..., 5] = 3
    taken = {"history": [{"step": "remove_sheets", "taken_db": -9.5}]}
    mask = Mask(grid_xy=grid.xy, inside=abs(values).max(axis=2) > 0)
    plain, under = SarImage(grid=grid, values=values), SarImage(grid=grid, values=lid)
    cleaned = SarImage(grid=grid, values=values, metadata=taken)
    where = "millisight.perception.classification._network.without_sheets"
    monkeypatch.setattr(where, lambda image, **_: cleaned if image is under else image)
    by = NetworkClassifier()
    thresholds = {kind: by.description["calibration"][kind]["threshold"] for kind in ("open", "covered")}
    assert thresholds["open"] != thresholds["covered"]
    assert by.classify(plain, mask).threshold == thresholds["open"]
    assert by.classify(under, mask).threshold == thresholds["covered"]
    # The same where the lid was taken off before, from the image or from the frames.
    assert by.classify(cleaned, mask).threshold == thresholds["covered"]
    frames = SarImage(grid=grid, values=values, metadata={"history": [{"step": "remove_sheets"}]})
    assert by.classify(frames, mask).threshold == thresholds["covered"]


@pytest.mark.slow
def test_members_learn_from_shares_of_a_batch_and_answer_by_their_mean(examples, recipe, tmp_path):
    torch = pytest.importorskip("torch")
    ort = pytest.importorskip("onnxruntime")
    from safetensors.torch import load_file

    several = dataclasses.replace(recipe, members=2)
    trained = train(several, examples, tmp_path)
    assert trained.description["members"] == 2
    network = several.lesson(examples).network()
    network.load_state_dict(load_file(trained.weights.with_suffix(".safetensors")))
    rng = np.random.default_rng(4)
    channels = torch.from_numpy(np.stack([example_of(one.whole, rng) for one in 2 * examples["training"]]))
    with torch.no_grad():
        network.eval()
        first, second = (one(channels).numpy() for one in network.members)
        for one in network.members:
            one.dropout.p = 0.0
        dealt = network.train()(channels).numpy()
    assert abs(first - second).max() > 1e-3
    np.testing.assert_allclose(dealt, [*first[: len(first) // 2], *second[len(first) // 2 :]], atol=1e-5)
    session = ort.InferenceSession(trained.weights)
    (answered,) = session.run(None, {session.get_inputs()[0].name: channels.numpy()})
    np.testing.assert_allclose(answered, (first + second) / 2, atol=1e-5)


@pytest.mark.slow
def test_what_learns_beside_a_trained_network_answers_with_it_by_their_mean(examples, recipe, tmp_path):
    torch = pytest.importorskip("torch")
    ort = pytest.importorskip("onnxruntime")
    from safetensors.torch import load_file

    former = train(recipe, examples, tmp_path / "former")
    held = former.weights.with_suffix(".safetensors")
    beside = dataclasses.replace(recipe, beside=(str(held),), schedule=Schedule(epochs=2, seed=2))
    trained = train(beside, examples, tmp_path / "both")
    assert trained.description["beside"] == [read_description(former.weights.with_suffix(".json"))["sha256"]]
    assert trained.description["objects"] == former.description["objects"]
    network = beside.lesson(examples).network()
    network.load_state_dict(load_file(trained.weights.with_suffix(".safetensors")))
    # What was trained before is as it was.
    for name, weights in load_file(held).items():
        assert torch.equal(network.state_dict()[f"beside.0.{name}"], weights)
    rng = np.random.default_rng(4)
    channels = torch.from_numpy(np.stack([example_of(one.whole, rng) for one in 2 * examples["training"]]))
    with torch.no_grad():
        network.eval()
        own, other = (one(channels).numpy() for one in (network.members[0], network.beside[0]))
    assert abs(own - other).max() > 1e-2
    session = ort.InferenceSession(trained.weights)
    (answered,) = session.run(None, {session.get_inputs()[0].name: channels.numpy()})
    np.testing.assert_allclose(answered, (own + other) / 2, atol=1e-5)


@pytest.mark.slow
def test_what_cannot_stand_beside_is_refused_before_scenes_are_made(examples, recipe, tmp_path):
    pytest.importorskip("torch")
    former = train(recipe, examples, tmp_path)
    held = str(former.weights.with_suffix(".safetensors"))
    with pytest.raises(InputError, match="beside: class_names of .* expected the recipe's"):
        dataclasses.replace(recipe, classes=dict(reversed(recipe.classes.items())), beside=(held,))
    with pytest.raises(UnknownNameError, match="kind of weights 'classifier.onnx'.*safetensors"):
        dataclasses.replace(recipe, beside=(str(former.weights),))
    with pytest.raises(FileError, match="no such file"):
        dataclasses.replace(recipe, beside=(str(tmp_path / "absent.safetensors"),))
    with pytest.raises(InputError, match="beside: network of .* is small; expected the recipe's, paper"):
        dataclasses.replace(recipe, network="paper", beside=(held,))
    batches = dataclasses.replace(recipe, normalisation="batch", beside=(held,))
    with pytest.raises(FormatError, match="other weights than the recipe's network has"):
        batches.lesson(examples).network()
    former.weights.with_suffix(".safetensors").write_bytes(b"half")
    with pytest.raises(DamagedFileError, match="no complete safetensors file"):
        dataclasses.replace(recipe, beside=(held,)).lesson(examples).network()


@pytest.mark.slow
def test_weights_are_the_same_again_and_resumed_and_run_without_torch(examples, recipe, tmp_path):
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")

    def cut_off(done, total):
        raise KeyboardInterrupt

    first = train(recipe, examples, tmp_path / "a")
    with pytest.raises(KeyboardInterrupt):
        train(recipe, examples, tmp_path / "b", progress=cut_off)
    second = train(recipe, examples, tmp_path / "b")
    for name in ("classifier.onnx", "classifier.json", "classifier.safetensors"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    told = json.loads(second.weights.with_suffix(".json").read_text())
    assert told == {"sha256": told["sha256"], **first.description}
    assert told["objects"] == {"training": ["dice", "golf_ball"], "validation": ["dice", "golf_ball"]}
    assert told["classes"] == {"box": ["dice"], "sphere": ["golf_ball"]}
    assert {name: len(poses) for name, poses in told["poses"].items()} == {"dice": 2, "golf_ball": 2}
    assert told["seed"] == 1
    by = NetworkClassifier(first.weights)
    assert (by.class_names, by.bands) == (("box", "sphere"), ("77_ghz", "24_ghz"))


@pytest.mark.slow
def test_the_papers_network_looks_at_one_projection_alone(examples, tmp_path):
    torch = pytest.importorskip("torch")
    from millisight.perception.training.networks import PaperNetwork, SmallNetwork

    magnitude = CLASSIFIER_CHANNELS.index("magnitude")
    torch.manual_seed(0)
    paper, small = PaperNetwork(4).eval(), SmallNetwork(4).eval()
    convolutions = [layer for layer in paper.modules() if isinstance(layer, torch.nn.Conv2d)]
    assert [(layer.in_channels, layer.out_channels, layer.stride[0]) for layer in convolutions] == [
        (1, 16, 2), (16, 128, 2), (128, 256, 2), (256, 512, 2), (512, 512, 1)
    ]  # fmt: skip
    connected = [layer.out_features for layer in paper.modules() if isinstance(layer, torch.nn.Linear)]
    assert connected == [1024, 512, 256, 4]
    changed = {name: torch.rand(1, len(CLASSIFIER_CHANNELS), 80, 80) for name in "ab"}
    changed["b"][:, magnitude] = changed["a"][:, magnitude]
    with torch.no_grad():
        torch.testing.assert_close(paper(changed["a"]), paper(changed["b"]))
        assert (small(changed["a"]) - small(changed["b"])).abs().max() > 1e-3
    assert len(CLASSIFIER_CHANNELS) == 13


def test_damaged_descriptions_and_other_weights_are_refused(tmp_path):
    pytest.importorskip("onnxruntime")
    told = json.loads(CLASSIFIER_WEIGHTS.with_suffix(".json").read_text())
    (tmp_path / "one.onnx").write_bytes(CLASSIFIER_WEIGHTS.read_bytes())
    for changed, kind, message in (
        ({"channels": ["mask"]}, FormatError, "does not describe a classifier"),
        ({"class_names": ["box"]}, DamagedFileError, "expected lists of names"),
        ({"bands": []}, DamagedFileError, "expected lists of names"),
        ({"temperature": 0}, DamagedFileError, "temperature is 0"),
        ({"temperature": 1e-320}, DamagedFileError, "temperature is 1e-320; expected a number above 1e-06, at most 1e"),
        ({"temperature": 10**400}, DamagedFileError, "does not describe weights: .*a number of 401 digits"),
        ({"threshold": 2}, DamagedFileError, "threshold is 2"),
        ({"never_sure": ["pen"]}, DamagedFileError, "never_sure is .'pen'.; expected a list of classes"),
        ({"never_sure": "can"}, DamagedFileError, "expected a list of classes"),
        ({"sha256": "0" * 64}, DamagedFileError, "its SHA-256 differs"),
    ):
        (tmp_path / "one.json").write_text(json.dumps(told | changed))
        with pytest.raises(kind, match=message):
            NetworkClassifier(tmp_path / "one.onnx")


def test_the_shipped_weights_are_those_of_the_recipe_and_saw_no_test():
    told = json.loads(CLASSIFIER_WEIGHTS.with_suffix(".json").read_text())
    recipe = tomllib.loads((EXAMPLES / "training/classifier.toml").read_text())
    for key, value in recipe.items():
        held = told["recipe"][key]
        assert held == value if not isinstance(value, dict) else held | value == held, key
    split = tomllib.loads((EXAMPLES / "objects.toml").read_text())
    seen = {name for names in told["objects"].values() for name in names}
    assert len(seen) == 23
    assert seen <= set(split["training"])
    assert told["class_names"] == list(PUBLISHED_CLASSES)
    assert told["never_sure"] == ["clamp"]  # all clamps are for tests
    assert set(told["calibration"]) == {"open", "covered"}
    assert told["physics"].startswith("paper's simulator")


def test_an_object_that_was_seen_often_counts_once():
    # One object of eleven is taken for another in all of its twenty answers, the surest.
    confidence = np.concatenate([np.full(20, 0.99), np.linspace(0.9, 0.6, 40)])
    logits = np.log(np.stack([confidence, 1 - confidence], axis=1))
    labels = np.array([1] * 20 + [0] * 40)
    objects = np.array([0] * 20 + list(np.arange(40) % 40 + 1))
    assert best_threshold(logits, labels) == pytest.approx(0.99)  # 40 of 60 are right
    assert best_threshold(logits, labels, objects) == pytest.approx(0.6)  # 40 of 41 are
    assert best_threshold(logits[:25], labels[:25], objects[:25]) == pytest.approx(0.99)  # too few


@pytest.mark.slow
def test_neither_the_rig_nor_torch_is_loaded_where_it_is_not_used():
    code = (
        "import sys, numpy as np\n"
        "from millisight.perception import classification, segmentation, training\n"
        "from millisight.perception.training import _classifier_examples, _segmenter\n"
        "settings = training.SceneSettings(vertices=200, positions=100)\n"
        "parts = training.make_scene('dice', settings, rng=np.random.default_rng(0))\n"
        "whole = training.compose([parts], [], training.WholeSettings(covered=0), np.random.default_rng(1))\n"
        "_classifier_examples.example_of(whole, np.random.default_rng(0))\n"
        "_segmenter.example_of(whole, np.random.default_rng(0))\n"
        "print(classification.CLASSIFIERS.names(), segmentation.SEGMENTERS.names(), training.RECIPES.names())\n"
        "print(sorted(m for m in sys.modules if m.startswith(('millisight.rig', 'millisight.datasets', 'torch'))))\n"
        "print('millisight.simulation._simulate' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[1:3] == ["[]", "True"]
