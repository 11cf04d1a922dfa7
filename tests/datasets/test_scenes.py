"""Scenes joined from a dataset's files: truth from the camera or exact, pictures, and what is missing."""

import json
import shutil

import numpy as np
import pytest

from helpers.small_scenes import BLOCKS, INFO, LID, POSE, TOP, add, inside, make
from millisight import datasets
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.datasets import evaluate, find_empties, find_scenes
from millisight.evaluation import INPUTS, score_mask
from millisight.io.mito import experiment_folder


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make(tmp_path_factory.mktemp("scenes") / "data")


@pytest.fixture
def own(dataset, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(dataset, tmp_path / "data")


def scenes(root, **settings):
    return find_scenes(datasets.open(root), **settings)


def test_every_sight_of_every_object_is_a_scene(dataset):
    found = scenes(dataset)
    assert [files.name for files in found] == [
        f"{folder}/0_0_0/exp1/{sight}" for folder in BLOCKS for sight in ("los", "nlos")
    ]
    assert [files.name for files in scenes(dataset, sight="nlos")] == [found[1].name, found[3].name]
    # The catalogue's name, with its sibling's letter, where it is of it.
    assert {files.object for files in found} == {"a_lego_duplo", "wide"}
    assert {files.physics() for files in found} == {"by hand"}


def test_the_cameras_truth_is_the_exact_one(dataset):
    for files in scenes(dataset):
        scene, exact = files.read(), files.read(truth="exact")
        assert scene.inputs == INPUTS
        block = BLOCKS[files.name.split("/")[0]]
        for given, mask in exact.truth.items():
            assert np.array_equal(mask.inside, inside(block))
            assert score_mask(scene.truth[given], mask).iou > 0.9, files.name


def test_prompts_lie_on_what_rises_above_the_support(dataset):
    scene = scenes(dataset)[0].read()
    assert scene.view.T_radar_camera == pytest.approx(POSE)
    # From 0.15 m: under the block's top, not down to the support.
    assert 0.15 - TOP < scene.view.farthest < 0.15 + 0.30
    raised = scenes(dataset)[1].read(support=LID)
    assert raised.view.farthest < 0.15 - LID


def test_what_is_not_simulated_has_no_exact_truth_and_the_published_transform(own):
    for path in own.rglob("experiment_info.json"):
        path.write_text(json.dumps({key: value for key, value in INFO.items() if key not in ("simulated", "physics")}))
    files = scenes(own)[0]
    assert files.physics() == ""
    with pytest.raises(InputError, match="not marked as simulated"):
        files.read(truth="exact")
    with pytest.raises(InputError, match="the mask lies outside the grid"):  # it is of another mount
        files.read(transform="published")


def test_the_mask_of_another_experiment_serves_only_where_the_object_was_not_moved(own):
    for sight in ("los", "nlos"):
        (own / "073-a_lego_duplo/robot_collected/0_0_0/exp2").mkdir(exist_ok=True)
        source = own / "073-a_lego_duplo/robot_collected/0_0_0/exp1"
        shutil.copytree(source / "nlos", own / "073-a_lego_duplo/robot_collected/0_0_0/exp2" / sight)
    info = own / "073-a_lego_duplo/robot_collected/0_0_0/exp2/experiment_info.json"
    info.write_text(json.dumps(INFO))
    files = next(one for one in scenes(own) if one.name.endswith("exp2/nlos"))
    assert files.read().truth
    info.write_text(json.dumps({key: value for key, value in INFO.items() if key != "simulated"}))
    with pytest.raises(FileError, match="no camera mask"):
        files.read()


def test_a_band_or_the_camera_may_be_missing(own):
    folder = own / "073-a_lego_duplo/robot_collected/0_0_0/exp1/los"
    shutil.rmtree(folder / "processed/radars/24_ghz")
    shutil.rmtree(folder / "unprocessed")
    assert scenes(own)[0].read().inputs == ("77 GHz",)
    shutil.rmtree(folder / "processed/camera")
    with pytest.raises(FileError, match="073-a_lego_duplo/0_0_0/exp1/los has no camera mask"):
        scenes(own)[0].read()


def test_crops_and_names_are_checked(dataset):
    files = scenes(dataset)[0]
    cropped = files.read(crop=(1, 1)).images
    assert cropped["77 GHz"].grid.z.tolist() == [-0.26]
    assert cropped["24 GHz"].grid.shape[2] == 3
    with pytest.raises(InputError, match="expected at least one to stay"):
        files.read(crop=(2, 1))
    with pytest.raises(UnknownNameError, match="truth"):
        files.read(truth="guess")
    with pytest.raises(UnknownNameError, match="transform"):
        files.read(transform="guess")


@pytest.mark.slow
def test_an_empty_carton_is_a_scene_where_nothing_is_to_be_found(own):
    add(
        experiment_folder(own, "tripod-carton_EMPTY", (0, 0, 0), 1, "nlos"),
        next(iter(BLOCKS.values())),
        INFO,
        hidden=True,
    )
    assert len(scenes(own)) == 4
    (empty,) = find_empties(datasets.open(own))
    assert (empty.sight, empty.number) == ("nlos", 1)
    scene = empty.read(truth="exact", view=False)
    assert not any(mask.inside.any() for mask in scene.truth.values())
    result = evaluate("segmentation", own, methods=["threshold"], blind=(), seeds=1, truth="exact", workers=1)
    (table,) = (table for name, table in result.tables.items() if name == "empty")
    assert [row[:4] for row in table.rows] == [
        ("threshold", given, 0, 1) for given in ("24 GHz", "77 GHz", "multi-spectral")
    ]
    seen = evaluate("segmentation", own, methods=["threshold"], blind=(), sight="los", seeds=1, workers=1)
    assert {one.sight for one in seen.rows} == {"los"}
