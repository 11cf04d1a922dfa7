"""Ghosts of steps that are too far apart, against images of reflectors by the imager."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import label

import millisight as ms
from helpers.oracles import point_frames
from millisight.perception.segmentation import _ghosts

pytestmark = pytest.mark.slow

STEP = 0.0025  # as the published pace: 0.67 wavelengths
BOXES = {"near": ((-0.01, 0.01), (-0.03, 0.01)), "far": ((-0.01, 0.01), (0.04, 0.06))}  # of reflectors, along x and y


@cache
def image_of(start=77.5e9, bandwidth=3e9, spacing=(0.0025, 0.0025, 0.01), step=STEP):
    """Two plates of reflectors 27 and 29 cm below a scan whose positions are `step` apart along y."""
    samples = 24
    radar = ms.Radar(
        name="test",
        waveform=ms.Waveform.stepped(start, bandwidth / samples, samples),
        array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=[[0, 0, 0]]),
    )
    x, y = np.arange(-0.02, 0.0201, 0.002), np.arange(-0.12, 0.1201, step)
    positions = np.stack([np.repeat(x, len(y)), np.tile(y, len(x)), np.zeros(len(x) * len(y))], axis=1)
    path = ms.Trajectory(times=np.arange(float(len(positions))), positions=positions)
    rng = np.random.default_rng(3)
    reflectors = np.concatenate(
        [
            np.column_stack([*(rng.uniform(*side, 40) for side in sides), np.full(40, height)])
            for sides, height in zip(BOXES.values(), (-0.27, -0.29), strict=True)
        ]
    )
    tx, rx = (path.placed(a) for a in (radar.array.tx_positions, radar.array.rx_positions))
    frames = point_frames(reflectors, np.ones(len(reflectors)), tx, rx, radar.waveform.frequencies)
    grid = ms.VoxelGrid.regular((-0.03, -0.28, -0.35), (0.03, 0.28, -0.15), spacing)
    capture = ms.Capture(radar=radar, trajectory=path, frames=frames)
    return ms.form_image(capture, grid, method="backprojection", tolerance=0.02)


def mask_of(image, below_db=20):
    """What is bright: the reflectors, and their ghosts; parts of a few pixels left out."""
    level = image.magnitude.max(axis=2)
    parts, _ = label(level > level.max() / 10 ** (below_db / 20), structure=np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return (sizes >= 8)[parts]


def without_ghosts(mask, image):
    (left,) = _ghosts.without_ghosts([mask], image)
    return left


def on_plates(image):
    """(X, Y) where the plates are, and 2.5 cm around them."""
    found, grid = np.zeros(image.grid.shape[:2], bool), image.grid
    for (left, right), (front, back) in BOXES.values():
        along_x = (grid.x > left - 0.025) & (grid.x < right + 0.025)
        found |= along_x[:, None] & (grid.y > front - 0.025) & (grid.y < back + 0.025)
    return found


def test_ghosts_are_left_out_and_reflectors_stay():
    image = image_of()
    mask, plates = mask_of(image), on_plates(image)
    assert (mask & ~plates).sum() > 100, "this scan has ghosts"
    left = without_ghosts(mask, image)
    assert not (left & ~plates).any()
    np.testing.assert_array_equal(left & plates, mask & plates)


@pytest.mark.parametrize("change", [np.conj, lambda values: values.astype(np.complex128)], ids=["conjugate", "double"])
def test_the_sign_of_the_phases_and_the_precision_do_not_matter(change):
    image = image_of()
    other = dataclasses.replace(image, values=change(image.values))
    np.testing.assert_array_equal(without_ghosts(mask_of(image), other), without_ghosts(mask_of(image), image))


def test_a_ghost_that_outshines_the_reflectors_is_left_out():
    image = image_of()
    mask, plates = mask_of(image), on_plates(image)
    louder = dataclasses.replace(image, values=np.where(plates[..., None], image.values, 1.7 * image.values))
    level = louder.magnitude.max(axis=2)
    ghosts = mask & ~plates & (level > 0.6 * level[mask & ~plates].max())  # a mask holds the brightest of them
    mask = (mask & plates) | ghosts
    assert louder.magnitude[ghosts].max() > louder.magnitude[plates].max()
    left = without_ghosts(mask, louder)
    assert not (left & ghosts).any()
    np.testing.assert_array_equal(left & plates, mask & plates)


def test_where_the_scan_is_dense_nothing_is_left_out():
    image = image_of(step=0.00125)
    mask = mask_of(image)
    assert label(mask)[1] >= 2
    np.testing.assert_array_equal(without_ghosts(mask, image), mask)


def magnitudes(image):
    return dataclasses.replace(image, values=image.magnitude.astype(np.complex64))


def noise(image):
    rng = np.random.default_rng(0)
    values = rng.standard_normal((*image.values.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    return dataclasses.replace(image, values=values)


def uneven(image):
    grid = dataclasses.replace(image.grid, z=image.grid.z + 0.002 * (np.arange(len(image.grid.z)) % 2))
    return dataclasses.replace(image, grid=grid)


def thin(image):
    return ms.SarImage(grid=dataclasses.replace(image.grid, z=image.grid.z[:3]), values=image.values[:, :, :3])


@pytest.mark.parametrize("without_phases", [magnitudes, noise, uneven, thin])
def test_images_that_do_not_tell_keep_all_parts(without_phases):
    mask = mask_of(image_of())
    np.testing.assert_array_equal(without_ghosts(mask, without_phases(image_of())), mask)


def test_another_band_keeps_all_parts():
    image = image_of(start=24e9, bandwidth=0.25e9)
    mask = mask_of(image_of())
    np.testing.assert_array_equal(without_ghosts(mask, image), mask)


def test_one_part_and_none_stay_as_they_are():
    image = image_of()
    ghost = mask_of(image) & ~on_plates(image)
    one = label(ghost, structure=np.ones((3, 3)))[0] == 1
    for mask in (one, np.zeros_like(one)):
        np.testing.assert_array_equal(without_ghosts(mask, image), mask)


def test_ghosts_alone_stay():
    """No part is surely a reflector, so that nothing tells that the image's phases are what they should be."""
    image = image_of()
    ghosts = mask_of(image) & ~on_plates(image)
    assert label(ghosts, structure=np.ones((3, 3)))[1] >= 2
    np.testing.assert_array_equal(without_ghosts(ghosts, image), ghosts)
