"""Judging many scenes: what is kept, what is done again, and failures that stop nothing."""

import json
import os

import pytest

from millisight.datasets import judging
from millisight.datasets.judging import Settings, judge
from millisight.datasets.mito import find
from millisight.datasets.scenes import find_scenes
from millisight.perception.segmentation import Candidates
from small_scenes import make


class Bright:
    """What is brighter than its threshold, whatever the prompts."""

    name = "bright"
    needs_prompts = True
    calls = 0

    def __init__(self, above=0.4):
        self.above = above
        self.description = {"sha256": str(above)}

    def segment(self, picture, prompts):
        Bright.calls += 1
        shown = picture.rgb.mean(axis=2) / 255 if picture.power is None else picture.power
        return Candidates(masks=(shown > self.above)[None], scores=[1.0])


@pytest.fixture
def root(tmp_path):
    return make(tmp_path / "data")


@pytest.fixture(autouse=True)
def bright(monkeypatch):
    monkeypatch.setattr(judging, "segmenter", lambda name, **options: Bright(**options))
    judging._made.cache_clear()
    Bright.calls = 0
    yield
    judging._made.cache_clear()


def run(root, tmp_path, sight=None, **settings):
    scenes = find_scenes(find(root), sight=sight)
    return judge(scenes, ["bright"], tmp_path / "out", Settings(**settings), workers=1)


def test_a_second_run_takes_what_is_there(root, tmp_path):
    told = []
    scenes = find_scenes(find(root))
    first = judge(scenes, ["bright"], tmp_path / "out", Settings(), workers=1, progress=lambda *n: told.append(n))
    assert told == [(n, 4) for n in (1, 2, 3, 4)]
    assert len(first.trials) == 4 * 4 * 3  # scenes, inputs, seeds
    assert Bright.calls == len(first.trials)
    assert not first.failures
    second = run(root, tmp_path)
    assert (second.kept, Bright.calls) == (4, 48)
    assert [one.scores for one in second.trials] == [one.scores for one in first.trials]
    assert [(one.scene, one.input, one.seed) for one in second.trials] == [
        (one.scene, one.input, one.seed) for one in first.trials
    ]


def test_only_what_changed_is_done_again(root, tmp_path):
    def again(**settings):
        return run(root, tmp_path, sight="los", **{"seeds": (0,), **settings})

    done = again()
    assert again().kept == 2
    assert again(reading={"truth": "exact"}).kept == 0
    assert again(options={"bright": {"above": 0.3}}).kept == 0
    assert again(seeds=(1,)).kept == 0
    assert again().kept == 0
    (tmp_path / "out" / "bright.073-a_lego_duplo.0_0_0.exp1.los.json").write_text('{"key": "cut off')
    assert again().kept == 1
    image = root / "074-x_wide/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/processed_image.pkl"
    os.utime(image, (1, 1))
    last = again()
    assert last.kept == 1
    assert [one.scores for one in last.trials] == [one.scores for one in done.trials]


def test_a_damaged_scene_fails_alone_and_is_tried_again(root, tmp_path):
    image = root / "073-a_lego_duplo/robot_collected/0_0_0/exp1/nlos/processed/radars/77_ghz/processed_image.pkl"
    whole = image.read_bytes()
    image.write_bytes(whole[:500])
    done = run(root, tmp_path, seeds=(0,))
    ((scene, method, why),) = done.failures
    assert (scene, method) == ("073-a_lego_duplo/0_0_0/exp1/nlos", "bright")
    assert "processed_image.pkl" in why
    assert len({one.scene for one in done.trials}) == 3
    image.write_bytes(whole)
    mended = run(root, tmp_path, seeds=(0,))
    assert (mended.kept, len(mended.failures)) == (3, 0)
    assert len({one.scene for one in mended.trials}) == 4


def test_results_are_files_of_plain_json(root, tmp_path):
    run(root, tmp_path, seeds=(5,))
    files = sorted((tmp_path / "out").iterdir())
    assert len(files) == 4
    content = json.loads(files[0].read_text())
    assert {one["seed"] for one in content["trials"]} == {5}
    assert all(0 <= value <= 1 for one in content["trials"] for value in one["scores"])
