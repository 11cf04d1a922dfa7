"""The published layout both ways: names, pickles and raw captures, bit for bit, and each thing that goes wrong."""

import json
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.miniature import (
    ANGLES,
    BOX,
    FAULTS,
    INFOS,
    MUG,
    NUMBERS,
    fault_folder,
    full_radar,
    hostile_deed,
    image_file,
    raw_file,
    recorded,
    same,
    scanned,
    small_grid,
    small_scene,
    values_of,
)
from helpers.oracles import relative
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError, UnknownNameError
from millisight.data import CameraFrame, CameraMask
from millisight.io.mito import (
    RecordedRow,
    experiment_folder,
    experiment_radar,
    is_experiment,
    kind_of,
    origin,
    place_of,
    published_grid,
    radar_folder,
    read_experiment,
    read_info,
    read_published,
    write_published,
    write_raw_experiment,
)
from millisight.io.mito import _raw as mito_raw
from millisight.io.raw import read_dca1000, read_position2go, write_dca1000


def experiment(miniature, name=MUG, number=1, sight="los"):
    return experiment_folder(miniature.healthy, name, ANGLES, number, sight)


# Names


def test_a_folder_is_told_by_its_name_and_back(tmp_path, monkeypatch):
    folder = experiment_folder(tmp_path, "065-a_cups", (0, -90, 180), 12, "nlos")
    place = place_of(folder)
    assert place == ("065-a", "cups", (0, -90, 180), 12, "nlos")
    assert str(place) == "065-a_cups/robot_collected/0_-90_180/exp12/nlos"
    assert not is_experiment(folder)
    folder.mkdir(parents=True)
    assert is_experiment(folder)
    assert not is_experiment(folder.parent)
    monkeypatch.chdir(folder)
    assert is_experiment(".")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("mug", ANGLES, 1, "los"), "object 'mug'"),
        (("../x_y", ANGLES, 1, "los"), "object '../x_y'"),
        (("1_a", (0, 0.5, 0), 1, "los"), "object '1_a' at angles"),
        (("1_a", ANGLES, "one", "los"), "experiment is 'one'"),
        (("1_a", ANGLES, 1, "dark"), "unknown kind of sight 'dark'"),
    ],
)
def test_names_that_are_none_are_refused(arguments, message, tmp_path):
    with pytest.raises((InputError, UnknownNameError), match=message):
        experiment_folder(tmp_path, *arguments)


@pytest.mark.parametrize(
    ("section", "name", "kind"),
    [
        ("radars", "processed_image.pkl", ("image", "")),
        ("radars", "processed_image_edges.h5", ("image", "_edges")),
        ("radars", "radar_masks_x.pkl", ("radar mask", "_x")),
        ("camera", "camera_masks.pkl", ("camera mask", "")),
        ("camera", "continuous_17.pkl", ("camera frame", "_17")),
        ("radars", "continuous.pkl", None),
        ("camera", "processed_image.pkl", None),
        ("radars", "processed_image.png", None),
    ],
)
def test_a_file_is_told_by_its_name(section, name, kind):
    assert kind_of(section, name) == kind


def test_an_origin_is_the_same_on_every_machine(tmp_path):
    path = tmp_path / "a" / MUG / "simulation" / "0_0_0" / "x.pkl"
    assert origin(path) == f"{MUG}/simulation/0_0_0/x.pkl"
    assert origin(tmp_path / "x.pkl") == "x.pkl"


def test_published_grids():
    """Ranges by a step, as floating-point numbers make them."""
    ends = {"tripod": (-0.37, -0.15), "styrofoam": (-0.55, -0.3)}
    shapes = {}
    for background, z in ends.items():
        for radar, x, y in (("77_ghz", (-0.1, 0.45), (-0.05, 0.55)), ("24_ghz", (-0.05, 0.37 + 0.05), (0.05, 0.65))):
            grid = published_grid(radar, background, farthest=0.37)
            expected = [np.arange(*x, 0.0025), np.arange(*y, 0.0025), np.arange(*z, 0.01)]
            shapes[radar, background] = grid.shape
            for name, axis in zip("xyz", expected, strict=True):
                assert getattr(grid, name) == pytest.approx(axis, abs=1e-9)
    assert shapes["77_ghz", "tripod"] == (220, 241, 22)
    assert shapes["77_ghz", "styrofoam"] == (220, 241, 26)
    assert published_grid("24_ghz", "tripod").bounds[1, 0] == pytest.approx(0.4475)
    with pytest.raises(UnknownNameError, match="60_ghz"):
        published_grid("60_ghz", "tripod")


# Pickles


@pytest.mark.slow
def test_every_pickle_comes_back_bit_for_bit(miniature, tmp_path):
    paths = [p for p in miniature.healthy.rglob("*.pkl") if p.name != "continuous.pkl"]
    kinds = {}
    for path in paths:
        record, extras = read_published(path)
        write_published(tmp_path / "again.pkl", record, extras)
        assert same(values_of(path), values_of(tmp_path / "again.pkl")), path
        kinds.setdefault(type(record), []).append(values_of(path))
    assert {kind: len(found) for kind, found in kinds.items()} == {
        ms.SarImage: 23, ms.Mask: 7, CameraFrame: 2, CameraMask: 2,
    }  # fmt: skip
    stored = [values["image"].dtype for values in kinds[ms.SarImage]]
    assert {np.dtype("complex64"), np.dtype("complex128")} == set(stored)
    assert {type(values["antenna_locs"]) for values in kinds[ms.SarImage]} == {type(None), dict, np.ndarray}
    assert {values["radar_mask"].ndim for values in kinds[ms.Mask]} == {2, 3}
    assert {values["depth"].dtype.name for values in kinds[CameraFrame]} == {"uint16", "float32"}


def test_an_image_is_conjugated_at_the_door(miniature):
    path = image_file(experiment(miniature))
    record, _ = read_published(path)
    published = values_of(path)["image"]
    assert np.abs(published.imag).max() > 0
    assert np.array_equal(record.values, published.conj())
    step = record.metadata["history"][-1]
    assert step["conjugated"] is True
    assert step["file"] == f"{MUG}/robot_collected/0_0_90/exp1/los/processed/radars/77_ghz/processed_image.pkl"


def test_a_mask_lies_on_its_image(miniature):
    path = image_file(experiment(miniature, number=2))
    mask, image = read_published(path.with_name("radar_masks.pkl")).record, read_published(path).record
    seen = image.project("z")
    assert np.array_equal(mask.grid_xy.x, image.grid.x)
    assert np.array_equal(mask.inside, seen > 0.4 * seen.max())


def test_what_else_a_file_holds_is_kept(miniature, tmp_path):
    more = {"note": "by hand", "count": 3, "tags": ["a", None], "swapped": np.arange(3, dtype=np.int16)}
    path = tmp_path / "processed_image_more.pkl"
    path.write_bytes(pickle.dumps({**values_of(image_file(experiment(miniature))), **more}))
    record, extras = read_published(path)
    assert set(more) < set(extras)
    write_published(tmp_path / "again.pkl", record, extras)
    assert same(values_of(path), values_of(tmp_path / "again.pkl"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": np.ones((10, 10, 5))}, "image is an array of float64; expected complex"),
        ({"image": np.ones((2, 2), complex)}, r"values has shape \(2, 2\)"),
        ({"x_locs": np.zeros(10)}, "x must increase strictly"),
        ({"x_locs": [[1], [1, 2]]}, "x_locs is not an array"),
        ({"odd": {1, 2}}, "odd is of type set"),
        ({"a.b": 1}, "the key 'a.b'"),
        ({3: 1}, "other keys than texts"),
    ],
)
def test_an_image_that_cannot_be_is_refused_by_name(changes, message, miniature, tmp_path):
    path = tmp_path / "processed_image.pkl"
    path.write_bytes(pickle.dumps({**values_of(image_file(experiment(miniature))), **changes}))
    with pytest.raises(FileError, match=f"{re.escape(str(path))}.*{message}"):
        read_published(path)


def test_files_that_are_not_of_the_layout_are_refused(tmp_path):
    for name, content, message in (
        ("picture.pkl", {}, "not a file of the published layout"),
        ("processed_image.h5", {}, "not a file of the published layout"),
        ("processed_image.pkl", [1], "holds a list; expected a dictionary"),
        ("radar_masks.pkl", {"mask": 1}, "has no 'radar_mask' but 'mask'"),
    ):
        (tmp_path / name).write_bytes(pickle.dumps(content))
        with pytest.raises((FormatError, DamagedFileError), match=message):
            read_published(tmp_path / name)
    with pytest.raises(InputError, match="write_published got VoxelGrid"):
        write_published(tmp_path / "x.pkl", published_grid("77_ghz", "tripod"))


# Raw captures


@pytest.mark.parametrize("radar", ["77_ghz", "24_ghz"])
@pytest.mark.parametrize("number", [1, 2])
def test_a_capture_that_was_written_gives_the_image_of_the_direct_path(radar, number, tmp_path):
    """Simulated, quantised, written as the recorders do, read, placed by the log: the image, to int16 quantisation."""
    info, scene = INFOS[number], small_scene(MUG)
    rows, log = recorded(scene, radar, info)
    folder = experiment_folder(tmp_path, MUG, ANGLES, number, "los")
    write_raw_experiment(folder, radar, rows, log, info=info)
    scan = read_experiment(folder, radar)
    capture = scan.to_capture(min_distance=0)
    assert len(capture.trajectory) == sum(len(row.frames) for row in rows) > 17
    used = len(scan.radar.array.rx_positions)
    assert used == {"77_ghz": 4, "24_ghz": number}[radar]
    assert np.array_equal(capture.frames, np.concatenate([row.frames for row in rows])[:, :, :used])
    direct_log, times = scanned(radar, info)
    # Positions and times pass through the robot's base frame and back.
    assert scan.log.positions == pytest.approx(direct_log.positions, abs=1e-12)
    assert capture.trajectory.times == pytest.approx(np.concatenate(times), abs=1e-6)
    direct = ms.simulate(scene, experiment_radar(radar, info), direct_log.at(np.concatenate(times)), model="diffuse")
    grid = small_grid(radar, info)
    actual, expected = (ms.form_image(c, grid).values for c in (capture, direct))
    scale = np.vdot(expected, actual) / np.vdot(expected, expected)
    assert scale.real > 0
    assert relative(actual, scale * expected) < 1e-3
    assert relative(actual.conj(), scale * expected) > 0.5


def test_repeats_are_dropped_as_published(miniature):
    capture = read_experiment(experiment(miniature), "77_ghz").to_capture()
    step = capture.metadata["history"][-1]
    assert (step["frames"], step["repeats"], step["lost"], step["outside_log"]) == (56, 8, 0, 0)
    assert step["min_distance"] == pytest.approx(3 / 16 * 299_792_458 / 77.5001e9)


def test_an_experiment_says_how_it_was_set_up(miniature):
    first = read_experiment(experiment(miniature), "77_ghz")
    second = read_experiment(radar_folder(experiment(miniature, number=2), "77_ghz", processed=False), "77_ghz")
    assert np.ptp(first.radar.array.rx_positions, axis=0) == pytest.approx([0.0058024, 0, 0], abs=1e-6)
    assert np.ptp(second.radar.array.rx_positions, axis=0) == pytest.approx([0, 0.0058024, 0], abs=1e-6)
    assert np.diff(first.rows[0].times) == pytest.approx(np.full(13, 0.125), abs=1e-6)
    assert np.diff(second.rows[0].times) == pytest.approx(np.full(13, 0.003), abs=1e-6)
    assert first.metadata["source"] == f"{MUG}/robot_collected/0_0_90/exp1/los/unprocessed/radars/77_ghz"
    assert first.metadata["experiment"] == INFOS[1]
    assert ms.VoxelGrid.regular(**second.metadata["image_grid"]).shape == (220, 241, 26)
    assert first.metadata["left_out"] == first.metadata["notes"] == []
    assert first.log.orientations is None


def test_frames_are_read_when_they_are_asked_for_and_a_row_at_a_time(miniature, monkeypatch):
    read = []
    monkeypatch.setattr(
        mito_raw, "read_dca1000", lambda path, **how: read.append(path.name) or read_dca1000(path, **how)
    )
    seen = []
    scan = read_experiment(experiment(miniature), "77_ghz", progress=lambda *done: seen.append(done))
    assert seen == [(i, 4) for i in range(1, 5)]
    assert read == []
    assert scan.rows[2].read().shape == (14, 1, 4, 512)
    assert read == [scan.rows[2].source]


@pytest.mark.parametrize(
    ("fault", "left_out", "notes", "frames"),
    [
        ("row_missing", ["row 1700000001 is listed, but its file is missing"], [], 42),
        ("row_unlisted", [], ["adc_data1799999999.bin exists, but is not listed"], 56),
        ("two_lane", [], ["adc_data1700000001.bin: the sample order is two-lane interleaved"], 56),
        ("zero_gap", ["adc_data1700000001.bin: 1 of 14 frames lost"], [], 56),
        ("cut_file", ["adc_data1700000001.bin: ends within frame 13, after 3191 of 8192 bytes"], [], 55),
        ("big_endian", ["adc_data1700000001.bin stand in big-endian order"], [], 42),
        ("short_block", ["p2g_data_1700500001.txt line 71 has 247 cells; expected 256"], [], 12),
        ("unequal_log", [], ["antenna.npz: 330 times, 333 places; the first 250", "14 of 56 frames lie outside"], 56),
    ],
)
def test_what_is_wrong_with_a_row_is_said_and_the_rest_is_read(fault, left_out, notes, frames, miniature):
    radar = "24_ghz" if fault == "short_block" else "77_ghz"
    scan = read_experiment(fault_folder(miniature.faults, fault), radar)
    for found, expected in ((scan.metadata["left_out"], left_out), (scan.metadata["notes"], notes)):
        assert len(found) == len(expected)
        assert all(e in f for e, f in zip(expected, found, strict=True))
    assert sum(len(row.times) for row in scan.rows) == frames
    whole = read_experiment(experiment(miniature), radar)
    kept = {row.source: row.read() for row in whole.rows}
    for row in scan.rows:
        there = np.zeros(len(row.times), bool) if row.missing is None else row.missing
        assert np.array_equal(row.read()[~there], kept[row.source][: len(row.times)][~there])
    assert sum(int(row.missing.sum()) for row in scan.rows) == (fault == "zero_gap")


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        ("log_backwards", DamagedFileError, r"antenna.npz, times_77\[41\]: .* follows .* expected times that increase"),
        ("log_truncated", DamagedFileError, "antenna.npz"),
        ("list_unequal", DamagedFileError, "continuous.pkl: all_radar_filenames has 4 entries, .* 2"),
        ("no_info", FileError, "experiment_info.json: no such file"),
        ("odd_info", DamagedFileError, "experiment_info.json: 'aperture size' is 'round'"),
        ("empty_files", DamagedFileError, "antenna.npz: the file is empty"),
    ],
)
def test_what_is_wrong_with_the_whole_is_an_error_that_names_it(fault, kind, message, miniature):
    with pytest.raises(kind, match=message):
        read_experiment(fault_folder(miniature.faults, fault), "77_ghz")


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        ("truncated_pickle", DamagedFileError, "processed_image.pkl"),
        ("hostile_pickle", FormatError, r"processed_image.pkl.*\bmkdir"),
        ("nan_in_image", DamagedFileError, r"processed_image.pkl: values has 1 values that are NaN .* \(1, 2, 3\)"),
        ("wrong_shape", DamagedFileError, r"radar_masks.pkl: inside has shape \(3, 4\); expected \(10, 10\)"),
        ("mask_without_image", FileError, "processed_image.pkl: no such file"),
    ],
)
def test_what_is_wrong_with_a_pickle_is_an_error_that_names_it(fault, kind, message, miniature):
    folder = fault_folder(miniature.faults, fault)
    path = image_file(folder)
    with pytest.raises(kind, match=message):
        read_published(path.with_name("radar_masks.pkl") if "mask" in message else path)
    assert not hostile_deed(folder).exists()


def test_the_faults_are_all_looked_at():
    source = Path(__file__).read_text(encoding="utf-8")
    untested = [name for name in FAULTS if f'("{name}"' not in source]
    assert untested == ["stray_files"]  # the readers never meet them


@pytest.fixture
def scan_folder(tmp_path):
    """A small raw experiment of its own, to be changed."""
    rows, log = recorded(small_scene(BOX), "77_ghz", INFOS[1])
    folder = experiment_folder(tmp_path, BOX, ANGLES, 1, "los")
    return write_raw_experiment(folder, "77_ghz", rows, log, info=INFOS[1])


def listed(raw, numbers, created, name="continuous.pkl"):
    (raw / name).write_bytes(
        pickle.dumps({"all_radar_filenames": numbers, "all_radar_created_ts": created, "pattern": 1})
    )


def test_logs_and_lists_in_several_files_are_joined(scan_folder):
    whole = read_experiment(scan_folder, "77_ghz")
    with np.load(scan_folder / "antenna.npz") as log:
        tables = dict(log)
    (scan_folder / "antenna.npz").unlink()
    for i, part in enumerate((slice(0, 100), slice(99, None))):  # the pose between stands in both
        np.savez(scan_folder / f"antenna_{i}.npz", **{name: table[part] for name, table in tables.items()})
    (scan_folder / "continuous.pkl").unlink()
    first, times = NUMBERS["77_ghz"], [row.times[0] for row in whole.rows]
    listed(scan_folder, [str(first), first + 1], times[:2], "continuous_1.pkl")
    listed(scan_folder, np.array([first + 3, first + 2]), [-1, times[2]], "continuous_2.pkl")
    joined = read_experiment(scan_folder, "77_ghz")
    assert np.array_equal(joined.log.positions, whole.log.positions)
    assert [row.source for row in joined.rows] == [row.source for row in whole.rows][:3]
    assert "robot log: 1 poses occur twice, with the same time and position" in joined.metadata["notes"]
    assert any("exists, but is not listed" in note for note in joined.metadata["notes"])


def test_rows_come_in_the_order_of_their_times_and_odd_entries_are_named(scan_folder):
    first = NUMBERS["77_ghz"]
    times = [row.times[0] for row in read_experiment(scan_folder, "77_ghz").rows]
    listed(scan_folder, [first + 1, first, "x", first, first + 2], [times[1], times[0], 1.0, 5.0, float("nan")])
    scan = read_experiment(scan_folder, "77_ghz")
    assert [row.times[0] for row in scan.rows] == times[:2]
    assert [text.split(":")[0] for text in scan.metadata["left_out"]] == [
        f"continuous.pkl, entry {i}" for i in (2, 3, 4)
    ]


def test_twelve_digit_names_and_foreign_files(scan_folder):
    path = raw_file(scan_folder.parents[2])
    number = 241124153000
    path.rename(path.with_name(f"adc_data_{number}.bin"))
    first = NUMBERS["77_ghz"]
    times = [row.times[0] for row in read_experiment(scan_folder, "77_ghz").rows]
    listed(scan_folder, [number, first], [times[-1] + 5, times[0]])
    (scan_folder / "radar_data" / "adc_data.log").write_text("log")
    scan = read_experiment(scan_folder, "77_ghz")
    assert [row.source for row in scan.rows] == [f"adc_data{first}.bin", f"adc_data_{number}.bin"]
    assert "radar_data/adc_data.log is not a raw file of this radar" in scan.metadata["notes"]


def test_orders_are_found_for_each_file_and_noise_goes_with_the_others(scan_folder):
    whole = {row.source: row.read() for row in read_experiment(scan_folder, "77_ghz").rows}
    data = sorted((scan_folder / "radar_data").iterdir())
    noise = np.random.default_rng(0).integers(-99, 99, size=(14, 1, 4, 512, 2)) @ [1, 1j]
    for path, swap in zip(data, (True, True, False), strict=False):
        frames = read_dca1000(path, samples=512, order="four-lane").samples
        order = "two-lane interleaved"
        write_dca1000(path, frames, order=order, sample_swap=swap)
    write_dca1000(data[3], noise, order="two-lane interleaved", sample_swap=True)
    scan = read_experiment(scan_folder, "77_ghz")
    for row in scan.rows[:3]:
        assert np.array_equal(row.read(), whole[row.source])
    assert np.array_equal(scan.rows[3].read(), noise.conj().astype(np.complex64))
    notes = scan.metadata["notes"]
    assert notes[0] == f"{data[3].name}: the sample order cannot be determined; assumed two-lane interleaved"
    assert notes[1].startswith(f"{data[0].name} and 1 more: the sample order is two-lane interleaved, Q before I;")
    assert notes[2].startswith(
        f"{data[2].name}: the sample order is two-lane interleaved; published files are four-lane"
    )
    assert len(notes) == 3


def test_an_experiment_without_a_usable_row_is_refused(scan_folder):
    for path in (scan_folder / "radar_data").iterdir():
        path.unlink()
    with pytest.raises(DamagedFileError, match="no row can be used, such as: row 1700000000 is listed"):
        read_experiment(scan_folder, "77_ghz")
    (scan_folder / "continuous.pkl").unlink()
    with pytest.raises(FileError, match="no list of rows"):
        read_experiment(scan_folder, "77_ghz")
    (scan_folder / "antenna.npz").unlink()
    with pytest.raises(FileError, match="no robot log"):
        read_experiment(scan_folder, "77_ghz")
    with pytest.raises(FileError, match="no raw files of the 24_ghz radar"):
        read_experiment(scan_folder, "24_ghz")


def test_robot_logs_that_cannot_be_are_refused(scan_folder):
    log = scan_folder / "antenna.npz"
    times, places = np.arange(50.0), np.zeros((50, 7))
    for tables, message in (
        ({"times_77": times}, "tx_77_locs"),
        ({"times_77": times, "tx_77_locs": places[:, :2]}, r"tx_77_locs is float64 \(50, 2\)"),
        ({"times_77": times, "tx_77_locs": places.astype(str)}, r"tx_77_locs is <U32 \(50, 7\); expected numbers"),
        ({"times_77": times, "tx_77_locs": places + 420}, "reaches 420; expected positions in metres"),
        ({"times_77": times[:5], "tx_77_locs": places}, "no robot log"),
        ({"times_77": times[:1], "tx_77_locs": places[:1]}, "a single pose"),
        ({"times_77": np.where(times == 7, np.nan, times), "tx_77_locs": places}, "antenna.npz.*times_77"),
        (
            {"times_77": np.where(times == 7, 6.0, times), "tx_77_locs": np.arange(350.0).reshape(50, 7) / 9},
            r"times_77\[7\]",
        ),
    ):
        np.savez(log, **tables)
        with pytest.raises(FileError, match=message):
            read_experiment(scan_folder, "77_ghz")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "has no text 'aperture size'"),
        ('{"aperture size": "normal", "rx offset": "z", "background": ""}', "'rx offset' is 'z'; expected 'x' or 'y'"),
        ('{"aperture size": "normal", "rx offset": "x", "background": NaN}', None),
        (" " * (2 << 20), "expected a few lines of JSON"),
    ],
)
def test_experiment_infos_that_cannot_be_are_refused(content, message, tmp_path):
    (tmp_path / "experiment_info.json").write_text(content)
    if message is None:
        assert read_info(tmp_path / "experiment_info.json")["background"] == "NaN"
        return
    with pytest.raises(FileError, match=f"experiment_info.json.*{message}"):
        read_info(tmp_path / "experiment_info.json")


def test_what_no_recorder_could_have_written_is_refused(tmp_path):
    info = INFOS[1]
    log, _ = scanned("77_ghz", info)
    folder = experiment_folder(tmp_path, BOX, ANGLES, 1, "los")
    frames = np.zeros((2, 1, 4, 512), np.complex64)
    for row, message in (
        (RecordedRow(10**10, 0.0, frames), "ten digits"),
        (RecordedRow(1, 0.0, frames[:, :, :2]), r"frames of row 1 has shape \(2, 1, 2, 512\)"),
        (RecordedRow(1, 0.0, frames + 40_000), "int16"),
    ):
        with pytest.raises(InputError, match=message):
            write_raw_experiment(folder, "77_ghz", [row], log, info=info)
    with pytest.raises(InputError, match="choose another experiment"):
        write_raw_experiment(folder, "77_ghz", [], log, info={**info, "rx offset": "y"})
    assert json.loads((folder.parent / "experiment_info.json").read_text()) == info


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 110, 115])
def test_a_24_ghz_file_has_the_110_frames_that_the_published_code_asks_for(count, tmp_path):
    """Short ones are filled with empty frames, which are left out when they are read; long ones become several."""
    info, rng = INFOS[1], np.random.default_rng(count)
    log = ms.Trajectory(times=np.arange(0, 40, 0.05), positions=np.arange(800)[:, None] * [0.0, 0.001, 0.0])
    frames = rng.integers(1, 1000, (count, 1, 2, 256)) + 1j * rng.integers(1, 1000, (count, 1, 2, 256))
    folder = experiment_folder(tmp_path, BOX, ANGLES, 1, "los")
    rows = [RecordedRow(7, 1.0, frames), RecordedRow(8, 20.0, frames[:2])]
    raw = write_raw_experiment(folder, "24_ghz", rows, log, info=info)
    files = sorted((raw / "radar_data").iterdir())
    assert len(files) == (3 if count > 110 else 2)
    for path in files:
        assert path.read_bytes().count(b"\n") == 110 * 16 * 4  # as the published code counts
    scan = read_experiment(folder, "24_ghz")
    assert scan.metadata["left_out"] == []
    (note,) = scan.metadata["notes"]
    empty = 110 * len(files) - count - 2
    assert f"filled with empty frames at the end, {empty} in all" in note
    first = [row for row in scan.rows if row.times[0] < 19]
    assert np.concatenate([row.times for row in first]) == pytest.approx(1.0 + 0.1 * np.arange(count))
    assert np.array_equal(np.concatenate([row.read() for row in first])[:, 0], frames[:, 0, :1].astype(np.complex64))


def test_a_24_ghz_file_is_read_once_for_its_frames_and_again_whenever_they_are_wanted_again(tmp_path, monkeypatch):
    """Text takes long to read."""
    log = ms.Trajectory(times=np.arange(0, 40, 0.05), positions=np.arange(800)[:, None] * [0.0, 0.001, 0.0])
    folder = experiment_folder(tmp_path, BOX, ANGLES, 1, "los")
    write_raw_experiment(folder, "24_ghz", [RecordedRow(7, 1.0, np.ones((3, 1, 2, 256)))], log, info=INFOS[1])
    read = []
    monkeypatch.setattr(
        mito_raw, "read_position2go", lambda path, **sizes: read.append(path) or read_position2go(path, **sizes)
    )
    (row,) = read_experiment(folder, "24_ghz").rows
    assert (row.read() == 1).all()
    assert len(read) == 1
    assert (row.read() == 1).all()
    assert len(read) == 2


def test_the_full_radar_is_the_used_one_and_more():
    one, both = experiment_radar("24_ghz", INFOS[1]), full_radar("24_ghz", INFOS[1])
    assert one.array.rx_positions.tolist() == both.array.rx_positions[:1].tolist() == [[0, -0.021, 0]]


def test_frames_come_at_the_pace_that_the_experiment_states(miniature, tmp_path):
    """A rig of one's own may be slower than the published ones; what is no time is refused."""
    source = miniature.healthy / MUG / "robot_collected" / "0_0_90" / "exp1"
    shutil.copytree(source, tmp_path / "exp1")
    path = tmp_path / "exp1" / "experiment_info.json"
    info = json.loads(path.read_text())
    published = read_experiment(tmp_path / "exp1" / "los", "77_ghz").rows[0].times
    path.write_text(json.dumps({**info, "frame period": {"77_ghz": 0.05}}))
    stated = read_experiment(tmp_path / "exp1" / "los", "77_ghz").rows[0].times
    np.testing.assert_allclose(np.diff(published), 0.125, atol=1e-6)
    np.testing.assert_allclose(np.diff(stated), 0.05, atol=1e-6)
    assert published[0] == stated[0]
    for wrong in ({"77_ghz": 0}, {"77_ghz": "fast"}, [0.05]):
        path.write_text(json.dumps({**info, "frame period": wrong}))
        with pytest.raises(DamagedFileError, match="'frame period' is"):
            read_experiment(tmp_path / "exp1" / "los", "77_ghz")
