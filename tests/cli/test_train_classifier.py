"""`millisight train classifier` on a recipe made in seconds: what it writes, and what its options change."""

import shutil
import tomllib
from pathlib import Path

import pytest

from commands import refused
from millisight.cli.train import classifier
from millisight.datasets.recipefile import record_from_file
from millisight.errors import FormatError
from millisight.perception.training_classifier import ClassifierRecipe

EXAMPLES = Path(__file__).parents[2] / "examples"

TEXT = """
name = "tiny"
batch = 2
examples = 4
scenes = 2
vertices = 200
spacing = [0.008, 0.008, 0.02]
tests = ["plum"]
{extra}
[classes]
{classes}

[schedule]
epochs = 1
seed = 1
"""
TWO = 'box = ["dice"]\nsphere = ["golf_ball", "plum"]'


def written(folder, *, extra="", classes=TWO):
    path = folder / "tiny.toml"
    path.write_text(TEXT.format(extra=extra, classes=classes))
    return path


def test_one_command_makes_weights_that_the_options_change(tmp_path, capsys):
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from millisight.perception.classification import Classifier

    recipe, scenes = written(tmp_path), tmp_path / "scenes"
    classifier(recipe, tmp_path / "a", scenes=scenes)
    out = capsys.readouterr().out
    assert "1 epochs, the best of them 1; " in out
    assert out.splitlines()[-1] == f"weights: {tmp_path / 'a' / 'classifier.onnx'}"
    assert len(list(scenes.iterdir())) == 4
    told = Classifier(tmp_path / "a" / "classifier.onnx").description
    assert told["objects"]["training"] == ["dice", "golf_ball"]
    assert (told["parts"], told["network"]) == ("both", "small")
    shutil.copytree(scenes, tmp_path / "all")
    classifier(recipe, tmp_path / "b", scenes=tmp_path / "all", parts="edge", all_objects=True)
    other = Classifier(tmp_path / "b" / "classifier.onnx").description
    assert other["objects"]["training"] == ["dice", "golf_ball", "plum"]
    assert other["parts"] == "edge"
    assert other["sha256"] != told["sha256"]


def test_a_recipe_that_cannot_be_right_is_refused_by_its_place(tmp_path):
    for changes, place in (
        ({"extra": "wdths = [8]"}, r"tiny\.toml: wdths: unknown key"),
        ({"extra": 'parts = "diffuse"'}, r"tiny\.toml: unknown parts 'diffuse'"),
        ({"classes": 'box = ["dice"]'}, r"tiny\.toml: classes are \['box'\]; expected two at least"),
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


@pytest.mark.parametrize("name", ["classifier", "paper", "kinds"])
def test_the_recipes_train_on_no_object_of_the_test_images_and_know_the_class_of_each(name):
    recipe = record_from_file(ClassifierRecipe, EXAMPLES / f"training/{name}.toml")
    trained, named = (
        {one for names in by_class.values() for one in names} for by_class in (recipe.objects, recipe.every_object)
    )
    assert len(trained) == {"kinds": 26}.get(name, 28)
    tested = tomllib.loads((EXAMPLES / "recipes/classes.toml").read_text())["objects"]["names"]
    assert len(tested) == 14
    assert not trained & set(tested)
    assert set(tested) <= named


def test_the_shipped_recipe_leaves_all_objects_of_the_benchmark_to_tests():
    recipe = record_from_file(ClassifierRecipe, EXAMPLES / "training/classifier.toml")
    tested = tomllib.loads((EXAMPLES / "recipes/bench24.toml").read_text())["objects"]["names"]
    assert len(tested) == 24
    assert set(recipe.tests) == set(tested)
