"""Waveforms, antennas, presets and trajectories against the published figures."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import FormatError, InputError, UnknownNameError
from millisight.data import RADAR_PRESETS, radar_names


def test_presets_have_the_published_bands():
    expected = {
        "iwr1443": (77.5001e9, 80.501e9, 512, 4),
        "position2go": (24.025e9, 24.225e9, 256, 2),
        "mito-sim-77ghz": (77.5e9, 80.5e9, 512, 1),
        "mito-sim-24ghz": (24.025e9, 24.225e9, 256, 1),
    }
    assert set(radar_names()) == set(expected)
    for name, (start, stop, samples, receivers) in expected.items():
        radar = ms.Radar.preset(name)
        assert radar.waveform.start_frequency == start
        assert radar.waveform.start_frequency + radar.waveform.bandwidth == pytest.approx(stop, rel=1e-6)
        assert radar.waveform.samples_per_chirp == samples
        assert radar.array.tx_positions.tolist() == [[0, 0, 0]]
        assert len(radar.array.rx_positions) == receivers


@pytest.mark.parametrize("axis", ["x", "y"])
def test_receivers_sit_where_published(axis):
    half = 299_792_458 / 77.5e9 / 2
    other = 1 - "xy".index(axis)
    receivers = ms.Radar.preset("iwr1443", rx_axis=axis).array.rx_positions
    assert receivers[:, "xy".index(axis)] == pytest.approx([-(0.005 + n * half) for n in (3, 2, 1, 0)], abs=1e-9)
    assert not receivers[:, [other, 2]].any()
    two = ms.Radar.preset("position2go").array.rx_positions
    assert two == pytest.approx(np.array([[0, -0.021, 0], [0, -0.02725, 0]]))
    assert ms.Radar.preset("iwr1443").path_offset == 0.15


def test_waveform_derives_what_it_says():
    waveform = ms.Waveform(start_frequency=77e9, slope=50e12, sample_rate=5e6, samples_per_chirp=4)
    assert waveform.frequencies == pytest.approx([77e9, 77.01e9, 77.02e9, 77.03e9])
    assert waveform.bandwidth == pytest.approx(40e6)
    assert waveform.center_frequency == pytest.approx(77.015e9)
    assert waveform.range_resolution == pytest.approx(299_792_458 / 80e6)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("start_frequency", 0, "start_frequency is 0 Hz; expected more than 0 Hz"),
        ("slope", -2e17, "the chirp falls to -4.3e"),
        ("slope", 0, "slope is 0 Hz/s with 4 samples"),
        ("sample_rate", float("nan"), "sample_rate is nan; expected a finite number in Hz"),
        ("slope", 1e300, r"the chirp runs from 7.7e\+10 to 6e\+293 Hz; .* 1e\+15 Hz at most: check .*slope"),
        ("start_frequency", 1e-310, r"the chirp runs from 1e-310 to .* Hz; expected 1 Hz at least"),
        ("slope", -1e300, r"the chirp falls to -6e\+293 Hz"),
        ("sample_rate", 1e-300, "the chirp runs from .* to inf Hz; expected .*sample_rate"),
        ("start_frequency", 1e300, r"the chirp runs from 1e\+300 to 1e\+300 Hz"),
        ("samples_per_chirp", 10**12, "the chirp runs from .* to 1e"),
        ("samples_per_chirp", 0, "samples_per_chirp is 0"),
        ("samples_per_chirp", 2.5, "samples_per_chirp is 2.5; expected a whole number of at least 1"),
        ("samples_per_chirp", "4", "samples_per_chirp is '4'"),
        ("samples_per_chirp", float("inf"), "samples_per_chirp is inf"),
        ("samples_per_chirp", [4], r"samples_per_chirp is \[4\]"),
        ("sample_rate", [1.0], "sample_rate is .*; expected a number in Hz"),
        ("sample_rate", 10**400, "sample_rate is .*; expected a number in Hz"),
        ("start_frequency", "77 GHz", "start_frequency is '77 GHz'; expected a number in Hz"),
    ],
)
def test_impossible_waveforms_are_refused(field, value, message):
    good = {"start_frequency": 77e9, "slope": 50e12, "sample_rate": 5e6, "samples_per_chirp": 4}
    with pytest.raises(InputError, match=message):
        ms.Waveform(**(good | {field: value}))


def test_unknown_radar_suggests_a_known_one():
    with pytest.raises(UnknownNameError, match=r"unknown radar 'iwr1442'\. Did you mean 'iwr1443'"):
        ms.Radar.preset("iwr1442")
    with pytest.raises(InputError, match="rx_axis is 'z'"):
        ms.Radar.preset("iwr1443", rx_axis="z")


def test_published_raster_has_the_published_size():
    trajectory = ms.Trajectory.published(77.5e9)
    assert len(trajectory) == 130_640
    assert len(ms.Trajectory.published(77.5e9, large=True)) == 270 * 568
    step = 299_792_458 / (4 * 77.5e9)
    assert trajectory.positions[1] - trajectory.positions[0] == pytest.approx([0, step, 0])
    assert trajectory.extent == pytest.approx([229 * step, 567 * step, 0])
    assert trajectory.positions.mean(axis=0) == pytest.approx([0, 0, 0.2])


def test_raster_takes_size_step_center_and_serpentine():
    straight = ms.Trajectory.raster(size=(0.02, 0.01), step=(0.01, 0.005), center=(1, 2, 3))
    assert straight.positions[:, 0] == pytest.approx(np.repeat([0.99, 1.0, 1.01], 3))
    assert straight.positions[:, 1] == pytest.approx(np.tile([1.995, 2.0, 2.005], 3))
    assert (straight.positions[:, 2] == 3).all()
    there_and_back = ms.Trajectory.raster(size=(0.02, 0.01), step=(0.01, 0.005), serpentine=True)
    assert there_and_back.positions[:, 1] == pytest.approx([-0.005, 0, 0.005, 0.005, 0, -0.005, -0.005, 0, 0.005])
    assert np.linalg.norm(np.diff(there_and_back.positions, axis=0), axis=1).max() == pytest.approx(0.01)
    assert straight.times == pytest.approx(1e-3 * np.arange(9))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (0.1, 0.1, 0.1)}, "size has 3 numbers; expected 2, or one"),
        ({"step": "fine"}, "step is 'fine'; expected 2 numbers, or one"),
        ({"step": (0.01, np.nan)}, "step is nan"),
        ({"center": (0, 0)}, "center has 2 numbers; expected 3"),
        ({"center": 0.2}, "center is 0.2; expected 3 numbers"),
        ({"interval": 0}, "interval is 0 s; expected more than 0 s"),
        ({"step": 1e-9}, r"would have 1e\+08 x 1e\+08 positions; .* larger step"),
    ],
)
def test_impossible_rasters_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        ms.Trajectory.raster(**({"size": (0.1, 0.1), "step": 0.01} | changes))


def test_a_radar_is_made_of_records():
    radar = ms.Radar.preset("iwr1443")
    for changes, message in (
        ({"waveform": "x"}, "waveform is of type str; expected Waveform"),
        ({"array": np.zeros((1, 3))}, "array is of type ndarray; expected AntennaArray"),
        ({"name": 3}, "name is of type int; expected str"),
    ):
        with pytest.raises(InputError, match=message):
            ms.Radar(**({"name": "mine", "waveform": radar.waveform, "array": radar.array} | changes))
    trajectory = ms.Trajectory.raster(size=0.01, step=0.01)
    for changes, message in (
        ({"radar": "x"}, "radar is of type str"),
        ({"trajectory": 3}, "trajectory is of type int"),
    ):
        with pytest.raises(InputError, match=message):
            ms.Capture(**({"radar": radar, "trajectory": trajectory, "frames": np.zeros((4, 1, 4, 512))} | changes))


def test_reprs_are_short():
    radar, trajectory = ms.Radar.preset("iwr1443"), ms.Trajectory.raster(size=0.02, step=0.01)
    assert repr(trajectory) == "Trajectory(9 poses, x -0.01 to 0.01 m, y -0.01 to 0.01 m, z 0.2 to 0.2 m)"
    capture = ms.Capture(radar=radar, trajectory=trajectory, frames=np.zeros((9, 1, 4, 512)))
    assert repr(capture) == "Capture(iwr1443, 9 poses x 1 TX x 4 RX x 512 samples, in memory)"


def test_orientations_turn_the_antennas():
    quarter = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # 90 degrees about z: x becomes y
    trajectory = ms.Trajectory(times=[0.0], positions=[[1, 2, 3]], orientations=[quarter])
    assert trajectory.placed(np.array([[0.1, 0, 0]])) == pytest.approx(np.array([[[1, 2.1, 3]]]))


def test_poses_are_interpolated_but_never_extrapolated():
    times = np.linspace(0, 1, 21)
    angles = times  # [rad] about z
    trajectory = ms.Trajectory(
        times=times,
        positions=np.stack([np.sin(times), np.cos(times), times], axis=1),
        orientations=np.stack([0 * times, 0 * times, np.sin(angles / 2), np.cos(angles / 2)], axis=1),
    )
    between = trajectory.at(np.array([0.123, 0.987]))
    assert between.positions[:, 0] == pytest.approx(np.sin([0.123, 0.987]), abs=1e-5)
    assert between.orientations[:, 2] == pytest.approx(np.sin(np.array([0.123, 0.987]) / 2), abs=1e-9)
    with pytest.raises(InputError, match="poses are not extrapolated"):
        trajectory.at(np.array([0.5, 1.01]))


def test_quaternions_must_be_unit():
    with pytest.raises(InputError, match="expected unit quaternions"):
        ms.Trajectory(times=[0.0], positions=[[0, 0, 0]], orientations=[[0, 0, 0, 2]])


def test_positions_beyond_reach_are_refused():
    """Float64 no longer holds their phase, and 1e20 m once ended the process while it imaged."""
    radar, here = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory(times=[0, 1], positions=np.zeros((2, 3)))
    words = r"has coordinates of 1e\+20; expected under 1e\+09: correct or remove it"
    for sign in (1, -1):
        stray = np.array([[0, 0, 0], [0, sign * 1e20, 0]])
        with pytest.raises(InputError, match=f"^positions {words}"):
            ms.Trajectory(times=[0, 1], positions=stray)
        for name in ("tx_points", "rx_points"):
            with pytest.raises(InputError, match=f"^{name} {words}"):
                ms.Capture(radar=radar, trajectory=here, frames=np.zeros((2, 1, 1, 256)), **{name: stray[:, None]})
        for name in ("tx_positions", "rx_positions"):
            with pytest.raises(InputError, match=f"^{name} {words}"):
                ms.AntennaArray(
                    **({"tx_positions": np.zeros((1, 3)), "rx_positions": np.zeros((1, 3))} | {name: stray})
                )
        with pytest.raises(InputError, match=r"path_offset is -?1e\+20 m; expected under 1e\+09 m"):
            ms.Radar(name="far", waveform=radar.waveform, array=radar.array, path_offset=sign * 1e20)


def test_a_callers_array_cannot_change_a_record():
    positions = np.zeros((2, 3))
    trajectory = ms.Trajectory(times=[0, 1], positions=positions)
    positions[0, 0] = 5
    assert trajectory.positions[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.positions[0, 0] = 5


def test_frames_must_fit_radar_and_trajectory():
    radar, trajectory = ms.Radar.preset("iwr1443"), ms.Trajectory(times=[0, 1], positions=np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"frames has shape \(2, 1, 4, 500\); expected \(2, 1, 4, 512\)"):
        ms.Capture(radar=radar, trajectory=trajectory, frames=np.zeros((2, 1, 4, 500)))
    with pytest.raises(InputError, match="metadata must be a mapping"):
        ms.Capture(radar=radar, trajectory=trajectory, frames=np.zeros((2, 1, 4, 512)), metadata={"a": object()})


TOML = """
rx_axis = "x"
rx_offsets = [0.01, 0.02]
[waveform]
start_frequency = 60e9
slope = 20e12
sample_rate = 5e6
samples_per_chirp = 128
"""


@pytest.fixture
def plugin(monkeypatch):
    """Adds what a plug-in's entry point would give, for one test."""
    return lambda name, entry: monkeypatch.setitem(RADAR_PRESETS._entries, name, entry)


def test_a_plug_in_gives_a_file_a_radar_or_a_function(plugin, tmp_path):
    (tmp_path / "mine.toml").write_text(TOML)
    known = ms.Radar.preset("iwr1443")
    plugin("file", tmp_path / "mine.toml")
    plugin("radar", known)
    plugin("function", lambda rx_axis="y": ms.Radar.preset("iwr1443", rx_axis=rx_axis))
    assert radar_names()[-3:] == ("file", "radar", "function")
    mine = ms.Radar.preset("file", rx_axis="y")
    assert (mine.name, mine.path_offset, mine.waveform.samples_per_chirp) == ("file", 0.0, 128)
    assert mine.array.rx_positions.tolist() == [[0, 0.01, 0], [0, 0.02, 0]]
    assert ms.Radar.preset("radar") is known
    for axis, row in (("x", 0), (None, 1), ("y", 1)):
        receivers = ms.Radar.preset("function", rx_axis=axis).array.rx_positions
        assert receivers[:, row].all()
        assert not receivers[:, 1 - row].any()
    with pytest.raises(InputError, match="receivers of the radar 'radar' are fixed"):
        ms.Radar.preset("radar", rx_axis="y")
    plugin("none", lambda: 3)
    with pytest.raises(InputError, match="radar 'none' is of type int; expected Radar"):
        ms.Radar.preset("none")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TOML.replace("slope", "slop"), r"mine.toml: waveform.slop: unknown key 'slop'. Did you mean 'slope'"),
        (TOML.replace("60e9", "-1"), "mine.toml: waveform: start_frequency is -1 Hz"),
        (TOML.replace('"x"', '"z"'), "mine.toml: rx_axis is 'z'"),
        (TOML.replace("[0.01, 0.02]", "0.01"), "mine.toml: rx_offsets: expected a list"),
        (TOML.replace("rx_offsets = [0.01, 0.02]\n", ""), "mine.toml: rx_offsets is missing"),
        ("rx_axis = ", "is not valid TOML"),
    ],
)
def test_a_radar_s_file_is_checked_and_its_place_named(plugin, tmp_path, text, words):
    (tmp_path / "mine.toml").write_text(text)
    plugin("mine", str(tmp_path / "mine.toml"))
    with pytest.raises(FormatError, match=words):
        ms.Radar.preset("mine")
