"""Factorised backprojection against the exact imager, over geometries that it was not tuned on."""

from functools import cache
from itertools import pairwise

import numba
import numpy as np
import pytest

import millisight as ms
from helpers.oracles import point_frames, relative
from millisight.imaging import _fast as module
from millisight.imaging import _plan
from millisight.imaging._kernels import merge
from millisight.imaging._lengths import antenna_rows
from millisight.imaging._plan import Planner, coarse_axis
from millisight.imaging._taps import axis_weights


def scan_of(radar, positions, reflectors=300, box=((-0.1, -0.1, -0.34), (0.1, 0.1, -0.2)), seed=0):
    """Random reflectors of random strength all over a box, seen from `positions` (P, 3)."""
    rng = np.random.default_rng(seed)
    # Few samples over the same band: the physics is the same, the oracle is quicker by as much.
    waveform = ms.Waveform.stepped(radar.waveform.start_frequency, radar.waveform.bandwidth / 32, 32)
    radar = ms.Radar(name="test", waveform=waveform, array=radar.array, path_offset=radar.path_offset)
    trajectory = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)
    points = rng.uniform(*box, (reflectors, 3))
    amplitudes = rng.normal(size=reflectors) + 1j * rng.normal(size=reflectors)
    tx, rx = trajectory.placed(radar.array.tx_positions), trajectory.placed(radar.array.rx_positions)
    frames = point_frames(points, amplitudes, tx, rx, waveform.frequencies, radar.path_offset)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


def raster(size, count, jitter, seed=1):
    x, y = np.linspace(-0.5, 0.5, count[0]) * size[0], np.linspace(-0.5, 0.5, count[1]) * size[1]
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return grid + np.random.default_rng(seed).normal(0, 1, grid.shape) * jitter


GRID = ms.VoxelGrid.regular((-0.12, -0.11, -0.34), (0.12, 0.11, -0.2), (0.0025, 0.0025, 0.01))

TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x, y, z become y, z, x

GEOMETRIES = {
    "77 GHz, four receivers, jittered": ("iwr1443", raster((0.3, 0.25), (40, 34), 0.0005), GRID),
    "77 GHz, monostatic, plane": ("mito-sim-77ghz", raster((0.3, 0.25), (44, 40), 0.0), GRID),
    "77 GHz, scattered positions": ("iwr1443", np.random.default_rng(2).uniform(
        [-0.15, -0.15, -0.05], [0.15, 0.15, 0.05], (1200, 3)), GRID),
    "24 GHz, two receivers": ("position2go", raster((0.4, 0.4), (40, 40), 0.001), GRID),
    "uneven grid": ("iwr1443", raster((0.3, 0.25), (40, 34), 0.0005), ms.VoxelGrid(
        x=np.sort(np.random.default_rng(3).uniform(-0.1, 0.1, 90)), y=GRID.y, z=[-0.3, -0.29, -0.25])),
    "one plane": ("iwr1443", raster((0.3, 0.25), (40, 34), 0.0005), ms.VoxelGrid(x=GRID.x, y=GRID.y, z=[-0.27])),
}  # fmt: skip


@pytest.fixture(autouse=True)
def eager(monkeypatch):
    """Problems of this size are factorised too."""
    monkeypatch.setattr(_plan, "_LEAST_PAIRS", 1e6)
    monkeypatch.setitem(_plan.COSTS, "cpu", _plan.COSTS["cpu"]._replace(top=0))


@cache
def capture_of(geometry):
    name, positions, _ = GEOMETRIES[geometry]
    return scan_of(ms.Radar.preset(name), positions)


@cache
def image_of(geometry):
    """Made once, by the first test that needs it."""
    return ms.form_image(capture_of(geometry), GEOMETRIES[geometry][2])


@pytest.fixture(params=GEOMETRIES)
def case(request):
    """A capture, its grid, and the image."""
    return capture_of(request.param), GEOMETRIES[request.param][2], image_of(request.param)


def exact_at(capture, grid, picks):
    frequencies = capture.radar.waveform.frequencies
    offset = capture.radar.path_offset
    return ms.image_at(
        capture.frames, capture.tx_positions, capture.rx_positions, frequencies, grid.points[picks], offset
    )


@pytest.mark.slow
def test_within_the_tolerance_of_exact_at_random_and_at_the_brightest_voxels(case):
    capture, grid, image = case
    assert image.metadata["history"][-1]["done_by"] == "factorised backprojection"
    assert len(image.metadata["history"][-1]["sub_apertures"]) >= 1
    brightest = np.argsort(image.magnitude.ravel())[-250:]
    for picks in (np.random.default_rng(4).choice(grid.size, 500, replace=False), brightest):
        assert relative(image.values.ravel()[picks], exact_at(capture, grid, picks)) < 0.005


def test_axes_may_come_in_any_order():
    """The same scene turned so that the aperture looks along x: the same image, turned."""
    geometry = "77 GHz, four receivers, jittered"
    capture, image = capture_of(geometry), image_of(geometry)
    radar = capture.radar
    array = ms.AntennaArray(
        tx_positions=radar.array.tx_positions @ TURN.T, rx_positions=radar.array.rx_positions @ TURN.T
    )
    turned = ms.Capture(
        radar=ms.Radar(name="turned", waveform=radar.waveform, array=array, path_offset=radar.path_offset),
        trajectory=ms.Trajectory(times=capture.trajectory.times, positions=capture.trajectory.positions @ TURN.T),
        frames=capture.frames,
    )
    other = ms.form_image(turned, ms.VoxelGrid(x=GRID.z, y=GRID.x, z=GRID.y))
    assert other.metadata["history"][-1]["done_by"] == "factorised backprojection"
    assert relative(other.values.transpose(1, 2, 0), image.values) < 0.005


@pytest.mark.parametrize("window", ["hann", ("taylor", None)])
def test_windows_go_through(window):
    geometry = "one plane"
    capture, grid = capture_of(geometry), GEOMETRIES[geometry][2]
    image = ms.form_image(capture, grid, window=window)
    assert image.metadata["history"][-1]["done_by"] == "factorised backprojection"
    direct = ms.form_image(capture, grid, window=window, method="backprojection")
    assert relative(image.values, direct.values) < 0.01


def test_bytes_do_not_depend_on_the_number_of_threads(case):
    capture, grid, image = case
    before = numba.get_num_threads()
    if before < 2:
        pytest.skip("one core: nothing to compare")
    many = image.values.tobytes()
    try:
        numba.set_num_threads(1)
        assert ms.form_image(capture, grid).values.tobytes() == many
    finally:
        numba.set_num_threads(before)


def test_a_capture_that_does_not_fit_at_once_is_imaged_in_parts(case, tmp_path, monkeypatch):
    capture, grid, whole = case
    ms.save(tmp_path / "c.h5", capture)
    monkeypatch.setattr(module, "_PROFILE_BYTES", 500_000)
    calls = []
    with ms.open_capture(tmp_path / "c.h5") as on_disk:
        parts = ms.form_image(on_disk, grid, progress=lambda done, total: calls.append((done, total)))
    assert relative(parts.values, whole.values) < 0.01
    assert len(calls) > 3
    assert calls[-1][0] == calls[-1][1] == len(capture.trajectory)
    assert all(a[0] <= b[0] for a, b in pairwise(calls))


def plan_of(capture, grid, tolerance=0.003):
    axes = (grid.x, grid.y, grid.z)
    return Planner(capture.tx_positions, capture.rx_positions, capture).plan(axes, tolerance)


def test_the_plan_follows_the_geometry_and_the_tolerance(case):
    capture, grid, _ = case
    plan = plan_of(capture, grid)
    assert plan is not None
    assert plan.gain > 1.2
    assert plan.error <= 0.003
    sizes = [level.size for level in plan.levels]
    assert sizes == sorted(sizes)
    counts = [len(level.axes[0]) for level in plan.levels]
    assert counts == sorted(counts)
    strict = plan_of(capture, grid, tolerance=1e-4)
    assert strict is None or strict.gain < plan.gain


def test_small_problems_are_done_directly():
    capture = scan_of(ms.Radar.preset("iwr1443"), np.zeros((1, 3)), reflectors=1)
    grid = ms.VoxelGrid(x=[0.0], y=[0.0], z=[-0.3, 0.0])
    image = ms.form_image(capture, grid)
    assert image.metadata["history"][-1]["done_by"] == "backprojection"
    assert relative(image.values, ms.form_image(capture, grid, method="exact").values) < 0.01
    # Many coincident positions have no aperture to factorise either.
    still = scan_of(ms.Radar.preset("iwr1443"), np.zeros((200, 3)), reflectors=1)
    assert plan_of(still, GRID) is None


def parts_of(capture, grid):
    axes = (grid.x, grid.y, grid.z)
    return Planner(capture.tx_positions, capture.rx_positions, capture).parts(axes)


@pytest.mark.parametrize("upwards", [True, False])
def test_deep_grids_are_imaged_in_parts(upwards, monkeypatch):
    """Of the nearest part the most points are needed; all of them together are the grid, and the image is right."""
    side = 1.0 if upwards else -1.0
    capture = scan_of(
        ms.Radar.preset("iwr1443"), raster((0.2, 0.2), (28, 28), 0.0005),
        box=((-0.1, -0.1, min(0.12 * side, 0.5 * side)), (0.1, 0.1, max(0.12 * side, 0.5 * side))),
    )  # fmt: skip
    grid = ms.VoxelGrid.regular(
        (-0.1, -0.1, min(0.12 * side, 0.5 * side)), (0.1, 0.1, max(0.12 * side, 0.5 * side)), (0.0025, 0.0025, 0.01)
    )
    parts = parts_of(capture, grid)
    assert len(parts) > 2
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(len(grid.z)))
    spans = [part.stop - part.start for part in parts]
    assert spans == sorted(spans, reverse=not upwards)  # the distance grows by the same factor
    made, factorise = [], module._factorise
    monkeypatch.setattr(module, "_factorise", lambda *args: made.append(args[5]) or factorise(*args))
    image = ms.form_image(capture, grid)
    assert [part.along for part in made[0]] == parts
    points = [np.prod([len(axis) for axis in part.plan.levels[0].axes]) for part in made[0]]
    assert points == sorted(points, reverse=upwards)
    picks = np.random.default_rng(6).choice(grid.size, 500, replace=False)
    assert relative(image.values.ravel()[picks], exact_at(capture, grid, picks)) < 0.005


UNEVEN = np.concatenate([np.linspace(-0.6, -0.58, 20), np.linspace(-0.2, -0.19, 20)])


@pytest.mark.parametrize("z", [np.linspace(-0.4, 0, 41), UNEVEN, -UNEVEN[::-1], np.linspace(-0.2, -0.101, 15), [0.0]])
def test_parts_are_all_of_the_grid_whatever_its_planes(z):
    """Planes in that of the antennas, or with a gap that no edge falls into; a grid too thin for parts."""
    capture = capture_of("77 GHz, monostatic, plane")
    parts = parts_of(capture, ms.VoxelGrid(x=GRID.x, y=GRID.y, z=z))
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(len(z)))
    assert min(part.stop - part.start for part in parts) > 0
    assert (len(parts) > 1) == (len(z) > 15)


def test_grids_that_are_flat_or_around_the_antennas_are_imaged_at_once():
    capture = capture_of("77 GHz, four receivers, jittered")
    for z in ([-0.27], np.linspace(-0.5, -0.4, 11), np.linspace(-0.2, 0.2, 41)):
        grid = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=z)
        assert parts_of(capture, grid) == [slice(0, len(z))]


def test_voxels_at_the_antennas_are_right_too():
    """There the field turns as fast as it can: the plan must see it, or leave the work to direct backprojection."""
    capture = scan_of(ms.Radar.preset("mito-sim-77ghz"), raster((0.1, 0.1), (20, 20), 0.0005))
    grid = ms.VoxelGrid.regular((-0.05, -0.05, -0.02), (0.05, 0.05, 0.02), (0.002, 0.002, 0.01))
    image = ms.form_image(capture, grid)
    picks = np.random.default_rng(5).choice(grid.size, 500, replace=False)
    assert relative(image.values.ravel()[picks], exact_at(capture, grid, picks)) < 0.005


@pytest.mark.parametrize("away", [0.3, 1e4])
@pytest.mark.parametrize(
    ("depth", "across"), [(1, (12, 70)), (5, (12, 20)), (22, (12, 20)), (22, (3, 3)), (130, (9, 11)), (300, (9, 9))]
)
def test_merging_is_its_formula_whatever_the_shape(depth, across, away):
    """Against float64; 150 rows by 1 lane, 1 row by 300, and axes that stay as they are."""
    rng = np.random.default_rng(depth)
    carrier, fine = 263.0, [np.linspace(-0.1, 0.1, n) for n in (150 if depth < 5 else 21, across[1], depth)]
    coarse = [coarse_axis(fine[0], 12, 2), fine[1] if across[0] == across[1] else coarse_axis(fine[1], across[0], 1)]
    pairs = [axis_weights(a, b, 0.5) for a, b in zip(coarse, fine, strict=False)]
    fields = rng.normal(size=(2, 3, 12, across[0], depth)).astype(np.float32)
    ends = rng.uniform([-0.05, -0.05, away], [0.05, 0.05, away + 0.1], (5, 3))
    rows = antenna_rows(ends, 0.0, 0.0, 0.0)
    children, starts = np.array([2, 0, 1]), np.array([0, 2, 3])
    for last in (False, True):
        out = rng.normal(size=(2, 1 if last else 2, *map(len, fine))).astype(np.float32)
        expected = (out[0] + 1j * out[1]) * last
        for s in range(len(out[0])):
            for c in children if last else children[starts[s] : starts[s + 1]]:
                wide = fields[0, c] + 1j * fields[1, c].astype(complex)
                for axis, pair in enumerate(pairs):
                    if pair is not None:
                        tapped = np.take(wide, pair[0][:, None] + np.arange(8), axis)
                        tapped = np.moveaxis(tapped, (axis, axis + 1), (0, 1))
                        wide = np.moveaxis(np.einsum("nt,nt...->n...", pair[1], tapped), 0, axis)
                grid = np.stack(np.meshgrid(*fine, indexing="ij"), -1)
                beyond = [np.linalg.norm(grid - e, axis=-1) - np.linalg.norm(e) for e in (ends[c], ends[3 + s])]
                expected[s] += wide * np.exp(4j * np.pi * carrier * (beyond[0] - (not last) * beyond[1]))
        ours = np.array([0, 3]) if last else starts
        merge(
            fields, children, ours, rows[:3], rows[3:], not last, carrier, *pairs, *(np.float32(a) for a in fine), out
        )
        assert relative(out[0] + 1j * out[1], expected) < 3e-4
