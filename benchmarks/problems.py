"""The two problems that speed is measured on, at any scale: R, a real-size image, and S, a simulated object."""

import numpy as np

import millisight as ms
from millisight.simulation import _kernels as _kernels
from millisight.simulation._simulate import _add_signals


def real_size(scale: float = 1.0, seed: int = 0) -> tuple[ms.Capture, ms.VoxelGrid]:
    """Problem R: 220 x 240 x 22 voxels, 10 900 poses over 0.55 x 0.45 m with 0.5 mm of jitter in all axes, 4 RX.

    `scale` reduces voxels and channels alike (1/4, 1/16), over the same aperture and volume. The frames are those
    of 1000 reflectors of random complex strength all over the grid, with the radar's own offsets.
    """
    rng = np.random.default_rng(seed)
    root = np.sqrt(scale)
    radar = ms.Radar.preset("iwr1443")
    counts = round(109 * root), round(100 * root)
    x, y = np.meshgrid(np.linspace(0, 0.55, counts[0]), np.linspace(0, 0.45, counts[1]), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + rng.normal(0, 0.0005, (x.size, 3))
    trajectory = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)
    tx, rx = trajectory.placed(radar.array.tx_positions), trajectory.placed(radar.array.rx_positions)
    points = rng.uniform([-0.10, -0.05, -0.37], [0.45, 0.55, -0.16], (1000, 3))
    strengths = rng.normal(size=1000) + 1j * rng.normal(size=1000)
    frames = np.zeros((len(positions), 1, 4, radar.waveform.samples_per_chirp), dtype=np.complex64)
    for start in range(0, len(positions), 500):
        some = np.arange(start, min(start + 500, len(positions)))
        lit = np.ones((len(some), 1, 4, len(points)), dtype=bool)
        _add_signals(_kernels, lit, tx[some], rx[some], points, strengths, radar, "none", some, frames)
    frames.flags.writeable = False
    grid = ms.VoxelGrid(
        x=np.linspace(-0.10, 0.4475, round(220 * root)),
        y=np.linspace(-0.05, 0.5475, round(240 * root)),
        z=np.linspace(-0.37, -0.16, 22),
    )
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames), grid


def simulated_object(scale: float = 1.0) -> tuple[ms.Scene, ms.Radar, ms.Trajectory, ms.VoxelGrid]:
    """Problem S: a 10 000-vertex mesh, the published raster of 130 640 positions, an image of 220 x 220 x 22 voxels."""
    scene = ms.Scene.from_mesh("power_drill", vertices=10_000)
    published = ms.Trajectory.published(77.5e9)
    keep = np.arange(0, len(published), round(1 / scale))
    trajectory = ms.Trajectory(times=published.times[keep], positions=published.positions[keep])
    lower, upper = scene.mesh.bounds
    count = round(220 * np.sqrt(scale))
    axes = [np.linspace(a - 0.01, b + 0.01, n) for a, b, n in zip(lower, upper, (count, count, 22), strict=True)]
    return scene, ms.Radar.preset("mito-sim-77ghz"), trajectory, ms.VoxelGrid(x=axes[0], y=axes[1], z=axes[2])
