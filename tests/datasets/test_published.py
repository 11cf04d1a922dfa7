"""The table of the published dataset, and its splits, packaged and as the authors' files hold them."""

import pickle

import pytest

from helpers.published_mock import split_values
from millisight.core.errors import DamagedFileError, FileError, UnknownNameError
from millisight.datasets import (
    PUBLISHED_OBJECTS,
    PUBLISHED_SPLITS,
    SplitImage,
    published_experiment,
    published_split,
    read_split,
)
from millisight.meshes import CATALOGUE

PAPER_CLASSES = ("can", "handle", "box", "sphere")


def test_the_published_test_has_the_34_images_of_the_papers_table():
    split = published_split()
    tested = [
        one
        for one in split.test
        if split.classes[one.folder] in PAPER_CLASSES
        and one.sight in published_experiment(one.folder, one.experiment).available
    ]
    assert [sum(one.sight == sight for one in tested) for sight in ("los", "nlos")] == [18, 16]
    assert len({one.folder for one in tested}) == 26
    assert len({one.folder for one in split.training}) == 63
    assert all(one.simulated for one in split.training)


def test_numbers_of_objects_that_the_authors_use():
    used = {
        number: sum(
            "los" in one.experiments[number].available
            for one in PUBLISHED_OBJECTS.values()
            if number in one.experiments
        )
        for number in (1, 2)
    }
    assert used == {1: 55, 2: 47}
    assert PUBLISHED_OBJECTS["001_chips_can"].left_out == ("exp1",)
    assert PUBLISHED_OBJECTS["063_marbles"].left_out == ("exp1 nlos",)


def test_crops_are_of_experiment_1_alone():
    crops = {number: {one.experiments[number].crop for one in PUBLISHED_OBJECTS.values() if number in one.experiments}
             for number in (1, 2)}  # fmt: skip
    assert crops == {1: {(0, 0), (12, 7), (17, 3)}, 2: {(0, 0)}}
    high = [folder for folder, one in PUBLISHED_OBJECTS.items() if one.exp1 and one.exp1.crop == (17, 3)]
    assert high == ["039_key", "041_small_marker", "046_plastic_bolt", "049_small_clamp"]


def test_published_names_lead_to_the_catalogue():
    for folder, name in (
        ("042_wrench", "adjustable_wrench"),
        ("065d_cups_d", "d_cups"),
        ("070_colored_wood_blocks", "a_colored_wood_blocks"),
        ("025_mug", "mug"),
        ("023_wine_glass", ""),
    ):
        assert PUBLISHED_OBJECTS[folder].catalogue == name
    named = {one.catalogue for one in PUBLISHED_OBJECTS.values()} - {""}
    assert len(named) > 60
    assert named <= set(CATALOGUE)


@pytest.mark.parametrize("name", PUBLISHED_SPLITS)
def test_a_split_file_reads_as_the_packaged_one(name, tmp_path):
    expected = published_split(name)
    path = tmp_path / f"test_split_{name}.pkl"
    path.write_bytes(pickle.dumps(split_values(expected, experiments=name == "1729816641")))
    found = read_split(path)
    assert (found.name, dict(found.classes)) == (name, dict(expected.classes))
    assert (found.training, found.validation, found.test) == (expected.training, expected.validation, expected.test)
    assert found.test[0] in (
        SplitImage("005_tomato_soup_can", False, "los", 1), SplitImage("010_potted_meat_can", False, "los", 1),
    )  # fmt: skip


def test_the_two_splits_differ_in_the_pear_and_in_experiment_2():
    old, new = PUBLISHED_SPLITS.values()
    assert {folder for folder in new.classes if new.classes[folder] != old.classes[folder]} == {"016_pear"}
    assert {one.experiment for one in old.test} == {1}
    assert {one.experiment for one in new.test} == {1, 2}


@pytest.mark.parametrize(
    "held", [[1], {"classes": {}}, {"train": [], "validation": [], "test": [(1, 2)], "classes": {("1", "a"): "can"}}]
)
def test_what_is_no_split_is_refused(held, tmp_path):
    (tmp_path / "test_split_1.pkl").write_bytes(pickle.dumps(held))
    with pytest.raises(DamagedFileError, match="holds no split"):
        read_split(tmp_path / "test_split_1.pkl")
    with pytest.raises(UnknownNameError, match="unknown published split '1'"):
        published_split("1")
    with pytest.raises(FileError):
        read_split(tmp_path / "none.pkl")
