"""`millisight evaluate classification`: an oracle, a constant and a coin through the whole command; leaks refused."""

import csv
import json
import re
import shutil

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from helpers.small_scenes import INFO, make
from helpers.some_answers import NAMES, prediction
from millisight.cli.evaluate import classification
from millisight.core.errors import InputError, MillisightError
from millisight.datasets import Manifest, write_manifest
from millisight.evaluation import ClassificationTask
from millisight.evaluation.tasks import _candidates as candidates

LEARNED = {"fork": [[0, 0, 90]], "a_cups": [[0, 0, 0]]}
TOLD = {
    "sha256": "1", "parts": "both", "network": "small", "seed": 3, "physics": "paper's simulator: point reflectors",
    "objects": {"training": ["fork"], "validation": ["a_cups"]}, "poses": LEARNED, "classes": {"can": ["wide"]},
}  # fmt: skip
KNOWN = {"training": ["fork", "a_lego_duplo"], "validation": ["a_cups"]}
DESCRIPTIONS = {
    "oracle": TOLD,
    "constant": {**TOLD, "sha256": "2", "parts": "edge"},
    "coin": {**TOLD, "sha256": "3", "network": "paper"},
    "known": {**TOLD, "sha256": "4", "objects": KNOWN, "poses": {**LEARNED, "a_lego_duplo": [[0, 0, 45]]}},
    "posed": {**TOLD, "sha256": "5", "objects": KNOWN, "poses": {**LEARNED, "a_lego_duplo": [[0, 0, 359.5]]}},
    "seeded": {**TOLD, "seed": 76},
    "rig": {**TOLD, "physics": "By hand: the same"},
    "silent": {"sha256": "6"},
    "blind": {**TOLD, "classes": {}},
}


class Fake:
    """The long block is a box, and the square one a can: by the true mask alone; told by the weights' name."""

    class_names, bands = NAMES, ("77_ghz", "24_ghz")

    def __init__(self, weights):
        self.kind = str(weights).rpartition("/")[2].partition(".")[0]
        self.name, self.description = "mine", DESCRIPTIONS[self.kind]

    def classify(self, image, mask, *, other_band=None):
        wide, deep = (np.ptp(np.flatnonzero(mask.inside.any(axis=n))) + 1 for n in (1, 0))
        if self.kind == "constant":
            return prediction("box", 0.4)
        if self.kind == "coin":
            return prediction(NAMES[int(mask.inside.sum()) % 4], 0.6)
        return prediction("box" if wide > 1.6 * deep else "can", 1.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole") / "data")


@pytest.fixture
def work(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(candidates, "classifier", Fake)
    candidates._loaded.cache_clear()
    shutil.copytree(whole, tmp_path / "data")
    yield tmp_path
    candidates._loaded.cache_clear()


@pytest.fixture
def plain(monkeypatch):
    """Without pictures: they take as long as the rest, and other tests ask for them."""
    monkeypatch.setattr(ClassificationTask, "figures", lambda *_: ())


def run(work, *options, weights=("oracle",)):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(classification)
    arguments = [str(work / "data"), "-o", str(work / "out"), "--workers", "1", "--method", "classical", *options]
    for name in weights:
        arguments += ["--weights", str(work / name / f"{name}.onnx")]
    return CliRunner().invoke(app, arguments)


def rows(work, name):
    with open(work / "out" / f"{name}.csv", newline="") as file:
        return list(csv.DictReader(file))


def without_marks(work):
    for path in (work / "data").rglob("experiment_info.json"):
        path.write_text(json.dumps({key: value for key, value in INFO.items() if key not in ("simulated", "physics")}))


@pytest.mark.slow
def test_an_oracle_a_constant_and_a_coin(work):
    done = run(work, "--truth", "exact", "--mistakes", "2", weights=("oracle", "constant", "coin"))
    assert done.exit_code == 0, done.output
    kinds = ("", "-true-masks", "-pairs", "-shapes", "-objects", "-mistakes", "-calibration")
    tables = ["classifiers", "times", "answers", "confusions", "reliability", *(f"object-disjoint{k}" for k in kinds)]
    pictures = [
        "accuracy-object-disjoint",
        "reliability-object-disjoint",
        *(f"confusion-object-disjoint-{n}" for n in (1, 2, 3)),
        *(f"mistakes-object-disjoint-{n}" for n in (2, 3)),
    ]
    names = {path.name for path in (work / "out").iterdir()} - {
        "mistakes-object-disjoint-1.png",
        "mistakes-object-disjoint-1.svg",
    }
    assert names == {"index.html", "classification.md", "answers", *(f"{name}.csv" for name in tables),
                     *(f"{name}.{suffix}" for name in pictures for suffix in ("png", "svg"))}  # fmt: skip

    true = rows(work, "object-disjoint-true-masks")
    assert [row["classifier"] for row in true] == ["mine, both, small", "mine, edge", "mine, both, paper"]
    assert true[0]["overall [%]"] == "100.0 (51.0 to 100.0) [100.0 to 100.0]"
    assert true[1]["overall [%]"] == "50.0 (15.0 to 85.0) [0.0 to 100.0]"
    assert [row["overall images"] for row in true] == ["4", "4", "4"]
    main = rows(work, "object-disjoint")
    assert [row["classifier"] for row in main[3:]] == ["paper: its real data"] * 3
    assert {row["object-disjoint images"] for row in rows(work, "classifiers")} == {"4"}

    pairs = {(row["masks"], row["sight"], row["second"]): row for row in rows(work, "object-disjoint-pairs")}
    assert len(pairs) == 2 * 3 * 2  # the oracle and the constant each against those after them, by the second's name
    found = pairs["true", "overall", "mine, edge"]
    assert (found["only first right"], found["only second right"], found["p, McNemar"]) == ("2", "0", "0.5")

    sure = {(row["classifier"], row["sight"]): row for row in rows(work, "object-disjoint-calibration")}
    assert sure["mine, edge", "overall"]["not sure [%]"] == "100.0"
    assert sure["mine, both, paper", "overall"]["not sure [%]"] == "0.0"
    answers = rows(work, "answers")
    assert len(answers) == 3 * 4 * 2
    assert {row["shape"] for row in answers} == {"unknown"}

    text, page = ((work / "out" / name).read_text() for name in ("classification.md", "index.html"))
    assert len(re.findall(r"^### .*", text, re.M)) == 9
    for heading in re.findall(r"^### .*", text, re.M):
        assert heading.endswith("data (virtual rig, by hand; simulated, not real data)")
    assert "Nothing was measured" in text
    assert page.count("simulated, not real data") >= 9
    assert page.count("<img") == len(pictures) + (work / "out/mistakes-object-disjoint-1.png").exists()
    assert "paper: its real data" in done.output
    assert "classical" in done.output


@pytest.mark.slow
def test_known_and_new_objects_stand_in_tables_of_their_own(work):
    done = run(work, "--truth", "exact", weights=("known", "oracle"))
    assert done.exit_code == 0, done.output
    answers = rows(work, "answers")
    where = {(row["classifier"], row["object"]): row["split"] for row in answers}
    assert where == {
        ("mine, both, small, known", "a_lego_duplo"): "object-closed",
        ("mine, both, small, known", "wide"): "object-disjoint",
        ("mine, both, small, oracle", "a_lego_duplo"): "object-disjoint",
        ("mine, both, small, oracle", "wide"): "object-disjoint",
    }
    assert [row["overall images"] for row in rows(work, "object-closed-true-masks")] == ["2"]
    assert [row["overall images"] for row in rows(work, "object-disjoint-true-masks")] == ["2", "4"]
    assert not (work / "out/object-closed-pairs.csv").exists()


def test_answers_are_among_the_classes_that_are_asked_for(work, plain):
    done = run(work, "--truth", "exact", "--classes", "box, sphere", weights=("oracle", "constant"))
    assert done.exit_code == 0, done.output
    answers = [row for row in rows(work, "answers") if row["masks"] == "true"]
    assert {row["object"] for row in answers} == {"a_lego_duplo"}  # the other is a can
    assert {row["answer"] for row in answers} == {"box"}
    assert {round(float(row["p(sphere)"]), 9) for row in answers if row["classifier"] == "mine, edge"} == {0.333333333}
    # In a mask that is as wide as deep the oracle is certain of a can: of neither class, and wrong.
    (ruled_out,) = {(row["answer"], row["right"], row["failure"]) for row in rows(work, "answers") if row["failure"]}
    assert ruled_out == ("no mask", "0", "box, sphere: together of probability 0; name other classes")


def test_images_in_poses_of_training_are_left_out_and_counted(work, plain):
    done = run(work, "--mistakes", "0", weights=("posed",))
    assert done.exit_code == 0, done.output
    (row,) = rows(work, "classifiers")
    assert (row["left out: in a pose of training"], row["object-closed images"], row["object-disjoint images"]) == (
        "2", "0", "2"
    )  # fmt: skip
    assert {row["object"] for row in rows(work, "answers")} == {"wide"}


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        ("seeded", "was trained with the seed 76, which the test images were made with"),
        ("rig", "images of the same physics as the test images, 'by hand'"),
        ("silent", "does not state the objects, poses, seed and physics of its training"),
    ],
)
def test_leaks_are_refused_before_the_work(work, weights, said):
    write_manifest(work / "data", Manifest(settings={"seed": 76}, entries={}))
    done = run(work, weights=("oracle", weights))
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)
    assert not (work / "out").exists()


def test_what_tests_nothing_is_refused(work):
    done = run(work, "--object", "073-a_lego_duplo", weights=("posed",))
    assert isinstance(done.exception, InputError)
    said = "no image to test on. Left out of mine, which knows can, handle, box, sphere: 2 {}"
    assert str(done.exception).endswith(said.format("in a pose of training (a_lego_duplo)"))
    done = run(work, "--object", "074-x_wide", weights=("blind",))
    assert said.format("of no class that it knows (wide); state the class of an object of your own") in str(
        done.exception
    )


def test_the_class_of_an_own_object_is_the_datasets(work, plain):
    info = work / "data/074-x_wide/robot_collected/0_0_0/exp1/experiment_info.json"
    info.write_text(json.dumps({**INFO, "class": "can"}))
    done = run(work, "--object", "074-x_wide", "--truth", "exact", "--mistakes", "0", weights=("blind",))
    assert done.exit_code == 0, done.output
    answers = rows(work, "answers")
    assert {(row["object"], row["truth"], row["split"]) for row in answers} == {("wide", "can", "object-disjoint")}
    info.write_text(json.dumps({**INFO, "class": 3}))
    done = run(work, "--object", "074-x_wide", weights=("blind",))
    assert done.exit_code == 1


@pytest.mark.slow
@pytest.mark.parametrize("physics", [" ", None, "rays"])
def test_unknown_physics_of_the_images_is_told(work, plain, physics):
    for path in (work / "data").rglob("experiment_info.json"):
        path.write_text(json.dumps({**INFO, "physics": physics}))
    done = run(work, "--mistakes", "0")
    assert done.exit_code == 0, done.output
    text = (work / "out/classification.md").read_text()
    told = physics if physics == "rays" else "simulated"
    assert f"data (virtual rig, {told}; simulated, not real data)" in text
    said = "mine: whether the physics of the test images is other than that of training is unknown"
    assert said in text
    assert said in done.output


@pytest.mark.slow
def test_it_goes_on_where_it_stopped_and_a_damaged_scene_stops_no_other(work):
    image = work / "data/073-a_lego_duplo/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image.pkl"
    content = image.read_bytes()
    image.write_bytes(b"no pickle")
    done = run(work, "--mistakes", "0")
    assert done.exit_code == 1
    assert "failed: 1" in done.stderr
    assert "073-a_lego_duplo/0_0_0/exp1/los: " in done.stderr
    assert len(rows(work, "answers")) == 3 * 2
    image.write_bytes(content)
    (work / "data/074-x_wide/robot_collected/0_0_0/exp1/experiment_info.json").unlink()
    done = run(work, "--mistakes", "0")
    assert done.exit_code == 1
    assert "failed: 2" in done.stderr  # who made them is not known
    assert "1 results came from an earlier run" in done.output
    assert {row["object"] for row in rows(work, "answers")} == {"a_lego_duplo"}


@pytest.mark.slow
def test_data_not_marked_as_simulated_are_not_called_so(work, plain):
    without_marks(work)
    done = run(work, "--transform", "file", "--mistakes", "0")
    assert done.exit_code == 0, done.output
    text = (work / "out/classification.md").read_text()
    assert "data (not marked as simulated)" in text
    assert "virtual rig" not in text
    # By default with the published constants, which experiment 1's files here do not go with.
    failed = run(work, "--mistakes", "0")
    assert failed.exit_code == 1
    assert "failed: 4" in failed.stderr


def test_simulated_and_other_scenes_are_not_thrown_together(work):
    path = next((work / "data").rglob("experiment_info.json"))
    path.write_text(json.dumps({key: value for key, value in INFO.items() if key != "simulated"}))
    done = run(work)
    assert isinstance(done.exception, InputError)
    assert "evaluate them separately" in str(done.exception)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--sight", "both"), "unknown --sight 'both'"),
        (("--crop", "1"), "two whole numbers such as 12,7"),
        (("--object", "cup"), "unknown object 'cup'"),
        (("--method", "magic"), "unknown segmenter 'magic'"),
        (("--classes", "can,teapot"), "unknown class of mine 'teapot'"),
    ],
)
def test_what_is_wrong_is_said_before_the_work(work, options, said):
    done = run(work, *options)
    assert isinstance(done.exception, MillisightError)
    assert said in str(done.exception)
    assert not (work / "out").exists()
