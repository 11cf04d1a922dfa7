"""What leaks between the antennas: found by its path, taken off, and nothing else with it."""

import numpy as np
import pytest

import millisight as ms
from helpers.mirrors import DEVICES, capture_of, leak_of, points, raster
from millisight.core.errors import InputError
from millisight.imaging import remove_leakage

RADAR = DEVICES["77 GHz"]


@pytest.fixture(scope="module")
def path():
    return raster(step=0.004)


@pytest.fixture(scope="module")
def spots(path):
    return points(RADAR, path, strength=0.01)


def test_the_leak_goes_and_the_rest_stays(path, spots):
    leak = leak_of(RADAR, 1000 * np.abs(spots).max())
    cleaned = remove_leakage(capture_of(RADAR, path, spots + leak))
    assert np.linalg.norm(cleaned.frames - spots) < 0.02 * np.linalg.norm(spots)
    step = cleaned.metadata["history"][-1]
    assert step["step"] == "remove_leakage"
    assert step["power"] == pytest.approx(1, abs=1e-3)
    # Without a leak there is next to nothing to take.
    unchanged = remove_leakage(capture_of(RADAR, path, spots)).frames
    assert np.linalg.norm(unchanged - spots) < 0.02 * np.linalg.norm(spots)


@pytest.mark.slow
def test_weak_surfaces_stand_out_of_a_leak(path):
    frames = points(RADAR, path, strength=0.01)
    grid = ms.VoxelGrid.regular((-0.03, -0.03, -0.3), (0.03, 0.03, -0.2), (0.003, 0.003, 0.005))
    leaking = capture_of(RADAR, path, frames + leak_of(RADAR, 1e4 * np.abs(frames).max()))
    there = ms.surface_points(capture_of(RADAR, path, frames), grid)
    assert len(there) > 10
    found = ms.surface_points(leaking, grid)
    assert [step["step"] for step in found.metadata["history"]] == ["remove_leakage", "surface_points"]
    assert abs(len(found) - len(there)) < 0.1 * len(there)


@pytest.mark.parametrize("scale", [1e30, 1e-30])
def test_the_frames_unit_does_not_matter(path, spots, scale):
    frames = spots + leak_of(RADAR, 1000 * np.abs(spots).max())
    usual = remove_leakage(capture_of(RADAR, path, frames))
    odd = remove_leakage(capture_of(RADAR, path, frames * scale))
    assert np.linalg.norm(odd.frames / np.float32(scale) - usual.frames) < 1e-5 * np.linalg.norm(frames)
    assert odd.metadata["history"][-1]["power"] == pytest.approx(usual.metadata["history"][-1]["power"])


def test_what_leaves_float32_s_range_is_refused(path):
    with pytest.raises(InputError, match="infinite"):
        remove_leakage(capture_of(RADAR, path, np.full_like(points(RADAR, path), 3e38 + 3e38j)))


def test_a_narrow_band_does_not_tell_it(path):
    radar = DEVICES["24 GHz"]
    capture = capture_of(radar, path, points(radar, path, strength=0.01))
    assert radar.waveform.range_resolution > 0.1
    assert remove_leakage(capture) is capture
    with pytest.raises(InputError, match="capture"):
        remove_leakage(3)
