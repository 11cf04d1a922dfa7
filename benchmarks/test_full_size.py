"""The paper's full size: seconds, ratios and errors of the problems R and S (see problems.py).

    make bench TESTS=benchmarks/test_full_size.py

Takes about six minutes on two cores. Times that are compared are taken in turn, in one run.
"""

import resource
import time

import numba
import numpy as np
import pytest
from problems import real_size, simulated_object

import millisight as ms


def seconds(function, *arguments, **settings):
    start = time.perf_counter()
    result = function(*arguments, **settings)
    return time.perf_counter() - start, result


def relative(actual, expected):
    return float(np.linalg.norm(actual - expected) / np.linalg.norm(expected))


def errors_against_exact(capture, grid, image, count):
    """Relative L2 error on random voxels and on the 500 brightest, each set by itself."""
    values = image.values.ravel()
    picks = {
        "random": np.random.default_rng(1).choice(grid.size, count, replace=False),
        "brightest": np.argsort(np.abs(values))[-500:],
    }
    both = np.concatenate(list(picks.values()))
    exact = ms.image_at(
        capture.frames,
        capture.tx_positions,
        capture.rx_positions,
        capture.radar.waveform.frequencies,
        grid.points[both],
        capture.radar.path_offset,
    )
    parts = np.split(exact, [count])
    return {name: relative(values[p], e) for (name, p), e in zip(picks.items(), parts, strict=True)}


def test_r_fast_against_backprojection():
    """R at full size: at least 12 x faster than direct backprojection, within 1 % of exact."""
    small, grid = real_size(1 / 64)
    for method in ("fast", "backprojection"):
        ms.form_image(small, grid, method=method)  # compile
    capture, grid = real_size()
    quick, direct = [], []
    for _ in range(3):
        taken, image = seconds(ms.form_image, capture, grid, method="fast")
        quick.append(taken)
        taken, slow = seconds(ms.form_image, capture, grid, method="backprojection")
        direct.append(taken)
    ratio = float(np.median(np.array(direct) / np.array(quick)))
    pairs = grid.size * capture.channels
    cost = np.median(direct) * numba.get_num_threads() / pairs * 1e9
    print(
        f"\nR: fast {np.median(quick):.2f} s, backprojection {np.median(direct):.1f} s = {cost:.2f} ns a pair and core"
    )
    print(f"R: fast is {ratio:.1f} x faster; {image.metadata['history'][-1]['sub_apertures']}")
    for name, formed in (("fast", image), ("backprojection", slow)):
        errors = errors_against_exact(capture, grid, formed, 2000)
        print(f"R: {name}: error on 2000 random voxels {errors['random']:.3%}, 500 brightest {errors['brightest']:.3%}")
        assert max(errors.values()) < 0.01
    assert ratio >= 12


def test_r_growth():
    """From 1/16 to full size, voxels and channels x 4 each twice: pairs grow 16 x a step, the cost at most 7 x."""
    real = {scale: real_size(scale) for scale in (1 / 16, 1 / 4, 1)}
    for scale, (capture, grid) in real.items():
        if scale < 1:
            ms.form_image(capture, grid)
    taken = {
        scale: np.median([seconds(ms.form_image, *problem)[0] for _ in range(3)]) for scale, problem in real.items()
    }
    steps = taken[1 / 4] / taken[1 / 16], taken[1] / taken[1 / 4]
    print(
        "\nR at 1/16, 1/4, 1: "
        + ", ".join(f"{t:.2f} s" for t in taken.values())
        + f"; growth {steps[0]:.1f}, {steps[1]:.1f}"
    )
    assert max(steps) < 7


def test_s_both_models_with_images():
    """S at full size: both models, signals and images; and the peak memory of this process so far."""
    scene, radar, trajectory, grid = simulated_object()
    warm = ms.Trajectory.raster(size=(0.05, 0.05), step=0.005)
    for model in ("specular", "edge"):
        ms.form_image(ms.simulate(scene, radar, warm, model=model), grid)
    total = 0.0
    print()
    for model in ("specular", "edge"):
        simulating, capture = seconds(ms.simulate, scene, radar, trajectory, model=model)
        imaging, image = seconds(ms.form_image, capture, grid)
        total += simulating + imaging
        print(f"S: {model}: simulate {simulating:.1f} s, image {imaging:.1f} s")
        assert image.magnitude.max() > 0
        gigabytes = capture.frames.nbytes / 1e9
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"S: {total:.1f} s in all; capture {gigabytes:.2f} GB, peak memory of the process {peak:.2f} GB")


def test_r_beside_fastsar():
    """Direct backprojection of a part of R by fastsar 0.1.8, where it is installed, in turn with ours."""
    fastsar = pytest.importorskip("fastsar", reason="pip install fastsar==0.1.8 to compare with it")
    whole, grid = real_size()
    poses = 100
    capture = ms.Capture(
        radar=whole.radar,
        trajectory=ms.Trajectory(times=whole.trajectory.times[:poses], positions=whole.trajectory.positions[:poses]),
        frames=whole.frames[:poses],
    )
    frequencies, c = capture.radar.waveform.frequencies, 299_792_458.0
    origin = grid.bounds.mean(axis=0)
    tx = np.repeat(capture.tx_positions - origin, 4, axis=1).reshape(-1, 3)
    rx = (capture.rx_positions - origin).reshape(-1, 3)
    # Its convention: phase compensated to the origin, half the bistatic path, the sum over samples and pulses.
    reference = np.linalg.norm(tx, axis=1) + np.linalg.norm(rx, axis=1) + capture.radar.path_offset
    history = capture.frames.reshape(-1, len(frequencies))
    history = (history * np.exp(2j * np.pi * np.outer(reference, frequencies) / c)).astype(np.complex64)
    points = grid.points.reshape(*grid.shape, 3) - origin

    def theirs():
        return fastsar.backproject(
            history, tx, frequencies[0], frequencies[1] - frequencies[0], points, rcv=rx, window=False
        )

    theirs()
    ms.form_image(capture, grid, method="backprojection")
    times = {"fastsar": [], "ours": []}
    for _ in range(3):
        taken, other = seconds(theirs)
        times["fastsar"].append(taken)
        taken, image = seconds(ms.form_image, capture, grid, method="backprojection")
        times["ours"].append(taken)
    picks = np.random.default_rng(2).choice(grid.size, 1000, replace=False)
    exact = ms.image_at(
        capture.frames, capture.tx_positions, capture.rx_positions, frequencies, grid.points[picks],
        capture.radar.path_offset,
    )  # fmt: skip
    # Whatever its constant factor, the error is judged after the best scaling.
    values = np.asarray(other).ravel()[picks]
    values = values * (np.vdot(values, exact) / np.vdot(values, values))
    pairs = grid.size * capture.channels / numba.get_num_threads()
    print(f"\nfastsar: {np.median(times['fastsar']) / pairs * 1e9:.2f} ns a pair and core, "
          f"error {relative(values, exact):.3%}")  # fmt: skip
    print(f"ours: {np.median(times['ours']) / pairs * 1e9:.2f} ns a pair and core, "
          f"error {relative(image.values.ravel()[picks], exact):.3%}")  # fmt: skip
    print(f"ratio fastsar / ours: {np.median(np.array(times['fastsar']) / np.array(times['ours'])):.1f}")
