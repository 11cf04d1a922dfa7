"""`millisight train classifier` on a recipe made in seconds: what it writes, and what its options change."""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest

from helpers.commands import COMMANDS, refused
from millisight.cli.train import classifier
from millisight.core.errors import FormatError
from millisight.datasets.generation import record_from_file
from millisight.evaluation import classes_of, training_of
from millisight.evaluation._answers import DISJOINT
from millisight.evaluation._leaks import side_of
from millisight.meshes import PAPER_CLASSES
from millisight.perception.training import ClassifierRecipe

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGE = Path(__file__).parents[2] / "docs/how-to/train-classifier.md"

TEXT = """
name = "tiny"
batch = 2
examples = 4
scenes = 2
vertices = 200
positions = 400
tests = ["{tests}"]
{extra}
[classes]
{classes}

[whole]
views = 1
sheets = 0

[schedule]
epochs = 1
seed = 1
"""
TWO = 'box = ["dice"]\nsphere = ["golf_ball", "plum"]'


def written(folder, *, extra="", classes=TWO, tests="plum"):
    path = folder / "tiny.toml"
    path.write_text(TEXT.format(extra=extra, classes=classes, tests=tests))
    return path


@pytest.mark.slow
def test_one_command_makes_weights_that_the_options_change(tmp_path, capsys):
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from millisight.perception.classification import NetworkClassifier

    recipe = written(tmp_path, classes='box = ["dice"]\nball = ["golf_ball", "plum"]')
    scenes = tmp_path / "scenes"
    classifier(recipe, tmp_path / "a", scenes=scenes)
    out = capsys.readouterr().out
    assert re.search(r"^1 epoch; \d+\.\d % of the validation scenes right, chance is 50\.0 %$", out, re.MULTILINE)
    assert out.splitlines()[-1] == f"weights: {tmp_path / 'a' / 'classifier.onnx'}"
    assert len(list(scenes.glob("[!w]*"))) == 4
    told = NetworkClassifier(tmp_path / "a" / "classifier.onnx").description
    assert told["objects"]["training"] == ["dice", "golf_ball"]
    assert (told["parts"], told["network"]) == ("both", "small")
    known = classes_of(told, told["class_names"])  # what was left to tests is new, and its class is told
    assert (known["plum"], side_of(training_of("tiny", told), "plum", (0, 0, 30))) == ("ball", DISJOINT)
    shutil.copytree(scenes, tmp_path / "all")
    classifier(recipe, tmp_path / "b", scenes=tmp_path / "all", parts="edge", all_objects=True)
    other = NetworkClassifier(tmp_path / "b" / "classifier.onnx").description
    assert other["objects"]["training"] == ["dice", "golf_ball", "plum"]
    assert other["parts"] == "edge"
    assert other["sha256"] != told["sha256"]


def test_the_class_of_an_object_of_ones_own_is_told_where_it_is_only_tested(tmp_path):
    own = TWO.replace('"plum"', '"gear"')
    recipe = record_from_file(ClassifierRecipe, written(tmp_path, classes=own, tests="gear"))
    assert recipe.objects == {"box": ("dice",), "sphere": ("golf_ball",)}
    assert classes_of({"classes": recipe.every_object}, tuple(recipe.objects))["gear"] == "sphere"
    for tests, unknown in (("plum", "gear"), ("gaer", "gaer")):
        with pytest.raises(FormatError, match=f"unknown catalogue object '{unknown}'"):
            record_from_file(ClassifierRecipe, written(tmp_path, classes=own, tests=tests))


def test_a_recipe_that_cannot_be_right_is_refused_by_its_place(tmp_path):
    for changes, place in (
        ({"extra": "wdths = [8]"}, r"tiny\.toml: wdths: unknown key"),
        ({"extra": 'parts = "diffuse"'}, r"tiny\.toml: unknown parts 'diffuse'"),
        ({"classes": 'box = ["dice"]'}, r"tiny\.toml: classes are \['box'\]; expected at least two"),
        ({"classes": 'box = ["dice"]\nsphere = ["plum"]'}, "no object is left for the class 'sphere'"),
        ({"classes": 'box = "dice"\nsphere = ["apple"]'}, "box is 'dice'; expected a list"),
        ({"classes": 'box = ["dice"]\nsphere = ["aple"]'}, "unknown catalogue object 'aple'. Did you mean 'apple'"),
    ):
        with pytest.raises(FormatError, match=place):
            record_from_file(ClassifierRecipe, written(tmp_path, **changes))


def test_the_command_says_in_one_line_what_is_wrong(tmp_path):
    line = refused("train", "classifier", "missing.toml", cwd=tmp_path)
    assert line == "millisight: missing.toml: no such file"
    written(tmp_path)
    line = refused("train", "classifier", "tiny.toml", "--parts", "edges", cwd=tmp_path)
    assert line.startswith("millisight: unknown parts 'edges'. Did you mean 'edge'?")


@pytest.mark.parametrize("name", ["classifier", "paper"])
def test_the_recipes_train_on_no_object_of_the_test_images_and_know_the_class_of_each(name):
    recipe = record_from_file(ClassifierRecipe, EXAMPLES / f"training/{name}.toml")
    trained, named = (
        {one for names in by_class.values() for one in names} for by_class in (recipe.objects, recipe.every_object)
    )
    assert len(trained) == {"classifier": 23, "paper": 19}[name]
    tested = tomllib.loads((EXAMPLES / "recipes/unseen.toml").read_text())["objects"]["names"]
    assert len(tested) == 38
    assert not trained & set(tested)
    assert set(tested) <= named or name == "paper"


def test_the_papers_network_is_trained_on_what_the_shipped_one_is_trained_on():
    shipped, paper = (
        tomllib.loads((EXAMPLES / f"training/{name}.toml").read_text()) for name in ("classifier", "paper")
    )
    # The paper's knows no novelty, and has no class "other" for odd shapes; what only judges trains nothing.
    own = {"name", "about", "network", "examples", "schedule", "classes", "novel", "odd", "judged", "prior"}
    assert paper["network"] == "paper"
    assert {key: paper[key] for key in paper.keys() - own} == {key: shipped[key] for key in shipped.keys() - own}
    assert paper["prior"] == {shape: shipped["prior"][shape] for shape in PAPER_CLASSES}
    assert paper["schedule"]["seed"] == shipped["schedule"]["seed"]


def test_the_shipped_recipe_leaves_the_objects_of_development_and_test_to_tests():
    recipe = record_from_file(ClassifierRecipe, EXAMPLES / "training/classifier.toml")
    split = tomllib.loads((EXAMPLES / "objects.toml").read_text())
    assert set(recipe.tests) == {*split["development"], *split["test"]}


def test_the_pages_recipe_leaves_the_objects_of_the_tiny_dataset_to_tests(tmp_path):
    text, *_ = re.findall(r"^```toml\n(.*?)^```", PAGE.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    (tmp_path / "page.toml").write_text(text)
    recipe = record_from_file(ClassifierRecipe, tmp_path / "page.toml")
    tiny = tomllib.loads((EXAMPLES / "recipes/tiny.toml").read_text())
    tested = tiny["objects"]["names"]
    assert len(tested) == 2
    assert set(recipe.tests) == set(tested)
    assert {name for names in recipe.objects.values() for name in names}.isdisjoint(tested)
    known = classes_of({"classes": recipe.every_object}, tuple(recipe.objects))
    assert {known[name] for name in tested} == set(recipe.objects)
    assert recipe.schedule.seed != tiny["seed"]


def test_the_pages_commands_have_the_options_that_it_shows():
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("millisight ")]
    assert len(lines) >= 8
    for line in lines:
        name = max((name for name in COMMANDS if line.startswith(f"{name} ")), key=len)
        COMMANDS[name].make_context(name, shlex.split(line.removeprefix(name), comments=True))
