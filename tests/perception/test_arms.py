"""Arms that stick out of a mask, and what only seems to be one."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import millisight as ms
from millisight.perception.segmentation._arms import arms_of

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.2, 0.15, 0.03), (0.0025, 0.0025, 0.01))
X, Y = (1e3 * axis for axis in np.meshgrid(GRID.x, GRID.y, indexing="ij"))  # [mm]
BODY = (abs(X - 60) < 25) & (abs(Y - 75) < 20)
ARM = (X >= 85) & (X < 140) & (abs(Y - 75) < 4)


def image_of(*parts, noise=1e-3):
    """Of parts and their amplitudes, in one slice."""
    values = np.full(GRID.shape, 0j)
    values[..., 1] = sum(amplitude * gaussian_filter(part.astype(float), 0.8) for part, amplitude in parts)
    rng = np.random.default_rng(3)
    return ms.SarImage(grid=GRID, values=values + noise * (rng.standard_normal((2, *GRID.shape)).T @ [1, 1j]).T)


@pytest.mark.parametrize("amplitude", [1.0, 0.6, 0.4])
def test_an_arm_is_found_however_bright(amplitude):
    (found,) = arms_of([BODY], image_of((BODY, 1.0), (ARM, amplitude)))
    assert (found & ARM).sum() > 0.75 * ARM.sum()
    assert (found & ~ARM).sum() < 0.25 * ARM.sum()


@pytest.mark.parametrize(
    "part",
    [
        ARM & (X < 97),  # ends too near
        ARM & (X > 100),  # begins too far away
        (X >= 85) & (abs(Y - 75) < 4),  # goes on beyond the picture, as a streak does
        (abs(X - 60) < 45) & (abs(Y - 75) < 40),  # around it
    ],
)
def test_what_is_no_arm(part):
    (found,) = arms_of([BODY], image_of((BODY, 1.0), (part, 0.5)))
    assert part.any()
    assert not found.any()


def test_neither_noise_nor_blur_nor_what_is_too_dim_is_an_arm():
    for image in (
        image_of((BODY, 1.0), noise=0.1),
        image_of((gaussian_filter(BODY.astype(float), 4.0), 1.0)),
        image_of((BODY, 1.0), (ARM, 0.03)),
        image_of((BODY, 1.0), (ARM, 0.2), noise=0.08),
    ):
        (found,) = arms_of([BODY], image)
        assert not found.any()


def test_each_mask_has_its_own():
    masks = [BODY, BODY | ARM, np.zeros_like(BODY)]
    found = arms_of(masks, image_of((BODY, 1.0), (ARM, 0.5)))
    assert [one.any() for one in found] == [True, False, False]


def test_a_single_row_has_none():
    row = ms.VoxelGrid(x=GRID.x[:1], y=GRID.y, z=GRID.z)
    image = ms.SarImage(grid=row, values=image_of((BODY, 1.0)).values[:1])
    (found,) = arms_of([np.ones(row.xy.shape, bool)], image)
    assert not found.any()
