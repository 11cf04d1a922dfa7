"""The published imaging: one channel by hand, and near enough to Eq. 1 that a reflector stands where it is."""

import numpy as np
import pytest

import millisight as ms
from millisight.core import SPEED_OF_LIGHT
from millisight.core.errors import InputError
from millisight.imaging import FLOOR_BINS, form_as_published

RADAR = ms.Radar.preset("mito-sim-77ghz")
POINT = np.array([0.004, -0.002, -0.25])


def capture_of(trajectory, radar=RADAR):
    """Frames of a unit reflector at POINT."""
    blank = np.zeros(
        (len(trajectory), 1, len(radar.array.rx_positions), radar.waveform.samples_per_chirp), np.complex64
    )
    empty = ms.Capture(radar=radar, trajectory=trajectory, frames=blank)
    to = np.linalg.norm(empty.tx_positions[:, :, None] - POINT, axis=-1)
    fro = np.linalg.norm(empty.rx_positions[:, None] - POINT, axis=-1)
    d = to + fro + radar.path_offset
    frames = np.exp(-2j * np.pi * radar.waveform.frequencies * d[..., None] / SPEED_OF_LIGHT)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames.astype(np.complex64))


def test_a_voxel_takes_the_bin_below_and_the_first_frequency():
    """Summed by hand, bin by bin, without a Fourier transform."""
    trajectory = ms.Trajectory.raster(size=(0.004, 0.004), step=0.002, center=(0, 0, 0))
    for radar in (RADAR, ms.Radar.preset("iwr1443", rx_axis="y")):
        capture = capture_of(trajectory, radar)
        grid = ms.VoxelGrid(x=[0.0, 0.003], y=[-0.002], z=[-0.26, -0.25])
        f = radar.waveform.frequencies
        j, expected = np.arange(len(f)), []
        for point in grid.points:
            total = 0
            for p in range(len(trajectory)):
                for r in range(len(radar.array.rx_positions)):
                    d = (
                        np.linalg.norm(capture.tx_positions[p, 0] - point)
                        + np.linalg.norm(capture.rx_positions[p, r] - point)
                        + radar.path_offset
                    )
                    k = np.floor(FLOOR_BINS * d * (f[1] - f[0]) / SPEED_OF_LIGHT)
                    profile = (capture.frames[p, 0, r] * np.exp(2j * np.pi * j * k / FLOOR_BINS)).sum()
                    total += profile * np.exp(2j * np.pi * f[0] * d / SPEED_OF_LIGHT)
            expected.append(total / len(trajectory))
        found = form_as_published(capture, grid)
        assert found.values.ravel() == pytest.approx(np.array(expected), rel=1e-4)
        assert found.metadata["history"][-1]["step"] == "form_as_published"


@pytest.mark.slow
def test_it_is_roughly_the_right_image():
    trajectory = ms.Trajectory.raster(size=(0.06, 0.06), step=0.002, center=(0, 0, 0))
    capture = capture_of(trajectory)
    grid = ms.VoxelGrid.regular(POINT - 0.01, POINT + 0.01, 0.002)
    rough, right = form_as_published(capture, grid), ms.form_image(capture, grid, method="exact")
    assert rough.peak == pytest.approx(POINT, abs=1e-6)
    samples = RADAR.waveform.samples_per_chirp
    assert rough.magnitude.max() == pytest.approx(samples, rel=0.01)  # per pose: not divided by samples
    similar = abs(np.vdot(rough.values, right.values)) / np.linalg.norm(rough.values) / np.linalg.norm(right.values)
    assert 0.97 < similar < 0.99999
    flipped = ms.Capture(radar=capture.radar, trajectory=trajectory, frames=capture.frames.conj())
    assert form_as_published(flipped, grid).magnitude.max() < 0.2 * samples


def test_what_it_cannot_image_is_refused():
    trajectory = ms.Trajectory.raster(size=(0.002, 0.002), step=0.002, center=(0, 0, 0))
    waveform = ms.Waveform(start_frequency=77e9, slope=1e12, sample_rate=1e7, samples_per_chirp=5000)
    radar = ms.Radar(name="long", waveform=waveform, array=RADAR.array)
    with pytest.raises(InputError, match="a chirp has 5000 samples; expected 4096 at most"):
        form_as_published(capture_of(trajectory, radar), ms.VoxelGrid.regular((0, 0, -0.2), (0, 0, -0.2), 0.01))
