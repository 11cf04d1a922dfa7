"""Finding a dataset by names alone: what there is, what is missing, and how long it takes."""

import os
import time

import pytest

from helpers.miniature import ANGLES, BACKGROUND, BOX, EMPTY, FAULTS, MUG, fault_folder
from millisight import datasets
from millisight.core.errors import FileError, UnknownNameError
from millisight.datasets import experiments_under, find_object


def test_everything_of_the_miniature_is_found(miniature):
    dataset = datasets.open(miniature.healthy)
    assert [(one.id, one.name, one.role) for one in dataset.objects] == [
        ("000", "background", "background"), ("004", "sugar_box", "object"), ("0210", "EMPTY", "empty"),
        ("025", "mug", "object"),
    ]  # fmt: skip
    assert [(e.object, e.angles, e.number, e.sight) for e in dataset.experiments] == [
        (BACKGROUND, (0, 0, 0), 1, "los"), (BOX, ANGLES, 1, "los"), (BOX, ANGLES, 1, "nlos"), (BOX, ANGLES, 2, "los"),
        (EMPTY, (0, 0, 0), 1, "los"), (MUG, ANGLES, 1, "los"), (MUG, ANGLES, 1, "nlos"), (MUG, ANGLES, 2, "los"),
        (MUG, ANGLES, 2, "nlos"),
    ]  # fmt: skip
    mug = dataset.objects[-1]
    assert sorted((i.kind, i.radar, i.ext) for i in mug.experiments[0].items) == [
        ("camera frame", "", "_1"), ("camera mask", "", ""), ("image", "24_ghz", ""), ("image", "77_ghz", ""),
        ("info", "", ""), ("radar mask", "77_ghz", ""), ("raw", "24_ghz", ""), ("raw", "77_ghz", ""),
    ]  # fmt: skip
    assert [(i.radar, i.ext) for i in mug.simulations[0].items] == [
        ("24_ghz", "_edges"), ("24_ghz", "_specular"), ("77_ghz", "_edges"), ("77_ghz", "_specular"),
    ]  # fmt: skip
    assert mug.meshes == ("nontextured.stl",)
    assert len(dataset.items) == 53  # `experiment_info.json` once for los and nlos
    assert dataset.stray == ()
    assert all(one.stray == () for one in dataset.objects)
    assert all(item.path.exists() for item in dataset.items)


def test_what_is_missing_is_said_item_by_item(miniature):
    found = {
        (e.object, e.number, e.sight): e.missing for e in datasets.open(miniature.healthy).experiments if e.missing
    }
    assert found == {
        (BOX, 1, "los"): ("camera frame", "camera mask"),
        (BOX, 2, "los"): ("77_ghz raw", "24_ghz raw", "camera frame", "camera mask"),
    }
    assert {one.name: one.missing for one in datasets.open(miniature.healthy).objects if one.missing} == {
        "sugar_box": ("nlos of exp2 at 0_0_90",)
    }
    faults = {one.name: one for one in datasets.open(miniature.faults).objects}
    assert len(faults) == len(FAULTS)
    assert "experiment_info.json" in faults["no_info"].experiments[0].missing
    assert "77_ghz image" in faults["mask_without_image"].experiments[0].missing
    assert faults["two_lane"].missing == ("simulations", "nlos of exp1 at 0_0_90")


def test_what_is_out_of_place_is_named(miniature):
    dataset = datasets.open(miniature.faults)
    assert dataset.stray == ("figures",)
    (stray,) = (one for one in dataset.objects if one.name == "stray_files")
    base = "robot_collected/0_0_90/exp1"
    assert stray.stray == (
        f"{base}/exp1_backup", f"{base}/los/notes.txt", f"{base}/los/processed/radars/77_ghz/processed_image.pkl.tmp",
    )  # fmt: skip
    assert stray.meshes == ("nontextured.stl",)


def test_objects_are_chosen_by_id_name_or_folder(miniature):
    dataset = datasets.open(miniature.healthy)
    for name in ("025", "mug", MUG):
        assert [one.name for one in dataset.only([name]).objects] == ["mug"]
    assert len(dataset.only([]).objects) == 4
    assert len(dataset.only(["mug", "004"]).objects) == 2
    with pytest.raises(UnknownNameError, match=r"unknown object 'mugg'. Did you mean '025_mug'\?"):
        dataset.only(["mugg"])


def test_folders_that_are_no_dataset_are_refused(tmp_path, miniature):
    (tmp_path / "some_folder").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="holds no object of the published layout"):
        datasets.open(tmp_path)
    with pytest.raises(FileError, match="cannot list .*nowhere"):
        datasets.open(tmp_path / "nowhere")
    with pytest.raises(FileError, match=r"cannot list .*file.*: Not a directory"):
        datasets.open(tmp_path / "file")
    with pytest.raises(FileError, match="belongs to no|not an object or experiment"):
        find_object(tmp_path)
    assert find_object(fault_folder(miniature.faults, "two_lane") / "unprocessed").name == "two_lane"


def test_raw_experiments_are_found_at_and_under_any_folder(miniature, monkeypatch):
    root = miniature.healthy
    assert len(experiments_under(root)) == 13
    assert len(experiments_under(root / MUG)) == 8
    experiment = root / MUG / "robot_collected" / "0_0_90" / "exp1" / "nlos"
    for folder in (experiment, experiment / "unprocessed", experiment / "unprocessed" / "radars"):
        assert [(e.folder, e.name, e.radar) for e in experiments_under(folder)] == [
            (experiment, f"{MUG}.0_0_90.exp1.nlos.{radar}", radar) for radar in ("24_ghz", "77_ghz")
        ]
    assert len(experiments_under(experiment.parent)) == 4
    assert len(experiments_under(experiment / "unprocessed" / "radars" / "77_ghz")) == 1
    assert experiments_under(experiment / "processed") == []
    monkeypatch.chdir(experiment)
    assert len(experiments_under(".")) == 2


@pytest.mark.slow
def test_500_experiments_are_listed_in_under_two_seconds_and_no_file_is_opened(tmp_path):
    """Every file is a link to nowhere: who opens one fails."""

    def files(folder, *names):
        folder.mkdir(parents=True)
        for name in names:
            os.symlink("/nowhere", folder / name)

    for i in range(125):
        for number in (1, 2):
            base = tmp_path / f"{i:03d}_object" / "robot_collected" / "0_0_0" / f"exp{number}"
            for sight in ("los", "nlos"):
                for radar in ("77_ghz", "24_ghz"):
                    images = base / sight / "processed" / "radars" / radar
                    files(images, "processed_image.pkl", "radar_masks.pkl")
                    files(base / sight / "unprocessed" / "radars" / radar / "radar_data", "adc_data1700000000.bin")
                files(base / sight / "processed" / "camera", "camera_masks.pkl")
            os.symlink("/nowhere", base / "experiment_info.json")
    started = time.process_time()  # its own: other processes may keep the cores busy
    dataset = datasets.open(tmp_path)
    taken = time.process_time() - started
    assert len(dataset.experiments) == 500
    assert len(dataset.items) == 500 * 7 + 250
    assert taken < 2
