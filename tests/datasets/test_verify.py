"""Verification: what is healthy is found so, and each thing that goes wrong is found and named."""

import json
import os
import shutil

import pytest

import millisight as ms
from helpers.miniature import EMPTY, FAULTS, fault_folder, hostile_deed
from millisight.core.errors import DamagedFileError
from millisight.datasets import ManifestEntry, convert, read_manifest, verify, write_manifest

PROBLEMS = {
    "truncated_pickle": "processed_image.pkl", "hostile_pickle": "mkdir", "nan_in_image": "NaN",
    "wrong_shape": "shape (3, 4)", "mask_without_image": "no such file", "row_missing": "its file is missing",
    "zero_gap": "1 of 14 frames lost", "cut_file": "ends within frame 13", "big_endian": "big-endian",
    "short_block": "line 71 has 247 cells", "log_backwards": "times_77[41]", "log_truncated": "antenna.npz",
    "list_unequal": "4 entries", "no_info": "no such file", "odd_info": "'round'", "empty_files": "empty",
}  # fmt: skip
NOTES = {"row_unlisted": "not listed", "two_lane": "two-lane interleaved", "unequal_log": "the first 250 are used"}


@pytest.mark.slow
def test_the_healthy_part_is_healthy(miniature):
    seen = []
    results = verify(miniature.healthy, workers=1, progress=lambda *done: seen.append(done))
    assert len(results) == 53 == len(seen)
    assert [one for one in results if not one.ok or one.notes] == []
    assert [one.path for one in results] == sorted(one.path for one in results)


@pytest.mark.slow
def test_each_fault_is_found_and_named(miniature):
    assert {*PROBLEMS, *NOTES, "stray_files"} == set(FAULTS)
    results = verify(miniature.faults, workers=2)
    found = {name: [r for r in results if r.path.split("/")[0].endswith(name)] for name in FAULTS}
    for name, text in PROBLEMS.items():
        said = [problem for one in found[name] for problem in one.problems]
        assert any(text in problem for problem in said), (name, said)
        assert all(str(miniature.faults) not in problem for problem in said)
    for name, text in NOTES.items():
        assert all(one.ok for one in found[name])
        assert any(text in note for one in found[name] for note in one.notes)
    assert all(one.ok for one in found["stray_files"])
    assert not hostile_deed(fault_folder(miniature.faults, "hostile_pickle")).exists()


@pytest.fixture
def converted(miniature, tmp_path):
    """A converted object and scene, to be damaged."""
    dataset = ms.datasets.open(miniature.healthy).only(["0210", "000"])
    convert(dataset, tmp_path, workers=1)
    return tmp_path


def test_a_converted_dataset_is_held_to_its_manifest(converted):
    results = verify(converted, workers=1)
    assert [(one.kind, one.ok, one.notes) for one in results] == [
        ("info", True, ()), ("raw", True, ()), ("listed", True, ()), ("info", True, ()), ("image", True, ()),
    ]  # fmt: skip


def test_damage_to_a_converted_dataset_is_found(converted):
    raw = next(converted.rglob("24_ghz/capture.h5"))
    log = next(converted.rglob("robot_log.h5"))
    image = next(converted.rglob("processed_image.h5"))
    content = bytearray(raw.read_bytes())
    content[-3000] ^= 8
    raw.write_bytes(content)
    log.unlink()
    shutil.copy(image, image.with_name("processed_image_more.h5"))
    ms.save(image, ms.load(image))  # whole, and another: it tells when it was made
    found = {one.path.rsplit("/", 1)[-1]: one for one in verify(converted, workers=1)}
    assert not found["capture.h5"].ok
    assert found["robot_log.h5"].problems == ("it is listed in manifest.jsonl, but missing",)
    assert any("bytes, by manifest.jsonl" in text for text in found["processed_image.h5"].problems)
    assert found["processed_image_more.h5"].notes == ("not in manifest.jsonl",)


def test_only_the_objects_asked_for_are_verified(converted):
    results = verify(ms.datasets.open(converted).only([EMPTY]), workers=1)
    assert {one.path.split("/")[0] for one in results} == {EMPTY}
    assert len(results) == 2


def test_a_listed_file_is_looked_for_wherever_it_is(converted):
    """What the manifest lists of an object whose folder is gone was passed over, and all below truth/."""
    (converted / "truth").mkdir()
    ours = read_manifest(converted)
    note = ManifestEntry("truth/0210_mug/job.json", "truth", 2, "0" * 64, ())
    write_manifest(converted, ours.updated([note]))
    assert all(one.ok for one in verify(ms.datasets.open(converted).only(["000"]), workers=1))
    shutil.rmtree(next(converted.glob("0210*")))
    found = {one.path: one for one in verify(converted, workers=1)}
    assert found[note.path].problems == ("it is listed in manifest.jsonl, but missing",)
    lost = [path for path in ours.entries if path.startswith("0210")]
    assert lost
    assert all(found[path].problems for path in lost)


def test_what_is_no_regular_file_is_not_waited_for(converted):
    path = next(converted.rglob("robot_log.h5"))
    path.unlink()
    os.mkfifo(path)
    found = {one.path: one for one in verify(converted, workers=1)}
    assert found[path.relative_to(converted).as_posix()].problems == ("it is no regular file",)


def test_settings_that_nest_too_deep_are_damage(converted):
    path = converted / "manifest.jsonl"
    head, rest = path.read_text().split("\n", 1)
    deep = json.loads(head)
    for _ in range(500):
        deep["settings"] = {"a": deep["settings"]}
    path.write_text(f"{json.dumps(deep)}\n{rest}")
    with pytest.raises(DamagedFileError, match=r"manifest.jsonl, line 1: settings nest too deep"):
        verify(converted, workers=1)
