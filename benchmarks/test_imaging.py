"""Speed of imaging, per voxel-channel pair and core, and the error that goes with it.

    make bench

Absolute figures move with the machine; the ratios of one run are what to quote.
"""

import numba
import numpy as np
import pytest

import millisight as ms


def jittered_capture(poses, rng):
    """An IWR1443 over 0.55 x 0.45 m with 0.5 mm of position jitter, and noise for frames: the work is the same."""
    radar = ms.Radar.preset("iwr1443")
    rows = int(np.sqrt(poses * 0.55 / 0.45))
    x, y = np.meshgrid(np.linspace(0, 0.55, rows), np.linspace(0, 0.45, poses // rows), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    positions += rng.normal(0, 0.0005, positions.shape)
    shape = (len(positions), 1, 4, radar.waveform.samples_per_chirp)
    frames = rng.standard_normal((*shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
    trajectory = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


GRID = ms.VoxelGrid.regular((0, 0, -0.37), (0.5475, 0.5475, -0.16), (0.0025, 0.0025, 0.01))


@pytest.mark.benchmark(group="backprojection")
def test_backprojection_per_pair(benchmark):
    """220 x 220 x 22 voxels, 1200 channels: nanoseconds a pair and core in `extra_info` and on screen."""
    capture = jittered_capture(300, np.random.default_rng(0))
    ms.form_image(capture, GRID)
    benchmark.pedantic(ms.form_image, (capture, GRID), rounds=5)
    pairs = GRID.size * capture.channels
    cost = benchmark.stats.stats.median * numba.get_num_threads() / pairs * 1e9
    benchmark.extra_info["ns_per_pair_and_core"] = cost
    print(f"\nbackprojection: {cost:.2f} ns a voxel-channel pair and core ({pairs / 1e9:.2f} G pairs)")
    assert pairs > 1e9


@pytest.mark.parametrize("oversampling", [2, 4, 8, 16, 32])
@pytest.mark.benchmark(group="error against oversampling")
def test_error_against_oversampling(benchmark, oversampling):
    """Relative L2 error against `exact` of the image of 200 random reflectors."""
    rng = np.random.default_rng(1)
    capture = jittered_capture(200, rng)
    points = rng.uniform([0.1, 0.1, -0.36], [0.45, 0.35, -0.2], (200, 3))
    strengths = rng.normal(size=200) + 1j * rng.normal(size=200)
    d = np.linalg.norm(points - capture.tx_positions[:, :, None, None], axis=-1)
    d = d + np.linalg.norm(points - capture.rx_positions[:, None, :, None], axis=-1) + capture.radar.path_offset
    frames = [
        (strengths * np.exp(-2j * np.pi * f * d / 299792458)).sum(axis=-1) for f in capture.radar.waveform.frequencies
    ]
    capture = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=np.stack(frames, axis=-1))
    grid = ms.VoxelGrid.regular((0.1, 0.1, -0.36), (0.45, 0.35, -0.2), (0.03, 0.03, 0.04))
    exact = ms.form_image(capture, grid, method="exact").values
    image = benchmark.pedantic(ms.form_image, (capture, grid), {"oversampling": oversampling}, rounds=3)
    error = np.linalg.norm(image.values - exact) / np.linalg.norm(exact)
    benchmark.extra_info["relative_l2"] = error
    print(f"\noversampling {oversampling}: {100 * error:.3f} % of relative L2 error")
    assert error < 0.1
