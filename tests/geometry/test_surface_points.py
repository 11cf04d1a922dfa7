"""Oriented points of mirrors, against their closed forms; weighted images against sums over antennas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

import millisight as ms
from helpers import solid_mirrors
from millisight.core import SPEED_OF_LIGHT
from millisight.core.errors import InputError, UnknownNameError
from millisight.geometry._moments import weighted_images

GRID = ms.VoxelGrid.regular((-0.03, -0.03, -0.27), (0.03, 0.03, -0.235), (0.002, 0.002, 0.0035))
FOOT = np.array([0, 0, -0.25])
PAIR = ms.AntennaArray(
    tx_positions=[[0, 0, 0], [0.004, 0, 0]], rx_positions=[[-0.02, 0, 0], [-0.018, 0, 0], [-0.016, 0.002, 0]]
)


def angle_deg(one, other):
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=1), -1, 1)))


def unthresholded(capture, grid=GRID, **settings):
    """All points: mirrors without an end leave no voxel free, and so no noise to measure."""
    return ms.surface_points(capture, grid, false_alarms=0.999, **settings)


def shining(points, normals, within):
    """Whether the ray back from a point meets the plane of the antennas within so far of their middle along x and y."""
    meet = points - normals * (points[:, 2] / normals[:, 2])[:, None]
    return np.abs(meet[:, :2]).max(axis=1) < within


@pytest.mark.slow
@pytest.mark.parametrize(
    ("paths", "radius", "axes"),
    [
        (solid_mirrors.ball(0.05), 0.05, [1, 1, 1]),
        (solid_mirrors.rod(0.03), 0.03, [0, 1, 1]),
        (solid_mirrors.bowl(0.05), -0.05, [1, 1, 1]),  # seen from inside
    ],
    ids=["sphere", "cylinder", "inside of a cup"],
)
def test_round_mirrors_have_their_place_and_normals(paths, radius, axes):
    found = unthresholded(solid_mirrors.capture_of(paths, noise=0.1), window="hann")
    across = (found.points - [0, 0, -0.25 - radius]) * axes * np.sign(radius)
    away = np.linalg.norm(across, axis=1)
    truth = across / away[:, None]
    seen = shining(found.points, truth, 0.06)
    assert seen.sum() > 40
    assert np.percentile(np.abs(away - abs(radius))[seen], 95) < 1e-3
    errors = angle_deg(found.normals, truth)[seen]
    assert np.median(errors) < 1
    assert np.percentile(errors, 90) < 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("array", "window"), [(None, "taylor"), (PAIR, "hann")], ids=["one antenna, taylor", "TX and RX apart, hann"]
)
def test_a_plane_has_its_place_and_normal(array, window):
    found = unthresholded(solid_mirrors.capture_of(solid_mirrors.plane(), array, noise=0.02), window=window)
    tilt = np.radians(solid_mirrors.PLANE_TILT_DEG)
    truth = np.array([[np.sin(tilt), 0, np.cos(tilt)]])
    seen = shining(found.points, np.broadcast_to(truth, found.points.shape), 0.06)
    assert seen.sum() > 500
    assert np.percentile(np.abs((found.points - FOOT) @ truth[0])[seen], 95) < 1e-3
    assert np.percentile(angle_deg(found.normals, truth)[seen], 95) < 1


@pytest.mark.slow
def test_a_phase_of_the_other_sign_has_no_such_plane():
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), noise=0.1)
    found = unthresholded(replace(capture, frames=capture.frames.conj()))
    assert len(found) < 500


@pytest.mark.slow
def test_places_do_not_depend_on_where_the_world_begins():
    shift = np.array([100.0, -50.0, 20.0])
    here = unthresholded(solid_mirrors.capture_of(solid_mirrors.plane(), size=0.16))
    grid = ms.VoxelGrid(x=GRID.x + shift[0], y=GRID.y + shift[1], z=GRID.z + shift[2])
    there = unthresholded(solid_mirrors.capture_of(solid_mirrors.plane(), size=0.16, shift=shift), grid)
    assert len(here) > 300
    assert abs(len(there) - len(here)) < 0.02 * len(here)
    away, nearest = KDTree(here.points).query(there.points - shift)
    assert np.percentile(away, 95) < 1e-4
    assert np.percentile(angle_deg(there.normals, here.normals[nearest]), 95) < 0.1


def test_weighted_images_are_the_sums_over_antennas():
    """mmNorm's sum of (antenna - voxel) Re(contribution conj(image)) / |image|, channel by channel in float64."""
    rng = np.random.default_rng(3)
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), PAIR, size=0.03, step=0.005, noise=0.5)
    grid = ms.VoxelGrid.regular((-0.01, -0.01, -0.26), (0.01, 0.01, -0.24), 0.01)
    moved = ms.Trajectory(
        times=capture.trajectory.times,
        positions=capture.trajectory.positions + rng.normal(0, 0.002, (len(capture.trajectory), 3)),
    )
    capture = replace(capture, trajectory=moved)
    made = weighted_images(capture, grid, method="exact", window=(None, None))
    # The images count places from the grid's middle.
    origin = grid.bounds.mean(axis=0)
    points, frequencies = grid.points, capture.radar.waveform.frequencies
    sums = np.zeros((len(points), 3))
    image = np.zeros(len(points), complex)
    tx, rx = capture.tx_positions, capture.rx_positions
    shares = []
    for p in range(len(capture.trajectory)):
        for t in range(tx.shape[1]):
            for r in range(rx.shape[1]):
                way = np.linalg.norm(points - tx[p, t], axis=1) + np.linalg.norm(points - rx[p, r], axis=1)
                turn = np.exp(2j * np.pi / SPEED_OF_LIGHT * np.outer(way, frequencies))
                shares.append(((tx[p, t] + rx[p, r]) / 2, turn @ capture.frames[p, t, r].astype(complex)))
                image += shares[-1][1]
    for place, share in shares:
        sums += (place - points) * (share * image.conj()).real[:, None] / np.abs(image)[:, None]
    count = capture.channels * len(frequencies)
    values = made.values.reshape(-1).astype(complex)
    ours = np.empty_like(sums)
    for k, weighted in enumerate(made.by_place):
        about = weighted.reshape(-1) - (points[:, k] - origin[k]) * values
        ours[:, k] = (about * values.conj()).real / np.abs(values)
    assert np.linalg.norm(ours - sums / count) < 1e-4 * np.linalg.norm(sums / count)


def test_the_told_deviation_is_that_of_the_places():
    """With noise alone in the way, over many points."""
    found = unthresholded(solid_mirrors.capture_of(solid_mirrors.plane(), size=0.12, noise=4.0, step=0.004))
    tilt = np.radians(solid_mirrors.PLANE_TILT_DEG)
    normal = np.array([np.sin(tilt), 0, np.cos(tilt)])
    error = (found.points - FOOT) @ normal
    assert len(found) > 300
    assert 0.3 < np.sqrt(np.mean((error / found.place_sigma) ** 2)) < 3


def test_noise_alone_has_no_points():
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), size=0.06)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=capture.frames.shape) + 1j * rng.normal(size=capture.frames.shape)
    found = ms.surface_points(replace(capture, frames=noise.astype(np.complex64)), GRID)
    assert len(found) == 0
    assert found.normals.shape == (0, 3)
    assert found.metadata["history"][-1]["step"] == "surface_points"


def test_nothing_at_all_has_no_points():
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), size=0.03)
    assert len(ms.surface_points(replace(capture, frames=0 * capture.frames), GRID)) == 0


def test_of_an_image_alone_a_plane_is_found():
    image = ms.form_image(solid_mirrors.capture_of(solid_mirrors.plane(), noise=0.02), GRID, window="taylor")
    found = ms.surface_points(image, false_alarms=0.999)
    tilt = np.radians(solid_mirrors.PLANE_TILT_DEG)
    truth = np.array([[np.sin(tilt), 0, np.cos(tilt)]])
    assert len(found) > 300
    assert np.median(np.abs((found.points - FOOT) @ truth[0])) < 8e-3
    assert np.median(angle_deg(found.normals, truth)) < 1


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e12])
def test_of_an_image_alone_its_unit_does_not_matter(scale):
    """Squares of complex64 leave its range: no point was left."""
    image = ms.form_image(solid_mirrors.capture_of(solid_mirrors.plane(), noise=0.02), GRID, window="taylor")
    usual = ms.surface_points(image, false_alarms=0.999)
    found = ms.surface_points(replace(image, values=image.values * scale), false_alarms=0.999)
    assert len(found) == len(usual)
    assert np.abs(found.points - usual.points).max() < 1e-6
    np.testing.assert_allclose(found.magnitude.astype(float) / scale, usual.magnitude, rtol=1e-4)


@pytest.mark.parametrize("between", [-0.4, 0.1, 0.4])
def test_of_an_image_alone_the_top_of_an_echo_is_found_between_voxels(between):
    z = np.arange(-0.30, -0.20, 0.004)
    grid = ms.VoxelGrid(x=np.arange(-0.01, 0.011, 0.002), y=np.arange(-0.01, 0.011, 0.002), z=z)
    top = z[12] + between * 0.004
    values = np.broadcast_to((1 - ((z - top) / 0.03) ** 2) * (0.8 + 0.6j), grid.shape).astype(np.complex64)
    found = ms.surface_points(ms.SarImage(grid=grid, values=values), frequency=79e9, false_alarms=0.999)
    assert len(found) > 20
    assert np.abs(found.points[:, 2] - top).max() < 2e-4


@pytest.mark.slow
def test_of_an_image_alone_a_ball_lies_in_front_of_its_maximum():
    """The loss that the docstring states: millimetres by the echo's delay, centimetres by the maximum."""
    capture = solid_mirrors.capture_of(solid_mirrors.ball(0.05), noise=0.1)
    grid = ms.VoxelGrid.regular((-0.02, -0.02, -0.32), (0.02, 0.02, -0.235), (0.002, 0.002, 0.0035))
    middle = np.array([0, 0, -0.30])
    image = ms.form_image(capture, grid, window="taylor")
    delay, maximum = (
        np.median(np.linalg.norm(found.points - middle, axis=1) - 0.05)
        for found in (unthresholded(capture, grid), ms.surface_points(image, false_alarms=0.999))
    )
    assert abs(delay) < 1e-3
    assert maximum < -5e-3


def one_pose():
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), size=0.03)
    return ms.Capture(
        radar=capture.radar,
        trajectory=ms.Trajectory(times=[0.0], positions=[[0, 0, 0]]),
        frames=capture.frames[:1],
    )


def single_frequency():
    capture = solid_mirrors.capture_of(solid_mirrors.plane(), size=0.03)
    alone = replace(capture.radar, waveform=ms.Waveform.stepped(77.5e9, 1e6, 1))
    return replace(capture, radar=alone, frames=capture.frames[..., :1])


@pytest.mark.parametrize(
    ("source", "settings", "error", "told"),
    [
        (one_pose, {"grid": GRID}, InputError, "1 channels of the capture lie in one place or on one line"),
        (single_frequency, {"grid": GRID}, InputError, "a single frequency"),
        (lambda: solid_mirrors.capture_of(solid_mirrors.plane(), size=0.03), {}, InputError, "pass a grid"),
        (one_pose, {"grid": GRID, "clutter": "roof"}, UnknownNameError, "roof"),
        (one_pose, {"grid": GRID, "false_alarms": 2}, InputError, "a probability under 1"),
        (one_pose, {"grid": GRID, "frequency": 79e9}, InputError, "leave frequency out"),
        (lambda: ms.SarImage.from_array(np.ones((5, 5, 5)), 0.002), {}, InputError, "does not state its frequency"),
        (
            lambda: ms.SarImage.from_array(np.ones((5, 5, 5)), 0.002),
            {"frequency": 79e9}, InputError, "the image is real",
        ),
        (
            lambda: ms.SarImage.from_array(np.ones((5, 5)), 0.002),
            {"frequency": 79e9}, InputError, "5 x 5 x 1 voxels",
        ),
        (lambda: ms.SarImage.from_array(np.ones((5, 5, 5)), 0.002), {"grid": GRID}, InputError, "leave grid out"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(source, settings, error, told):
    with pytest.raises(error, match=told):
        ms.surface_points(source(), **settings)
