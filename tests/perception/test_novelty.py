"""How unlike an image is to those of the training: by the scan's steps, the picture beside the mask, and lids."""

import numpy as np
import pytest

import millisight as ms
from helpers.mirrors import DEVICES, GRID, capture_of, mirror, points, raster
from millisight.core import SPEED_OF_LIGHT
from millisight.perception import HIGH_BAND, LOW_BAND
from millisight.perception.classification import beside_db, lid_likeness, novelty

LIMIT = 0.4


def told(steps=(), frequency=None):
    """Metadata of an image whose scan had these steps [m]."""
    history = [{"step": "form_image", "steps": list(steps), **({"frequency": frequency} if frequency else {})}]
    return {"history": history if steps else []}


def blob(metadata=None, floor=1e-3, strength=1.0):
    """A bright rectangle, the median magnitude beside it `floor` of that within."""
    axis = np.arange(-0.1, 0.1001, 0.004)
    grid = ms.VoxelGrid(x=axis, y=axis, z=np.array([-0.25]))
    inside = np.outer(abs(axis) < 0.03, abs(axis) < 0.02)
    values = strength * np.where(inside, 1.0, floor)[..., None]
    return ms.SarImage(grid=grid, values=values, metadata=metadata or {}), ms.Mask(grid_xy=grid.xy, inside=inside)


def score(image, mask, *, other=None, by_network=0.05):
    return novelty(image, mask, other_band=other, cleaned=image, by_network=by_network, limit=LIMIT)


def test_the_network_alone_decides_where_nothing_else_speaks():
    for by_network in (0.0, 0.1, LIMIT, 0.41, 1.0):
        found, reasons = score(*blob(told((0.001, 0.002))), by_network=by_network)
        assert found == by_network
        assert reasons == (("unlike anything it was trained on",) if by_network > LIMIT else ())


@pytest.mark.parametrize(("frequency", "band"), [(77e9, 77e9), (None, HIGH_BAND)])
def test_the_widest_step_counts_in_wavelengths(frequency, band):
    wavelength = SPEED_OF_LIGHT / band
    scores = []
    for steps in ((0.85, 0.2), (0.3, 1.0), (1.1,), (1.3, 0.5), (0.5, 1.95), (3.0, 3.0)):
        image, mask = blob(told([wavelength * step for step in steps], frequency))
        found, reasons = score(image, mask, by_network=0.0)
        scores.append(found)
        if found > LIMIT + 1e-9:
            assert reasons == (f"the scan is too sparse: steps of {max(steps):.1f} wavelengths",)
    assert scores == sorted(scores)
    assert [scores[i] for i in (0, 2, 5)] == pytest.approx([0, LIMIT, 1])


def test_the_other_bands_scan_counts_in_its_own_wavelengths():
    fine, mask = blob(told((0.001, 0.001)))
    for steps, refused in (((0.006, 0.006), False), ((0.018, 0.006), True)):
        other, _ = blob(told(steps))
        found, reasons = score(fine, mask, other=other)
        assert (found > LIMIT) == bool(reasons) == refused
        if refused:
            assert f"{0.018 * LOW_BAND / SPEED_OF_LIGHT:.1f} wavelengths" in reasons[0]


def test_an_unknown_scan_is_told_by_what_lies_beside_the_mask():
    found = []
    for floor_db in (-40, -30, -21, -15, -10, -3):
        image, mask = blob(floor=10 ** (floor_db / 20))
        assert beside_db(image, mask) == pytest.approx(floor_db)
        found.append(score(image, mask, by_network=0.0)[0])
    assert found == sorted(found)
    assert found[2] == 0 < found[3] < LIMIT < found[4]
    assert "bright beside the mask" in score(*blob(floor=0.5))[1][0]
    assert score(*blob(told((0.001,)), floor=0.5)) == (0.05, ())  # its steps are known
    assert beside_db(*blob(floor=0.1, strength=1e-12)) == pytest.approx(-20)
    image, mask = blob()
    assert beside_db(image, ms.Mask(grid_xy=mask.grid_xy, inside=~mask.inside | mask.inside)) == -np.inf


@pytest.fixture(scope="module")
def carton():
    """A lid of 11 cm over a few reflectors, in an image of 20 cm."""
    path = raster()
    sides = [(axis, sign * -0.055, sign) for axis in (0, 1) for sign in (1, -1)]
    frames = mirror(DEVICES["77 GHz"], path, -0.2, sides=sides) + points(DEVICES["77 GHz"], path, strength=0.01)
    return ms.form_image(capture_of(DEVICES["77 GHz"], path, frames), GRID, tolerance=0.02)


def square(grid, half):
    inside = np.outer(abs(grid.x) < half, abs(grid.y) < half)
    return ms.Mask(grid_xy=grid.xy, inside=inside)


@pytest.mark.slow
def test_a_mask_of_a_lid_is_like_a_lid_until_the_lid_is_known(carton):
    assert carton.steps == pytest.approx((0.0025, 0.0025), abs=2e-6)
    whole = square(carton.grid, 0.055)
    assert lid_likeness(carton, whole) > 0.5
    found, reasons = score(carton, whole)
    assert found > LIMIT
    assert reasons == ("the mask looks like a lid, or like the flat top of something large",)
    assert lid_likeness(carton, square(carton.grid, 0.02)) == lid_likeness(carton, square(carton.grid, 0.099)) == 0
    without = ms.imaging.remove_sheets(carton, clutter="lid").result
    assert without is not carton
    assert lid_likeness(without, whole) == 0
    scaled = ms.SarImage(grid=carton.grid, values=1e-9 * carton.values, metadata=carton.metadata)
    assert lid_likeness(scaled, whole) == pytest.approx(lid_likeness(carton, whole), rel=1e-3)
