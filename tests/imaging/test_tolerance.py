"""Every image keeps its tolerance: geometries drawn at random, measured captures, far radars, and what is asked for.

50 geometries by default. All of 10 000, with the worst of them: MILLISIGHT_GEOMETRIES=10000 python -m pytest
tests/imaging/test_tolerance.py -k drawn -s
"""

import itertools
import os
import tracemalloc
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import C, point_frames, relative, shared
from helpers.random_geometries import SCANS, draw
from millisight.calibration import read_capture
from millisight.core.errors import InputError
from millisight.imaging import _plan
from millisight.imaging._check import Check
from millisight.imaging._kernels import backproject
from millisight.imaging._lengths import boxes, grid_in
from millisight.imaging._near import evenly, near_first

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "captures"
TOLERANCE = 0.005  # the default
COUNT = int(os.environ.get("MILLISIGHT_GEOMETRIES", "50"))
PART = 25  # geometries of one test
METHODS = ("fast", "backprojection")


def step_of(image):
    return image.metadata["history"][-1]


def errors(capture, grid, *images, seed=0, count=300):
    """Relative L2 errors of every image against `image_at`, at random voxels and at its brightest."""
    values = [image.values.ravel() for image in images]
    random = np.random.default_rng(seed).integers(0, grid.size, count)
    picks = [(random, np.argsort(np.abs(v))[-count // 3 :]) for v in values]
    # Once for all images: their brightest voxels are mostly the same.
    wanted = np.unique(np.concatenate([p for both in picks for p in both]))
    truth = ms.image_at(
        capture.frames_of(slice(None)), capture.tx_positions, capture.rx_positions,
        capture.radar.waveform.frequencies, grid.points[wanted], capture.radar.path_offset,
    )  # fmt: skip
    parts = [[(v[p], truth[np.searchsorted(wanted, p)]) for p in both] for v, both in zip(values, picks, strict=True)]
    return [[relative(made, part) for made, part in pairs if np.any(part)] for pairs in parts]


def plan_of(problem):
    origin = problem.grid.bounds.mean(axis=0)
    axes = tuple(a - o for a, o in zip((problem.grid.x, problem.grid.y, problem.grid.z), origin, strict=True))
    tx, rx = problem.capture.tx_positions - origin, problem.capture.rx_positions - origin
    return _plan.Planner(tx, rx, problem.capture).plan(axes, 0.003)


@pytest.fixture
def eager(monkeypatch):
    """Small problems are factorised too, wherever that takes fewer operations."""
    monkeypatch.setattr(_plan, "_LEAST_PAIRS", 0)
    monkeypatch.setitem(_plan.COSTS, "cpu", _plan.COSTS["cpu"]._replace(top=0))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, COUNT, PART))
def test_geometries_drawn_at_random(first, eager):
    """`fast` and `backprojection` keep the tolerance, at random voxels and at the brightest, and say so."""
    found, factorised = [], 0
    for seed in range(first, min(first + PART, COUNT)):
        problem = draw(seed)
        images = [ms.form_image(problem.capture, problem.grid, method=method) for method in METHODS]
        made = errors(problem.capture, problem.grid, *images, seed=seed)
        for method, image, its in zip(METHODS, images, made, strict=True):
            told = step_of(image)
            factorised += told.get("done_by") == "factorised backprojection"
            found.append((max(its, default=0.0), told["error"], f"{method}, {problem.words}"))
    found.sort(reverse=True)
    print("\n" + "\n".join(f"{worst:.3%}, stated {stated:.3%}: {words}" for worst, stated, words in found[:2]))  # noqa: T201
    assert max(stated for _, stated, _ in found) <= TOLERANCE
    assert [line for line in found if line[0] > TOLERANCE] == []
    assert factorised >= PART // 4


SEEDS = (494, 612, 1009, 1031, 1512, 1998, 2182, 2861, 2873, 3932, 3980, 5150, 6069, 6791, 7879, 7971)


@pytest.mark.parametrize("seed", SEEDS)
def test_images_that_erred_by_more_than_they_stated(seed, eager):
    """Of most, the channels cancel: at most voxels, or all over a grid within one resolution cell. 16 poses do not show
    it, and in 5150 it takes a second plan. 494 errs at the ends of an axis; 1009 passes through its grid, and errs next
    to its antennas. In 1031, the axes of smaller sub-apertures ended where those of larger ones went on."""
    problem = draw(seed)
    images = [ms.form_image(problem.capture, problem.grid, method=method) for method in METHODS]
    for image, made in zip(images, errors(problem.capture, problem.grid, *images, seed=seed), strict=True):
        stated = step_of(image)["error"]
        assert stated <= TOLERANCE
        assert len(made) == 2
        assert max(made) <= TOLERANCE
        assert max(made) <= 1.5 * stated


@pytest.mark.slow
def test_nothing_is_extrapolated_from_axes_of_smaller_sub_apertures(eager):
    """Their fields are wanted where the axes of larger ones lie, which reach beyond the grid: at most a step of theirs
    beyond their own, the outermost point of all."""
    seen = 0
    for seed in (1031, 109, *range(9, 200, 10)):
        plan = plan_of(draw(seed))
        for small, large in itertools.pairwise(plan.levels if plan else ()):
            for axis, wanted in zip(small.axes, large.axes, strict=True):
                beyond = max(axis[0] - wanted[0], wanted[-1] - axis[-1])
                assert beyond <= 1.01 * (axis[1] - axis[0])
                seen += not np.array_equal(axis, wanted)
    assert seen > 20


def test_samples_near_the_antennas_stand_for_all():
    """Weighted means over the samples are those over the pool, whether what is averaged is near or everywhere."""
    for pool, count in ((2048, 128), (1024, 64), (256, 16), (100, 128), (2, 2)):
        ranks, weights = near_first(pool, count)
        assert len(ranks) == min(pool, count)
        assert weights.sum() == pytest.approx(1)
        assert ranks.min() >= 0
        assert ranks.max() < pool
        assert (ranks / pool) @ weights == pytest.approx((pool - 1) / 2 / pool, abs=0.02)
    ranks, weights = near_first(2048, 128)
    assert len(np.unique(ranks)) == 128
    assert (ranks < 128).sum() == 32
    assert (ranks < 128) @ weights == pytest.approx(1 / 16)


def test_samples_of_groups_stand_for_all():
    """Of a small group all are taken, of an empty one none."""
    for sizes in ((100, 300, 1600), (7, 0, 1993), (0, 2000, 0)):
        group = np.repeat(np.arange(3), sizes)
        picks, weights = evenly([(group == number, count) for number, count in enumerate((48, 48, 144))])
        assert len(np.unique(picks)) == len(picks)
        assert np.bincount(group[picks], weights, minlength=3) == pytest.approx(np.divide(sizes, 2000))
        assert np.bincount(group[picks], minlength=3).tolist() == np.minimum(sizes, (48, 48, 144)).tolist()


def test_a_tenth_of_the_check_is_at_the_ends_of_axes():
    """Of axes over which fields are interpolated: not of z, which has three points."""
    axes = np.linspace(-1, 1, 40), np.linspace(-1, 1, 50), np.linspace(0, 0.1, 3)
    ends = np.array([[[0.0, 0.0, 1.0]]])
    check = Check(axes, ends, ends, 4)
    x, y, _ = np.unravel_index(check.random, check.shape)
    outer = (x % 39 == 0) | (y % 49 == 0)
    assert len(outer) == 240
    assert outer.sum() >= 48
    share = 1 - 38 * 48 / 2000
    assert outer @ check.weights[:240] / 240 == pytest.approx(share, abs=0.02)


@pytest.mark.slow
def test_every_kind_of_scan_is_factorised_somewhere(eager):
    kinds = set()
    for seed in range(120):
        problem = draw(seed)
        if problem.capture.radar.name not in kinds and plan_of(problem) is not None:
            kinds.add(problem.capture.radar.name)
    assert kinds == set(SCANS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "file", "box"),
    [
        ("letter_r", "letter_r_22ghz.npy", None),
        ("foam", "foam_22_26ghz.npy", ((0.15, 0.16, -0.12), (0.27, 0.285, -0.09), (0.0015, 0.0015, 0.01))),
    ],
)
def test_measured_captures_keep_the_tolerance(name, file, box):
    data = shared("captures", file).parent
    capture = read_capture(EXAMPLES / f"{name}.toml", data=data)
    grid = ms.VoxelGrid.regular(*box) if box else ms.VoxelGrid.regular(**capture.metadata["image_grid"])
    images = [ms.form_image(capture, grid, method=method) for method in METHODS]
    for image, made in zip(images, errors(capture, grid, *images), strict=True):
        assert step_of(image)["error"] <= TOLERANCE
        assert max(made) < TOLERANCE


def far_capture(distance, frequency=77e9):
    """A radar of 2 x 2 antennas on a way of a hundredth of its distance, and reflectors of 1 m around the origin."""
    rng = np.random.default_rng(5)
    waveform = ms.Waveform.stepped(frequency, 1e9 / 32, 32)
    array = ms.AntennaArray(tx_positions=rng.normal(0, 0.01, (2, 3)), rx_positions=rng.normal(0, 0.01, (2, 3)))
    radar = ms.Radar(name="far", waveform=waveform, array=array, path_offset=-2 * distance)
    positions = np.zeros((200, 3))
    positions[:, 0], positions[:, 2] = np.linspace(-0.005, 0.005, 200) * distance, distance
    trajectory = ms.Trajectory(times=np.arange(200.0), positions=positions)
    points, amplitudes = rng.uniform(-0.4, 0.4, (20, 3)), rng.normal(size=20)
    tx, rx = trajectory.placed(array.tx_positions), trajectory.placed(array.rx_positions)
    frames = point_frames(points, amplitudes, tx, rx, waveform.frequencies, radar.path_offset)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames)


@pytest.mark.parametrize("distance", [0.2, 30.0, 1e3, 1e4, 3e5])
def test_distance_costs_no_phase(distance, eager):
    capture = far_capture(distance)
    grid = ms.VoxelGrid.regular((-0.5, -0.05, -0.3), (0.5, 0.05, 0.3), (0.01, 0.05, 0.02))
    images = [ms.form_image(capture, grid, method=method) for method in METHODS]
    for made in errors(capture, grid, *images):
        assert max(made) < TOLERANCE
    if distance > 1:
        assert step_of(images[0])["done_by"] == "factorised backprojection"


@pytest.mark.slow
def test_a_grid_of_many_waves_is_done_in_boxes(eager):
    """100 m and 26 000 waves: voxels' own coordinates would lose their phase."""
    capture = far_capture(1e3)
    grid = ms.VoxelGrid(x=np.linspace(-50, 50, 41), y=np.linspace(-0.3, 0.3, 9), z=[-20.0, 20.0])
    parts = boxes(grid, 77e9 / C)
    assert len(parts) > 4
    counted = np.zeros(grid.shape, int)
    for part in parts:
        counted[part] += 1
        assert np.linalg.norm(np.ptp(grid_in(grid, part).bounds, axis=0)) / 2 * 77e9 / C <= 2000
    assert (counted == 1).all()
    calls, images = [], []
    for method in METHODS:
        images.append(
            ms.form_image(capture, grid, method=method, progress=lambda done, total: calls.append(done / total))
        )
        assert calls[-1] == 1
        assert calls == sorted(calls)
        calls.clear()
    for made in errors(capture, grid, *images):
        assert max(made) < TOLERANCE


def test_antennas_kilometres_apart_take_no_more_memory_than_the_grid():
    """What a channel's range profile holds follows from the grid, not from how far apart the antennas are."""
    from millisight.imaging import _kernels as kernels
    from millisight.imaging._backprojection import range_compression

    capture = far_capture(1e4)
    rng = np.random.default_rng(0)
    tx, rx = rng.uniform(-1e4, 1e4, (200, 2, 3)), rng.uniform(-1e4, 1e4, (200, 2, 3))
    box = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    compression = range_compression(capture, tx, rx, box, 8, None, kernels)
    assert compression.steering.shape[1] < 8 * 2 * 2 * np.sqrt(12) * 1e9 / C + 10


@pytest.mark.parametrize("far", [1e5, 1e7, 1e9])
def test_a_stray_pose_is_refused_before_it_takes_memory(far):
    """One at 100 km took 6.5 GB, one at 10 000 km asked for 204 GiB."""
    from millisight.imaging import path_bounds, range_steering

    capture, box = far_capture(0.2), np.array([[-0.5, -0.05, -0.3], [0.5, 0.05, 0.3]])
    stray = capture.tx_positions.copy()
    stray[7] += far
    assert range_steering(capture, *path_bounds(capture.tx_positions, capture.rx_positions, box), 8, None)[0].any()
    with pytest.raises(InputError, match=r"paths from antenna to grid and back .* remove positions that are far"):
        range_steering(capture, *path_bounds(stray, stray, box), 8, None)


def many_receivers():
    """16 poses of 1 024 receivers and 4 samples, half a megabyte, of a carrier so low that 150 m are one box."""
    rx = np.zeros((1024, 3))
    rx[:, 0] = np.linspace(-0.15, 0.15, 1024)
    waveform = ms.Waveform.stepped(1e9, 0.25e9, 4)
    radar = ms.Radar(name="wide", waveform=waveform, array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=rx))
    positions = np.zeros((16, 3))
    positions[:, 1] = np.linspace(-0.15, 0.15, 16)
    rng = np.random.default_rng(0)
    frames = rng.normal(size=(16, 1, 1024, 4)) + 1j * rng.normal(size=(16, 1, 1024, 4))
    return ms.Capture(
        radar=radar,
        trajectory=ms.Trajectory(times=np.arange(16.0), positions=positions),
        frames=frames.astype(np.complex64),
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fast", "backprojection"])
def test_a_thousand_receivers_take_no_more_memory_than_a_few(method):
    """The range profiles of all poses that measure their error were made at once: 1.4 GB for half a megabyte."""
    capture = many_receivers()
    grid = ms.VoxelGrid(x=[-0.05, 0.05], y=[-0.05, 0.05], z=[0.3, 150.0])
    tracemalloc.start()
    try:
        image = ms.form_image(capture, grid, method=method)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 2e8 < most < 8e8
    assert relative(image.values, ms.form_image(capture, grid, method="exact").values) < 0.005


def test_profiles_of_a_pose_that_take_more_than_a_gigabyte_are_refused():
    from millisight.imaging import path_bounds, range_steering

    capture = many_receivers()
    box = np.array([[-0.05, -0.05, 0.3], [0.05, 0.05, 4000.0]])
    bounds = path_bounds(capture.tx_positions, capture.rx_positions, box)
    with pytest.raises(InputError, match=r"are 0\.6 to 8000 m long; expected a span of 4\.\d+e\+03 m at most"):
        range_steering(capture, *bounds, 8, None)


def test_nothing_beyond_a_profile_is_read():
    """Voxels far out of what the profiles cover, and further than an entry's number can say: finite, from inside."""
    rng = np.random.default_rng(1)
    profiles = np.ones((3, 1, 1, 5), np.complex64)
    antennas = rng.normal(size=(3, 1, 3))
    places = np.array([0.0, 1.0, -1.0, 1e3, 1e7, 1e15], np.float32)
    sums = np.zeros((2, len(places)), np.float32)
    for nearest in (0.0, 1e6):
        backproject(profiles, nearest, 1e3, 1.0, antennas, antennas, places, places, places, *sums)
    # Every entry is 1: so is whatever lies between two of them.
    assert np.abs(sums).max() <= 2 * 3 * 1.001


@cache
def usual_oversampling(seed, method):
    """At the default tolerance."""
    problem = draw(seed)
    return step_of(ms.form_image(problem.capture, problem.grid, method=method))["oversampling"]


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.001, 0.02])
def test_the_tolerance_is_kept_and_pays(tolerance, eager):
    seeds = (8, 51, 69)
    for seed in seeds:
        problem = draw(seed)
        images = [ms.form_image(problem.capture, problem.grid, method=m, tolerance=tolerance) for m in METHODS]
        made = errors(problem.capture, problem.grid, *images, seed=seed)
        for method, image, its in zip(METHODS, images, made, strict=True):
            told = step_of(image)
            assert told["tolerance"] == tolerance
            assert told["error"] <= tolerance
            assert max(its) < tolerance
            assert (told["oversampling"] > usual_oversampling(seed, method)) == (tolerance < TOLERANCE)


@pytest.mark.slow
def test_the_error_that_is_stated_is_the_one_that_is_made():
    problem = draw(8)
    for oversampling in (3, 8):
        image = ms.form_image(problem.capture, problem.grid, method="backprojection", oversampling=oversampling)
        assert step_of(image)["oversampling"] == oversampling
        made = max(errors(problem.capture, problem.grid, image, count=1000)[0])
        assert 0.5 < step_of(image)["error"] / made < 2


def test_tolerances_that_cannot_be():
    problem = draw(0)
    for tolerance in (0, -1, 1e-5, 0.5, float("nan"), "tight"):
        with pytest.raises(InputError, match="tolerance"):
            ms.form_image(problem.capture, problem.grid, tolerance=tolerance)
    with pytest.raises(InputError, match=r'"exact" has no tolerance'):
        ms.form_image(problem.capture, problem.grid, method="exact", tolerance=0.01)
    with pytest.raises(InputError, match="oversampling"):
        ms.form_image(problem.capture, problem.grid, tolerance=0.01, oversampling=8)


@pytest.mark.slow
def test_an_image_of_nothing_has_no_error():
    problem = draw(8)
    nothing = ms.Capture(
        radar=problem.capture.radar, trajectory=problem.capture.trajectory, frames=0 * problem.capture.frames
    )
    image = ms.form_image(nothing, problem.grid)
    assert not image.values.any()
    assert step_of(image)["error"] == 0
