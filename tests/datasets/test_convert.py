"""Conversion: bit for bit, one bad item no hindrance, and the same bytes however often it was killed."""

import hashlib
import os
import pickle
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.miniature import ANGLES, BOX, EMPTY, MUG, fault_folder, hostile_deed, image_file, same, values_of
from helpers.processes import alive, wait_for
from millisight.core.errors import DamagedFileError, FileError, InputError
from millisight.datasets import Manifest, convert, read_manifest, write_manifest
from millisight.io import load_extras, provenance
from millisight.io.mito import experiment_folder, radar_folder, read_experiment, write_published


@pytest.fixture(scope="module")
def converted(miniature, tmp_path_factory):
    """The miniature's healthy part, converted in two processes, and what was said of it."""
    out = tmp_path_factory.mktemp("converted")
    seen = []
    done = convert(miniature.healthy, out, workers=2, progress=lambda *count: seen.append(count))
    assert seen == [(i, 53) for i in range(1, 54)]
    return out, done


def contents(folder):
    """The bytes of every file."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.slow
def test_everything_is_converted_once(converted, miniature):
    out, done = converted
    assert (done.made, done.kept, done.failures, done.notes) == (53, 0, (), ())
    kinds = {}
    for item in ms.datasets.open(out).items:
        kinds[item.kind] = kinds.get(item.kind, 0) + 1
    assert kinds == {"image": 23, "radar mask": 7, "camera mask": 2, "camera frame": 2, "raw": 13, "info": 6}
    assert [one.missing for one in ms.datasets.open(out).objects] == [
        one.missing for one in ms.datasets.open(miniature.healthy).objects
    ]
    assert not list(out.rglob("*.pkl"))
    assert not (out / ".millisight.partial").exists()


@pytest.mark.slow
def test_pickles_come_back_from_the_converted_files_bit_for_bit(converted, miniature, tmp_path):
    out, _ = converted
    paths = [p for p in miniature.healthy.rglob("*.pkl") if p.name != "continuous.pkl"]
    assert len(paths) == 34
    for path in paths:
        ours = (out / path.relative_to(miniature.healthy)).with_suffix(".h5")
        write_published(tmp_path / "again.pkl", ms.load(ours), load_extras(ours))
        assert same(values_of(path), values_of(tmp_path / "again.pkl")), path


def test_raw_captures_come_with_their_poses_and_the_robot_log(converted, miniature):
    out, _ = converted
    for name, number, radar in ((MUG, 1, "77_ghz"), (MUG, 2, "24_ghz"), (BOX, 1, "77_ghz")):
        folder = experiment_folder(miniature.healthy, name, ANGLES, number, "los")
        ours = radar_folder(experiment_folder(out, name, ANGLES, number, "los"), radar, processed=False)
        scan = read_experiment(folder, radar)
        expected, found, log = scan.to_capture(), ms.load(ours / "capture.h5"), ms.load(ours / "robot_log.h5")
        assert found.frames.tobytes() == expected.frames.tobytes()
        assert found.trajectory.positions.tobytes() == expected.trajectory.positions.tobytes()
        assert found.metadata == expected.metadata
        assert log.positions.tobytes() == scan.log.positions.tobytes()
        assert log.times.tobytes() == scan.log.times.tobytes()


def test_the_manifest_says_what_each_file_is_and_was_made_of(converted, miniature):
    out, done = converted
    manifest = read_manifest(out)
    assert manifest.entries == done.manifest.entries
    files = {p.relative_to(out).as_posix(): p for p in out.rglob("*") if p.is_file() and not p.name.startswith(".")}
    assert set(files) - {"manifest.jsonl"} == set(manifest.entries)
    assert list(manifest.entries) == sorted(manifest.entries)
    for path, entry in manifest.entries.items():
        content = files[path].read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (entry.size, entry.sha256)
        for source in entry.sources:
            if source.files == 1:
                content = (miniature.healthy / source.path).read_bytes()
                assert (len(content), hashlib.sha256(content).hexdigest()) == (source.size, source.sha256)
    raw = next(e for path, e in manifest.entries.items() if path.endswith("77_ghz/capture.h5"))
    assert [(source.path.rsplit("/", 1)[-1], source.files) for source in raw.sources] == [
        ("77_ghz", 6), ("experiment_info.json", 1),
    ]  # fmt: skip
    mask = next(e for path, e in manifest.entries.items() if path.endswith("radar_masks.h5"))
    assert [source.path.rsplit("/", 1)[-1] for source in mask.sources] == ["radar_masks.pkl", "processed_image.pkl"]


def test_no_time_and_no_machine_is_in_the_files(converted):
    out, _ = converted
    assert provenance(out / EMPTY / "robot_collected/0_0_0/exp1/los/processed/radars/24_ghz/processed_image.h5") == {
        "record": "SarImage", "schema_version": 2, "code_version": ms.__version__, "command": "unknown",
        "created": "unknown",
    }  # fmt: skip


@pytest.mark.slow
def test_killed_and_resumed_it_ends_with_the_same_bytes(converted, miniature, tmp_path):
    """Killed with no chance to clean up, twice; resumed by one process where the other run had two."""
    out, _ = converted
    again = tmp_path / "again"
    command = [sys.executable, "-m", "millisight.cli.main", "dataset", "convert", miniature.healthy, "-o", again]
    for wanted in (3, 20):
        run = subprocess.Popen([*command, "--workers", "2"], start_new_session=True, stderr=subprocess.PIPE)
        wait_for(lambda: finished(again) >= wanted)  # noqa: B023
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        run.stderr.close()
        wait_for(lambda: not alive(run.pid))  # noqa: B023, its workers end with it
        assert wanted <= finished(again) < 60
        for temporary in again.glob(".*.part.*"):  # just being written; swept when a minute old
            temporary.unlink()
    done = convert(miniature.healthy, again, workers=1)
    assert done.failures == ()
    assert done.made + done.kept == 53
    assert done.made > 0
    assert contents(again) == contents(out)


def finished(folder):
    """How many files are in their places."""
    return sum(".millisight.partial" not in path.parts for path in folder.rglob("*.h5"))


@pytest.mark.slow
def test_what_is_there_and_right_is_kept_and_the_rest_made_anew(converted, miniature, tmp_path):
    root, out = tmp_path / "root", tmp_path / "out"
    shutil.copytree(miniature.healthy / BOX, root / BOX)
    shutil.copytree(converted[0] / BOX, out / BOX)
    shutil.copy(converted[0] / "manifest.jsonl", out)
    before = contents(out / BOX)
    changed = {p: p.stat().st_mtime_ns for p in out.rglob("*.h5")}
    done = convert(root, out, workers=1)  # the sources' times are others, their checksums not
    assert (done.made, done.kept) == (0, 19)
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*.h5")} == changed
    # One output is damaged, one is gone, one source changed.
    images = sorted(out.rglob("processed_image.h5"))
    images[0].write_bytes(images[0].read_bytes()[:-1])
    images[1].unlink()
    source = image_file(experiment_folder(root, BOX, ANGLES, 2, "los"))
    values = pickle.loads(source.read_bytes())  # noqa: S301
    source.write_bytes(pickle.dumps({**values, "image": values["image"] * 2}))
    done = convert(root, out, workers=1)
    assert (done.made, done.kept) == (4, 15)  # and the mask that lies on the changed image
    differing = {path for path, content in contents(out / BOX).items() if content != before[path]}
    assert differing == {"robot_collected/0_0_90/exp2/los/processed/radars/77_ghz/processed_image.h5"}
    # A copy of another source that keeps size and time.
    time = source.stat().st_mtime_ns
    content = bytearray(source.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8] = np.float64(0.5).tobytes()
    source.write_bytes(content)
    os.utime(source, ns=(time, time))
    assert convert(root, out, workers=1).made >= 1
    # Other settings: everything anew, and the manifest says with which.
    done = convert(root, out, min_distance=0, workers=1)
    assert (done.made, done.kept) == (19, 0)
    assert read_manifest(out).settings["min_distance"] == 0
    capture = ms.load(next(out.rglob("77_ghz/capture.h5")))
    assert capture.metadata["history"][-1]["repeats"] == 0
    assert len(capture.trajectory) == 56


@pytest.mark.slow
def test_some_objects_now_and_others_later(miniature, converted, tmp_path):
    for name in (MUG, EMPTY):
        convert(ms.datasets.open(miniature.healthy).only([name]), tmp_path, workers=1)
    expected = {path: content for path, content in contents(converted[0]).items() if path.startswith((MUG, EMPTY))}
    found = contents(tmp_path)
    assert {path: found[path] for path in expected} == expected
    assert set(read_manifest(tmp_path).entries) == set(expected)


@pytest.mark.slow
def test_one_bad_item_does_not_stop_the_rest(miniature, tmp_path):
    done = convert(miniature.faults, tmp_path, workers=1)
    failed = sorted({path.split("/")[0][4:] for path, _ in done.failures})
    assert failed == [
        "empty_files", "hostile_pickle", "list_unequal", "log_backwards", "log_truncated", "mask_without_image",
        "nan_in_image", "no_info", "odd_info", "truncated_pickle", "wrong_shape",
    ]  # fmt: skip
    assert not hostile_deed(fault_folder(miniature.faults, "hostile_pickle")).exists()
    assert done.made == 29
    assert {path.split("/")[0][4:] for path, _ in done.notes} == {
        "row_missing", "row_unlisted", "two_lane", "zero_gap", "cut_file", "big_endian", "short_block", "unequal_log",
    }  # fmt: skip
    outputs = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.h5")}
    assert outputs < set(read_manifest(tmp_path).entries)
    for path, reason in done.failures:
        assert str(tmp_path) not in reason
        assert not path.startswith("/")


def test_folders_that_cannot_be_are_refused(miniature, converted, tmp_path):
    with pytest.raises(InputError, match="is the dataset itself"):
        convert(miniature.healthy, miniature.healthy)
    with pytest.raises(InputError, match="no file left to convert"):
        convert(converted[0], tmp_path)
    with pytest.raises(FileError, match="no object"):
        convert(tmp_path, tmp_path / "x")
    with pytest.raises(InputError, match="min_distance is -1 m"):
        convert(miniature.healthy, tmp_path / "x", min_distance=-1)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "line 1: not JSON"),
        ("{}\n", "is not a manifest of millisight"),
        ('{"format": "millisight dataset manifest", "version": 9}\n', "is of version 9"),
        ('{"format": "millisight dataset manifest", "version": 1}\n', "settings is None"),
        ('HEAD\n{"path": "a"\n', "line 2: not JSON"),
        ('HEAD\n{"path": "a"}\n', "line 2: 'sources'"),
        ('HEAD\n{"path": "a\\u0000b", "kind": "x", "size": 1, "sha256": "0", "sources": []}\n', "line 2: .* path"),
        ('HEAD\n{"path": "\\ud800", "kind": "x", "size": 1, "sha256": "0", "sources": []}\n', "line 2: .*surrogate"),
        ('HEAD\n{"path": "../a", "kind": "x", "size": 1, "sha256": "0", "sources": []}\n', "line 2: .* path"),
        ('HEAD\n{"path": "a", "kind": "x", "size": "1", "sha256": "0", "sources": []}\n', "line 2: sizes"),
        ("HEAD\n" + "[" * 100_000, "line 2: not JSON"),
    ],
)
def test_damaged_manifests_are_refused_by_line(content, message, tmp_path):
    head = '{"format": "millisight dataset manifest", "version": 1, "settings": {}}'
    (tmp_path / "manifest.jsonl").write_text(content.replace("HEAD", head))
    with pytest.raises(FileError, match=f"manifest.jsonl.*{message}"):
        read_manifest(tmp_path)
    assert read_manifest(Path(tmp_path, "none")) is None


def test_a_damaged_checksum_cache_is_worked_out_again(miniature, converted, tmp_path):
    shutil.copytree(converted[0], tmp_path / "out")
    for content in (b"", b"[]", b'{"a": {"b": 1}}', b"\xff", b'{"a": {"b": [1e999, 2, "0"]}}'):
        (tmp_path / "out" / ".millisight.checksums.json").write_bytes(content)
        done = convert(ms.datasets.open(miniature.healthy).only([EMPTY]), tmp_path / "out", workers=1)
        assert (done.made, done.kept) == (0, 2)


def test_a_damaged_converted_file_is_refused(converted, tmp_path):
    path = shutil.copy(next(converted[0].rglob("camera_masks.h5")), tmp_path)
    content = bytearray(Path(path).read_bytes())
    content[len(content) // 2] ^= 1
    Path(path).write_bytes(content)
    with pytest.raises(DamagedFileError, match="camera_masks.h5"):
        ms.load(path)


def test_a_damaged_output_of_the_same_size_is_made_anew(converted, miniature, tmp_path):
    root, out = ms.datasets.open(miniature.healthy).only([EMPTY]), tmp_path / "out"
    shutil.copytree(converted[0], out)
    path = next((out / EMPTY).rglob("processed_image.h5"))
    whole, times = path.read_bytes(), path.stat()
    path.write_bytes(bytes(len(whole)))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    done = convert(root, out, workers=1)
    assert (done.made, done.kept) == (1, 1)
    assert path.read_bytes() == whole


@pytest.mark.slow
def test_two_conversions_into_one_folder_are_refused(miniature, tmp_path):
    """They deleted each other's partial files."""
    root, out = tmp_path / "root", tmp_path / "out"
    shutil.copytree(miniature.healthy / BOX, root / BOX)
    command = [sys.executable, "-m", "millisight.cli.main", "dataset", "convert", root, "-o", out]
    first = subprocess.Popen([*command, "--workers", "1"], stderr=subprocess.PIPE)
    wait_for(lambda: finished(out) >= 1)
    with pytest.raises(FileError, match=rf"another run \(process {first.pid}\) is using .*; wait for it, or stop it"):
        convert(root, out, workers=1)
    _, err = first.communicate(timeout=120)
    assert first.returncode == 0, err
    assert not [path.name for path in out.iterdir() if path.name in (".millisight.lock", ".millisight.partial")]


@pytest.mark.slow
def test_a_pipe_within_a_dataset_is_no_file(miniature, tmp_path):
    """Whoever opens one waits for ever."""
    root = tmp_path / "root"
    shutil.copytree(miniature.healthy / BOX, root / BOX)
    first, second = (experiment_folder(root, BOX, ANGLES, number, "los") for number in (1, 2))
    raw = radar_folder(first, "77_ghz", processed=False)
    pipes = [
        image_file(second),
        min((raw / "radar_data").iterdir()),
        next(radar_folder(first, "24_ghz", processed=False).glob("antenna*.npz")),
    ]
    for path in pipes:
        path.unlink()
        os.mkfifo(path)
    for command, words in (
        (("convert", root, "-o", tmp_path / "out"), ("is a device or a pipe", "missing", "holds no robot log")),
        (("verify", root), ("is a device or a pipe",)),
    ):
        shown = [sys.executable, "-m", "millisight.cli.main", "dataset", *command, "--workers", "1"]
        done = subprocess.run(shown, capture_output=True, text=True, timeout=120)
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        for word in words:
            assert word in done.stdout + done.stderr
    assert finished(tmp_path / "out") >= 10


def test_a_file_of_the_users_where_ours_would_go_stays(converted, miniature, tmp_path):
    out, root = tmp_path / "out", ms.datasets.open(miniature.healthy).only([EMPTY])
    mine = out / next((converted[0] / EMPTY).rglob("processed_image.h5")).relative_to(converted[0])
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"mine")
    done = convert(root, out, workers=1)
    assert [why for _, why in done.failures] == [
        f"{mine} is there already, was not made here, and would be overwritten; move it away"
    ]
    assert mine.read_bytes() == b"mine"
    mine.unlink()
    assert convert(root, out, workers=1).failures == ()


@pytest.mark.slow
def test_other_settings_overwrite_what_an_earlier_conversion_made(miniature, tmp_path):
    """Also where a run between the two was broken off at once."""
    root, out = ms.datasets.open(miniature.healthy).only([BOX]), tmp_path / "out"
    assert convert(root, out, workers=1).failures == ()

    def stop(*count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        convert(root, out, min_distance=0.002, workers=1, progress=stop)
    done = convert(root, out, min_distance=0.002, workers=1)
    assert done.failures == ()


def test_a_changed_checksum_of_a_source_is_not_believed(converted, miniature, tmp_path):
    out, root = tmp_path / "out", ms.datasets.open(miniature.healthy).only([EMPTY])
    convert(root, out, workers=1)
    before, cache = read_manifest(out), (out / ".millisight.checksums.json").read_text()
    digest = next(iter(before.entries.values())).sources[0].sha256
    assert digest in cache
    (out / ".millisight.checksums.json").write_text(cache.replace(digest, "0" * 64))
    assert convert(root, out, workers=1).kept == 2
    assert read_manifest(out).entries == before.entries


def test_a_dataset_of_another_kind_is_not_converted_into(miniature, tmp_path):
    """Its manifest was replaced."""
    write_manifest(tmp_path, Manifest(settings={"generator": 1, "recipe": "r", "seed": 0}, entries={}))
    before = contents(tmp_path)
    with pytest.raises(InputError, match=r"holds another dataset: its manifest says .*'recipe': 'r'.*choose another"):
        convert(miniature.healthy, tmp_path, workers=1)
    assert contents(tmp_path) == before
