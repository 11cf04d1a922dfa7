"""The random walker with priors: against a dense solution, and on pictures whose answer is known."""

import time

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.perception import power_prompts, project
from millisight.perception.segmentation import ClassicalSegmenter, chosen, largest_share, segmenter
from millisight.perception.segmentation import _classical as classical


def picture(power):
    power = np.asarray(power, dtype=float)
    a, b = power.shape
    grid = ms.VoxelGrid(x=np.arange(a) * 0.0025, y=np.arange(b) * 0.0025, z=[0.0])
    return project(ms.SarImage(grid=grid, values=(power + 0j)[..., None]))


def disc(a, b, at, radius):
    i, j = np.mgrid[:a, :b]
    return (i - at[0]) ** 2 + (j - at[1]) ** 2 <= radius**2


def overlap(found, truth):
    """F1."""
    return 2 * (found & truth).sum() / (found.sum() + truth.sum())


def test_probabilities_solve_the_walker_s_equation():
    """The sparse solution against NumPy's of (L + g) x = g p with the seeds' rows replaced."""
    rng = np.random.default_rng(0)
    a, b = 5, 4
    values, prior = rng.random((a, b, 1)), rng.random((a, b))
    labels = np.full((a, b), -1, np.int8)
    labels[0, 1], labels[4, 2], labels[2, 2] = 1, 0, 1
    conductances = classical._conductances(values, 0.5)
    matrix, right = np.zeros((a * b, a * b)), np.zeros(a * b)
    for i in range(a):
        for j in range(b):
            row = i * b + j
            if labels[i, j] >= 0:
                matrix[row, row], right[row] = 1, labels[i, j]
                continue
            matrix[row, row] = classical._PULL
            right[row] = classical._PULL * prior[i, j]
            for k, m in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                if 0 <= k < a and 0 <= m < b:
                    weight = np.exp(-classical._BETA / 0.5 * (values[i, j, 0] - values[k, m, 0]) ** 2)
                    matrix[row, row] += weight
                    matrix[row, k * b + m] -= weight
    expected = np.linalg.solve(matrix, right).reshape(a, b)
    assert np.ptp(expected) > 0.5
    np.testing.assert_allclose(classical._walked(conductances, labels, prior), expected, atol=1e-4)


def test_a_bright_disc_on_speckle_is_found_from_power_prompts():
    rng = np.random.default_rng(1)
    truth = disc(90, 70, (40, 30), 15)
    speckle = np.abs(rng.normal(size=(90, 70)) + 1j * rng.normal(size=(90, 70)))
    one = picture(np.where(truth, 1, 0.02) * speckle)
    found = ClassicalSegmenter().segment(one, power_prompts(one, rng=0))
    assert found.masks.shape == (4, 90, 70)
    assert (np.diff(found.scores) <= 0).all()
    assert overlap(found.masks[0], truth) > 0.95


def test_a_glow_over_most_of_the_picture_is_passed_over_for_what_is_brighter():
    """As behind a carton: its reflection covers the picture's middle, and the object is brighter still."""
    truth = disc(100, 100, (50, 50), 20)
    glow = np.zeros((100, 100), bool)
    glow[5:-5, 5:-5] = True
    power = np.where(truth, 1.0, np.where(glow, 0.15, 0.005)) * (1 + 0.05 * np.sin(np.arange(100)))
    one = picture(power)
    found = ClassicalSegmenter().segment(one, power_prompts(one, rng=0))
    assert found.masks.mean(axis=(1, 2)).max() > 0.8  # the glow is among what is offered
    best = chosen(found, largest=largest_share(one))
    assert best is not None
    assert overlap(best, truth) > 0.95


def test_prompts_decide_between_two_equal_discs():
    left, right = disc(60, 90, (30, 20), 10), disc(60, 90, (30, 70), 10)
    one = picture(np.where(left | right, 1.0, 0.01))
    both = Prompts(points=[[30, 20], [30, 70], [5, 45]], positive=[True, True, False])
    assert overlap(ClassicalSegmenter().segment(one, both).masks[0], left | right) > 0.98


def test_prompts_are_in_the_mask_or_out_of_it():
    rng = np.random.default_rng(2)
    one = picture(rng.random((30, 40)))
    points = rng.permutation(np.argwhere(np.ones((30, 40))))[:40]
    prompts = Prompts(points=points, positive=rng.random(40) < 0.5)
    for mask in ClassicalSegmenter().segment(one, prompts).masks:
        np.testing.assert_array_equal(mask[tuple(prompts.points.T)], prompts.positive)


def test_holes_are_filled_but_for_those_that_were_clicked():
    ring = disc(60, 60, (30, 30), 20) & ~disc(60, 60, (30, 30), 8)
    one = picture(np.where(ring, 1.0, 0.01))
    on_ring, outside, in_hole = [15, 30], [2, 2], [30, 30]
    plain = ClassicalSegmenter().segment(one, Prompts(points=[on_ring, outside], positive=[True, False]))
    clicked = Prompts(points=[on_ring, outside, in_hole], positive=[True, False, False])
    kept = ClassicalSegmenter().segment(one, clicked)
    assert plain.masks[0][30, 30]
    assert not kept.masks[0][30, 30]
    assert overlap(kept.masks[0], ring) > 0.98


def test_without_negative_prompts_the_rim_is_taken():
    truth = disc(60, 60, (30, 30), 12)
    one = picture(np.where(truth, 1.0, 0.05))
    found = ClassicalSegmenter().segment(one, Prompts(points=[[30, 30]], positive=[True]))
    assert overlap(found.masks[0], truth) > 0.98


def test_photos_are_parted_by_colour():
    truth = disc(60, 80, (25, 50), 14)
    rng = np.random.default_rng(3)
    rgb = np.where(truth[..., None], [200, 40, 40], [60, 60, 160]) + rng.integers(-20, 20, (60, 80, 3))
    photo = Picture(rgb=rgb.astype(np.uint8))
    found = ClassicalSegmenter().segment(photo, Prompts(points=[[25, 50], [5, 5]], positive=[True, False]))
    assert overlap(found.masks[0], truth) > 0.98


def test_turning_the_picture_turns_the_mask():
    rng = np.random.default_rng(4)
    power = rng.random((31, 24))
    prompts = Prompts(points=[[3, 4], [20, 10]], positive=[True, False])
    turned = Prompts(points=prompts.points[:, ::-1], positive=prompts.positive)
    a = ClassicalSegmenter().segment(picture(power), prompts).masks
    b = ClassicalSegmenter().segment(picture(power.T), turned).masks
    assert a.any()
    np.testing.assert_array_equal(a, b.transpose(0, 2, 1))


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1)])
def test_pictures_of_few_pixels(shape):
    one = picture(np.linspace(0.1, 1, np.prod(shape)).reshape(shape))
    found = ClassicalSegmenter().segment(one, Prompts(points=[[shape[0] - 1, shape[1] - 1]], positive=[True]))
    assert found.masks.shape == (4, *shape)


def test_a_picture_of_one_brightness_is_all_object():
    found = ClassicalSegmenter().segment(picture(np.ones((9, 8))), Prompts(points=[[4, 4]], positive=[True]))
    assert found.masks.all()
    assert not found.scores.any()


def test_it_needs_a_positive_prompt_on_the_picture():
    one = picture(np.eye(5))
    for prompts in (None, Prompts(points=[[1, 1]], positive=[False])):
        with pytest.raises(InputError, match="at least one positive"):
            segmenter("classical").segment(one, prompts)
    with pytest.raises(InputError, match="5 x 5 pixels"):
        segmenter("classical").segment(one, Prompts(points=[[1, 5]], positive=[True]))


def test_a_full_size_image_takes_less_than_a_second():
    rng = np.random.default_rng(5)
    truth = disc(220, 240, (100, 120), 30)
    one = picture(np.where(truth, 1, 0.02) * rng.rayleigh(size=(220, 240)))
    prompts = power_prompts(one, rng=0)
    took = []
    for _ in range(3):  # the first one imports, and others may want the cores
        started = time.process_time()
        found = ClassicalSegmenter().segment(one, prompts)
        took.append(time.process_time() - started)
    assert min(took) < 1
    assert overlap(found.masks[0], truth) > 0.95
