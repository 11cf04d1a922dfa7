"""`millisight train segmenter` on a recipe made in seconds: what it writes, again and resumed, and what it refuses."""

import json
import shutil

import pytest

from helpers.commands import refused
from millisight.cli.train import segmenter
from millisight.core.errors import FormatError
from millisight.datasets.generation import record_from_file
from millisight.meshes import CATALOGUE
from millisight.perception.training import SegmenterRecipe, check_installed

TEXT = """
name = "small"
widths = [8, 8, 8, 8]
batch = 4
views = 2
{extra}
[scenes]
poses = 1
vertices = 200
positions = 400
without = {without}
validation = ["golf_ball"]

[whole]
views = 2
sheets = 0

[schedule]
epochs = 2
seed = 1
"""


def written(folder, *, extra="", keep=("dice", "golf_ball")):
    path = folder / "small.toml"
    path.write_text(TEXT.format(extra=extra, without=json.dumps([name for name in CATALOGUE if name not in keep])))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("extra", "scenes_of_a_side"), [("", 2), ('normalisation = "batch"\nodd = 2\nclose = 0.5', 4)])
def test_one_command_makes_the_weights_and_again_the_same_ones_even_when_resumed(
    tmp_path, capsys, extra, scenes_of_a_side
):
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from millisight.perception.segmentation import WaveSegmenter
    from millisight.perception.training import make_scenes, train

    recipe = written(tmp_path, extra=extra)
    segmenter(recipe, tmp_path / "a")
    out = capsys.readouterr().out
    assert "2 epochs, the best of them" in out
    assert out.splitlines()[-1] == f"weights: {tmp_path / 'a' / 'wave.onnx'}"
    told = WaveSegmenter(tmp_path / "a" / "wave.onnx").description
    assert told["objects"] == {"training": ["dice"], "validation": ["golf_ball"]}
    assert told["scenes"] == {"training": scenes_of_a_side, "validation": scenes_of_a_side}
    assert len(told["history"]) == 2

    def cut_off(done, total):
        raise KeyboardInterrupt

    described = record_from_file(SegmenterRecipe, recipe)
    shutil.copytree(tmp_path / "a" / "scenes", tmp_path / "b" / "scenes")
    scenes = make_scenes(described, tmp_path / "b" / "scenes")
    with pytest.raises(KeyboardInterrupt):
        train(described, scenes, tmp_path / "b", progress=cut_off)
    assert not (tmp_path / "b" / "wave.onnx").exists()
    segmenter(recipe, tmp_path / "b")
    for name in ("wave.onnx", "wave.json", "wave.safetensors"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_a_recipe_that_cannot_be_right_is_refused_by_its_place(tmp_path):
    for extra, place in (
        ("wdths = [8]", r"small\.toml: wdths: unknown key 'wdths'\. Did you mean 'widths'\?"),
        ("device = 1", r"small\.toml: device: unknown key"),
        ('normalisation = "none"', r"unknown normalisation 'none'\. Known: batch, group"),
        ("close = 1.5", r"close is 1\.5; expected a share, from 0 to 1"),
        ("about = 3", r"small\.toml: about: expected a text, got 3"),
    ):
        with pytest.raises(FormatError, match=place):
            record_from_file(SegmenterRecipe, written(tmp_path, extra=extra))
    with pytest.raises(FormatError, match="no object is left for validation"):
        record_from_file(SegmenterRecipe, written(tmp_path, keep=("dice",)))
    with pytest.raises(FormatError, match="no object is left for training"):
        record_from_file(SegmenterRecipe, written(tmp_path, keep=("golf_ball",)))
    (tmp_path / "small.toml").write_text("# no key\n")
    with pytest.raises(FormatError, match=r"small\.toml holds no key; expected a recipe"):
        record_from_file(SegmenterRecipe, tmp_path / "small.toml")
    (tmp_path / "small.toml").write_text("= 3")
    with pytest.raises(FormatError, match=r"small\.toml is not valid TOML"):
        record_from_file(SegmenterRecipe, tmp_path / "small.toml")
    shutil.copy(written(tmp_path), tmp_path / "other.toml")
    assert record_from_file(SegmenterRecipe, tmp_path / "other.toml").scenes.poses == 1


def test_what_training_needs_is_asked_for_before_any_work(monkeypatch):
    monkeypatch.setattr("millisight.perception.training._loop.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"needs torch and .*millisight\[train\]"):
        check_installed()


def test_the_command_says_in_one_line_what_is_wrong(tmp_path):
    line = refused("train", "segmenter", "missing.toml", cwd=tmp_path)
    assert line == "millisight: missing.toml: no such file"
