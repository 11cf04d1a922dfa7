"""What the classifiers look at: alike whatever the spacing, the strength and the place of an image."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import PixelGrid
from millisight.perception import run_network
from millisight.perception.classification import (
    CLASSIFIER_CHANNELS,
    CLASSIFIER_SIDE,
    _network,
    classifier_input,
    square_symmetries,
)
from millisight.perception.classification._network import MAGNITUDE, SLICES, THICKNESS


def blob(*, spacing=0.004, at=(0.0, 0.0, -0.25), size=(0.06, 0.03), strength=1.0, box=0.12):
    """An image of a soft rectangle, thin along z, and its mask."""
    axes = [c + np.arange(-half, half + spacing / 2, spacing) for c, half in zip(at, (box, box, 0.1), strict=True)]
    x, y, z = np.meshgrid(*(axis - c for axis, c in zip(axes, at, strict=True)), indexing="ij")
    inside = (abs(x[..., 0]) < size[0]) & (abs(y[..., 0]) < size[1])
    values = strength * inside[..., None] * np.exp(-((z / 0.012) ** 2)) * (1.5 + np.cos(x / 0.02))
    grid = ms.VoxelGrid(x=axes[0], y=axes[1], z=axes[2])
    return ms.SarImage(grid=grid, values=values), ms.Mask(grid_xy=grid.xy, inside=inside)


def test_the_object_is_in_the_middle_at_its_true_size():
    image, mask = blob(at=(0.05, -0.02, -0.3))
    channels = classifier_input(image, mask)
    assert channels.shape == (len(CLASSIFIER_CHANNELS), CLASSIFIER_SIDE, CLASSIFIER_SIDE) == (4 + SLICES + 1, 80, 80)
    assert channels.dtype == np.float32
    assert (channels.min(), channels.max()) == (0, 1)
    assert channels[0].sum() * 0.004**2 == pytest.approx(0.12 * 0.06, rel=0.05)
    middle = [np.arange(CLASSIFIER_SIDE) @ channels[0].sum(axis=1 - axis) / channels[0].sum() for axis in (0, 1)]
    np.testing.assert_allclose(middle, (CLASSIFIER_SIDE - 1) / 2, atol=0.6)
    assert channels[-2:].max() == 0  # no other band
    assert not channels[:, channels[0] == 0].any()


def test_neither_place_nor_strength_nor_spacing_matters():
    one = classifier_input(*blob())
    np.testing.assert_allclose(classifier_input(*blob(strength=1e-19)), one, atol=1e-5)
    np.testing.assert_allclose(classifier_input(*blob(strength=1e14)), one, atol=1e-5)
    np.testing.assert_allclose(classifier_input(*blob(at=(0.04, 0.04, -0.31))), one, atol=1e-4)
    finer = classifier_input(*blob(spacing=0.002))
    larger = classifier_input(*blob(size=(0.09, 0.03)))
    assert abs(finer - one).mean() < 0.3 * abs(larger - one).mean()


def test_slices_lie_about_the_middle_of_the_power():
    image, mask = blob()
    channels = classifier_input(image, mask)
    heights = channels[3 : 3 + SLICES].max(axis=(1, 2))
    np.testing.assert_allclose(heights, heights[::-1], atol=0.05)
    assert heights.argmax() in (SLICES // 2 - 1, SLICES // 2)
    assert pytest.approx(0.16) == SLICES * THICKNESS
    assert channels[MAGNITUDE].max() == 1
    assert (channels[MAGNITUDE] == 1).sum() > 20  # clipped at 80 % of the maximum


def test_the_other_band_is_masked_too():
    image, mask = blob()
    other = ms.SarImage(grid=image.grid, values=np.ones(image.grid.shape))
    channels = classifier_input(image, mask, other_band=other)
    np.testing.assert_array_equal(channels[-1], channels[0])
    assert channels[-2].max() == 1
    assert not channels[-2][channels[0] == 0].any()


def test_every_second_view_is_without_the_other_band(monkeypatch):
    pytest.importorskip("onnxruntime")
    image, mask = blob()
    other = ms.SarImage(grid=image.grid, values=np.ones(image.grid.shape))
    seen = []

    def looked(session, views):
        seen.append(views)
        return run_network(session, views)

    monkeypatch.setattr(_network, "run_network", looked)
    both = ms.classify(image, mask, other_band=other)
    alone = ms.classify(image, mask)
    assert [one[:, -2:].any(axis=(1, 2, 3)).tolist() for one in seen] == [4 * [True, False], 8 * [False]]
    np.testing.assert_array_equal(seen[0][:, :-2], seen[1][:, :-2])
    assert (both.probabilities != alone.probabilities).any()


def test_an_object_beyond_the_pixels_is_seen_in_part():
    image, mask = blob(size=(0.3, 0.03), box=0.35)
    channels = classifier_input(image, mask)
    assert channels[0].any(axis=1).all()


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (lambda image, mask: (image, ms.Mask(grid_xy=mask.grid_xy, inside=~mask.inside & False)), "the mask is empty"),
        (
            lambda image, mask: (
                image,
                ms.Mask(grid_xy=PixelGrid(x=mask.grid_xy.x + 0.01, y=mask.grid_xy.y), inside=mask.inside),
            ),
            "expected one grid",
        ),
        (lambda image, mask: (ms.SarImage(grid=image.grid, values=0 * image.values), mask), "0 everywhere under"),
    ],
)
def test_what_cannot_be_classified(broken, told):
    with pytest.raises(InputError, match=told):
        classifier_input(*broken(*blob()))


def test_an_other_band_elsewhere_is_refused():
    image, mask = blob()
    elsewhere, _ = blob(at=(3.0, 0.0, -0.25))
    with pytest.raises(InputError, match="the other band is 0 under the mask"):
        classifier_input(image, mask, other_band=elsewhere)


def test_a_square_is_laid_onto_itself_in_eight_ways():
    channels = np.random.default_rng(0).random((2, 5, 5), dtype=np.float32)
    ways = square_symmetries(channels)
    assert ways.shape == (8, 2, 5, 5)
    assert len({way.tobytes() for way in ways}) == 8
    np.testing.assert_array_equal(ways[0], channels)
    for way in ways:
        np.testing.assert_array_equal(np.sort(way.ravel()), np.sort(channels.ravel()))
        np.testing.assert_array_equal(way[:, 2, 2], channels[:, 2, 2])
