"""`ms.sampling`: steps, what a view needs, and ghosts, against images of a point reflector by the imager."""

import dataclasses
from functools import cache

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import C, point_frames
from millisight.core.errors import DamagedFileError, InputError, MillisightError
from millisight.imaging import steps_of
from millisight.io.mito import read_published, write_published

BAND = 3e9


def radar(bandwidth=BAND, start=77.5e9, samples=24, receivers=((0.0, 0.0, 0.0),)):
    return ms.Radar(
        name="test",
        waveform=ms.Waveform.stepped(start, bandwidth / samples, samples),
        array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=receivers),
    )


def rows(x, y, height=0.2):
    """Rows along y at the places x."""
    positions = np.stack([np.repeat(x, len(y)), np.tile(y, len(x)), np.full(len(x) * len(y), height)], axis=1)
    return ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)


def grid(half=(0.08, 0.05, 0.05), spacing=(0.002, 0.002, 0.005)):
    return ms.VoxelGrid.regular(tuple(-h for h in half), half, spacing)


def image_of(of, path, reflector, voxels):
    tx, rx = (path.placed(a) for a in (of.array.tx_positions, of.array.rx_positions))
    frames = point_frames(reflector[None], np.ones(1), tx, rx, of.waveform.frequencies)
    capture = ms.Capture(radar=of, trajectory=path, frames=frames)
    return ms.form_image(capture, voxels, method="backprojection", tolerance=0.02)


def nearby(ghost, direction, voxels):
    """The part of a grid on the ghost's side of its reflector, from half way on, 2 cm around both."""
    low, high = (f(ghost.place, ghost.reflector) + s for f, s in ((np.minimum, -0.02), (np.maximum, 0.02)))
    axis = int(np.argmax(abs(direction)))
    half = (ghost.place[axis] + ghost.reflector[axis]) / 2
    if ghost.place[axis] > half:
        low[axis], high[axis] = half, np.inf
    else:
        low[axis], high[axis] = -np.inf, half
    axes = zip((voxels.x, voxels.y, voxels.z), low - 1e-9, high + 1e-9, strict=True)
    x, y, z = (line[(line >= first) & (line <= last)] for line, first, last in axes)
    return ms.VoxelGrid(x=x, y=y, z=z)


X, Y = np.arange(-0.1, 0.1001, 0.006), np.arange(-0.08, 0.0801, 0.002)
SCANS = {
    "coarse rows": (radar(), rows(X, Y), grid()),
    "coarse along the rows": (radar(), rows(Y, X), grid((0.05, 0.08, 0.05))),
    "four receivers between the rows": (
        radar(receivers=[(-0.005 - n * 0.00193, 0, 0) for n in range(4)]), rows(X, Y[::2]), grid(),
    ),
    "unequal rows": (
        radar(), rows(X + np.random.default_rng(1).normal(0, 7e-4, len(X)), Y), grid(),
    ),
    "a wide band": (radar(9e9, samples=48), rows(X, Y), grid()),
    "24 GHz": (
        radar(2e8, 24e9, 8), rows(np.arange(-0.12, 0.121, 0.012), np.arange(-0.12, 0.121, 0.006)),
        grid((0.1, 0.06, 0.05), (0.004, 0.004, 0.008)),
    ),
}  # fmt: skip


@cache
def sampled(name):
    of, path, voxels = SCANS[name]
    return ms.sampling(path, voxels, radar=of)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANS)
def test_ghosts_are_where_and_as_strong_as_in_the_image(name):
    of, path, voxels = SCANS[name]
    found = sampled(name)
    step = max(found.steps, key=lambda one: one.step)
    assert len(step.ghosts) == 3
    spacing = np.array([np.diff(axis)[0] for axis in (voxels.x, voxels.y, voxels.z)])
    for ghost in step.ghosts:
        part = nearby(ghost, step.direction, voxels)
        image = image_of(of, path, ghost.reflector, part)
        assert np.abs((image.peak - ghost.place) / spacing).max() <= 2
        assert 20 * np.log10(image.magnitude.max()) == pytest.approx(ghost.strength_db, abs=1.5)


def test_what_takes_ghosts_away():
    """A wider band smears them, receivers between the rows suppress them, unequal rows spread them."""
    loudest = {name: sampled(name).ghosts[0].strength_db for name in SCANS}
    assert loudest["a wide band"] < loudest["coarse rows"] - 2
    assert loudest["four receivers between the rows"] < loudest["coarse rows"] - 4
    assert loudest["unequal rows"] < loudest["coarse rows"] - 0.2
    assert loudest["24 GHz"] > loudest["coarse rows"]


@pytest.mark.slow
def test_receivers_that_fill_the_rows_leave_no_ghosts():
    quarter = C / 80.4e9 / 4
    filled = radar(receivers=[(-2 * quarter * n, 0, 0) for n in range(4)])
    path = rows(np.arange(-0.1, 0.1, 4 * quarter), Y[::2])
    found = ms.sampling(path, grid(), radar=filled)
    assert found.across.step > 3.5 * found.across.needed / 2
    assert found.across.ghosts == ()
    assert ms.sampling(path, grid(), radar=radar()).across.ghosts


def test_the_needed_step_is_that_of_the_largest_angle():
    """lambda / (4 sin theta_max), where a position sees the view under theta_max on both sides."""
    path, flat = rows(np.linspace(-0.01, 0.01, 11), np.linspace(-0.01, 0.01, 11)), grid((0.08, 0.04, 0.0), 0.002)
    found = ms.sampling(path, flat, radar=radar())
    wavelength = C / radar().waveform.frequencies.max()
    assert found.wavelength == pytest.approx(wavelength)
    assert found.across.needed == pytest.approx(wavelength / (4 * 0.08 / np.hypot(0.08, 0.2)), rel=0.01)
    assert found.along.needed == pytest.approx(wavelength / (4 * 0.04 / np.hypot(0.04, 0.2)), rel=0.01)
    assert [step.step for step in found.steps] == pytest.approx([0.002, 0.002])
    assert abs(found.across.direction) == pytest.approx([1, 0, 0])


@pytest.mark.slow
def test_ghosts_go_farther_with_the_depth():
    """About lambda z / (2 s) away."""
    of, path, voxels = SCANS["coarse rows"]
    ghosts = sorted(ms.sampling(path, voxels, radar=of).across.ghosts, key=lambda g: -g.reflector[2])
    depths = np.array([0.2 - g.reflector[2] for g in ghosts])
    distances = np.array([g.distance for g in ghosts])
    assert (np.diff(distances) > 0.005).all()
    assert distances == pytest.approx(of.waveform.wavelength * depths / (2 * 0.006), rel=0.15)


def test_nothing_is_said_where_nothing_is_wrong():
    fine = ms.sampling(rows(Y, Y), grid((0.05, 0.05, 0.03)), radar=radar())
    assert fine.along.step <= fine.along.needed
    assert fine.ghosts == fine.warnings == ()
    # Larger than what sees no ghost at all, but in an image that is too small for one.
    small = ms.sampling(rows(X, Y), grid((0.012, 0.012, 0.01)), radar=radar(), reflectors=[[-0.01, 0, 0], [0.01, 0, 0]])
    assert small.warnings == ()


@pytest.mark.slow
def test_the_text_and_the_warning():
    of, path, voxels = SCANS["coarse rows"]
    found = ms.sampling(path, voxels, radar=of)
    assert found.text == ("2 mm (0.54 wavelengths) from position to position, 6 mm (1.61 wavelengths) from row to row")
    (line,) = found.warnings
    assert line.startswith("rows 6 mm (1.61 wavelengths) apart give ghosts (grating lobes) 5.")
    assert "cm from the object along x, up to -" in line
    assert "dB; this view needs 1.9" in line
    assert repr(found).startswith("Sampling(2 mm (0.54 wavelengths) from position to position, 6 mm")
    assert len(repr(found)) < 200


def test_a_capture_knows_its_scene():
    scene = ms.Scene.from_mesh("golf_ball", vertices=200)
    path = ms.Trajectory.raster(size=(0.1, 0.1), step=0.012)
    capture = ms.simulate(scene, ms.Radar.preset("mito-sim-77ghz"), path)
    told = ms.sampling(capture)
    assert told.warnings
    assert told.ghosts[0].reflector == pytest.approx([0, 0, 0], abs=0.03)
    assert ms.sampling(capture, ghosts=False).along.needed == told.along.needed
    assert ms.sampling(capture, ghosts=False).ghosts == ()
    unknown = ms.sampling(dataclasses.replace(capture, metadata={}))
    assert unknown.along.needed is None
    assert unknown.warnings == ()
    assert "from row to row" in unknown.text
    assert "sampling" in capture._repr_html_()


def test_other_paths_tell_their_step_alone():
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(400, 0.2)], axis=1)
    found = ms.sampling(ms.Trajectory(times=np.arange(400.0), positions=circle), grid(), radar=radar())
    assert found.across is None
    assert found.along.step == pytest.approx(2 * np.pi * 0.2 / 400, rel=1e-3)
    assert found.warnings == ()
    single = ms.sampling(rows(np.zeros(1), X), grid((0.05, 0.08, 0.05)), radar=radar())
    assert single.across is None
    assert single.along.step == pytest.approx(0.006)
    assert len(single.along.ghosts) > 0


@pytest.mark.slow
def test_turned_rows_give_turned_ghosts():
    """A rotation about the vertical turns all, and changes no strength."""
    of, path, _ = SCANS["coarse rows"]
    voxels = grid((0.06, 0.06, 0.02))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = ms.Trajectory(times=path.times, positions=path.positions @ turn.T)
    one, other = ms.sampling(path, voxels, radar=of), ms.sampling(turned, voxels, radar=of)
    assert one.ghosts
    assert [g.strength_db for g in one.ghosts] == pytest.approx([g.strength_db for g in other.ghosts], abs=0.2)
    assert "along y" in other.warnings[0]


@pytest.mark.slow
def test_rows_at_an_angle():
    of, path, voxels = SCANS["coarse rows"]
    c = np.sqrt(0.5)
    turned = dataclasses.replace(path, positions=path.positions @ np.array([[c, -c, 0], [c, c, 0], [0, 0, 1]]).T)
    found = ms.sampling(turned, voxels, radar=of)
    assert abs(found.across.direction) == pytest.approx([c, c, 0], abs=1e-6)
    ghost = found.ghosts[0]
    way = (ghost.place - ghost.reflector) / ghost.distance
    assert abs(way @ found.across.direction) > 0.95
    assert "along (0.71, 0.71, 0), " in found.warnings[0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"radar": None}, "a trajectory alone has no wavelength"),
        ({"scan": ms.Trajectory(times=[0.0], positions=[[0, 0, 0]])}, "one position has no step"),
        ({"scan": "scan"}, "expected Trajectory"),
        ({"reflectors": [[0, 0, 0]]}, "reflectors"),
        ({"grid": 0.002}, "grid"),
    ],
)
def test_bad_arguments(settings, message):
    arguments = {"scan": rows(Y, Y), "grid": grid(), "radar": radar(), **settings}
    with pytest.raises(MillisightError, match=message):
        ms.sampling(**arguments)
    assert issubclass(InputError, MillisightError)


@pytest.mark.parametrize(
    ("receivers", "expected"),
    [
        ([0.0], (0.002, 0.006)),
        ([0.0, 0.006], (0.002, 0.003)),  # phase centres 3 mm apart: half a row
        ([0.0, 0.001], (0.002, 0.0055)),  # and so near that the rows stay apart
        ([0.0, 0.003, 0.006, 0.009], (0.002, 0.0015)),
        ([0.0, 0.012], (0.002, 0.006)),  # on the next row
    ],
)
def test_the_widest_gap_between_phase_centres(receivers, expected):
    of, path = radar(receivers=[(-0.005 - place, 0, 0) for place in receivers]), rows(X, Y)
    shape = (len(path), 1, len(receivers), of.waveform.samples_per_chirp)
    capture = ms.Capture(radar=of, trajectory=path, frames=np.zeros(shape, np.complex64))
    assert steps_of(capture) == pytest.approx(expected, abs=1e-6)
    backwards = dataclasses.replace(path, positions=path.positions[::-1])
    assert steps_of(dataclasses.replace(capture, trajectory=backwards)) == pytest.approx(expected, abs=1e-6)


def test_images_keep_the_steps_of_their_scan_unless_it_has_none(tmp_path):
    of, path = radar(samples=4), rows(X, Y)
    voxels = ms.VoxelGrid.regular((-0.01, -0.01, 0), (0.01, 0.01, 0), 0.01)
    image = image_of(of, path, np.zeros(3), voxels)
    assert image.steps == pytest.approx((0.002, 0.006), abs=1e-6)
    ms.save(tmp_path / "one.h5", image)
    assert ms.load(tmp_path / "one.h5").steps == image.steps
    write_published(tmp_path / "processed_image.pkl", image)
    assert read_published(tmp_path / "processed_image.pkl").record.steps == image.steps
    assert ms.SarImage(grid=voxels, values=image.values).steps == ()
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    circle = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(40, 0.2)], axis=1)
    assert image_of(of, ms.Trajectory(times=np.arange(40.0), positions=circle), np.zeros(3), voxels).steps == ()


IMPOSSIBLE = [np.array([1.0, -2.0]), np.array([np.nan]), np.zeros(3), np.array(1.0), np.array(["a"])]


@pytest.mark.parametrize("steps", IMPOSSIBLE)
def test_steps_that_cannot_be_are_damage(tmp_path, steps):
    voxels = ms.VoxelGrid.regular((-0.01, -0.01, 0), (0.01, 0.01, 0), 0.01)
    image = ms.SarImage(grid=voxels, values=np.ones(voxels.shape))
    write_published(tmp_path / "processed_image.pkl", image, {"steps": steps})
    with pytest.raises(DamagedFileError, match="steps"):
        read_published(tmp_path / "processed_image.pkl")
