"""Lids and other sheets: found where they are, taken off, and nothing else with them."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.mirrors import DEVICES, GRID, capture_of, disc, leak_of, mirror, points, raster
from helpers.oracles import shared
from helpers.scatter import from_places
from millisight.calibration import read_capture
from millisight.core import rotation_from_euler_deg
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Layers
from millisight.imaging import DetectedSheet, remove_sheets

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "captures"
RADAR = DEVICES["77 GHz"]
FREQUENCY = RADAR.waveform.center_frequency
SHEETS = {
    "level": {"height": -0.2},
    "tilted": {"height": -0.2, "tilt_deg": (1.0, -2.0)},
    "steep": {"height": -0.2, "tilt_deg": (5.0, 0.0)},
    "bowed": {"height": -0.2, "tilt_deg": (0.5, 0.5), "bow": 0.002},
    "half": {"height": -0.2, "sides": [(0, 0.0, 1)]},
    "a corner": {"height": -0.2, "tilt_deg": (0.0, 1.0), "sides": [(0, -0.03, 1), (1, 0.03, -1)]},
}


def image_of(frames, path, grid=GRID, device=RADAR):
    return ms.form_image(capture_of(device, path, frames), grid, tolerance=0.02)


def left_of(cleaned, truth, sheet):
    """The power that is left of a sheet, or lost of what it covers, over that of the sheet."""
    return np.linalg.norm(cleaned - truth) ** 2 / np.linalg.norm(sheet) ** 2


@pytest.fixture(scope="module")
def path():
    return raster()


@pytest.fixture(scope="module")
def spots(path):
    return points(RADAR, path, strength=0.005)


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_is_found_and_only_its_echo_taken(name, path, spots):
    sheet = mirror(RADAR, path, **SHEETS[name])
    found = remove_sheets(capture_of(RADAR, path, spots + sheet))
    (one,) = found.sheets
    assert found.reason == ""
    np.testing.assert_allclose(one.tilt_deg, SHEETS[name].get("tilt_deg", (0, 0)), atol=0.3)
    if "sides" not in SHEETS[name]:
        assert abs(one.height - -0.2) < 0.005
        assert one.border > 0.7
        assert abs(one.power - np.linalg.norm(sheet) ** 2 / np.linalg.norm(spots + sheet) ** 2) < 0.05
    assert left_of(found.result.frames, spots, sheet) < (0.06 if "sides" in SHEETS[name] else 0.02)


OVER = np.array([1, 1, -1])


def test_from_below_it_is_the_mirror_image(path, spots):
    """Frames do not change where antennas and scene are mirrored."""
    below = ms.Trajectory(times=path.times, positions=path.positions * OVER)
    grid = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=-GRID.z[::-1])
    frames = spots + mirror(RADAR, path, **SHEETS["tilted"])
    one, other = (capture_of(RADAR, poses, frames) for poses in (path, below))
    for down, up, on in ((one, other, {"grid": GRID}), (ms.form_image(one, GRID), ms.form_image(other, grid), {})):
        found = remove_sheets(down, **on)
        again = remove_sheets(up, **({"grid": grid} if on else {}))
        (sheet,), (mirrored,) = found.sheets, again.sheets
        assert mirrored.height == pytest.approx(-sheet.height, abs=1e-4)
        np.testing.assert_allclose(mirrored.tilt_deg, np.negative(sheet.tilt_deg), atol=0.01)
        kept = again.result.frames if on else again.result.values[..., ::-1]
        truth = found.result.frames if on else found.result.values
        assert np.linalg.norm(kept - truth) < 0.02 * np.linalg.norm(frames if on else down.values)
        assert again.result.metadata["history"][-1]["sheets"][0]["height"] == mirrored.height
    assert ms.form_image(other, grid).seen_from == "below"


def test_from_beside_none_are_looked_for(path, spots):
    turned = ms.Trajectory(times=path.times, positions=path.positions[:, [2, 0, 1]])
    grid = ms.VoxelGrid(x=GRID.z, y=GRID.x, z=GRID.y)
    capture = capture_of(RADAR, turned, spots + mirror(RADAR, path, **SHEETS["level"]))
    image = ms.form_image(capture, grid)
    assert image.seen_from == "beside"
    for found in (remove_sheets(capture, grid=grid), remove_sheets(image, clutter="lid")):
        assert found.sheets == ()
        assert found.reason == "the antennas lie beside the scene, and sheets are looked for along z: turn the frame"


@pytest.mark.parametrize("name", ["level", "steep", "bowed", "half"])
def test_in_images_too(name, path, spots):
    sheet, truth = image_of(mirror(RADAR, path, **SHEETS[name]), path), image_of(spots, path)
    covered = ms.SarImage(grid=GRID, values=truth.values + sheet.values)
    found = remove_sheets(covered, frequency=FREQUENCY)
    (one,) = found.sheets
    np.testing.assert_allclose(one.tilt_deg, SHEETS[name].get("tilt_deg", (0, 0)), atol=0.3)
    assert left_of(found.result.values, truth.values, sheet.values) < (0.08 if "sides" in SHEETS[name] else 0.05)
    if "sides" not in SHEETS[name]:
        assert abs(one.height - -0.2) < 0.01
    # What lies below keeps its peak.
    inside = np.hypot(*np.meshgrid(GRID.x, GRID.y, indexing="ij")) < 0.04
    below = inside[..., None] & (GRID.z < -0.235)
    assert 20 * abs(np.log10(found.result.magnitude[below].max() / truth.magnitude[below].max())) < 1


@pytest.mark.parametrize("device", DEVICES)
def test_every_radar(device):
    radar, path = DEVICES[device], raster(step=0.004)
    sheet, spots = mirror(radar, path, -0.2, tilt_deg=(2, 1)), points(radar, path, strength=0.01)
    found = remove_sheets(capture_of(radar, path, spots + sheet))
    (one,) = found.sheets
    np.testing.assert_allclose(one.tilt_deg, (2, 1), atol=0.5)
    assert left_of(found.result.frames, spots, sheet) < 0.05


@pytest.mark.slow
def test_nothing_but_a_lid_leaves_next_to_nothing(path):
    sheet = mirror(RADAR, path, -0.2, tilt_deg=(1, 0))
    noise = np.random.default_rng(0).normal(size=(*sheet.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    frames = remove_sheets(capture_of(RADAR, path, sheet + 1e-3 * noise)).result.frames
    assert left_of(frames, 0, sheet) < 1e-3
    image = remove_sheets(image_of(sheet, path), frequency=FREQUENCY).result
    assert left_of(image.values, 0, image_of(sheet, path).values) < 0.05


def test_two_sheets_are_taken_one_after_the_other(path, spots):
    sheets = mirror(RADAR, path, -0.2, tilt_deg=(1, 0)) + mirror(RADAR, path, -0.14, tilt_deg=(-2, 1), strength=0.05)
    capture = capture_of(RADAR, path, spots + sheets)
    found = remove_sheets(capture)
    assert len(found.sheets) == 2
    np.testing.assert_allclose(found.sheets[0].tilt_deg, (1, 0), atol=0.3)
    np.testing.assert_allclose(found.sheets[1].tilt_deg, (-2, 1), atol=0.5)
    assert left_of(found.result.frames, spots, sheets) < 0.03
    assert len(remove_sheets(capture, most=1).sheets) == 1


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
def test_in_sight_nothing_changes(device):
    radar, path = DEVICES[device], raster(step=0.004)
    for places in (np.array([[0.01, 0, -0.25]]), disc(0.035, -0.24)):
        capture = capture_of(radar, path, points(radar, path, places, 0.05 / len(places) ** 0.5))
        found = remove_sheets(capture)
        assert found.result is capture
        assert found.sheets == ()
        assert found.reason
        image = ms.form_image(capture, GRID, tolerance=0.02)
        again = remove_sheets(image, frequency=radar.waveform.center_frequency, clutter="auto")
        assert again.result is image
        assert "nothing taken" in repr(again)


@pytest.mark.slow
@pytest.mark.parametrize("strength", [0.014, 0.14])
def test_a_flat_top_under_a_lid_keeps_its_peak(path, strength):
    """Like metal: ten and a hundred times as bright as the lid in the image."""
    top = points(RADAR, path, disc(0.03, -0.24), strength)
    truth, sheet = image_of(top, path), image_of(mirror(RADAR, path, -0.2, tilt_deg=(0.5, 0)), path)
    assert 0.5 < truth.magnitude.max() / sheet.magnitude.max() / (strength / 0.0014) < 3
    frames = remove_sheets(capture_of(RADAR, path, top + mirror(RADAR, path, -0.2, tilt_deg=(0.5, 0))))
    image = remove_sheets(ms.SarImage(grid=GRID, values=truth.values + sheet.values), frequency=FREQUENCY)
    for found in (image_of(frames.result.frames, path), image.result):
        inside = truth.magnitude > 0.5 * truth.magnitude.max()
        assert 20 * abs(np.log10(np.median(found.magnitude[inside] / truth.magnitude[inside]))) < 1


@pytest.mark.parametrize("strength", [1.0, 4.0])
def test_what_leaks_between_the_antennas_hides_no_lid(path, spots, strength):
    sheet = mirror(RADAR, path, -0.2, tilt_deg=(1, 0))
    leak = leak_of(RADAR, strength * np.abs(sheet).max())
    found = remove_sheets(capture_of(RADAR, path, spots + sheet + leak), clutter="lid")
    (one,) = found.sheets
    assert abs(one.height - -0.2) < 0.003
    assert one.explained > 0.9
    assert left_of(found.result.frames, spots + leak, sheet) < 0.02


def test_a_known_lid_within_the_scan_goes_with_what_its_edges_send_beside_it(path, spots):
    edges = [(axis, -sign * 0.06, sign) for axis in (0, 1) for sign in (1, -1)]
    sheet = mirror(RADAR, path, -0.2, sides=edges)
    found = remove_sheets(capture_of(RADAR, path, spots + sheet), clutter="lid")
    (one,) = found.sheets
    assert abs(one.height - -0.2) < 0.002
    assert left_of(found.result.frames, spots, sheet) < 0.02
    assert found.left == ()


@pytest.mark.slow
def test_a_wall_behind_the_grid_is_left(path, spots):
    """It hides nothing there; and where the band is too narrow to tell the two apart, its echo holds the object's."""
    slow = raster(step=0.004)
    narrow = DEVICES["24 GHz"]
    for radar, way, height in ((RADAR, path, -0.5), (narrow, slow, -1.0)):
        wall, there = mirror(radar, way, height), points(radar, way, strength=0.03)
        capture = capture_of(radar, way, wall + there)
        assert len(remove_sheets(capture).sheets) == 1
        found = remove_sheets(capture, grid=GRID)
        assert found.result is capture
        assert found.sheets == ()
    assert found.left[0].height == pytest.approx(-1.0, abs=0.1)
    assert re.search(r"at z = -(9|10)\d\.\d cm, lies behind the grid", found.reason)
    # A lid before a wall twice as strong.
    lid, wall = mirror(RADAR, path, -0.2, tilt_deg=(1, 0)), mirror(RADAR, path, -0.5, strength=0.2)
    capture = capture_of(RADAR, path, spots + lid + wall)
    (far,) = remove_sheets(capture, most=1).sheets
    assert far.height == pytest.approx(-0.5, abs=0.01)
    (near,) = remove_sheets(capture, grid=GRID).sheets
    assert near.height == pytest.approx(-0.2, abs=0.03)  # some of the wall leaks there
    np.testing.assert_allclose(near.tilt_deg, (1, 0), atol=0.3)
    image = image_of(remove_sheets(capture, grid=GRID).result.frames, path)
    assert left_of(image.values, image_of(spots + wall, path).values, image_of(lid, path).values) < 0.05


def test_a_measured_letter_before_a_wall_keeps_all_of_its_echo():
    """Six frequencies, 0.25 m of range resolution; the wall is 65 cm behind the letter."""
    data = shared("captures", "letter_r_22ghz.npy").parent
    capture = read_capture(EXAMPLES / "letter_r.toml", data=data)
    grid = ms.VoxelGrid.regular(**capture.metadata["image_grid"])
    assert remove_sheets(capture, clutter="lid").sheets
    found = remove_sheets(capture, clutter="lid", grid=grid)
    assert found.result is capture
    assert "behind the grid" in found.reason


def test_noise_and_nothing_are_no_sheets(path):
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(len(path), 1, 1, 32)) + 1j * rng.normal(size=(len(path), 1, 1, 32))
    for frames in (noise, 0 * noise):
        assert remove_sheets(capture_of(RADAR, path, frames)).sheets == ()
    for values in (rng.normal(size=(*GRID.shape, 2)) @ [1, 1j], np.zeros(GRID.shape)):
        assert remove_sheets(ms.SarImage(grid=GRID, values=values), frequency=FREQUENCY).sheets == ()


def test_voxels_of_a_nanometre_take_no_time():
    """A cell has no more columns than the image: 5 000 000 were added up, all but a few empty, for minutes."""
    grid = ms.VoxelGrid(x=np.arange(30) * 1e-9, y=np.arange(30) * 1e-9, z=np.arange(8) * 1e-9)
    began = time.process_time()
    remove_sheets(ms.SarImage(grid=grid, values=np.random.default_rng(0).normal(size=grid.shape)), frequency=FREQUENCY)
    assert time.process_time() - began < 5


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e14])
def test_an_image_s_unit_does_not_matter(path, spots, scale):
    """Squares of complex64 leave its range, which NumPy warned of."""
    image = image_of(spots + mirror(RADAR, path, -0.2), path)
    found = remove_sheets(image, frequency=FREQUENCY)
    other = remove_sheets(replace(image, values=image.values * scale), frequency=FREQUENCY)
    assert len(found.sheets) == len(other.sheets) == 1
    assert other.sheets[0].height == pytest.approx(found.sheets[0].height, abs=1e-6)
    error = np.abs(other.result.values.astype(complex) / scale - found.result.values).max()
    assert error < 1e-4 * np.abs(image.values).max()


def test_a_stray_pose_is_told_and_few_samples_find_nothing(path):
    """Cells over a million metres took gigabytes; a range within 5 cm ended in a traceback."""
    echoes = mirror(RADAR, path, -0.2)
    stray = replace(path, positions=np.concatenate([path.positions[:-1], [[1e6, 1e5, 0]]]))
    with pytest.raises(InputError, match=r"poses lie over 1e\+06 x 1e\+05 m, too far apart .*leave stray poses out"):
        remove_sheets(capture_of(RADAR, stray, echoes))
    wide = ms.Waveform.stepped(70e9, 5e9, 2)  # unambiguous over 3 cm
    two = capture_of(replace(RADAR, waveform=wide), path, echoes[..., :2])
    assert remove_sheets(two).result is not None


@pytest.mark.parametrize("odd", ["one value", "one outlier", "alike", "one frequency in effect"])
@pytest.mark.parametrize("clutter", ["auto", "lid"])
def test_odd_frames_end_without_a_warning(path, odd, clutter):
    echoes = mirror(RADAR, path, -0.2)
    first = np.arange(echoes.size).reshape(echoes.shape) == 7
    frames = {"one value": first * 1.0, "one outlier": np.where(first, 1e37, echoes), "alike": np.ones_like(echoes)}
    radar = replace(RADAR, waveform=ms.Waveform.stepped(77e9, 1e-300, 32)) if odd.startswith("one freq") else RADAR
    assert remove_sheets(capture_of(radar, path, frames.get(odd, echoes)), clutter=clutter).result is not None


def test_an_image_of_many_slices_and_few_columns_takes_no_time():
    """Principal components of 3000 slices took minutes, though nine columns have nine at most."""
    grid = ms.VoxelGrid(x=np.arange(3) * 0.002, y=np.arange(3) * 0.002, z=np.arange(3000) * 0.002 - 6)
    rng = np.random.default_rng(0)
    began = time.process_time()
    remove_sheets(ms.SarImage(grid=grid, values=rng.normal(size=(*grid.shape, 2)) @ [1, 1j]), frequency=FREQUENCY)
    assert time.process_time() - began < 5


def test_one_row_of_poses_or_voxels():
    path = from_places(np.column_stack([np.zeros(100), np.linspace(-0.12, 0.12, 100), np.zeros(100)]))
    spot, sheet = points(RADAR, path, strength=0.01), mirror(RADAR, path, -0.2, tilt_deg=(0, 1))
    found = remove_sheets(capture_of(RADAR, path, spot + sheet))
    assert abs(found.sheets[0].tilt_deg[1] - 1) < 0.3
    assert left_of(found.result.frames, spot, sheet) < 0.1
    wide = raster()
    grid = ms.VoxelGrid(x=[0.0], y=GRID.y, z=GRID.z)
    image = remove_sheets(image_of(mirror(RADAR, wide, -0.2), wide, grid), frequency=FREQUENCY)
    assert len(image.sheets) == 1
    assert left_of(image.result.values, 0, image_of(mirror(RADAR, wide, -0.2), wide, grid).values) < 0.05


def test_one_slice_and_one_pose(path):
    grid = ms.VoxelGrid(x=GRID.x, y=GRID.y, z=[-0.2])
    image = image_of(mirror(RADAR, path, -0.2), path, grid)
    (one,) = remove_sheets(image, frequency=FREQUENCY).sheets
    assert one.height == pytest.approx(-0.2)
    alone = from_places([0, 0, 0])
    capture = capture_of(RADAR, alone, mirror(RADAR, alone, -0.2))
    assert remove_sheets(capture).reason == remove_sheets(capture, clutter="lid").reason == "the radar did not move"


@pytest.mark.slow
def test_what_ends_within_the_scene_is_left_and_told_unless_a_lid_is_known_to_be_there(path, spots):
    """A lid of 11 cm in an image of 20 cm may as well be an object's top; in an image of 12 cm it is a lid."""
    sides = [(axis, sign * -0.055, sign) for axis in (0, 1) for sign in (1, -1)]
    lid, under = mirror(RADAR, path, -0.2, sides=sides), points(RADAR, path, strength=0.002)
    sheet, scene = lid + under, image_of(lid + under, path)
    whole = remove_sheets(scene, frequency=FREQUENCY)
    assert whole.sheets == ()
    assert whole.reason
    known = remove_sheets(scene, frequency=FREQUENCY, clutter="lid")
    (one,) = known.sheets
    assert abs(one.height + 0.2) < 0.005
    truth, alone = image_of(under, path).values, image_of(lid, path).values
    assert left_of(known.result.values, truth, alone) < 0.15
    # What its maximum lost is told.
    ratio = known.result.magnitude.max() / scene.magnitude.max()
    assert known.result.metadata["history"][-1]["taken_db"] == pytest.approx(20 * np.log10(ratio), abs=0.01)
    # Something smaller than any lid is none, even then.
    spot = remove_sheets(image_of(points(RADAR, path, disc(0.02, -0.2)), path), frequency=FREQUENCY, clutter="lid")
    assert spot.sheets == ()
    grid = ms.VoxelGrid.regular((-0.06, -0.06, -0.28), (0.06, 0.06, -0.15), (0.0025, 0.0025, 0.01))
    (one,) = remove_sheets(image_of(sheet, path, grid), frequency=FREQUENCY, clutter="lid").sheets
    assert one.border > 0.3


@pytest.mark.parametrize("tilt_deg", [(0, 0), (1, -2)])
@pytest.mark.parametrize("ends", [(-0.043, 0.052, -0.037, 0.048), (-0.06, 0.03, -0.05, 0.05)])
def test_a_known_lid_s_edges_go_with_it_on_all_sides(path, spots, ends, tilt_deg):
    sides = [(axis, ends[2 * axis + high], -1 if high else 1) for axis in (0, 1) for high in (0, 1)]
    lid, under = (
        image_of(frames, path).values for frames in (mirror(RADAR, path, -0.2, tilt_deg=tilt_deg, sides=sides), spots)
    )
    found = remove_sheets(ms.SarImage(grid=GRID, values=lid + under), frequency=FREQUENCY, clutter="lid")
    left = abs(found.result.values - under)[:, :, abs(GRID.z + 0.2) < 0.025]  # above it lie grating lobes
    near = [(a - 0.03 < axis) & (axis < b + 0.03) for axis, a, b in ((GRID.x, *ends[:2]), (GRID.y, *ends[2:]))]
    assert left[np.ix_(*near)].max() < 0.25 * abs(lid).max()


@pytest.mark.parametrize(
    "turn_deg", [3, pytest.param(20, marks=pytest.mark.slow), pytest.param(45, marks=pytest.mark.slow)]
)
def test_a_known_lid_may_be_turned_about_z(path, spots, turn_deg):
    turn = rotation_from_euler_deg((0, 0, turn_deg))
    poses = ms.Trajectory(times=path.times, positions=path.positions @ turn)  # as the lid sees them
    ends = np.array([[-0.05, 0.05], [-0.04, 0.04]])
    sides = [(axis, place, -np.sign(place)) for axis in (0, 1) for place in ends[axis]]
    lid, under = (image_of(one, path).values for one in (mirror(RADAR, poses, -0.2, sides=sides), spots))
    found = remove_sheets(ms.SarImage(grid=GRID, values=lid + under), frequency=FREQUENCY, clutter="lid")
    (one,) = found.sheets
    corners = np.array(np.meshgrid(*ends, indexing="ij")).reshape(2, -1).T @ turn[:2, :2].T
    nearest = np.linalg.norm(corners[:, None] - np.array(one.corners), axis=2).min(axis=1)
    assert nearest.max() < 0.003
    first, second = np.array(one.corners)[:2]
    assert abs((np.degrees(np.arctan2(*(second - first)[::-1])) - turn_deg + 45) % 90 - 45) < 0.6
    u, v = np.einsum("ji,j...->i...", turn[:2, :2], np.stack(np.meshgrid(GRID.x, GRID.y, indexing="ij")))
    assert (one.box_on(GRID.xy) == ((abs(u) < 0.05) & (abs(v) < 0.04))).mean() > 0.97
    level = abs(GRID.z + 0.2) < 0.025
    assert left_of(found.result.values[..., level], under[..., level], lid[..., level]) < 0.02
    # Tables of numbers, as a file's history holds it, are the same sheet again.
    told = json.loads(json.dumps(found.result.metadata["history"][-1]["sheets"][0]))
    assert DetectedSheet(**told).corners == one.corners


@pytest.mark.slow
def test_a_known_lid_goes_before_what_its_edges_add_up_to(path):
    """Beside a lid of 14 cm, its ripples pass for a sheet of their own that reaches the image's border."""
    sides = [(axis, sign * -0.07, sign) for axis in (0, 1) for sign in (1, -1)]
    lid, under = (
        image_of(frames, path).values
        for frames in (mirror(RADAR, path, -0.2, sides=sides), points(RADAR, path, strength=0.002))
    )
    found = remove_sheets(ms.SarImage(grid=GRID, values=lid + under), frequency=FREQUENCY, clutter="lid")
    first = found.sheets[0]
    assert abs(first.height + 0.2) < 0.005
    assert first.explained > 0.95
    assert left_of(found.result.values, under, lid) < 0.15


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [0, 30])
def test_grating_lobes_beside_a_lid_are_no_part_of_it(turn_deg):
    """Where positions are as far apart as voxels, lobes look like mirrors, too: brighter than the lid, but higher."""
    grid = ms.VoxelGrid.regular((-0.12, -0.2, -0.28), (0.12, 0.2, -0.14), (0.0025, 0.0025, 0.01))
    path = ms.Trajectory.raster(size=(0.25, 0.4), step=0.0025, center=(0, 0, 0))
    turn = rotation_from_euler_deg((0, 0, turn_deg))
    poses = ms.Trajectory(times=path.times, positions=path.positions @ turn)
    sides = [(axis, sign * half, -sign) for axis, half in enumerate((0.06, 0.09)) for sign in (-1, 1)]
    frames = mirror(RADAR, poses, -0.2, tilt_deg=(1, -1), sides=sides)
    lid, under = (image_of(one, path, grid).values for one in (frames, points(RADAR, path, strength=0.005)))
    beside, level = abs(grid.y) > 0.14, abs(grid.z + 0.2) < 0.025
    of_lid = np.ix_(np.ones(len(grid.x), dtype=bool), ~beside, level)
    assert abs(lid[:, beside]).max() > abs(lid[of_lid]).max()
    found = remove_sheets(ms.SarImage(grid=grid, values=lid + under), frequency=FREQUENCY, clutter="lid")
    first = found.sheets[0]
    u, v = np.einsum("ji,j...->i...", turn[:2, :2], np.stack(np.meshgrid(grid.x, grid.y, indexing="ij")))
    assert (first.box_on(grid.xy) == ((abs(u) < 0.06) & (abs(v) < 0.09))).mean() > 0.97
    assert left_of(found.result.values[of_lid], under[of_lid], lid[of_lid]) < 0.02


@pytest.mark.slow
def test_a_bright_box_below_is_not_taken_for_a_lid_at_the_top_of_the_grid():
    grid = ms.VoxelGrid.regular((-0.12, -0.14, -0.28), (0.12, 0.14, -0.14), (0.0025, 0.0025, 0.01))
    path = ms.Trajectory.raster(size=(0.25, 0.3), step=0.0022, center=(0, 0, 0))

    def mirrored(height, half, **how):
        sides = [(axis, sign * side, -sign) for axis, side in enumerate(half) for sign in (-1, 1)]
        return image_of(mirror(RADAR, path, height, sides=sides, **how), path, grid).values

    lid = mirrored(-0.14, (0.1, 0.11), tilt_deg=(1, -1))
    box = mirrored(-0.2, (0.05, 0.06), strength=0.2)
    found = remove_sheets(ms.SarImage(grid=grid, values=lid + box), frequency=FREQUENCY, clutter="lid")
    (one,) = found.sheets
    assert one.height == pytest.approx(-0.14, abs=0.005)
    assert left_of(found.result.values, box, lid) < 0.02


def test_history_files_and_precision(path, spots, tmp_path):
    capture = capture_of(RADAR, path, spots + mirror(RADAR, path, -0.2))
    cleaned = remove_sheets(capture).result
    step = cleaned.metadata["history"][-1]
    assert step["step"] == "remove_sheets"
    assert abs(step["sheets"][0]["height"] + 0.2) < 0.005
    assert json.loads(json.dumps(step["sheets"][0]))["power"] > 0.5
    ms.save(tmp_path / "capture.h5", capture)
    with ms.open_capture(tmp_path / "capture.h5") as on_disk:
        np.testing.assert_array_equal(remove_sheets(on_disk).result.frames, cleaned.frames)
    image = ms.form_image(capture, GRID, tolerance=0.02)
    assert image.frequency == FREQUENCY
    told = remove_sheets(image).result.values
    np.testing.assert_array_equal(told, remove_sheets(image, frequency=FREQUENCY).result.values)
    precise = ms.SarImage(grid=GRID, values=image.values.astype(complex))
    assert remove_sheets(precise, frequency=FREQUENCY).result.values.dtype == complex
    ms.save(tmp_path / "image.h5", remove_sheets(image, frequency=FREQUENCY).result)
    assert ms.load(tmp_path / "image.h5").metadata["history"][-1]["clutter"] == "auto"


@pytest.mark.filterwarnings("error")
def test_weak_frames_on_disk_are_searched_as_strong_ones_are(path, spots, tmp_path):
    """Squares of 1e-36 are 0 in float32: means were NaN."""
    frames = spots + mirror(RADAR, path, -0.2)
    strong = remove_sheets(capture_of(RADAR, path, frames)).sheets
    ms.save(tmp_path / "weak.h5", capture_of(RADAR, path, frames * 2.0**-120))
    with ms.open_capture(tmp_path / "weak.h5") as on_disk:
        weak = remove_sheets(on_disk)
    assert [sheet.height for sheet in weak.sheets] == pytest.approx([sheet.height for sheet in strong], abs=1e-6)
    assert 0 < np.abs(weak.result.frames).max() < 1e-34


def test_what_cannot_be_right_is_refused(path, spots):
    capture = capture_of(RADAR, path, spots)
    image = ms.SarImage(grid=GRID, values=np.ones(GRID.shape))
    assert remove_sheets(capture, clutter="none").result is capture
    with pytest.raises(UnknownNameError, match="clutter"):
        remove_sheets(capture, clutter="box")
    with pytest.raises(InputError, match="does not state its frequency"):
        remove_sheets(image)
    with pytest.raises(InputError, match="leave frequency out"):
        remove_sheets(capture, frequency=79e9)
    with pytest.raises(InputError, match="its own grid"):
        remove_sheets(image, frequency=79e9, grid=GRID)
    with pytest.raises(InputError, match="grid"):
        remove_sheets(capture, grid=(0, 1))
    with pytest.raises(InputError, match="most"):
        remove_sheets(capture, most=0)
    with pytest.raises(InputError, match="expected an image or a capture"):
        remove_sheets(GRID)
    slab = Layers(thicknesses=[0.01], indices=[1.4], normal=[0, 0, -1], moved=0.0, offset=0.0, error=0.0)
    with pytest.raises(InputError, match="before layers are added"):
        remove_sheets(replace(capture, layers=slab))
    (sheet,) = remove_sheets(capture_of(RADAR, path, mirror(RADAR, path, -0.2))).sheets
    with pytest.raises(InputError):
        replace(sheet, area=-1.0)
    with pytest.raises(InputError, match="corners has 3 places; expected four, or none"):
        replace(sheet, corners=((0, 0), (0, 1), (1, 1)))
    with pytest.raises(InputError, match="counterclockwise"):
        replace(sheet, corners=((0, 0), (0, 1), (1, 1), (1, 0)))
    with pytest.raises(InputError, match="corners is 3; expected four places"):
        replace(sheet, corners=3)
