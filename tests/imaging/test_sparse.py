"""Sparse reconstruction: a pair of adjoint operators, FISTA's optimum, images from few rows, and what is refused."""

import dataclasses

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here
from helpers.oracles import point_frames, relative
from millisight.core.errors import InputError, UnknownNameError
from millisight.imaging import _sparse
from millisight.imaging._sparse import Operator, shrunk, solutions, without_gaps

RADAR = ms.Radar(
    name="test",
    waveform=ms.Waveform.stepped(76e9, 3e9 / 12, 12),
    array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0.004, 0, 0], [0.006, 0.001, 0]]),
    path_offset=0.1,
)
HEIGHT = 0.2
GRID = ms.VoxelGrid.regular((-0.024, -0.024, 0), (0.024, 0.024, 0.02), (0.002, 0.002, 0.02))
POINTS = np.array([[0.0, 0.0, 0.0], [0.012, -0.008, 0.0], [-0.016, 0.01, 0.0], [0.007, 0.015, 0.0]])


def raster(spacing=0.0016, size=0.08, step=0.0016):
    """Rows along y at x, back and forth, with half a millimetre of jitter."""
    x, y = (np.arange(-size / 2, size / 2 + 1e-9, s) for s in (spacing, step))
    rows = [np.stack([np.full(len(y), a), y[:: 1 - 2 * (i % 2)], np.full(len(y), HEIGHT)], 1) for i, a in enumerate(x)]
    positions = np.concatenate(rows)
    positions += np.random.default_rng(0).normal(0, 2e-4, positions.shape)
    return ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)


def seen_from(path, points=POINTS, noise=0.02):
    tx, rx = path.placed(RADAR.array.tx_positions), path.placed(RADAR.array.rx_positions)
    frames = point_frames(points, np.ones(len(points)), tx, rx, RADAR.waveform.frequencies, RADAR.path_offset)
    rng = np.random.default_rng(1)
    frames = frames + noise * (rng.normal(size=frames.shape) + 1j * rng.normal(size=frames.shape))
    return ms.Capture(radar=RADAR, trajectory=path, frames=frames)


@pytest.fixture(scope="module")
def few():
    """A sixth of the rows that half a wavelength asks for."""
    return seen_from(raster(spacing=0.0112))


def random_pair(model, rng):
    values = rng.normal(size=model.voxels) + 1j * rng.normal(size=model.voxels)
    frames = rng.normal(size=model.shape) + 1j * rng.normal(size=model.shape)
    return values.astype(np.complex64), frames.astype(np.complex64)


def test_the_unit_of_frames_does_not_matter(few):
    tiny = dataclasses.replace(few, frames=few.frames * np.float32(1e-30))
    images = [_sparse.sparse(one, GRID, iterations=5)[0] for one in (few, tiny)]
    assert relative(images[1] * np.float32(1e30), images[0]) < 1e-4


@pytest.mark.parametrize("block", [256_000_000, 1_000_000])
def test_the_operators_are_adjoint(few, block, monkeypatch):
    monkeypatch.setattr(_sparse, "_BLOCK_BYTES", block)
    model = Operator(few, GRID)
    values, frames = random_pair(model, np.random.default_rng(3))
    left, right = np.vdot(frames, model.forward(values)), np.vdot(model.adjoint(frames), values)
    assert abs(left) > 0.1 * np.linalg.norm(values)
    assert left == pytest.approx(right, rel=1e-4)


def test_the_operators_are_the_phase_law(few):
    """Forward: frames of point reflectors on voxels. Adjoint: the exact image."""
    model = Operator(few, GRID, oversampling=16)
    picks = [5, 300, 900]
    values = np.zeros(GRID.size, np.complex64)
    values[picks] = [1, 2j, -1]
    frames = point_frames(
        GRID.points[picks], values[picks], few.tx_positions, few.rx_positions, RADAR.waveform.frequencies,
        RADAR.path_offset,
    )  # fmt: skip
    assert relative(model.forward(values), model.scaled(frames)) < 2e-3
    exact = ms.form_image(few, GRID, method="exact").values
    assert relative(model.adjoint(model.scaled(few.frames_of(slice(None)))), exact) < 2e-3


def test_the_norm_bounds_the_operator(few):
    model = Operator(few, GRID)
    size, rng = model.norm(), np.random.default_rng(4)
    for _ in range(3):
        values, _ = random_pair(model, rng)
        for _ in range(12):  # towards the largest eigenvalue
            values = values / np.linalg.norm(values)
            grown = float(np.linalg.norm(values := model.adjoint(model.forward(values))))
        assert 0.7 * size < grown <= size


@pytest.mark.slow
def test_it_converges_to_the_optimum(few):
    """At the optimum |A* (s - A q)| is the weight where q is not zero, and no more than that elsewhere."""
    model = Operator(few, GRID)
    frames = model.scaled(few.frames_of(slice(None)))
    image = model.adjoint(frames)
    threshold = 0.05 * float(np.abs(image).max())
    costs = []
    for values in solutions(model, image, threshold, model.norm(), 300):
        costs.append(0.5 * np.linalg.norm(frames - model.forward(values)) ** 2 + threshold * np.abs(values).sum())
    assert len(costs) == 300
    assert costs[29] - costs[-1] < 0.1 * (costs[0] - costs[-1])
    assert costs[-1] < min(costs) * (1 + 1e-5)
    slope = model.adjoint(frames - model.forward(values))
    some = values != 0
    assert 3 <= some.sum() < 0.1 * GRID.size
    assert np.abs(slope).max() <= 1.02 * threshold
    assert np.abs(slope[some]) == pytest.approx(np.full(some.sum(), threshold), rel=0.02)
    # It turns like the voxel: the slope of a magnitude.
    assert np.abs(np.angle(slope[some] / values[some])).max() < 0.02


def test_shrinking_keeps_phases():
    values = np.array([3 + 4j, 0.3j, 0, -2], np.complex64)
    np.testing.assert_allclose(shrunk(values, 1.0), [(3 + 4j) * 0.8, 0, 0, -1], rtol=1e-6)


def psnr(values, reference):
    """Of magnitudes, over the largest of the reference [dB]."""
    error = np.mean((np.abs(values) - np.abs(reference)) ** 2)
    return 10 * np.log10(np.abs(reference).max() ** 2 / error)


@pytest.mark.slow
def test_half_and_a_third_of_the_rows_make_the_image_of_all():
    """Rows 4.8 mm apart are enough here: without every second one ghosts come, which q takes away again."""
    whole = ms.form_image(seen_from(raster(0.0048), noise=0), GRID, method="exact").values
    assert psnr(ms.form_image(seen_from(raster(0.0048)), GRID).values, whole) > 40
    for spacing, gained in ((0.0096, 8), (0.0144, 8)):
        capture = seen_from(raster(spacing))
        plain = psnr(ms.form_image(capture, GRID, method="exact").values, whole)
        image = ms.form_image(capture, GRID, method="sparse")
        assert plain < 30
        assert psnr(image.values, whole) > plain + gained
        # A unit reflector on a voxel has the value 1, as in every image.
        assert np.abs(image.values).max() == pytest.approx(1, abs=0.1)


def test_the_metadata_say_how():
    capture = seen_from(raster(0.0112))
    calls = []
    image = ms.form_image(capture, GRID, method="sparse", progress=lambda done, total: calls.append((done, total)))
    told = image.metadata["history"][-1]
    assert told["method"] == "sparse"
    assert told["oversampling"] == 8
    assert told["solver"]["iterations"] == _sparse.ITERATIONS
    # What it leaves unexplained: the noise, 0.02 sqrt(2) beside four reflectors of 1, and a reflector between voxels.
    assert 0.9 < told["solver"]["misfit"] / (0.02 * np.sqrt(2) / 2) < 4
    assert calls == sorted(calls)
    assert calls[-1][0] == calls[-1][1] == max(done for done, _ in calls)
    assert len(calls) >= _sparse.ITERATIONS


@pytest.mark.slow
def test_oversampling_is_used():
    capture = seen_from(raster(0.0112))
    coarse, fine = (ms.form_image(capture, GRID, method="sparse", oversampling=n) for n in (2, 16))
    assert coarse.metadata["history"][-1]["oversampling"] == 2
    assert 1e-3 < relative(coarse.values, fine.values) < 0.2


def test_rows_are_put_between():
    path = raster(0.008)
    dense = without_gaps(path, 0.0022)  # four rows instead of one: 2 mm is nearest
    x = np.round(dense.positions[:, 0] / 0.002).astype(int)
    assert len(np.unique(x)) == 41
    assert np.bincount(x - x.min()).min() >= 40
    np.testing.assert_array_equal(dense.positions[: len(path)], path.positions)
    assert without_gaps(path, 0.01) is not path
    assert len(without_gaps(path, 0.01)) == len(path)
    line = ms.Trajectory(times=[0, 1, 2], positions=[[0, 0, 0], [0, 1, 0], [0, 2, 0]])
    assert without_gaps(line, 0.1) is line


def test_a_path_without_rows_is_imaged_as_it_is():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = 0.05 * np.stack([np.cos(angle), np.sin(angle), np.full(200, HEIGHT / 0.05)], axis=1)
    image = ms.form_image(seen_from(ms.Trajectory(times=angle, positions=circle)), GRID, method="sparse")
    away = np.linalg.norm(POINTS - GRID.points[np.abs(image.values).argmax()], axis=1)
    assert away.min() < 0.0025


def test_an_image_of_nothing_is_nothing(few):
    nothing = dataclasses.replace(few, frames=0 * few.frames)
    image = ms.form_image(nothing, GRID, method="sparse")
    assert not image.values.any()
    assert image.metadata["history"][-1]["solver"]["iterations"] == 0


def test_what_it_cannot_do_is_refused(few):
    for settings, message in (
        ({"window": "hann"}, "takes no window"),
        ({"window": (None, "taylor")}, "takes no window"),
        ({"tolerance": 0.01}, "has no tolerance"),
        ({"device": "cuda"}, "CPU"),
    ):
        with pytest.raises(InputError, match=message):
            ms.form_image(few, GRID, method="sparse", **settings)
    with pytest.raises(UnknownNameError, match="sparce"):
        ms.form_image(few, GRID, method="sparce")
    placed = dataclasses.replace(few, tx_points=few.tx_positions, rx_points=few.rx_positions)
    with pytest.raises(InputError, match="tx_points"):
        ms.form_image(placed, GRID, method="sparse")
    away = ms.VoxelGrid(x=GRID.x + 2000, y=GRID.y, z=GRID.z)
    with pytest.raises(InputError, match=r"float32.*km"):
        ms.form_image(few, away, method="sparse")
    for settings in ({"weight": 0}, {"weight": -1}, {"iterations": 0}, {"iterations": 1.5}):
        with pytest.raises(InputError, match=next(iter(settings))):
            _sparse.sparse(few, GRID, **settings)


@pytest.mark.slow
def test_the_command_line(few, tmp_path):
    ms.save(tmp_path / "few.h5", few)
    box = "--grid=-24mm:24mm:2mm,-24mm:24mm:2mm,0mm:20mm:20mm"
    ask = ("image", tmp_path / "few.h5", box, "--method", "sparse", "-o", tmp_path / "i.h5")
    code, out, err, _ = run_here(*ask, "--plot", tmp_path / "i.png")
    assert code == 0, err
    assert "image by sparse" in err
    assert "peak" in out
    image = ms.load(tmp_path / "i.h5")
    np.testing.assert_array_equal(image.values, ms.form_image(few, image.grid, method="sparse").values)
    assert (tmp_path / "i.png").stat().st_size > 1000
    code, _, _, error = run_here(*ask, "--window", "hann")
    assert code == 1
    assert "takes no window" in error
