"""The clocks of radar and robot: offset and drift found together, with an honest uncertainty, or not at all."""

import numpy as np
import pytest

import millisight as ms
from helpers.arm import scan
from millisight.core.errors import InputError
from millisight.imaging import estimate_clock

GRID = ms.VoxelGrid.regular((-0.1, -0.1, -0.01), (0.1, 0.1, 0.04), 0.01)


def nominal(capture, log):
    """The capture with the poses that the log gives when the clocks are believed."""
    return ms.retime(capture, log, ms.ClockCorrection(offset=0.0))


def likeness(a, b):
    return abs(np.vdot(a.values, b.values)) / np.linalg.norm(a.values) / np.linalg.norm(b.values)


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "drift", "seed"), [(-0.05, -80e-6, 1)])
def test_offset_and_drift_are_recovered_together_and_the_image_with_them(offset, drift, seed):
    capture, log, middle = scan(offset, drift, count=51, period=0.012)
    way = np.linalg.norm(np.diff(capture.trajectory.positions, axis=0), axis=1).sum()
    assert way > 25
    seen = []
    told = {"max_drift": 100e-6, "progress": lambda done, total: seen.append((done, total))}
    found = estimate_clock(nominal(capture, log), log, GRID, rng=seed, **told)
    assert found.observable
    assert found.clock is not None
    true_offset = offset + drift * (found.clock.reference_time - middle)
    offset_error, drift_error = found.clock.offset - true_offset, found.clock.drift - drift
    assert abs(offset_error) < 1e-3
    assert abs(drift_error) < 5e-6
    assert abs(offset_error) < 4 * found.offset_uncertainty < 1e-3
    assert abs(drift_error) < 4 * found.drift_uncertainty < 8e-6
    assert found.against > 0.45
    assert abs(found.coarse_offset - true_offset) < 5e-3
    assert seen
    assert seen[-1][0] == seen[-1][1]

    corrected = ms.retime(capture, log, found.clock)
    assert corrected.metadata["history"][-1]["step"] == "retime"
    grid = ms.VoxelGrid.regular((-0.02, -0.02, 0.01), (0.04, 0.05, 0.03), 0.0015)
    truth = ms.form_image(capture, grid)
    assert likeness(ms.form_image(corrected, grid), truth) > 0.99
    assert likeness(ms.form_image(nominal(capture, log), grid), truth) < 0.5


def test_where_rows_all_run_one_way_nothing_is_guessed():
    capture, log, _ = scan(0.02, 50e-6, one_way=True, only_rows=True, count=31, period=0.012)
    found = estimate_clock(nominal(capture, log), log, GRID)
    assert not found.observable
    assert found.clock is None
    assert found.against < 0.1
    assert "one direction" in found.reason
    assert np.isinf(found.offset_uncertainty)


def heard(snr_db):
    """What is estimated of a scan whose clock is 20 ms ahead, in noise; and the true offset."""
    capture, log, _ = scan(0.02, 0.0, count=31, period=0.012)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(*capture.frames.shape, 2)).astype(np.float32).view(np.complex64)[..., 0] / np.sqrt(2)
    sigma = np.sqrt((abs(capture.frames) ** 2).mean()) * 10 ** (-snr_db / 20)
    noisy = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=capture.frames + sigma * noise)
    return estimate_clock(nominal(noisy, log), log, GRID)


@pytest.mark.slow
def test_noise_is_borne_up_to_a_level_and_beyond_it_no_clock_is_guessed():
    noisy = heard(0)
    assert noisy.clock is not None
    assert noisy.clock.offset == pytest.approx(0.02, abs=4 * noisy.offset_uncertainty)
    deaf = heard(-30)
    assert not deaf.observable
    assert deaf.clock is None
    assert "too faint" in deaf.reason


def test_no_scene_is_looked_for_where_the_rows_tell_too_little(monkeypatch):
    """Which is most of the time for a large capture."""
    capture, log, _ = scan(0.02, 0.0, count=12)
    rng = np.random.default_rng(0)
    frames = rng.normal(size=(*capture.frames.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    noise = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=frames)
    monkeypatch.setattr("millisight.imaging._focus.bright_scene", lambda *_: pytest.fail("a scene was looked for"))
    found = estimate_clock(noise, log, GRID, max_offset=0.2)
    assert found.clock is None
    assert "too coarse a start" in found.reason


def test_a_radar_at_rest_and_too_few_rows():
    capture, log, _ = scan(0.02, 0.0, count=2, period=0.01)
    found = estimate_clock(capture, log, GRID)
    assert found.clock is None
    assert "2 rows" in found.reason
    still = ms.Trajectory(times=log.times, positions=np.zeros((len(log), 3)))
    assert estimate_clock(capture, still, GRID).clock is None


def test_what_does_not_meet_is_refused():
    capture, log, _ = scan(0.0, 0.0, count=3, period=0.05)
    elsewhere = ms.Trajectory(times=log.times + 1e6, positions=log.positions)
    with pytest.raises(InputError, match="do not overlap"):
        estimate_clock(capture, elsewhere, GRID)
    with pytest.raises(InputError, match="max_offset"):
        estimate_clock(capture, log, GRID, max_offset=-1)
