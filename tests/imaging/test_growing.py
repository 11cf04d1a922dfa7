"""An image that grows: after the last part it is that of the whole scan."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError
from millisight.imaging import GrowingImage, form_image, image_at

GRID = ms.VoxelGrid.regular((-0.05, -0.06, -0.02), (0.05, 0.06, 0.02), (0.004, 0.004, 0.02))


@pytest.fixture(scope="module")
def capture():
    rng = np.random.default_rng(3)
    preset = ms.Radar.preset("iwr1443")
    waveform = ms.Waveform.stepped(preset.waveform.start_frequency, preset.waveform.bandwidth / 64, 64)
    radar = ms.Radar(name="fewer samples", waveform=waveform, array=preset.array, path_offset=preset.path_offset)
    path = ms.Trajectory.raster(size=(0.12, 0.1), step=0.004, center=(0.0, 0.0, 0.25))
    tx, rx = path.placed(radar.array.tx_positions)[:, :, None], path.placed(radar.array.rx_positions)[:, None]
    frames = np.zeros((len(path), 1, 4, radar.waveform.samples_per_chirp), complex)
    for point in rng.uniform([-0.05, -0.06, -0.02], [0.05, 0.06, 0.02], (12, 3)):
        length = np.linalg.norm(tx - point, axis=-1) + np.linalg.norm(rx - point, axis=-1) + radar.path_offset
        phase = 2 * np.pi * radar.waveform.frequencies / 299792458.0 * length[..., None]
        frames += np.exp(-1j * phase + 2j * np.pi * rng.random())
    return ms.Capture(radar=radar, trajectory=path, frames=frames.astype(np.complex64))


def parts(capture, sizes):
    start = 0
    for size in sizes:
        path = capture.trajectory
        yield ms.Capture(
            radar=capture.radar,
            trajectory=ms.Trajectory(
                times=path.times[start : start + size], positions=path.positions[start : start + size]
            ),
            frames=capture.frames[start : start + size],
        )
        start += size


@pytest.mark.parametrize("window", [None, "hann"])
def test_the_last_image_is_that_of_the_whole(capture, window):
    # Parts of different sizes: each counts by its channels.
    total = len(capture.trajectory)
    sizes = [31, 62, 5, 100]
    sizes.append(total - sum(sizes))
    growing, changes = GrowingImage(GRID, window=window), []
    for part in parts(capture, sizes):
        growing.add(part)
        changes.append(growing.change)
    assert growing.poses == total == growing.image.metadata["poses"]
    assert changes[0] == 1
    assert 0 < changes[-1] < 2
    whole = form_image(capture, GRID, window=(window, None), tolerance=0.001).values
    error = np.linalg.norm(growing.image.values - whole) / np.linalg.norm(whole)
    assert error < 0.005
    if window is None:
        exact = image_at(
            capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies,
            GRID.points[::3], capture.radar.path_offset,
        )  # fmt: skip
        assert np.linalg.norm(growing.image.values.ravel()[::3] - exact) / np.linalg.norm(exact) < 0.005


def test_a_capture_of_another_radar_is_refused_and_loses_nothing(capture):
    growing = GrowingImage(GRID)
    with pytest.raises(InputError, match="nothing was added yet"):
        _ = growing.image
    growing.add(next(parts(capture, [62])))
    before = growing.image.values
    other = ms.simulate(
        ms.Scene.from_mesh("golf_ball", vertices=100),
        ms.Radar.preset("position2go"),
        ms.Trajectory.raster(size=(0.02, 0.0), step=0.01, center=(0, 0, 0.25)),
    )
    with pytest.raises(InputError, match="one radar"):
        growing.add(other)
    assert growing.poses == 62
    assert np.array_equal(growing.image.values, before)


def test_arguments_are_checked():
    with pytest.raises(UnknownNameError):
        GrowingImage(GRID, window="hamming")
    with pytest.raises(InputError, match="grid"):
        GrowingImage("2mm")
