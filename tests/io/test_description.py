"""A description and the files it names give the capture that was meant, whatever the files' format, axes and units."""

import pickle
import re
import time
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

import millisight as ms
from helpers.oracles import point_frames, point_image, shared
from millisight.calibration import read_capture
from millisight.core.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.io.description import description_in, read_frames, read_scan
from millisight.io.raw import write_dca1000, write_position2go

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES, HOW_TO = ROOT / "examples" / "captures", ROOT / "docs" / "how-to"


def small_scan():
    """A 3 x 4 raster, 5 mm by 4 mm, of 2 TX, 3 RX and 8 samples at 24 GHz: radar, positions and our frames."""
    radar = ms.Radar(
        name="test radar",
        waveform=ms.Waveform.stepped(24.0e9, 25e6, 8),
        array=ms.AntennaArray(
            tx_positions=[[0, 0, 0], [0.01, 0, 0]], rx_positions=[[0.02, 0, 0], [0.03, 0, 0], [0.04, 0, 0]]
        ),
    )
    x, y = 0.005 * (np.arange(3) - 1), 0.004 * (np.arange(4) - 1.5)
    positions = np.array([[a, b, 0.1] for a in x for b in y])
    tx, rx = (positions[:, None] + a for a in (radar.array.tx_positions, radar.array.rx_positions))
    frames = point_frames(
        np.array([[0.01, 0.02, -0.1], [-0.02, 0, -0.2]]), [1.0, 0.5j], tx, rx, radar.waveform.frequencies
    )
    return radar, positions, frames.astype(np.complex64)


RADAR = """
[radar]
name = "test radar"
start_frequency = 24e9
step = 25e6
tx_positions = [[0, 0, 0], [0.01, 0, 0]]
rx_positions = [[0.02, 0, 0], [0.03, 0, 0], [0.04, 0, 0]]
"""
RASTER = """
[positions]
raster = { step = [0.005, 0.004], center = [0, 0, 0.1] }
"""
FRAMES = """
[frames]
file = "frames.npy"
axes = ["pose", "tx", "rx", "sample"]
phase_sign = -1
"""
POINTS = """
[positions]
points = { file = "positions.csv", unit = "mm" }
"""


def described(folder, text):
    (folder / "scan.toml").write_text(text, encoding="utf-8")
    return folder / "scan.toml"


def check(capture, order=None):
    """The capture is that of `small_scan`, its poses in another order where one is given."""
    radar, positions, frames = small_scan()
    order = np.arange(12) if order is None else order
    assert capture.frames.shape == (12, 2, 3, 8)
    assert np.array_equal(capture.frames, frames[order])
    assert np.allclose(capture.trajectory.positions, positions[order], atol=1e-12)
    assert np.allclose(capture.radar.waveform.frequencies, radar.waveform.frequencies, rtol=1e-12)
    assert np.array_equal(capture.rx_positions, capture.trajectory.positions[:, None] + radar.array.rx_positions)
    assert capture.metadata["history"][0]["step"] == "read_capture"


def on_raster():
    """(x, y, tx, rx, sample)"""
    return small_scan()[2].reshape(3, 4, 2, 3, 8)


def test_axes_in_any_order_and_direction(tmp_path):
    for axes in (
        ["x", "y", "tx", "rx", "sample"], ["sample", "-y", "x", "rx", "tx"], ["-x", "rx", "sample", "-tx", "y"],
        ["-rx", "-sample", "y", "tx", "-x"],
    ):  # fmt: skip
        names = [axis.removeprefix("-") for axis in axes]
        data = np.moveaxis(on_raster(), range(5), [names.index(n) for n in ("x", "y", "tx", "rx", "sample")])
        data = np.flip(data, [i for i, axis in enumerate(axes) if axis.startswith("-")])
        np.save(tmp_path / "frames.npy", data)
        text = f'{RADAR}[frames]\nfile = "frames.npy"\naxes = {axes}\nphase_sign = -1\n{RASTER}'
        poses = np.arange(12).reshape(3, 4)
        slow_is_x = names.index("x") < names.index("y")
        check(read_capture(described(tmp_path, text)), (poses if slow_is_x else poses.T).ravel())


@pytest.mark.parametrize("save", ["npy", "npz", "mat 5", "mat 7.3", "h5", "pkl"])
def test_every_format(tmp_path, save):
    data, name = small_scan()[2], "data"
    path = tmp_path / f"frames.{save.split()[0]}"
    if save == "npy":
        with open(path, "wb") as file:
            np.save(file, np.arange(3))
            np.save(file, data)
        name = "1"
    elif save == "npz":
        np.savez_compressed(path, data=data, other=np.zeros(3))
    elif save == "mat 5":
        import scipy.io

        scipy.io.savemat(path, {"scan": {"data": data, "text": "hello"}})
        name = "scan.data"
    elif save == "pkl":
        path.write_bytes(pickle.dumps({"data": data, "other": [1, 2]}))
    else:
        with h5py.File(path, "w", userblock_size=512 if save == "mat 7.3" else 0) as file:
            file["scan/data"] = data.T if save == "mat 7.3" else data
        name = "scan/data"
        if save == "mat 7.3":
            with open(path, "r+b") as file:
                file.write(b"MATLAB 7.3")
            name = "scan.data"
    text = RADAR + FRAMES.replace('"frames.npy"', f'"{path.name}"\narray = "{name}"')
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1], delimiter=",", header="x,y,z", comments="")
    check(read_capture(described(tmp_path, text + POINTS)))


def test_parts_units_chirps_and_signs(tmp_path):
    """I and Q as axes or as arrays, Q first, the other sign, several chirps, a flat array: all the same frames."""
    frames = small_scan()[2]
    conjugate = frames.conj()
    np.savez(
        tmp_path / "frames.npz",
        parts=np.stack([conjugate.imag, conjugate.real]), i=conjugate.real, q=conjugate.imag,
        chirps=np.stack([frames - 1, frames + 1, frames], axis=1), flat=frames.ravel(),
        f=np.linspace(24.0, 24.175, 8)[:, None], positions=1e3 * small_scan()[1].T,
    )  # fmt: skip
    base = '[positions]\npoints = { file = "points.npy", unit = "mm" }\n' + RADAR.replace(
        "start_frequency = 24e9\nstep = 25e6", 'frequencies = { array = "f", unit = "GHz" }'
    )
    np.save(tmp_path / "points.npy", 1e3 * small_scan()[1])
    base += '[frames]\nfile = "frames.npz"\n'
    axes = '["pose", "tx", "rx", "sample"]'
    for text in (
        f'array = "parts"\naxes = ["part", {axes[1:]}\nparts = ["Q", "I"]\nphase_sign = 1',
        f'array = ["i", "q"]\naxes = ["part", {axes[1:]}\nparts = ["I", "Q"]\nphase_sign = 1',
        f'array = ["q", "i"]\naxes = ["part", {axes[1:]}\nparts = ["I", "Q"]\nphase_sign = -1',  # i times the frames
        'array = "chirps"\naxes = ["pose", "chirp", "tx", "rx", "sample"]\nchirp = 2\nphase_sign = -1',
        'array = "chirps"\naxes = ["pose", "chirp", "tx", "rx", "sample"]\nchirp = "mean"\nphase_sign = -1',
        f'array = "flat"\nshape = [12, 2, 3, 8]\naxes = {axes}\nphase_sign = -1',
    ):
        capture = read_capture(described(tmp_path, base + text))
        if 'array = ["q", "i"]' in text:
            assert np.allclose(capture.frames, 1j * frames, atol=1e-6)
        elif '"mean"' in text:
            assert np.allclose(capture.frames, frames, atol=1e-6)
        else:
            check(capture)


def test_real_samples_become_analytic(tmp_path):
    frames = small_scan()[2][:, :1, :1]
    samples = np.arange(64)
    waves = np.real(frames[..., :1] * np.exp(2j * np.pi * 5 * samples / 64))  # whole periods: no leakage
    np.save(tmp_path / "frames.npy", waves)
    text = '[radar]\nstart_frequency = 24e9\nslope = 1e12\nsample_rate = 1e6\n[frames]\nfile = "frames.npy"\n'
    text += 'axes = ["pose", "tx", "rx", "sample"]\nphase_sign = -1\n'
    text += "[positions]\nraster = { step = 0.1, counts = [3, 4] }\n"
    with pytest.raises(FormatError, match="analytic; expected true"):
        read_capture(described(tmp_path, text))
    text = text.replace("phase_sign", "analytic = true\nphase_sign")
    waves = frames[..., :1] * np.exp(2j * np.pi * 5 * samples / 64)
    for slope, sign, kept in (("1e12", 1, waves.conj()), ("-1e12", -1, waves)):
        good = text.replace("1e12", slope).replace("phase_sign = -1", f"phase_sign = {sign}")
        capture = read_capture(described(tmp_path, good))
        assert np.allclose(capture.frames, kept, atol=1e-5)
        assert capture.radar.waveform.slope == float(slope)
        with pytest.raises(FormatError, match=f"expected {sign}: the positive half"):
            read_capture(described(tmp_path, good.replace(f"phase_sign = {sign}", f"phase_sign = {-sign}")))


def test_rasters_of_frames_in_the_order_of_time(tmp_path):
    """One axis of poses dealt out over rows, to and fro, along either axis, from a corner or about a centre."""
    _, positions, frames = small_scan()
    grid = np.arange(12).reshape(3, 4)
    to_and_fro = grid.copy()
    to_and_fro[1::2] = to_and_fro[1::2, ::-1]
    along_x = grid.T.copy()
    along_x[1::2] = along_x[1::2, ::-1]
    for raster, order in (
        ("counts = [3, 4]", grid), ("counts = [3, 4], serpentine = true", to_and_fro),
        ('counts = [3, 4], along = "x"', grid.T), ('counts = [3, 4], along = "x", serpentine = true', along_x),
    ):  # fmt: skip
        np.save(tmp_path / "frames.npy", frames[order.ravel()])
        text = RASTER.replace("center", f"{raster}, center")
        check(read_capture(described(tmp_path, RADAR + FRAMES + text)), order.ravel())
    corner = "[positions]\nraster = { step = [-0.005, 0.004], start = [1.005, 1.994, 0.1], counts = [3, 4] }\n"
    corner += "origin = [1, 2, 0]\norientations = [0, 0, 1, 0]\n"
    np.save(tmp_path / "frames.npy", frames[grid[::-1].ravel()])
    capture = read_capture(described(tmp_path, RADAR + FRAMES + corner))
    assert np.allclose(capture.trajectory.positions, positions[grid[::-1].ravel()], atol=1e-12)
    assert np.allclose(capture.trajectory.orientations, [[0, 0, 1, 0]] * 12)
    assert np.array_equal(capture.frames, frames[grid[::-1].ravel()])


def raw_scan(radar, positions, scale):
    """Frames (P, 1, R, N) of two points for a preset radar, in whole counts, of the sign of the released captures."""
    tx, rx = (positions[:, None] + a for a in (radar.array.tx_positions, radar.array.rx_positions))
    points = np.array([[0.0, 0.0, -0.05], [0.02, -0.01, -0.1]])
    frames = point_frames(points, [1.0, 0.7], tx, rx, radar.waveform.frequencies, radar.path_offset)
    return np.round(scale * frames.conj())


def test_recorders_files_in_several_rows(tmp_path):
    """DCA1000 files, the order found from the data, and Position2Go files; a raster over all, or a point each."""
    positions = ms.Trajectory.raster(size=(0.02, 0.03), step=0.01, center=(0, 0, 0.2)).positions
    assert len(positions) == 12
    np.save(tmp_path / "positions.npy", positions)
    for preset, suffix, format_keys in (
        ("iwr1443", "bin", "samples = 512"), ("position2go", "txt", "chirps = 2"),
    ):  # fmt: skip
        radar = ms.Radar.preset(preset)
        raw = raw_scan(radar, positions, 1000)
        chirps = np.concatenate([raw, 0 * raw], axis=1) if suffix == "txt" else raw  # the first one is used
        for row in range(3):
            write = write_dca1000 if suffix == "bin" else write_position2go
            write(tmp_path / f"row_{8 + row}.{suffix}", chirps[4 * row : 4 * row + 4])
        for where in (
            "raster = { step = 0.01, counts = [3, 4], center = [0, 0, 0.2] }",
            'points = { file = "positions.npy" }',
        ):
            text = f'[radar]\npreset = "{preset}"\n[frames]\nfile = "row_*.{suffix}"\n{format_keys}\nphase_sign = 1\n'
            capture = read_capture(described(tmp_path, f"{text}[positions]\n{where}\n"))
            assert np.array_equal(capture.frames, raw.conj())
            assert np.allclose(capture.trajectory.positions, positions)
            assert capture.radar.path_offset == radar.path_offset
        assert capture.metadata["history"][0]["files"] == [f"row_{n}.{suffix}" for n in (8, 9, 10)]
    with pytest.raises(FormatError, match=r"samples is missing|has no samples; expected the number of samples"):
        read_capture(
            described(tmp_path, text.replace("*.txt", "*.bin").replace("chirps = 2", "") + "[positions]\nraster={}\n")
        )


SWEEP = (
    '[radar]\npreset = "iwr1443"\n[frames]\nfile = "row_*.bin"\nsamples = 512\nphase_sign = 1\n'
    '[positions]\nlog = "robot.csv"\norigin = [0.4, -0.2, 0]\n[times]\nstart = [10, 11]\nperiod = 0.01\n'
)


def swept(folder):
    """Two rows of 30 frames each of a DCA1000 recording, 2 mm apart, a robot's log beside them, and what is true."""
    log_times = np.arange(9.9, 11.5, 0.02)
    log = np.stack([0.4 + 0.2 * (log_times - 10.5), -0.2 + 0.01 * log_times, 0.3 + 0 * log_times], axis=1)
    log[:, 2] += 0.001 * np.sin(5 * log_times)
    columns = np.column_stack([log_times, log])
    np.savetxt(folder / "robot.csv", columns, delimiter=",", header="time,x,y,z", comments="", fmt="%.17g")
    times = np.concatenate([start + 0.01 * np.arange(30) for start in (10, 11)])
    from scipy.interpolate import CubicSpline

    positions = CubicSpline(log_times, log)(times) - [0.4, -0.2, 0]
    raw = raw_scan(ms.Radar.preset("iwr1443"), positions, 1000)
    for row in range(2):
        write_dca1000(folder / f"row_{row}.bin", raw[30 * row : 30 * row + 30])
    return times, positions, raw.conj().astype(np.complex64)


@pytest.mark.slow
def test_a_robots_log_places_the_frames(tmp_path):
    times, positions, frames = swept(tmp_path)
    scan = read_scan(described(tmp_path, SWEEP))
    assert [row.source for row in scan.rows] == ["row_0.bin", "row_1.bin"]
    capture = read_capture(tmp_path / "scan.toml")
    assert len(capture.trajectory) == 60
    assert np.allclose(capture.trajectory.times, times)
    assert np.allclose(capture.trajectory.positions, positions, atol=1e-9)
    assert np.array_equal(capture.frames, frames)
    lines = (tmp_path / "robot.csv").read_text().splitlines()[1:]
    other = ["Arm 7;;;;", "t [s];joint;z/mm;y/mm;x/mm"]
    for t, x, y, z in (line.split(",") for line in lines):
        other.append(";".join([t, "3,5", *(repr(1e3 * float(v)) for v in (z, y, x))]).replace(".", ","))
    (tmp_path / "arm.txt").write_text("\n".join(other))
    np.savez(tmp_path / "robot.npz", times=[0.0])
    log = '{ file = "arm.txt", skip_rows = 1, decimal = ",", columns = [0, 4, "y/mm", 2], unit = "mm" }'
    text = described(tmp_path, SWEEP.replace('"robot.csv"', log))
    assert np.allclose(read_capture(text).trajectory.positions, positions, atol=1e-9)
    with pytest.raises(FileError, match=r"arm.txt, line 3 has .*set decimal = \",\""):
        read_capture(described(tmp_path, SWEEP.replace('"robot.csv"', log.replace('decimal = ",", ', ""))))
    described(tmp_path, SWEEP)
    late = read_capture(tmp_path / "scan.toml", clock=ms.ClockCorrection(offset=0.05))
    assert np.allclose(late.trajectory.positions[5], positions[10], atol=2e-5)
    calibrated = read_capture(
        described(tmp_path, SWEEP + "[calibration]\nsubtract_mean = true\nsamples = [100, 400]\n")
    )
    assert [entry["step"] for entry in calibrated.metadata["history"]] == [
        "read_capture", "place_frames", "subtract_mean", "crop_samples",
    ]  # fmt: skip
    assert np.allclose(calibrated.frames, (frames - frames.mean(axis=0))[..., 100:400], atol=1e-3)
    for old, new, message in (
        ("start = [10, 11]", "start = 10", "2 times, of the first frame of each file, not 1"),
        ('"robot.csv"', '{ file = "robot.csv", times = "t" }', "this key only for arrays; for a text file, columns"),
        ('"robot.csv"', '{ file = "robot.csv", columns = ["time", "x"] }', r"log: columns is .*expected 4 or 8"),
        ('"robot.csv"', '{ file = "robot.csv", columns = [0, 1, 2, 9] }', "column in .*robot.csv: 9. Known: 0, 1"),
        ('"robot.csv"', '{ file = "robot.csv", decimal = "," }', "robot.csv, line 2 .*a number cannot contain a point"),
        (
            '"robot.csv"',
            '{ file = "robot.npz", skip_rows = 1 }',
            "skip_rows is '1'; expected this key only for text files",
        ),
        ("[times]\nstart = [10, 11]\nperiod = 0.01\n", "", "no table .times. with the times"),
    ):
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(described(tmp_path, SWEEP.replace(old, new)))
    write_dca1000(tmp_path / "one.bin", raw_scan(ms.Radar.preset("iwr1443"), positions[:1], 1000))
    still = SWEEP.split("[positions]")[0].replace("row_*", "one") + "[positions]\nraster = {}\n"
    with pytest.raises(InputError, match="no robot log.*leave clock out"):
        read_capture(described(tmp_path, still), clock=ms.ClockCorrection(offset=0.1))


def test_calibration_takes_its_steps_in_order(tmp_path):
    frames = small_scan()[2]
    rng = np.random.default_rng(0)
    empty = (rng.normal(size=frames.shape) + 1j * rng.normal(size=frames.shape)).astype(np.complex64)
    gains = np.array([[1, 2, 0.5], [1j, -1, 3]])
    phases = np.linspace(0, 3, 8)
    recorded = frames * np.exp(-1j * phases) * gains[:, :, None] + empty
    np.savez(tmp_path / "frames.npz", data=recorded.conj(), empty=empty.conj(), one=empty[:1].conj())
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1])
    np.savetxt(tmp_path / "phase.txt", [24e9 + 25e6 * np.arange(8), np.degrees(phases)])
    text = RADAR + FRAMES.replace("-1", "1").replace('"frames.npy"', '"frames.npz"\narray = "data"') + POINTS
    text += """
[calibration]
background = { array = "empty", frame = "same" }
gains = { amplitudes = [[1, 2, 0.5], [1, 1, 3]], phases = [[0, 0, 0], [1.5707963267948966, 3.141592653589793, 0]] }
phase = { frequencies = { file = "phase.txt", index = 0 }, values = { file = "phase.txt", index = 1, unit = "deg" } }
"""
    capture = read_capture(described(tmp_path, text))
    steps = [entry["step"] for entry in capture.metadata["history"]]
    assert steps == ["read_capture", "subtract_background", "divide_gains", "add_phase"]
    assert np.allclose(capture.frames, frames, atol=2e-6)
    plain = read_capture(described(tmp_path, text.split("gains")[0].replace('"empty", frame = "same"', '"one"')))
    assert np.allclose(plain.frames, recorded - empty[:1], atol=1e-5)
    both = read_capture(described(tmp_path, text + "subtract_mean = true\nsamples = [2, 7]\n"))
    assert np.allclose(both.frames, (frames - frames.mean(axis=0))[..., 2:7], atol=5e-6)
    assert np.isclose(both.radar.waveform.start_frequency, 24.05e9)
    for old, new, message in (
        ('array = "empty", frame = "same"', 'array = "one", frame = "same"', "scene has 12 poses, the empty one 1"),
        ("amplitudes = [[1, 2, 0.5], [1, 1, 3]]", "amplitudes = [1, 2]", "amplitudes is .*expected one number or 6"),
        ('values = { file = "phase.txt"', 'values = { file = "positions.csv"', r"phases has shape \(3,"),
        ("background", "backgrounds", "Did you mean 'background'"),
    ):  # fmt: skip
        assert old in text
        with pytest.raises(ms.errors.MillisightError, match=message):
            read_capture(described(tmp_path, text.replace(old, new)))


def test_frames_that_no_radar_measured_are_marked(tmp_path):
    np.save(tmp_path / "frames.npy", small_scan()[2])
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1])
    assert "simulated" not in read_capture(described(tmp_path, f"{RADAR}{FRAMES}{POINTS}")).metadata
    assert read_capture(described(tmp_path, f"simulated = true\n{RADAR}{FRAMES}{POINTS}")).metadata["simulated"] is True
    with pytest.raises(ms.errors.MillisightError, match="simulated is 'yes'.*expected true or false"):
        read_capture(described(tmp_path, f'simulated = "yes"\n{RADAR}{FRAMES}{POINTS}'))


def test_what_a_description_says_of_the_image(tmp_path):
    np.save(tmp_path / "frames.npy", small_scan()[2])
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1])
    image = (
        '[image]\nlower = [0, 0, -0.2]\nupper = [0.1, 0.1, -0.2]\nspacing = 0.01\nmethod = "exact"\nwindow = "hann"\n'
    )
    path = described(tmp_path, f'title = "test"\n{RADAR}{FRAMES}{POINTS}{image}')
    capture = read_capture(path)
    assert capture.metadata["source"] == "test"
    assert capture.metadata["image_grid"] == {"lower": [0, 0, -0.2], "upper": [0.1, 0.1, -0.2], "spacing": [0.01] * 3}
    assert capture.metadata["imaging"] == {"method": "exact", "window": "hann"}
    check(capture)
    check(read_capture(tmp_path))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'x'\n")
    moved = described(tmp_path / "elsewhere", path.read_text())
    check(read_capture(moved, data=tmp_path))
    with pytest.raises(FileError, match=r"frames.npy: no such file; pass the folder"):
        read_capture(moved)
    assert description_in(tmp_path) == path
    assert description_in(ROOT / "docs") is None
    with pytest.raises(FileError, match=r"several descriptions, aeroplane.toml, .*pass one of"):
        description_in(EXAMPLES)


GOOD = RADAR + FRAMES + POINTS


FREQUENCIES = "start_frequency = 24e9\nstep = 25e6"


@pytest.mark.parametrize(
    ("old", "new", "error", "facts"),
    [
        ("[frames]", "[frame]", UnknownNameError, ["'frame'", "'frames'"]),
        ("axes =", "axis =", UnknownNameError, ["[frames]", "'axis'", "'axes'"]),
        ("unit =", "units =", UnknownNameError, ["[positions] points", "'units'", "'unit'"]),
        ('"tx"', '"transmitter"', UnknownNameError, ["'transmitter'", "tx"]),
        ('axes = ["pose", "tx", "rx", "sample"]', "", FormatError, ["[frames]", "axes", "sample", "pose"]),
        ("phase_sign = -1", "", FormatError, ["[frames]", "phase_sign", "1 or -1"]),
        ("phase_sign = -1", "phase_sign = -1\nchirp = 0", FormatError, ["[frames]", "chirp", "among the axes"]),
        ("phase_sign = -1", 'phase_sign = -1\nparts = ["I", "Q"]', FormatError, ["[frames]", "parts", '"part" among']),
        ("phase_sign = -1", "phase_sign = -1\nanalytic = true", FormatError, ["[frames]", "analytic", "frames.npy"]),
        ("phase_sign = -1", "phase_sign = -1\nshape = [5, 5]", FormatError, ["shape", "576", "(12, 2, 3, 8)"]),
        ("phase_sign = -1", "phase_sign = 2", FormatError, ["[frames]", "phase_sign", "'2'", "1 or -1"]),
        (
            "phase_sign = -1",
            "phase_sign = -1\narray = []",
            FormatError,
            ["[frames]", "array is []", "name of an array"],
        ),
        ('"tx", "rx", ', "", FormatError, ["[frames]", "axes", "4", "frames.npy", "(12, 2, 3, 8)"]),
        ('"tx", "rx"', '"tx", "tx"', FormatError, ["[frames]", "axes", "'tx'", "once"]),
        ('"pose", ', '"pose", "x", ', FormatError, ["[frames]", "axes", "'pose'", "'x'"]),
        ('"tx", "rx"', '"rx", "tx"', FormatError, ["[radar]", "tx_positions", "3"]),
        ("step = 25e6", "", FormatError, ["[radar]", "stop_frequency", "step", "slope"]),
        ("step = 25e6", "step = 25e6\nslope = 1e12", FormatError, ["[radar]", "step", "slope", "one of"]),
        ("step = 25e6", "step = 25e6\nsamples = 9", FormatError, ["[radar]", "samples", "'9'", "8"]),
        ("step = 25e6", "step = -4e9", FormatError, ["[radar]", "falls to -4e+09 Hz"]),
        ("step = 25e6", 'step = "25 MHz"', FormatError, ["[radar]", "step", "'25 MHz'", "[Hz]"]),
        (FREQUENCIES, 'preset = "iwr1433"', UnknownNameError, ["[radar]", "'iwr1433'", "'iwr1443'"]),
        (FREQUENCIES, "frequencies = [1, 2, 4, 5, 6, 7, 8, 9]", FormatError, ["[radar]", "frequencies", "even"]),
        (FREQUENCIES, "frequencies = [8, 7, 6, 5, 4, 3, 2, 1]", FormatError, ["[radar]", "frequencies", "8 Hz"]),
        (FREQUENCIES, "frequencies = [1, 2, 3, 4, 5, 6, 7, 8]", FormatError, ["[radar]", "frequencies", "GHz", "8 Hz"]),
        (FREQUENCIES, "start_frequency = 24\nstep = 1", FormatError, ["[radar]", "start_frequency", "31 Hz"]),
        ("step = 25e6", "slope = 60\nsample_rate = 1e6", FormatError, ["[radar]", "slope", "0.00048 Hz", "Hz/s"]),
        (FREQUENCIES, "frequencies = [1, 2]\nstep = 25e6", FormatError, ["[radar]", "frequencies", "step", "one of"]),
        ("frames.npy", "frame.npy", FileError, ["frame.npy"]),
        ("frames.npy", "f*.npz", FileError, ["'f*.npz'"]),
        ("positions.csv", "short.csv", FormatError, ["[positions]", "points", "(12, 3)", "(1, 3)"]),
        ("positions.csv", "words.csv", FileError, ["words.csv", "line 2", "'y'", "number"]),
        ("positions.csv", "ragged.csv", FileError, ["ragged.csv", "line 3", "2 columns", "3"]),
        ('unit = "mm"', 'unit = "inch"', UnknownNameError, ["[positions] points", "'inch'", "cm, m, mm"]),
        ('unit = "mm"', 'columns = ["x", "q"]', UnknownNameError, ["positions.csv", "'q'"]),
        ('unit = "mm"', "index = 99", FormatError, ["[positions] points", "index", "'99'", "(12, 3)"]),
        ("[positions]", "[positions]\nlog = 'x.csv'", FormatError, ["[positions]", "points", "log", "one of"]),
        ("[positions]", "[positions]\norigin = [0, [0, 1]]", FormatError, ["[positions]", "origin"]),
        ("[positions]", '[positions]\norigin = { file = "words.npy" }', FormatError, ["[positions]", "origin"]),
        (POINTS, RASTER.replace("0.005", "1e308"), FormatError, ["[positions]"]),
        ("[positions]", "[positions]\norientations = [0, 0, 1]", FormatError, ["orientations", "x, y, z, w"]),
        ("[positions]", "[positions]\norientations = [0, 0, 0, 2]", FormatError, ["orientations", "unit"]),
        ("[positions]", "[times]\nstart = 0\n[positions]", FormatError, ["[times]", "period"]),
        ("[positions]", "[times]\narray = [1, 2]\n[positions]", FormatError, ["[times]", "12", "2"]),
        ("[positions]", "[image]\nlower = [0, 0, 0]\n[positions]", FormatError, ["[image]", "upper"]),
        ("[positions]", "[image]\nmethod = 5\n[positions]", FormatError, ["[image]", "method", "'5'"]),
        ("[frames]", "[frames", FormatError, ["TOML", "line 9"]),
        (FRAMES, "", FormatError, ["[frames]", "file"]),
        (GOOD, "frames = 1", FormatError, ["[frames]", "1", "table"]),
    ],
)
def test_errors_name_the_place_what_came_and_what_was_expected(tmp_path, old, new, error, facts):
    """Not in which words."""
    np.save(tmp_path / "frames.npy", small_scan()[2])
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1], delimiter=",", header="x,y,z", comments="")
    (tmp_path / "short.csv").write_text("1,2,3\n")
    (tmp_path / "words.csv").write_text("1 2 3\n1 y 3\n")
    np.save(tmp_path / "words.npy", np.array(["a", "b", "c"]))
    (tmp_path / "ragged.csv").write_text("# comment\n1;2;3\n1;2\n")
    check(read_capture(described(tmp_path, GOOD)))
    assert old in GOOD
    path = described(tmp_path, GOOD.replace(old, new))
    with pytest.raises(error) as caught:
        read_capture(path)
    told = str(caught.value).replace(str(tmp_path), "")
    assert [fact for fact in facts if fact not in told] == [], told
    # The description is named, or the file that it leads to.
    assert any(
        name in told for name in ("scan.toml", "frame.npy", "f*.npz", *(file.name for file in tmp_path.iterdir()))
    ), told
    assert issubclass(error, ms.errors.MillisightError)


def test_data_that_cannot_be_used_is_named(tmp_path):
    np.savetxt(tmp_path / "positions.csv", 1e3 * small_scan()[1])
    frames = small_scan()[2]
    holed = np.where(np.arange(12)[:, None, None, None] == 3, np.nan, frames)
    for data, message in (
        (holed, r"frames.npy.*NaN or infinite, the first at \(3,"), (frames[:0], "frames.npy: array '0' is empty"),
        (frames.astype(complex) * 1e60, r"frames of .*frames.npy has .*infinite"),
        (np.full((12, 2, 3, 8), "x"), "not an array of numbers; that in .*frames.npy is <U1"),
        (frames.real, "analytic"),
        (frames[:, :, :, 0], "axes is"),
    ):  # fmt: skip
        np.save(tmp_path / "frames.npy", data)
        with pytest.raises(FileError, match=message):
            read_capture(described(tmp_path, GOOD))
    np.savez(tmp_path / "frames.npy.npz", a=frames, b=frames)
    with pytest.raises(FormatError, match=r"frames.npy.npz holds the arrays a, b; choose one"):
        read_capture(described(tmp_path, GOOD.replace("frames.npy", "frames.npy.npz")))
    with pytest.raises(InputError, match="no robot log"):
        read_scan(described(tmp_path, GOOD.replace("frames.npy", 'frames.npy.npz"\narray = "a')))


def tutorial_sample(folder, dtype):
    """A file in the layout of the tutorial's, of two points, and where these are."""
    points = np.array([[0.15, 0.25, -0.43], [0.22, 0.23, -0.40]])
    x, y = np.meshgrid(np.arange(0.07, 0.3, 0.004), np.arange(0.15, 0.35, 0.004))
    positions = np.stack([x.ravel(), y.ravel(), 0.001 * np.sin(40 * x.ravel())], axis=1)
    wavelength = 299_792_458 / 77.5e9
    receivers = positions[:, None] - [[0.005 + 1.5 * wavelength, 0, 0], [0.005 + 0.5 * wavelength, 0, 0]]
    frequencies = 77.5e9 + 3e9 / 32 * np.arange(32)
    frames = point_frames(points, [1.0, 0.8], positions[:, None], receivers, frequencies, 0.15)[:, 0].conj()
    path = folder / "sample_data.npz"
    np.savez(path, received_signals=frames.transpose(0, 2, 1).astype(dtype), antenna_locations=positions)
    return path, points, (positions[:, None], receivers, frequencies)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
def test_the_tutorials_sample_opens_by_its_arrays(tmp_path, dtype):
    path, points, setup = tutorial_sample(tmp_path, dtype)
    capture = read_capture(path)
    grid = capture.metadata["image_grid"]
    assert ms.VoxelGrid.regular(**grid).shape == (461, 201, 181)
    near = [ms.VoxelGrid.regular(point - 0.004, point + 0.004, 0.0005) for point in points]
    images = [ms.form_image(capture, grid, method="backprojection") for grid in near]
    for image, point in zip(images, points, strict=True):
        assert np.abs(image.peak - point).max() < 0.0005 * 1.001  # a voxel
    # The values are those of the closed form, the two reflectors' images summed.
    at = near[0].points[::50]
    expected = point_image(at, points[0], *setup) + 0.8 * point_image(at, points[1], *setup)
    assert np.abs(images[0].values.ravel()[::50] - expected).max() < 0.01
    assert capture.metadata["description"] == "mito-tutorial.toml"
    np.savez(tmp_path / "other.npz", received_signals=np.zeros((9, 32, 3)), antenna_locations=np.zeros((9, 3)))
    with pytest.raises(FormatError, match=r"other.npz holds the arrays received_signals \(9, 32, 3\).*no shipped"):
        read_capture(tmp_path / "other.npz")


def test_the_file_of_a_radar_at_rest_decodes_but_cannot_be_imaged():
    data = shared("captures", "iwr1443_adc_data20251124114141.bin").parent
    radar, frames = read_frames(EXAMPLES / "iwr1443_still.toml", data=data)
    assert frames.shape == (50, 1, 4, 256)
    assert radar.name == "iwr1443"
    spectrum = (np.abs(np.fft.fft(frames.conj(), axis=-1)) ** 2).mean(axis=(0, 1))
    assert spectrum.sum(axis=0).argmax() == 19
    one_sided = 10 * np.log10(spectrum[:, 1:128].sum(axis=1) / spectrum[:, 129:].sum(axis=1))
    assert len(one_sided) == 4
    assert one_sided.min() > 15
    with pytest.raises(InputError, match=r"iwr1443_still.toml has no table \[positions\].*but not imaged"):
        read_capture(EXAMPLES / "iwr1443_still.toml", data=data)


def pages_blocks(page):
    """The TOML blocks of a how-to page."""
    text = (HOW_TO / f"{page}.md").read_text(encoding="utf-8")
    return [tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)]


@pytest.mark.slow
def test_the_pages_show_what_works(tmp_path):
    """The first example of the page on your own scanner, on the file it speaks of; the others are the examples' own."""
    import scipy.io

    place = np.array([0.02, -0.04, -0.3])
    raster = ms.Trajectory.raster(size=(59 * 0.004, 39 * 0.004), step=0.004, center=(0, 0, 0))
    assert len(raster) == 2400
    antennas, frequencies = raster.positions[:, None], np.linspace(24e9, 26e9, 11)
    field = point_frames(place[None], [1.0], antennas, antennas, frequencies).conj().reshape(60, 40, 11)
    scipy.io.savemat(tmp_path / "scan.mat", {"S": field.transpose(2, 0, 1), "f": frequencies / 1e9})
    text = (HOW_TO / "your-own-scanner.md").read_text(encoding="utf-8")
    capture = read_capture(described(tmp_path, re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)[0]))
    image = ms.form_image(capture, ms.VoxelGrid.regular(**capture.metadata["image_grid"]))
    assert np.allclose(image.peak, place, atol=0.003)
    assert np.isclose(image.magnitude.max(), 1, atol=0.05)
    for page, name in (
        ("letter-r", "letter_r"), ("foam", "foam"), ("dca1000", "iwr1443_still"), ("turntable", "aeroplane"),
        ("multistatic", "phantom"),
    ):  # fmt: skip
        example = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
        shown = pages_blocks(page)[0]
        assert {table: example[table] for table in shown} == shown


def conjugated(capture):
    return ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=capture.frames.conj())


@pytest.mark.slow
def test_the_letter_r_is_readable():
    """Real waves: the strokes of the measured letter stand out from its ground, only in focus and with our sign."""
    data = shared("captures", "letter_r_22ghz.npy").parent
    capture = read_capture(EXAMPLES / "letter_r.toml", data=data)
    plane = ms.VoxelGrid.regular(**capture.metadata["image_grid"])

    def contrast(capture, z):
        """The brightest 8 % of the pixels over the rest, in mean magnitude."""
        values = np.sort(ms.form_image(capture, ms.VoxelGrid(x=plane.x, y=plane.y, z=[z])).magnitude.ravel())
        assert len(values) > 10_000
        cut = int(0.92 * len(values))
        return values[cut:].mean() / values[:cut].mean()

    in_focus = contrast(capture, -0.2)
    assert in_focus > 5
    assert in_focus > 1.3 * contrast(capture, -0.3)
    assert in_focus > 1.3 * contrast(capture, -0.12)
    assert in_focus > 1.3 * contrast(conjugated(capture), -0.2)

    # An upright R: its stem is one bright column on the left, its bowl closes on the right of the upper half alone.
    bright = ms.form_image(capture, plane).magnitude[:, :, 0]
    bright = bright > 0.4 * bright.max()
    columns, rows = np.nonzero(bright.any(axis=1))[0], np.nonzero(bright.any(axis=0))[0]
    letter = bright[columns[0] : columns[-1] + 1, rows[0] : rows[-1] + 1]
    width, height = letter.shape
    assert 0.05 < width * 0.002 < 0.15
    assert letter[: width // 4].any(axis=0).mean() > 0.9
    right = letter[2 * width // 3 :]
    assert right[:, 2 * height // 3 :].any(axis=0).mean() > 0.8
    assert not right[:, height // 4 : height // 2 - 3].any(axis=0).all()


@pytest.mark.slow
def test_the_flaw_in_the_foam_is_sharp_at_its_depth():
    """The edges of a square of 8 cm stand out at z = -0.08 to -0.12 m, where it is, and at no other depth."""
    data = shared("captures", "foam_22_26ghz.npy").parent
    capture = read_capture(EXAMPLES / "foam.toml", data=data)
    assert capture.frames.shape == (187 * 144, 1, 1, 11)
    x, y = np.arange(0.15, 0.27, 0.003), np.arange(0.16, 0.285, 0.003)
    beyond = np.maximum(abs(x[:, None] - 0.21) - 0.040, abs(y - 0.2205) - 0.0385)  # the border of the square [m]

    def sharpness(capture, depths):
        """The steepness of |I| along the border of the square over that elsewhere, by depth."""
        image = ms.form_image(capture, ms.VoxelGrid(x=x, y=y, z=depths), method="backprojection")
        steepness = np.hypot(*np.gradient(image.magnitude, 0.003, axis=(0, 1)))
        along, elsewhere = (steepness[where].mean(axis=0) for where in (abs(beyond) < 0.006, abs(beyond) > 0.012))
        return dict(zip(depths, along / elsewhere, strict=True))

    found = sharpness(capture, [-0.17, -0.15, -0.12, -0.10, -0.09, -0.07, -0.05])
    assert max(found, key=lambda z: found[z]) in (-0.09, -0.10)
    assert found[-0.09] > 1.7
    assert all(found[-0.09] > 1.6 * found[z] for z in (-0.05, -0.07, -0.15, -0.17))
    assert found[-0.09] > 1.4 * sharpness(conjugated(capture), [-0.09])[-0.09]


def test_the_format_follows_from_suffix_keys_and_axes(tmp_path):
    """A .txt is a Position2Go's, or a text where the axes are another's; a .csv may be asked for as an array."""
    _, positions, _ = small_scan()
    raw = raw_scan(ms.Radar.preset("position2go"), positions, 1000)
    write_position2go(tmp_path / "f.txt", raw)
    base = '[radar]\npreset = "position2go"\n[frames]\nfile = "f.txt"\nphase_sign = 1\nsamples = 256\nchirps = 1\n'
    np.savetxt(tmp_path / "positions.csv", 1e3 * positions)
    for axes in ("", 'axes = ["pose", "tx", "rx", "sample"]\n'):
        capture = read_capture(described(tmp_path, base + axes + POINTS))
        assert np.allclose(capture.frames, raw.conj())
    field = small_scan()[2][:, 0, 0]
    np.savetxt(tmp_path / "t.txt", np.stack([field.real, field.imag], axis=-1).reshape(12, 16))
    for name, more in (("t.txt", ""), ("t.csv", 'array = "0"\n')):
        (tmp_path / name).write_text((tmp_path / "t.txt").read_text())
        text = f'[radar]\nstart_frequency = 24e9\nstep = 25e6\n[frames]\nfile = "{name}"\n{more}shape = [12, 8, 2]\n'
        text += 'axes = ["pose", "sample", "part"]\nparts = ["I", "Q"]\nphase_sign = -1\n'
        assert np.allclose(read_capture(described(tmp_path, text + POINTS)).frames[:, 0, 0], field)


@pytest.mark.parametrize("pattern", ["**/**/**/*.bin", "*/../" * 8 + "*.bin", "*/" * 40 + "*.bin"])
def test_patterns_that_run_through_folders_again_and_again_are_refused(tmp_path, pattern):
    for i in range(20):
        (tmp_path / f"{i}").mkdir()
    text = f'[radar]\npreset = "iwr1443"\n[frames]\nfile = "{pattern}"\nsamples = 512\n[positions]\nraster = {{}}\n'
    began = time.process_time()
    with pytest.raises(FileError, match="could run through folders again and again; expected at most 32 names"):
        read_capture(described(tmp_path, text))
    assert time.process_time() - began < 1
    with pytest.raises(FileError, match=r"no file in .* matches '\.\./\*\*/\*\.none'"):
        read_capture(described(tmp_path, text.replace(pattern, "../**/*.none")))
