"""Autofocus: rows and smooth errors are recovered, a path that is right stays, and what cannot be told is said."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import millisight as ms
from helpers.commands import refused, run_inside
from helpers.oracles import point_frames
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Layers
from millisight.imaging._autofocus_model import Pieces, View
from millisight.imaging._autofocus_search import Subject
from millisight.imaging._path_rows import rows_of_path
from millisight.imaging._row_offsets import row_offsets

GRID = ms.VoxelGrid.regular((-0.06, -0.06, -0.02), (0.06, 0.06, 0.02), (0.002, 0.002, 0.005))
LINES = 61


def radar(samples=16):
    preset = ms.Radar.preset("mito-sim-77ghz")
    waveform = ms.Waveform.stepped(preset.waveform.start_frequency, preset.waveform.bandwidth / samples, samples)
    return ms.Radar(name="77 GHz, few samples", waveform=waveform, array=preset.array)


def plan(size=(0.12, 0.12), step=0.002):
    return ms.Trajectory.raster(size=size, step=step, center=(0, 0, 0.2), serpentine=True)


def heard(path, count=12, seed=3):
    """What the radar hears of points along a path, in noise 20 dB under the echoes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-0.05, -0.05, -0.01), (0.05, 0.05, 0.01), (count, 3))
    setup = radar()
    tx, rx = path.placed(setup.array.tx_positions), path.placed(setup.array.rx_positions)
    frames = point_frames(points, rng.uniform(0.5, 1, count), tx, rx, setup.waveform.frequencies)
    noise = rng.normal(size=(*frames.shape, 2)).view(complex)[..., 0] * np.sqrt((abs(frames) ** 2).mean() / 200)
    return ms.Capture(radar=setup, trajectory=path, frames=(frames + noise).astype(np.complex64))


def errors(path, seed, frames=2.0, wander=1e-3):
    """(P, 3) offsets of rows and a smooth wander [m]."""
    rng = np.random.default_rng(seed)
    way = np.arange(len(path)) * 0.002
    waves = rng.normal(size=(3, 20)) / 0.5
    moved = wander / np.sqrt(30) * np.cos(way[:, None, None] * waves + rng.uniform(0, 7, (3, 20))).sum(axis=2)
    for row in rows_of_path(path):
        moved[row.poses] += np.clip(rng.normal(0, frames), -2 * frames, 2 * frames) * row.step
    return moved


def astray(truth, moved):
    """The capture with the path that its owner believes in."""
    path = truth.trajectory
    return replace(truth, trajectory=replace(path, positions=path.positions - moved))


def distance_error(truth, left):
    """rms of the distance to the scene's middle that is wrong, less what moves or stretches the whole [m]."""
    path = truth.trajectory.positions
    sight = path / np.linalg.norm(path, axis=1, keepdims=True)
    centred = np.concatenate([np.ones((len(path), 1)), path - path.mean(axis=0)], axis=1)
    terms = np.concatenate([(sight[:, :, None] * centred[:, None]).reshape(len(path), -1), np.ones((len(path), 1))], 1)
    along = (left * sight).sum(axis=1)
    return np.sqrt(np.mean((along - terms @ np.linalg.lstsq(terms, along, rcond=None)[0]) ** 2))


def peak(capture):
    """The largest magnitude, between the voxels as well."""
    brightest = GRID.points[ms.form_image(capture, GRID).magnitude.argmax()]
    steps = np.array([0.002, 0.002, 0.005])
    around = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 7)]), axis=-1).reshape(-1, 3) * steps
    values = ms.image_at(
        capture.frames,
        capture.tx_positions,
        capture.rx_positions,
        capture.radar.waveform.frequencies,
        brightest + around,
    )
    return abs(values).max()


@pytest.fixture(scope="module")
def right():
    return heard(plan())


@pytest.fixture(scope="module")
def right_peak(right):
    return peak(right)


def test_the_gradient_is_that_of_finite_differences():
    """In float64, every component of a few pieces, to 1e-5 of the largest."""
    path = plan(size=(0.01, 0.03))
    capture = heard(path)
    pieces = Pieces.of(path, rows_of_path(path), capture.radar.waveform.wavelength)
    points = np.random.default_rng(0).uniform(-0.03, 0.03, (50, 3))
    view = View.of(capture, pieces, np.zeros((1, 1, 16), np.complex64), points)
    exact = View(*(np.asarray(value, dtype=float) for value in view[:4]), np.float64(view.per_metre))
    moves = np.random.default_rng(1).normal(0, 3e-4, (len(view.places), 3))
    _, gradient = exact.sharpness(moves)
    assert gradient.size >= 18
    assert abs(gradient).max() > 0
    step = 1e-6
    for index in np.ndindex(moves.shape):
        nudge = np.zeros_like(moves)
        nudge[index] = step
        numeric = (exact.sharpness(moves + nudge)[0] - exact.sharpness(moves - nudge)[0]) / (2 * step)
        assert gradient[index] == pytest.approx(numeric, abs=1e-5 * abs(gradient).max())


@pytest.mark.slow
def test_rows_and_wander_are_recovered_and_the_image_with_them(right, right_peak):
    seed = 0
    moved = errors(right.trajectory, seed)
    bad = astray(right, moved)
    wavelength = right.radar.waveform.wavelength
    assert distance_error(right, moved) > wavelength / 5
    assert peak(bad) < 0.6 * right_peak
    seen = []
    found = ms.autofocus(bad, GRID, rng=seed, progress=lambda done, total: seen.append((done, total)))
    assert found.applied == ("rows", "path")
    assert distance_error(right, found.displacements - moved) < wavelength / 18
    assert peak(found.capture) > 0.95 * right_peak
    assert found.uncertainty < wavelength / 15
    assert found.row_uncertainty < 0.5
    assert len(found.row_offsets) == LINES
    assert found.unobservable
    assert seen[-1][0] <= seen[-1][1]
    step = found.capture.metadata["history"][-1]
    assert step["step"] == "autofocus"
    assert step["applied"] == ["rows", "path"]
    assert step["uncertainty"] == found.uncertainty
    assert step["row_offsets"] == pytest.approx(found.row_offsets, abs=1e-3)
    np.testing.assert_allclose(found.capture.trajectory.positions, bad.trajectory.positions + found.displacements)


@pytest.mark.slow
def test_rows_alone(right):
    moved = errors(right.trajectory, 2, wander=0.0)
    found = ms.autofocus(astray(right, moved), GRID, focus="rows")
    assert found.applied == ("rows",)
    assert distance_error(right, found.displacements - moved) < right.radar.waveform.wavelength / 18


@pytest.mark.slow
def test_a_path_that_is_right_stays_so(right, right_peak):
    found = ms.autofocus(right, GRID)
    assert peak(found.capture) == pytest.approx(right_peak, rel=0.005)
    assert np.linalg.norm(found.displacements, axis=1).max() < right.radar.waveform.wavelength / 18


@pytest.fixture(scope="module")
def small():
    return heard(plan(size=(0.08, 0.08)))


@pytest.fixture(scope="module")
def usual(small):
    return ms.autofocus(small, GRID, focus="rows")


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e30, 1e-30])
def test_the_unit_of_frames_does_not_matter(small, usual, unit):
    late = replace(small, frames=small.frames * np.float32(unit))
    found = ms.autofocus(late, GRID, focus="rows")
    assert found.applied == usual.applied
    np.testing.assert_allclose(found.row_offsets, usual.row_offsets, atol=1e-3)
    assert np.abs(found.capture.frames).max() == pytest.approx(np.abs(late.frames).max(), rel=1e-6)


@pytest.mark.slow
def test_where_nothing_tells_the_path_stays_and_the_reason_is_said(right):
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(*right.frames.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    rows = plan(size=(0.002, 0.12))
    scenes = {
        "no echo": replace(right, frames=np.zeros_like(right.frames)),
        "differ|nothing to correct": replace(right, frames=noise),
        "2 rows": heard(rows),
        "did not move": heard(replace(rows, positions=np.tile([0, 0, 0.2], (len(rows), 1)))),
    }
    for reason, capture in scenes.items():
        found = ms.autofocus(capture, GRID, focus="rows")
        assert found.applied == ()
        assert any(part in found.reason for part in reason.split("|")), (reason, found.reason)
        assert not found.displacements.any()
        assert found.capture is capture
        assert np.isinf(found.uncertainty)
        assert "nothing corrected" in repr(found)
    one = ms.Trajectory(times=[0.0], positions=[[0, 0, 0.2]])
    assert ms.autofocus(heard(one), GRID).reason == "the radar did not move"


def test_a_turntable_has_no_rows_and_its_circle_stays():
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = ms.Trajectory(
        times=np.arange(400.0), positions=0.3 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    )
    capture = heard(circle)
    found = ms.autofocus(capture, GRID)
    assert peak(found.capture) > 0.995 * peak(capture)
    assert found.row_offsets.size == 0


@pytest.mark.slow
def test_the_band_of_light_takes_no_memory():
    """A lattice over a cell of a scene 100 000 waves wide had 50 million points, seen from 48 places: 19 GB."""
    path = ms.Trajectory.raster(size=(0.016, 0.012), step=0.004, center=(0, 0, 0.2), serpentine=True)
    light = ms.Radar(name="light", waveform=ms.Waveform.stepped(6.3e14, 2e12, 16), array=radar().array)
    noise = np.random.default_rng(0).normal(size=(len(path), 1, 1, 16))
    tracemalloc.start()
    try:
        ms.autofocus(ms.Capture(radar=light, trajectory=path, frames=noise.astype(np.complex64)), GRID, focus="rows")
        assert tracemalloc.get_traced_memory()[1] < 1e8
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_what_cannot_be_right_is_refused(right):
    points = right.tx_positions
    slab = Layers(thicknesses=[0.01], indices=[1.4], normal=[0, 0, -1], moved=0.0, offset=0.0, error=0.0)
    with pytest.raises(InputError, match="tx_points"):
        ms.autofocus(replace(right, tx_points=points, rx_points=points), GRID)
    with pytest.raises(InputError, match="layers"):
        ms.autofocus(replace(right, layers=slab), GRID)
    with pytest.raises(UnknownNameError, match="focus"):
        ms.autofocus(right, GRID, focus="sharp")
    with pytest.raises(InputError, match="max_offset"):
        ms.autofocus(right, GRID, max_offset=0)
    with pytest.raises(InputError, match="smoothness"):
        ms.autofocus(right, GRID, smoothness=-1)
    with pytest.raises(InputError, match="no pose has several knots"):
        ms.autofocus(right, GRID, smoothness=1e-8)


@pytest.mark.slow
def test_on_the_command_line(small, tmp_path):
    moved = errors(small.trajectory, 4, wander=0.0)
    ms.save(tmp_path / "bad.capture.h5", astray(small, moved))
    code, out, err = run_inside(
        "image", "bad.capture.h5", "--grid=-6cm:6cm:4mm,-6cm:6cm:4mm,-2cm:2cm:1cm", "--focus", "rows", cwd=tmp_path
    )
    assert code == 0, err
    assert "focus: rows corrected by up to" in out
    image = ms.load(tmp_path / "bad.image.h5")
    assert [step["step"] for step in image.metadata["history"]][-2:] == ["autofocus", "form_image"]
    assert "rows" in refused("image", "bad.capture.h5", "--focus", "sharp", cwd=tmp_path)


def test_a_line_of_positions_takes_no_longer_and_no_more_memory_than_a_raster():
    """Across it the main lobe has no end: points were looked at half a kilometre away."""
    rows = plan(size=(0.06, 0.02))
    line = ms.Trajectory(times=rows.times, positions=rows.positions * [1, 0, 1])
    tracemalloc.start()
    found = ms.autofocus(heard(line), ms.VoxelGrid.regular((-0.02, -0.02, -0.02), (0.02, 0.02, 0.03), 0.004))
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert not found.applied


def test_combined_captures_keep_their_own_antennas(right):
    points = right.tx_positions + 0.01
    own = replace(right, tx_points=points, rx_points=points)
    np.testing.assert_array_equal(ms.combine(own, own, (1, 1)).tx_positions, points)


def test_rows_are_laid_on_each_other_by_magnitude_alone(right):
    """To a third of a frame though phases are random; noise is no more alike than rows shifted at random."""
    moved = errors(right.trajectory, 5, wander=0.0)
    turned = np.exp(2j * np.pi * np.random.default_rng(0).uniform(size=LINES))
    rows = rows_of_path(right.trajectory)
    frames = np.array(right.frames)
    for row, turn in zip(rows, turned, strict=True):
        frames[row.poses] *= turn
    found = offsets_of(astray(replace(right, frames=frames), moved))
    true = np.array([moved[row.poses].mean(axis=0) @ row.step / (row.step @ row.step) for row in rows])
    left = (found.frames - true) * [np.sign(row.step.sum()) for row in rows]
    trend = np.polyval(np.polyfit(np.arange(LINES), left, 1), np.arange(LINES))
    assert true.std() > 1
    assert (left - trend).std() < 1 / 3
    assert found.likeness > 3 * found.chance
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(*right.frames.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    found = offsets_of(replace(right, frames=noise))
    assert found.likeness < 1.5 * found.chance


def offsets_of(capture):
    rows = rows_of_path(capture.trajectory)
    pieces = Pieces.of(capture.trajectory, rows, capture.radar.waveform.wavelength)
    subject = Subject(capture, rows, pieces, np.zeros((1, 1, 16), np.complex64), GRID.bounds)
    return row_offsets(subject, 5.0, np.random.default_rng(0))
