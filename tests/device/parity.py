"""Every GPU kernel, and the doors to them, beside the CPU's on tiny problems, as JSON: {what: relative L2 difference}.

A program of its own, since NUMBA_ENABLE_CUDASIM must be set before Numba is imported: with it the kernels run in
numba-cuda's simulator, without it on a GPU.
"""

import json
import os
import sys

import numpy as np

import millisight as ms
from millisight.core import _matrix as matrix
from millisight.core import gpu
from millisight.imaging import _cuda as _cuda
from millisight.imaging import _kernels as _kernels
from millisight.imaging import _plan
from millisight.imaging._lengths import antenna_rows, rows_of_pairs
from millisight.imaging._refraction import Excess
from millisight.simulation import _cuda as capture_cuda
from millisight.simulation import _kernels as capture_cpu

# Few waves a metre, so that what float32 rounds off the phases stays far below the tolerance.
CARRIER = np.float32(10e9 / 299792458)
NEAREST, PER_METRE = np.float32(0.1), np.float32(60.0)


if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1":
    # The simulator starts a thread of Python for each of a block, and these wait for each other: few are the fastest.
    gpu.launch.__kwdefaults__["threads"] = 2


def taken_by_a_gpu(value):
    """Whether numba-cuda hands such a value over to a kernel; the simulator takes anything, None for one."""
    if isinstance(value, tuple):
        return all(map(taken_by_a_gpu, value))
    return isinstance(value, bool | int | float | complex | np.generic) or hasattr(value, "dtype")


def launch(function, size, *args, _launch=gpu.launch, **options):
    strange = [type(value).__name__ for value in args if not taken_by_a_gpu(value)]
    assert not strange, f"{function} takes {strange}"
    _launch(function, size, *args, **options)


for module in (gpu, _cuda, capture_cuda):
    module.launch = launch


def random_complex(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def difference(got, expected):
    got, expected = np.asarray(got), np.asarray(expected)
    if got.shape != expected.shape or not np.linalg.norm(expected) > 0:
        return float("inf")
    return float(np.linalg.norm(got - expected) / np.linalg.norm(expected))


def imaging(rng):
    """A radar of 2 TX and 3 RX over a small block, in an order of axes and sizes that are all different."""
    poses = 5
    tx = rng.uniform(-0.05, 0.05, (poses, 2, 3)).astype(np.float32)
    rx = rng.uniform(-0.05, 0.05, (poses, 3, 3)).astype(np.float32)
    profiles = random_complex(rng, poses, 2, 3, 40)
    x, y, z = (np.float32(start) + np.float32(0.01) * np.arange(n, dtype=np.float32) for start, n in
               ((-0.05, 9), (-0.04, 11), (-0.13, 2)))  # fmt: skip
    points = [np.ascontiguousarray(a.ravel()) for a in np.meshgrid(x[:5], y[:4], z, indexing="ij")]
    far = np.array([3e3, -4e3, 1e3])  # antennas so far off that float32 lengths would lose the phase
    for where, offset in (("", 0.0), (", far off", far)):
        towards = np.float64(tx) + offset, np.float64(rx) + offset
        starts = tuple(np.linalg.norm(a, axis=-1) - 0.2 for a in towards)
        sums = np.zeros((2, 2, 40), np.float32)
        for kernels, result in ((_kernels, sums[1]), (_cuda, sums[0])):
            kernels.backproject(profiles, starts, PER_METRE, CARRIER, *towards, *points, *result)
        yield f"backproject with starts of channels{where}", *sums
    radar = (profiles, NEAREST, PER_METRE, CARRIER, tx, rx)
    rows = (profiles, PER_METRE, CARRIER, *rows_of_pairs(tx, rx, NEAREST, PER_METRE, CARRIER))

    expected, got = rng.normal(size=(2, 2, 40)).astype(np.float32)
    got[:] = expected  # what was there is added to
    _kernels.backproject(*radar, *points, *expected)
    _cuda.backproject(*radar, *points, *got)
    yield "backproject", got, expected

    excess = Excess(rng.uniform(0, 0.01, (5, 7)).astype(np.float32), np.float32([0, 0.6, -0.8, 0.02, 40, 30]), 0.01)
    expected, got = np.zeros((2, 2, 40), np.float32)
    _kernels.backproject(*radar, *points, *expected, excess)
    _cuda.backproject(*radar, *points, *got, excess)
    yield "backproject through layers", got, expected

    # The same in two blocks, everything kept on the device.
    sums = _cuda.zeros((2, 40))
    vx, vy, vz = (_cuda.to_device(a) for a in points)
    for block in (slice(0, 2), slice(2, 5)):
        there = _cuda.to_device(profiles[block])
        _cuda.backproject(
            there, NEAREST, PER_METRE, CARRIER, tx[block], rx[block], vx, vy, vz, sums[0], sums[1]
        )  # fmt: skip
    expected = np.zeros((2, 40), np.float32)
    _kernels.backproject(*radar, *points, *expected)
    yield "backproject in blocks on the device", _cuda.to_host(sums), expected

    members, starts = np.array([3, 0, 4, 2, 1]), np.array([0, 2, 5])
    centers, far_centers = (antenna_rows(rng.uniform(-0.03, 0.03, (2, 3)) + o, 0.0, 0.0, 0.0) for o in (0.0, far))
    points = [np.ascontiguousarray(a.ravel()) for a in np.meshgrid(x, y, z, indexing="ij")]
    fields = np.empty((2, 2, 2, 9 * 11 * 2), np.float32)  # got or expected, part, sub-aperture, point
    _kernels.leaf_fields(*rows, members, starts, centers, *points, *fields[1])
    _cuda.leaf_fields(*rows, members, starts, centers, *points, *fields[0])
    yield "leaf_fields", *fields
    bent = np.empty_like(fields)
    _kernels.leaf_fields(*rows, members, starts, centers, *points, *bent[1], excess)
    _cuda.leaf_fields(*rows, members, starts, centers, *points, *bent[0], excess)
    yield "leaf_fields through layers", *bent
    fields = fields.reshape(2, 2, 2, 9, 11, 2)

    def taps(coarse, fine):
        return np.sort(rng.integers(0, coarse - 7, fine)), rng.normal(size=(fine, 8)).astype(np.float32)

    fine, wide = (np.linspace(-0.04, 0.04, n, dtype=np.float32) for n in (5, 13))
    parents, far_parents = (antenna_rows(rng.uniform(-0.03, 0.03, (2, 3)) + o, 0.0, 0.0, 0.0) for o in (0.0, far))
    for has_parents, starts, rows, ends, along, across, finer in (
        (True, np.array([0, 1, 2]), 2, (centers, parents), taps(9, 5), taps(11, 13), (fine, wide)),
        (True, np.array([0, 1, 2]), 2, (far_centers, far_parents), taps(9, 5), None, (fine, y)),
        (True, np.array([0, 1, 2]), 2, (centers, parents), None, taps(11, 13), (x, wide)),
        (False, np.array([0, 2]), 1, (centers, parents), taps(9, 5), taps(11, 13), (fine, wide)),
    ):
        out = np.empty((2, 2, rows, *map(len, finer), 2), np.float32)
        out[:] = rng.normal(size=out.shape[1:])  # the image is added to
        for kernels, result in ((_cuda, out[0]), (_kernels, out[1])):
            kernels.merge(
                fields[1], np.array([1, 0]), starts, *ends, has_parents, CARRIER, along, across, *finer, z, result
            )
        where = (", far off" if ends[0] is far_centers else "") + ("" if along and across else ", along one axis")
        yield f"merge {'to parents' if has_parents else 'to the image'}{where}", *out


def arrays(rng):
    left, right = random_complex(rng, 3, 2, 7), random_complex(rng, 7, 5)
    yield "product", gpu.to_host(gpu.product(left, right)), matrix.product(left, right)
    out = gpu.empty((4, 2, 5), np.complex64)
    gpu.product(gpu.to_device(left[:2]), gpu.to_device(right), out[:2])
    gpu.product(gpu.to_device(left[1:]), gpu.to_device(right), out[2:])
    yield "product into a place", gpu.to_host(out), matrix.product(left[[0, 1, 1, 2]], right)
    yield "zeros", gpu.to_host(gpu.zeros((3, 100))) + 1, np.ones((3, 100))


def capture(rng):
    vertices = rng.uniform(-0.03, 0.03, (50, 3))
    tx, rx = rng.uniform([-0.1, -0.1, 0.2], [0.1, 0.1, 0.25], (2, 4, 3))
    lit = rng.uniform(size=(4, 50)) < 0.4
    reflections, nodes = random_complex(rng, 50).astype(complex), np.cos(np.pi * (np.arange(6) + 0.5) / 6)
    center = np.array([0.001, 0.002, 0.003])
    signals = np.empty((2, 4, 2, 6), np.complex64)
    weights = np.where(lit, rng.uniform(size=lit.shape), 0).astype(np.float32)
    for weight, spread in ((weights, True), (weights, False), (lit, False), (lit, True)):
        for kernels, result in ((capture_cuda, signals[0]), (capture_cpu, signals[1])):
            kernels.node_signals(
                weight, tx, rx, vertices, reflections, spread, center, 0.15, 80.0, 0.7, nodes, result
            )  # fmt: skip
        yield f"node_signals, {weight.dtype} weights, {'1/d' if spread else 'no'} spreading", *signals
    for samples in (9, 10):
        interpolation = rng.normal(size=(2, 6, (samples + 1) // 2)).astype(np.float32)
        interpolation[1, :, -1] *= samples % 2 == 0  # the odd part has none in the middle
        frames, offsets = np.zeros((2, 6, samples), np.complex64), np.linspace(0.7, 0.0, (samples + 1) // 2)
        for kernels, result in ((capture_cuda, frames[0]), (capture_cpu, frames[1])):
            kernels.write_frames(
                signals[1], interpolation, tx, rx, center, 0.15, offsets, np.array([5, 0, 3, 2]), result
            )  # fmt: skip
        yield f"write_frames of {samples} samples", *frames


def doors(rng):
    """simulate and form_image, with a plan of two levels, so that fields are carried to parents."""
    radar = ms.Radar.preset("mito-sim-24ghz")
    trajectory = ms.Trajectory.raster(size=(0.006, 0.006), step=0.003)
    scene = ms.Scene.from_mesh("rubiks_cube", vertices=100)
    corners = ms.Trajectory.raster(size=(0.006, 0.006), step=0.006)
    for model, path in (("rough", corners), ("diffuse", trajectory)):
        frames = [ms.simulate(scene, radar, path, model=model, device=d).frames for d in ("cuda", "cpu")]
        yield f"simulate {model}", *frames

    capture = ms.Capture(radar=radar, trajectory=trajectory, frames=frames[1])
    grid = ms.VoxelGrid.regular((-0.02, -0.02, 0), (0.02, 0.02, 0), 0.01)
    coarse = np.linspace(-0.03, 0.03, 8)
    levels = tuple(_plan.Level(size, (coarse, coarse)) for size in (0.002, 0.004))
    _plan.Planner.plan = lambda *_: _plan.Plan(levels, (0, 1, 2), 1.0)
    for method in ("backprojection", "fast"):
        images = [ms.form_image(capture, grid, method=method, window="hann", device=d) for d in ("cuda", "cpu")]
        done_by = "factorised backprojection" if method == "fast" else None  # the plan above, and no other
        assert all(image.metadata["history"][-1].get("done_by") == done_by for image in images)
        yield method, *(image.values for image in images)


def main():
    rng = np.random.default_rng(4)
    results = {}
    for checks in (imaging, arrays, capture, doors):
        for name, got, expected in checks(rng):
            results[name] = difference(got, expected)
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()
