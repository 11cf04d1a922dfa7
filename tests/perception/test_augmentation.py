"""What is done to simulated images before a network sees them: drawn from one generator, and what it says it is."""

import numpy as np
import pytest
from scipy.ndimage import affine_transform

from helpers.whole_scenes import object_parts
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._augmentation_kernels import sampled

DONE = (
    augmentation.moved, augmentation.blurred, augmentation.distorted, augmentation.erased, augmentation.seen_otherwise
)  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return object_parts("dice")


def channels():
    rng = np.random.default_rng(1)
    some = np.zeros((4, 80, 80), np.float32)
    some[0, 20:50, 30:60] = 1
    some[1:] = some[0] * (0.5 + 0.5 * rng.random((3, 80, 80)))
    return some


@pytest.mark.parametrize("step", DONE, ids=lambda step: step.__name__)
def test_one_seed_makes_one_picture(step):
    first, again, other = (step(channels(), np.random.default_rng(seed)) for seed in (3, 3, 5))
    np.testing.assert_array_equal(first, again)
    assert first.shape == channels().shape
    assert not np.array_equal(first, channels())
    assert not np.array_equal(first, other)
    assert np.isfinite(first).all()


def test_moving_keeps_sizes_within_what_is_said():
    sizes = [
        augmentation.moved(channels(), np.random.default_rng(seed))[0].sum() / channels()[0].sum() for seed in range(40)
    ]
    assert 0.85**2 * 0.98 < min(sizes) < 0.85
    assert 1.15 < max(sizes) < 1.15**2 * 1.02


def test_moving_interpolates_as_scipy_does():
    turn, offset = np.array([[0.8, -0.5], [0.6, 0.9]]), np.array([20.3, -9.1])
    some = np.random.default_rng(3).random((3, 40, 50), dtype=np.float32)
    expected = [affine_transform(one, turn, offset, order=1) for one in some]
    np.testing.assert_allclose(sampled(some, turn, offset), expected, atol=1e-6)
    assert (sampled(some, turn, offset) == 0).any()


def test_erasing_takes_a_part_of_the_object_and_no_more():
    shares = []
    for seed in range(40):
        left = augmentation.erased(channels(), np.random.default_rng(seed))
        assert np.array_equal(left[:, left[0] > 0], channels()[:, left[0] > 0])
        shares.append(1 - left[0].sum() / channels()[0].sum())
    assert min(shares) > 0
    assert 0.05 < max(shares) < 0.2
    empty = np.zeros_like(channels())
    assert augmentation.erased(empty, np.random.default_rng(0)) is empty


@pytest.mark.slow
def test_weights_are_the_papers(scene):
    drawn = [augmentation.drawn_gains(np.random.default_rng(seed)) for seed in range(200)]
    assert {"specular", "edge", "plate"} == set(drawn[0])
    assert 0.19 < min(one["specular"] for one in drawn) < max(one["specular"] for one in drawn) <= 1
    assert 0 <= min(one["edge"] for one in drawn) < max(one["edge"] for one in drawn) <= 0.6
    one, two = (augmentation.object_image(scene, "77_ghz", {"specular": a, "edge": b}) for a, b in ((1, 0), (0, 1)))
    assert abs(one).max() == pytest.approx(1, rel=1e-5)
    assert abs(two).max() == pytest.approx(1, rel=1e-5)
    assert abs(abs(one) - abs(two)).max() > 0.2


def test_noise_has_the_strength_that_is_asked_for():
    image = np.zeros((40, 40, 10), np.complex64)
    image[20, 20, 5] = 2j
    noise = np.random.default_rng(0).standard_normal((2, *image.shape), dtype=np.float32)
    noisy = augmentation.with_noise(image, noise, 0.1)
    assert np.std((noisy - image).real) == pytest.approx(0.2, rel=0.02)
    assert np.std((noisy - image).imag) == pytest.approx(0.2, rel=0.02)


def test_echoes_lie_further_down_and_are_weaker():
    image = np.zeros((20, 20, 9), np.complex64)
    image[10, 10, 6] = 1
    for seed in range(20):
        echo = augmentation.echo(image, np.random.default_rng(seed), highest_db=-6, sideways=2)
        (place,) = np.argwhere(echo)
        assert 3 <= place[2] <= 5
        assert abs(place[:2] - 10).max() <= 2
        assert 10 ** (-28 / 20) <= abs(echo).max() <= 10 ** (-6 / 20) + 1e-6


def test_masks_err_in_both_directions_and_are_never_empty():
    inside = np.zeros((60, 60), bool)
    inside[20:40, 25:35] = True
    power = inside * np.random.default_rng(0).random((60, 60)) + 1e-6
    masks = [augmentation.erring_mask(inside, power, np.random.default_rng(seed)) for seed in range(60)]
    sizes = np.array([mask.sum() for mask in masks]) / inside.sum()
    shared = [(mask & inside).sum() / (mask | inside).sum() for mask in masks]
    assert all(mask.any() for mask in masks)
    assert sizes.min() < 0.8 < 1.5 < sizes.max() < 6
    assert 0.5 < np.median(shared) < 0.98


def test_a_mask_of_a_pixel_in_a_corner_errs_and_is_never_empty():
    inside = np.zeros((50, 50), bool)
    inside[0, 0] = True
    masks = [augmentation.erring_mask(inside, np.ones((50, 50)), np.random.default_rng(seed)) for seed in range(400)]
    assert all(mask.any() for mask in masks)


def test_clouds_and_blur_keep_what_they_say():
    clouds = augmentation.clouds((40, 50), np.random.default_rng(0))
    assert clouds.shape == (40, 50)
    assert (clouds.mean(), clouds.std()) == pytest.approx((0, 1), abs=1e-5)
    spot = np.zeros((21, 21), np.float32)
    spot[10, 10] = 1
    blurred = augmentation.blurred_once(spot, 2.0)
    assert blurred.sum() == pytest.approx(1, abs=1e-3)
    assert blurred.max() == blurred[10, 10] < 0.1
