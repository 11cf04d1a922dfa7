"""`ms.evaluate`: what is cached, what is done again, failures that stop nothing; the same as the command; plug-ins."""

import csv
import hashlib
import json
import os
import shutil
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer
from scipy.spatial.distance import directed_hausdorff
from typer.testing import CliRunner

import millisight as ms
from helpers.small_scenes import make
from helpers.undrawn import undrawn
from millisight.cli.evaluate import segmentation
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets._runner import _cache_key
from millisight.evaluation import METRICS, TASKS, Metric, SegmentationTask, Task
from millisight.evaluation import _scenes as scenes
from millisight.perception.segmentation import Candidates


class Bright:
    """What is brighter than its threshold, whatever the prompts."""

    name = "bright"
    needs_prompts = True
    calls = 0

    def __init__(self, above=0.4, weights=None):
        self.above = above if weights is None else float(Path(weights).read_text())
        self.description = {"sha256": str(self.above)}

    def segment(self, picture, prompts):
        Bright.calls += 1
        shown = picture.rgb.mean(axis=2) / 255 if picture.power is None else picture.power
        return Candidates(masks=(shown > self.above)[None], scores=[1.0])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return make(tmp_path_factory.mktemp("whole") / "data")


@pytest.fixture
def root(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "data")


@pytest.fixture(autouse=True)
def bright(monkeypatch):
    monkeypatch.setattr(scenes, "segmenter", lambda name, **options: Bright(**options))
    scenes._segmenter.cache_clear()
    Bright.calls = 0
    yield
    scenes._segmenter.cache_clear()


def run(root, tmp_path, **options):
    options = {"blind": ()} | options
    given = {"output": tmp_path / "out", "workers": 1, "methods": ["bright"], "failures": 0, **options}
    with undrawn():
        return ms.evaluate("segmentation", root, **given)


@pytest.mark.slow
def test_a_second_run_takes_what_is_there(root, tmp_path):
    told = []
    first = run(root, tmp_path, progress=lambda *n: told.append(n))
    assert told == [(n, 4) for n in (1, 2, 3, 4)]
    assert len(first.rows) == 4 * 4 * 3  # scenes, inputs, seeds
    assert Bright.calls == len(first.rows)
    assert not first.failures
    second = run(root, tmp_path)
    assert (second.cached, Bright.calls) == (4, 48)
    assert [one.scores for one in second.rows] == [one.scores for one in first.rows]
    assert [(one.scene, one.input, one.seed) for one in second.rows] == [
        (one.scene, one.input, one.seed) for one in first.rows
    ]


@pytest.mark.slow
def test_only_what_changed_is_done_again(root, tmp_path):
    def again(**options):
        return run(root, tmp_path, sight="los", **{"seeds": 1, **options})

    done = again()
    assert again().cached == 2
    assert again(truth="exact").cached == 0
    assert again(options={"bright": {"above": 0.3}}).cached == 0
    assert again(seeds=2).cached == 0
    assert again().cached == 0
    place = tmp_path / "out" / "trials" / "bright.073-a_lego_duplo.0_0_0.exp1.los.json"
    place.write_text('{"key": "cut off')
    assert again().cached == 1
    content = json.loads(place.read_text())
    content["result"][0]["scores"]["f1"] = 0.123
    place.write_text(json.dumps(content))
    assert again().cached == 1
    # Whole by its checksum, but no result of this task: all are made anew.
    content |= {"result": [{}], "checksum": hashlib.sha256(b"[{}]").hexdigest()}
    place.write_text(json.dumps(content))
    assert again().cached == 0
    assert again().cached == 2
    image = root / "074-x_wide/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image.pkl"
    os.utime(image, (1, 1))
    last = again()
    assert last.cached == 1
    assert [one.scores for one in last.rows] == [one.scores for one in done.rows]
    weights = tmp_path / "weights.onnx"
    found = []
    for above in ("0.3", "0.95"):  # written anew while the process runs
        weights.write_text(above)
        found.append(again(options={"bright": {"weights": str(weights)}}))
        assert found[-1].cached == 0
    assert [one.scores for one in found[0].rows] != [one.scores for one in found[1].rows]


def test_a_result_of_a_folder_is_that_of_its_files(tmp_path):
    raw = tmp_path / "77_ghz" / "radar_data"
    raw.mkdir(parents=True)
    (raw / "adc.bin").write_bytes(b"one")
    before = _cache_key([raw.parent])
    assert _cache_key([raw.parent]) == before
    (raw / "adc.bin").write_bytes(b"two")
    assert _cache_key([raw.parent]) != before


@pytest.mark.slow
def test_a_damaged_scene_fails_alone_and_is_tried_again(root, tmp_path):
    image = root / "073-a_lego_duplo/robot_collected/0_0_0/exp1/nlos/processed/radars/77_ghz/processed_image.pkl"
    whole = image.read_bytes()
    image.write_bytes(whole[:500])
    done = run(root, tmp_path, seeds=1)
    ((name, why),) = done.failures
    assert name == "073-a_lego_duplo/0_0_0/exp1/nlos, bright"
    assert "processed_image.pkl" in why
    assert len({one.scene for one in done.rows}) == 3
    image.write_bytes(whole)
    mended = run(root, tmp_path, seeds=1)
    assert (mended.cached, len(mended.failures)) == (3, 0)
    assert len({one.scene for one in mended.rows}) == 4


@pytest.mark.slow
def test_results_are_files_of_plain_json(root, tmp_path):
    run(root, tmp_path, seeds=2)
    files = sorted((tmp_path / "out" / "trials").iterdir())
    assert len(files) == 4
    content = json.loads(files[0].read_text())
    assert {one["seed"] for one in content["result"]} == {0, 1}
    assert all(0 <= value <= 1 for one in content["result"] for value in one["scores"].values())


@pytest.mark.slow
def test_python_writes_what_the_command_writes(root, tmp_path):
    shutil.rmtree(root / "074-x_wide")  # one object is enough
    result = ms.evaluate("segmentation", root, output=tmp_path / "python", workers=1, methods="bright", failures=2)
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(segmentation)
    options = ["-o", str(tmp_path / "command"), "--workers", "1", "--method", "bright", "--failures", "2"]
    done = CliRunner().invoke(app, [str(root), *options])
    assert done.exit_code == 0, done.output
    one, other = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in (tmp_path / "python", tmp_path / "command")
    )
    assert len(one) == 5 + 4 + 4  # page, Markdown and figures; CSV; partial results, blind ones too
    assert one == other
    for table in result.summary:
        assert table.markdown() in done.output


@pytest.mark.slow
def test_a_result_is_for_notebooks_and_for_json(root, tmp_path):
    result = run(root, tmp_path, output=None, seeds=1, sight="los")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]
    content = json.loads(json.dumps(result.to_dict()))
    assert (content["task"], content["failures"]) == ("segmentation", [])
    assert content["data"] == "data (virtual rig, by hand; simulated, not real data)"
    assert list(content["tables"]) == ["los", "differences", "trials"]
    assert len(content["tables"]["trials"]["rows"]) == len(result.rows) == 8
    assert result._repr_html_().count("<table>") == 2
    page = result.save(tmp_path / "later")
    assert page.read_text().count("<table>") == 2


def hausdorff(predicted, truth):
    """Largest distance of a pixel of one mask from the other [m]; of an empty mask, 1 m."""
    points = [np.argwhere(mask.inside) * 0.005 for mask in (predicted, truth)]
    if not all(map(len, points)):
        return 1.0
    return max(directed_hausdorff(*points)[0], directed_hausdorff(*points[::-1])[0])


@pytest.fixture
def plugin(monkeypatch):
    """A function that installs an entry of a registry."""

    def install(registry, name, entry):
        module = ModuleType("plugged")
        module.entry = entry
        monkeypatch.setitem(sys.modules, "plugged", module)
        point = EntryPoint(name=name, value="plugged:entry", group=registry.group)
        registry.names()
        monkeypatch.setattr(registry, "_entries", dict(registry._entries))
        monkeypatch.setattr(registry, "_plugins", {name: point})

    return install


def test_a_metric_of_a_plugin_has_columns_in_the_tables(root, tmp_path, plugin):
    plugin(METRICS, "hausdorff", Metric(heading="Hausdorff", compute=hausdorff, unit="mm"))
    run(root, tmp_path, seeds=1, sight="los")
    with open(tmp_path / "out" / "trials.csv", newline="") as file:
        trials = list(csv.DictReader(file))
    assert {0 <= float(row["hausdorff"]) < 0.2 for row in trials} == {True}
    with open(tmp_path / "out" / "los.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    by_input = {row["input"]: row["Hausdorff [mm]"] for row in rows if row["segmenter"] == "bright"}
    found = [float(row["hausdorff"]) for row in trials if row["input"] == "77 GHz"]
    assert by_input["77 GHz"].startswith(f"{1000 * np.median(found):.1f} (")
    assert {row["Hausdorff [mm]"] for row in rows if row["segmenter"].startswith("paper")} == {""}
    assert next(row["precision [%]"] for row in rows if row["segmenter"].startswith("paper")) == "99.7"


def test_a_metric_that_is_not_finite_is_named(root, tmp_path, plugin):
    plugin(METRICS, "bad", Metric(heading="bad", compute=lambda *_: np.nan))
    done = run(root, tmp_path, seeds=1, sight="los")
    assert not done.rows
    assert all("metric 'bad' is nan" in why for _, why in done.failures)
    with pytest.raises(InputError, match="no result to save: 2 failures"):
        done.save(tmp_path / "none")


def test_a_task_of_a_plugin_is_run(root, plugin):
    class Mine(SegmentationTask):
        __slots__ = ()
        name = "mine"

    plugin(TASKS, "mine", Mine)
    result = ms.evaluate("mine", root, workers=1, methods=("bright",), blind=(), seeds=1, sight="los")
    assert (result.task.name, len(result.rows)) == ("mine", 8)
    plugin(TASKS, "wrong", dict)
    with pytest.raises(InputError, match="expected a subclass of millisight.evaluation.Task"):
        ms.evaluate("wrong", root)


def test_the_page_of_another_kind_of_evaluation_is_not_replaced(root, tmp_path):
    run(root, tmp_path, sight="los", seeds=1)
    page = (tmp_path / "out" / "segmentation.md").read_bytes()
    with pytest.raises(InputError, match="out holds an evaluation of the kind 'segmentation'.*choose another folder"):
        ms.evaluate("surface", root, output=tmp_path / "out")
    assert (tmp_path / "out" / "segmentation.md").read_bytes() == page


def test_two_evaluations_at_once_do_not_share_a_folder(root, tmp_path):
    refused = []

    def another(done, total):
        with pytest.raises(FileError, match="out"):
            run(root, tmp_path, sight="los", seeds=1)
        refused.append(done)

    run(root, tmp_path, sight="los", seeds=1, progress=another)
    assert refused
    assert (tmp_path / "out" / "segmentation.md").is_file()
    assert run(root, tmp_path, sight="los", seeds=1).rows


def test_tasks_and_options_are_checked(root):
    assert tuple(sorted(TASKS.names())) == ("classification", "pose", "segmentation", "simulator", "surface")
    assert all(issubclass(TASKS[name], Task) for name in TASKS)
    with pytest.raises(UnknownNameError, match="unknown task 'poses'"):
        ms.evaluate("poses", root)
    with pytest.raises(InputError, match="task 'simulator' has no option seeds; expected some of simulated, radar"):
        ms.evaluate("simulator", root, seeds=3)
    with pytest.raises(InputError, match="false_alarms is 2; expected a probability under 1"):
        ms.evaluate("surface", root, false_alarms=2)
    with pytest.raises(UnknownNameError, match="unknown sight 'side'"):
        ms.evaluate("segmentation", root, sight="side")
    task = SegmentationTask(methods=("bright",), blind=(), seeds=1)
    assert len(ms.evaluate(task, root, workers=1, sight="los").rows) == 8
    with pytest.raises(InputError, match="seeds: give options to SegmentationTask"):
        ms.evaluate(task, root, seeds=3)
