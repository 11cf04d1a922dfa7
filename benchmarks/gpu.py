"""A GPU's correctness and speed: `python benchmarks/gpu.py`. Without a GPU it says so and exits 1.

First small random problems: images against `ms.image_at` (float64) and the CPU's, signals against a sum in float64
and the CPU's. Then the problems R and S of `problems.py`: kernels with everything on the GPU, and whole calls from
NumPy to NumPy, the CPU's beside them; medians of 5 and of 3, after one that compiles. The rig has no kernels for a GPU.

`--tiny` shrinks all of it to try this script itself, with NUMBA_ENABLE_CUDASIM=1 without a GPU (figures mean nothing).
"""

import statistics
import sys
import time
from unittest import mock

import numpy as np
from problems import real_size, simulated_object

import millisight as ms
from millisight.core import SPEED_OF_LIGHT, check_device
from millisight.core.errors import DeviceError
from millisight.imaging import _plan, path_bounds, range_steering
from millisight.simulation._simulate import _add_signals, _kernels_on

TINY = "--tiny" in sys.argv[1:]


def relative(got, expected):
    return np.linalg.norm(got - expected) / np.linalg.norm(expected)


def jittered(counts, size, rng):
    """An IWR1443 in a raster with 0.5 mm of jitter, and frames of noise."""
    radar = ms.Radar.preset("iwr1443")
    x, y = np.meshgrid(*(np.linspace(0, s, n) for s, n in zip(size, counts, strict=True)), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + rng.normal(0, 0.0005, (x.size, 3))
    trajectory = ms.Trajectory(times=np.arange(float(x.size)), positions=positions)
    shape = (x.size, 1, 4, radar.waveform.samples_per_chirp)
    frames = rng.standard_normal((*shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


def real_size_grid(counts):
    nx, ny, nz = counts
    return ms.VoxelGrid(
        x=np.linspace(-0.10, 0.4475, nx), y=np.linspace(-0.05, 0.5475, ny), z=np.linspace(-0.37, -0.16, nz)
    )


def signals(count, lit_share, poses, rng):
    """What `_add_signals` takes after the kernels: one block of positions, a hand-sized object, a mito-sim radar."""
    radar = ms.Radar.preset("mito-sim-77ghz")
    points = rng.uniform([-0.1, -0.1, -0.05], [0.1, 0.1, 0.05], (count, 3))
    strengths = rng.normal(size=count) + 1j * rng.normal(size=count)
    antennas = rng.uniform([-0.2, -0.2, 0.3], [0.2, 0.2, 0.31], (poses, 1, 3))
    lit = rng.uniform(size=(poses, 1, 1, count)) < lit_share
    frames = np.zeros((poses, 1, 1, radar.waveform.samples_per_chirp), np.complex64)
    return (lit, antennas, antennas, points, strengths, radar, "none", np.arange(poses), frames)


def correctness(rng):
    print("Relative L2 differences on small problems")
    capture = jittered((3, 2) if TINY else (40, 30), (0.1, 0.08), rng)
    # Reflectors instead of noise, which no image could show.
    points = rng.uniform([0.0, 0.0, -0.36], [0.4, 0.5, -0.2], (100, 3))
    lit = np.ones((len(capture.trajectory), 1, 4, 100), bool)
    frames = np.zeros(capture.frames.shape, np.complex64)
    everyone = np.arange(len(frames))
    _add_signals(
        _kernels_on("cpu"), lit, capture.tx_positions, capture.rx_positions, points, rng.normal(size=100) + 0j,
        capture.radar, "none", everyone, frames,
    )  # fmt: skip
    capture = ms.Capture(radar=capture.radar, trajectory=capture.trajectory, frames=frames)
    grid = real_size_grid((2, 3, 2) if TINY else (80, 90, 5))
    some = rng.choice(grid.size, min(grid.size, 500), replace=False)
    exact = ms.image_at(
        frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies, grid.points[some],
        capture.radar.path_offset,
    )  # fmt: skip
    # Problems of this size are factorised too, by the same plan on both.
    eager = dict.fromkeys(("cuda", "cpu"), _plan.COSTS["cpu"]._replace(top=0))
    for method, most_exact, most_cpu in (("backprojection", 0.01, 1e-3), ("fast", 0.02, 3e-3)):
        with mock.patch.dict(_plan.COSTS, eager), mock.patch.object(_plan, "_LEAST_PAIRS", 0):
            images = [ms.form_image(capture, grid, method=method, device=d) for d in ("cuda", "cpu")]
        gpu, cpu = (image.values.ravel() for image in images)
        to_exact, to_cpu = relative(gpu[some], exact), relative(gpu, cpu)
        done_by = images[0].metadata["history"][-1].get("done_by", method)
        assert TINY or method != "fast" or done_by == "factorised backprojection"
        print(f"  {done_by:25} {to_exact:.1e} from image_at on {len(some)} voxels, {to_cpu:.1e} from the CPU")
        assert to_exact < most_exact
        assert to_cpu < most_cpu

    args = signals(30 if TINY else 1000, 0.3, 3 if TINY else 50, rng)
    lit, antennas, _, points, strengths, radar, *_, frames = args
    d = 2 * np.linalg.norm(antennas - points, axis=-1) + radar.path_offset
    waves = radar.waveform.frequencies / SPEED_OF_LIGHT
    direct = np.einsum("pv,pvn->pn", lit[:, 0, 0] * strengths, np.exp(-2j * np.pi * np.multiply.outer(d, waves)))
    results = []
    for device in ("cuda", "cpu"):
        frames[:] = 0
        _add_signals(_kernels_on(device), *args)
        results.append(frames[:, 0, 0].copy())
    to_exact, to_cpu = relative(results[0], direct), relative(*results)
    print(f"  {'signals':25} {to_exact:.1e} from a sum in float64, {to_cpu:.1e} from the CPU")
    assert to_exact < 1e-4
    assert to_cpu < 1e-4


def median_time(work, finish, rounds=1 if TINY else 5):
    """(first, median of the others) of the seconds that `work` takes until `finish` returns."""
    seconds = []
    for _ in range(1 + rounds):
        start = time.perf_counter()
        work()
        finish()
        seconds.append(time.perf_counter() - start)
    return seconds[0], statistics.median(seconds[1:])


def speed(rng):
    from millisight.core import gpu
    from millisight.core.gpu import cuda
    from millisight.imaging import _cuda

    device = cuda.get_current_device()
    try:
        units, clock = device.MULTIPROCESSOR_COUNT, device.CLOCK_RATE * 1e3
    except AttributeError:
        units, clock = 132, 1.755e9  # an H100's, for the simulator
    lanes = 64 if tuple(device.compute_capability) in {(6, 0), (7, 0), (7, 2), (7, 5), (8, 0)} else 128
    floor = units * lanes * clock / _cuda.PAIR_INSTRUCTIONS
    print(
        f"{getattr(device, 'name', 'simulator')}: {units} multiprocessors x {lanes} lanes x {clock / 1e9:.2f} GHz / "
        f"{_cuda.PAIR_INSTRUCTIONS} instructions a pair = {floor:.2e} pairs/s at most"
    )

    capture = jittered((4, 2) if TINY else (109, 100), (0.55, 0.45), rng)
    grid = real_size_grid((3, 2, 2) if TINY else (220, 240, 22))
    pairs = grid.size * capture.channels
    origin = grid.bounds.mean(axis=0)
    tx, rx = capture.tx_positions - origin, capture.rx_positions - origin
    nearest, furthest = path_bounds(tx, rx, grid.bounds - origin)
    steering, per_metre = range_steering(capture, nearest, furthest, 8, None)
    carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT
    frames, steering = _cuda.to_device(capture.frames), _cuda.to_device(steering)
    profiles = gpu.product(frames, steering)
    sums = _cuda.zeros((2, grid.size))
    print(
        f"Problem R: {grid.size} voxels x {capture.channels} channels = {pairs:.2e} pairs, {profiles.shape[3]} entries"
    )

    first, seconds = median_time(lambda: gpu.product(frames, steering, profiles), cuda.synchronize)
    print(f"  range compression, kernel        {seconds:8.4f} s (first {first:.2f})")
    for name, order in (("z innermost, as in the grid", (0, 1, 2)), ("y innermost", (0, 2, 1))):
        points = grid.points.reshape(*grid.shape, 3).transpose(*order, 3).reshape(-1, 3) - origin
        x, y, z = (_cuda.to_device(a) for a in np.ascontiguousarray(points.T.astype(np.float32)))
        first, seconds = median_time(
            lambda x=x, y=y, z=z: _cuda.backproject(
                profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sums[0], sums[1]
            ),
            cuda.synchronize,
        )
        print(
            f"  direct backprojection, kernel    {seconds:8.4f} s (first {first:.2f}): {pairs / seconds:.2e} pairs/s, "
            f"{100 * pairs / seconds / floor:.0f} % of the most; {name}"
        )
    del profiles, sums, frames
    whole_calls()


def whole_calls():
    """R and S as a user calls them."""
    rounds = 1 if TINY else 3
    capture, grid = real_size(1 / 4096 if TINY else 1)
    some = np.random.default_rng(1).choice(grid.size, min(grid.size, 500), replace=False)
    exact = ms.image_at(
        capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies,
        grid.points[some], capture.radar.path_offset,
    )  # fmt: skip
    pairs = grid.size * capture.channels
    for device, method in (("cuda", "backprojection"), ("cuda", "fast"), ("cpu", "fast")):
        kept = []
        work = lambda d=device, m=method, k=kept: k.append(ms.form_image(capture, grid, method=m, device=d))  # noqa: E731
        first, seconds = median_time(work, lambda: None, rounds)
        image = kept[-1]
        by = image.metadata["history"][-1].get("done_by", method)
        error = relative(image.values.ravel()[some], exact)
        print(f"R on {device}, {method} (by {by}): {seconds:.3f} s (first {first:.2f}), {pairs / seconds:.2e} pairs/s, "
              f"error {error:.2%}")  # fmt: skip
    scene, radar, trajectory, grid = simulated_object(1 / 2000 if TINY else 1)
    for model in ("specular", "edge"):
        for device in ("cuda", "cpu"):
            kept = []
            work = lambda d=device, m=model, k=kept: k.append(  # noqa: E731
                ms.simulate(scene, radar, trajectory, model=m, device=d)
            )
            simulated = median_time(work, lambda: None, rounds)[1]
            work = lambda d=device, k=kept: ms.form_image(k[-1], grid, device=d)  # noqa: E731
            formed = median_time(work, lambda: None, rounds)[1]
            print(f"S, {model} on {device}: simulate {simulated:.2f} s, form_image {formed:.2f} s")


def main():
    try:
        check_device("cuda")
    except DeviceError as error:
        print(error)
        return 1
    rng = np.random.default_rng(0)
    correctness(rng)
    speed(rng)
    return 0


if __name__ == "__main__":
    sys.exit(main())
