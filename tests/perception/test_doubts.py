"""What speaks against a mask: it is told where it holds, and not elsewhere."""

import dataclasses

import numpy as np
import pytest

import millisight as ms
from helpers.mirrors import DEVICES, GRID, capture_of, mirror, points, raster
from millisight.perception.segmentation import doubts_of

RADAR = DEVICES["77 GHz"]


def mask_of(grid, low, high):
    inside = ((grid.x >= low[0]) & (grid.x <= high[0]))[:, None] & ((grid.y >= low[1]) & (grid.y <= high[1]))
    return ms.Mask(grid_xy=grid.xy, inside=inside)


@pytest.fixture(scope="module")
def carton():
    """A lid of 11 cm over a few reflectors, in an image of 20 cm."""
    path = raster()
    sides = [(axis, sign * -0.055, sign) for axis in (0, 1) for sign in (1, -1)]
    frames = mirror(RADAR, path, -0.2, sides=sides) + points(RADAR, path, strength=0.002)
    return ms.form_image(capture_of(RADAR, path, frames), GRID, tolerance=0.02)


@pytest.mark.slow
def test_a_mask_of_a_lid_is_doubted_unless_the_lid_was_known(carton):
    whole = mask_of(carton.grid, (-0.055, -0.055), (0.055, 0.055))
    (doubt,) = doubts_of(whole, carton)
    assert "a lid or the top of a box" in doubt
    assert "nlos" in doubt
    assert doubts_of(whole, carton, covered=True) == ()
    assert doubts_of(mask_of(carton.grid, (-0.02, -0.02), (0.02, 0.02)), carton) == ()


def test_a_mask_at_the_edge_of_the_picture_may_be_a_part(carton):
    edge = carton.grid.x[-1]
    (doubt,) = doubts_of(mask_of(carton.grid, (edge - 0.02, -0.02), (edge, 0.02)), carton)
    assert "runs to the edge" in doubt
    assert doubts_of(mask_of(carton.grid, (edge - 0.02, -0.02), (edge - 0.004, 0.02)), carton) == ()


def test_what_fills_the_picture_and_is_left_out_may_be_the_object(carton):
    x, y = (abs(axis) < 0.05 for axis in (carton.grid.x, carton.grid.y))
    close = ms.VoxelGrid(x=carton.grid.x[x], y=carton.grid.y[y], z=carton.grid.z)
    filled = ms.SarImage(grid=close, values=carton.values[x][:, y], metadata=carton.metadata)
    (doubt,) = doubts_of(mask_of(close, (0.02, 0.02), (0.04, 0.04)), filled)
    assert "% of the echo lies outside the mask" in doubt
    assert "image a few centimetres more around it" in doubt
    assert doubts_of(mask_of(close, (0.02, 0.02), (0.04, 0.04)), filled, covered=True) == ()
    assert doubts_of(mask_of(close, (-0.04, -0.04), (0.04, 0.04)), filled) == ()


def test_a_carton_at_24_ghz_alone_may_be_empty(carton):
    some = mask_of(carton.grid, (-0.02, -0.02), (0.02, 0.02))
    # Echoes as long along z as the picture is deep.
    flat = dataclasses.replace(
        carton, values=np.repeat(carton.values.max(axis=2, keepdims=True), len(carton.grid.z), axis=2)
    )
    (doubt,) = doubts_of(some, flat, covered=True)
    assert "an empty carton from a full one" in doubt
    assert doubts_of(some, flat) == ()


def test_nothing_and_one_row_are_not_doubted(carton):
    assert doubts_of(ms.Mask(grid_xy=carton.grid.xy, inside=np.zeros(carton.grid.shape[:2], bool)), carton) == ()
    row = ms.VoxelGrid(x=carton.grid.x[:1], y=carton.grid.y, z=carton.grid.z)
    image = ms.SarImage(grid=row, values=carton.values[:1])
    assert doubts_of(ms.Mask(grid_xy=row.xy, inside=np.ones(row.shape[:2], bool)), image) == ()
