"""Scans as recorded: which frames become part of a capture, and where they are put; the clock's correction."""

import numpy as np
import pytest

import millisight as ms
from millisight.calibration._placing import without_repeats
from millisight.core.errors import InputError

RADAR = ms.Radar(
    name="test",
    waveform=ms.Waveform.stepped(77.5e9, 1e8, 4),
    array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0.01, 0, 0], [0.02, 0, 0]]),
)
LOG_TIMES = np.linspace(0, 10, 101)


def way(times):
    """(n, 3) where the robot is: a smooth curve."""
    times = np.asarray(times, float)
    return np.stack([0.05 * times, 0.02 * np.sin(times), 0.3 + 0.01 * np.cos(0.7 * times)], axis=-1)


def log(**settings):
    return ms.Trajectory(times=LOG_TIMES, positions=way(LOG_TIMES), **settings)


def row(times, name="row", missing=None, reads=None):
    """A row whose frames hold their own times."""

    def read():
        if reads is not None:
            reads.append(name)
        return np.broadcast_to(np.asarray(times)[:, None, None, None], (len(times), 1, 2, 4)).astype(np.complex64)

    return ms.ScanRow(times=np.asarray(times, float), read=read, source=name, missing=missing)


def scan_of(*rows, **settings):
    return ms.RawScan(radar=RADAR, rows=rows, log=log(**settings))


def test_frames_go_where_the_log_says():
    first, second = np.arange(1, 4, 0.25), np.arange(5, 9, 0.5)
    seen = []
    capture = scan_of(row(first), row(second)).to_capture(progress=lambda *done: seen.append(done))
    times = np.concatenate([first, second])
    np.testing.assert_array_equal(capture.trajectory.times, times)
    assert np.abs(capture.trajectory.positions - way(times)).max() < 1e-6  # the spline's error
    np.testing.assert_array_equal(capture.frames[:, 0, 1, 3].real, times.astype(np.float32))
    assert capture.trajectory.orientations is None
    assert seen[-1] == (2, 2)
    step = capture.metadata["history"][-1]
    assert (step["step"], step["frames"], step["kept"], step["repeats"], step["lost"]) == ("place_frames", 20, 20, 0, 0)


def test_a_row_of_a_file_that_was_cut_short_is_named():
    whole = [np.arange(start, start + 1, 0.05) for start in range(1, 7)]
    short = [*whole[:3], whole[3][:10], *whole[4:]]
    for times, names in ((whole, None), (short, ["row 3"])):
        capture = scan_of(*(row(some, f"row {i}") for i, some in enumerate(times))).to_capture()
        assert capture.metadata["history"][-1].get("short_rows") == names


def test_orientations_are_interpolated_along_the_sphere():
    angles = 0.1 * LOG_TIMES
    turned = np.stack([0 * angles, 0 * angles, np.sin(angles / 2), np.cos(angles / 2)], axis=-1)
    capture = scan_of(row([2.22, 3.33]), orientations=turned).to_capture()
    expected = [[0, 0, np.sin(0.111), np.cos(0.111)], [0, 0, np.sin(0.1665), np.cos(0.1665)]]
    np.testing.assert_allclose(capture.trajectory.orientations, expected, atol=1e-12)


def test_the_clock_moves_poses_and_not_times():
    clock = ms.ClockCorrection(offset=0.5, drift=0.01, reference_time=3.0)
    times = np.arange(2, 6, 0.5)
    capture = scan_of(row(times)).to_capture(clock=clock)
    np.testing.assert_array_equal(capture.trajectory.times, times)
    robot = times + 0.5 + 0.01 * (times - 3)
    assert np.abs(capture.trajectory.positions - way(robot)).max() < 1e-6
    again = ms.retime(scan_of(row(times)).to_capture(), log(), clock)
    np.testing.assert_array_equal(again.trajectory.positions, capture.trajectory.positions)
    np.testing.assert_array_equal(again.frames, capture.frames)
    assert again.metadata["history"][-1]["clock"] == {"offset": 0.5, "drift": 0.01, "reference_time": 3.0}


def test_nothing_is_extrapolated_and_what_is_left_out_is_counted():
    times = np.arange(-1, 12, 0.5)
    missing = np.zeros(len(times), bool)
    missing[[4, 9]] = True
    capture = scan_of(row(times, missing=missing)).to_capture()
    kept = (times >= 0) & (times <= 10) & ~missing
    np.testing.assert_array_equal(capture.trajectory.times, times[kept])
    step = capture.metadata["history"][-1]
    assert (step["lost"], step["outside_log"], step["kept"]) == (2, 5, kept.sum())
    late = ms.retime(capture, log(), ms.ClockCorrection(offset=2.1))
    assert late.trajectory.times.max() + 2.1 <= 10 < late.trajectory.times.max() + 2.6
    for clock in (ms.ClockCorrection(offset=100.0), ms.ClockCorrection(offset=-100.0)):
        with pytest.raises(InputError, match="the frames run from"):
            scan_of(row(times)).to_capture(clock=clock)
        with pytest.raises(InputError, match="no frame lies within"):
            ms.retime(capture, log(), clock)


def plain_rule(positions, distance):
    """Of each row: later ones closer than `distance` to any kept one are dropped."""
    kept = []
    for i, position in enumerate(positions):
        if all(np.linalg.norm(position - positions[k]) >= distance for k in kept):
            kept.append(i)
    return np.isin(np.arange(len(positions)), kept)


@pytest.mark.parametrize("seed", range(4))
def test_repeats_are_dropped_by_the_plain_rule(seed):
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(scale=0.4e-3, size=(600, 3)), axis=0)
    positions[100:140] = positions[100]
    fresh = without_repeats(positions, 0.7e-3)
    assert 50 < fresh.sum() < 550
    np.testing.assert_array_equal(fresh, plain_rule(positions, 0.7e-3))
    assert without_repeats(positions, 0.0).all()


def test_repeats_count_within_a_row_alone_and_by_the_start_frequency():
    still = np.full(101, 0.1)[:, None] * [1, 2, 3]
    stays = ms.Trajectory(times=LOG_TIMES, positions=still)
    scan = ms.RawScan(radar=RADAR, rows=(row([1, 2, 3]), row([4, 5])), log=stays)
    np.testing.assert_array_equal(scan.to_capture().trajectory.times, [1, 4])
    np.testing.assert_array_equal(scan.to_capture(min_distance=0).trajectory.times, [1, 2, 3, 4, 5])
    assert scan.to_capture().metadata["history"][-1]["min_distance"] == pytest.approx(3 / 16 * 299_792_458 / 77.5e9)


def test_rows_are_read_when_they_are_needed_and_once():
    reads = []
    rows = [row([1, 2], "a", reads=reads), row([20, 21], "b", reads=reads), row([3.0], "c", reads=reads)]
    scan = scan_of(*rows)
    assert reads == []
    scan.to_capture()
    assert reads == ["a", "c"]


def test_what_cannot_be_right_is_refused_by_name():
    with pytest.raises(InputError, match=r"times of row go from 2.0+ to 1.0+ s at frame 2"):
        row([1, 2, 1])
    with pytest.raises(InputError, match="rows is empty"):
        scan_of()
    with pytest.raises(InputError, match=r"frames of short has shape \(1, 1, 2, 4\)"):
        ms.RawScan(
            radar=RADAR,
            rows=(ms.ScanRow(times=[1.0, 2.0], read=lambda: np.zeros((1, 1, 2, 4)), source="short"),),
            log=log(),
        ).to_capture()
    backwards = ms.Trajectory(times=[0, 2, 1], positions=np.zeros((3, 3)))
    with pytest.raises(InputError, match="expected times that increase"):
        ms.RawScan(radar=RADAR, rows=(row([1]),), log=backwards)
    for settings in ({"offset": np.nan}, {"offset": 0.0, "drift": -1.0}, {"offset": "x"}):
        with pytest.raises(InputError):
            ms.ClockCorrection(**settings)
