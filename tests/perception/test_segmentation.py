"""The rules that choose a mask, the retry, and `ms.segment`, by segmenters that answer what a test tells them."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Picture, Prompts
from millisight.perception import project
from millisight.perception.segmentation import Candidates, chosen, find_mask, largest_share, segmenter

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.5475, 0.5975, 0.01), (0.0025, 0.0025, 0.01))  # 220 x 240, as published
ASKED = Prompts(points=[[1, 2]], positive=[True])


class Told:
    """Offers masks of the given shares of the picture, and keeps what it was asked."""

    name = "told"

    def __init__(self, *answers, needs_prompts=True):
        self.answers, self.asked, self.needs_prompts = list(answers), [], needs_prompts

    def segment(self, picture, prompts):
        self.asked.append(prompts)
        shares = self.answers[min(len(self.asked), len(self.answers)) - 1]
        order = np.arange(np.prod(picture.shape)).reshape(picture.shape)
        masks = [order < round(share * order.size) for share in shares]
        return Candidates(masks=masks, scores=-np.arange(len(shares)))


def image(grid=GRID, bright=(slice(50, 100), slice(60, 120))):
    """1 on a rectangle, 0.3 beside it, 0.01 elsewhere."""
    values = np.full(grid.shape, 0.01, complex)
    values[50:150, 60:120] = 0.3
    values[bright] = 1
    return ms.SarImage(grid=grid, values=values)


def test_the_best_mask_that_is_not_too_large_is_chosen():
    found = Told([0.9, 0.21, 0.2, 0.05]).segment(project(image()), ASKED)
    best = chosen(found)
    assert best is not None
    assert best.mean() == pytest.approx(0.2)
    assert chosen(Told([0.9, 0.21]).segment(project(image()), ASKED)) is None
    larger = chosen(found, largest=0.5)
    assert larger is not None
    assert larger.mean() == pytest.approx(0.21)
    with pytest.raises(InputError, match="largest is 0"):
        chosen(found, largest=0)


def test_candidates_are_sorted_and_of_one_shape():
    with pytest.raises(InputError, match="highest first"):
        Candidates(masks=np.zeros((2, 3, 3), bool), scores=[0.1, 0.2])
    with pytest.raises(InputError, match="scores has shape"):
        Candidates(masks=np.zeros((2, 3, 3), bool), scores=[0.1])
    with pytest.raises(InputError, match="masks has shape"):
        Candidates(masks=np.zeros((3, 3), bool), scores=[0.1])


def regular(width, height):
    grid = ms.VoxelGrid.regular((0, 0, 0), (width - 0.01, height - 0.01, 0), 0.01)
    return project(ms.SarImage(grid=grid, values=np.ones(grid.shape)))


@pytest.mark.parametrize(
    ("picture", "share"),
    [
        (regular(0.55, 0.60), 0.2),  # as published
        (regular(1.0, 1.0), 0.2),
        (regular(0.5, 0.4), 0.33),  # 0.066 m^2
        (regular(0.2, 0.2), 0.6),
        (Picture(rgb=np.zeros((9, 9, 3), np.uint8)), 0.2),
        (regular(0.01, 0.3), 0.2),
    ],
)
def test_how_much_of_a_picture_a_mask_may_cover(picture, share):
    assert largest_share(picture) == pytest.approx(share, rel=1e-6)


def test_a_mask_that_leaves_the_rim_free_may_cover_more():
    """A box of 16 by 21 cm, 2 cm around it, fills 68 % of the picture: it was refused."""
    small = regular(0.2, 0.25)
    assert largest_share(small, inner=True) == 0.85
    assert largest_share(regular(0.55, 0.60), inner=True) == pytest.approx(0.2)
    box, background = np.zeros((2, *small.shape), dtype=bool)
    box[1:-1, 1:-1] = True
    box[1:-1, 1:5] = False
    background[:, 4:] = True
    assert 0.6 < box.mean() < background.mean() < 0.85
    both = Candidates(masks=[background, box], scores=[1.0, 0.9])
    found = chosen(both, largest=0.6, inner=0.85)
    assert np.array_equal(found, box)
    assert chosen(both, largest=0.6) is None


def test_a_first_answer_that_fits_is_taken():
    by = Told([0.9, 0.1])
    found = find_mask(by, project(image()), rng=1)
    assert len(by.asked) == 1
    assert found.inside.mean() == pytest.approx(0.1)
    assert found.score == -1
    assert found.prompts is by.asked[0]
    np.testing.assert_array_equal(found.mask.grid_xy.x, GRID.x)


def test_where_all_masks_are_too_large_five_points_of_each_kind_are_drawn_once_more():
    by = Told([0.9, 0.3], [0.5, 0.15])
    found = find_mask(by, project(image()), rng=1)
    assert len(by.asked) == 2
    first, second = by.asked
    assert first.positive.sum() == 15  # 0.5 % of 3000
    assert second.positive.sum() == (~second.positive).sum() == 5
    assert found.prompts is second
    assert found.inside.mean() == pytest.approx(0.15)


def test_the_retry_comes_once():
    by = Told([0.9], [0.8], [0.1])
    with pytest.raises(InputError, match="every mask covers more than 20 %"):
        find_mask(by, project(image()), rng=1)
    assert len(by.asked) == 2


def test_given_prompts_are_not_replaced():
    by = Told([0.9], [0.1])
    with pytest.raises(InputError, match="every mask"):
        find_mask(by, project(image()), prompts=ASKED)
    assert by.asked == [ASKED]
    with pytest.raises(InputError, match="220 x 240 pixels"):
        find_mask(by, project(image()), prompts=Prompts(points=[[0, 240]], positive=[True]))


def test_who_needs_no_prompts_gets_none_but_for_the_retry():
    content, retried = Told([0.1], needs_prompts=False), Told([0.9], [0.1], needs_prompts=False)
    blank = project(ms.SarImage(grid=GRID, values=np.zeros(GRID.shape)))
    assert find_mask(content, blank).prompts is None
    assert content.asked == [None]
    find_mask(retried, project(image()), rng=1)
    assert retried.asked[0] is None
    assert len(retried.asked[1].points) == 10


def test_where_a_lid_is_known_to_lie_pictures_say_so():
    picture, by = project(image()), Told([0.1], needs_prompts=False)
    assert not find_mask(by, picture).picture.covered
    assert find_mask(by, picture, condition="nlos").picture.covered


def test_conditions_decide_what_is_dark():
    values = np.full(GRID.shape, 0.03, complex)
    values[50:100, 60:120] = 1
    picture = project(ms.SarImage(grid=GRID, values=values))
    by = Told([0.1])
    find_mask(by, picture, rng=0, condition="los")
    find_mask(by, picture, rng=0, condition="nlos")
    assert by.asked[0].positive.all()  # nothing is under 0.02
    assert (~by.asked[1].positive).sum() == 249  # 0.5 % of 49800
    with pytest.raises(UnknownNameError, match="Known: los, nlos"):
        find_mask(by, picture, condition="carton")


def test_segment_finds_a_bright_rectangle_and_the_same_for_the_same_seed():
    """From the library's front door."""
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.295, 0.295, 0), 0.005)
    values = np.full(grid.shape, 0.01)
    values[15:35, 20:45] = 1
    noisy = ms.SarImage(grid=grid, values=values * np.random.default_rng(0).rayleigh(size=grid.shape))
    masks = [ms.segment(noisy, method="classical", rng=rng) for rng in (7, 7, np.random.default_rng(7), 0)]
    for mask in masks:
        assert isinstance(mask, ms.Mask)
        assert mask.inside[17:33, 22:43].mean() > 0.99
        assert mask.inside.mean() < 0.18  # 0.14 are bright
    np.testing.assert_array_equal(masks[0].inside, masks[1].inside)
    np.testing.assert_array_equal(masks[0].inside, masks[2].inside)


def test_what_is_drawn_at_random_needs_a_seed():
    with pytest.raises(InputError, match="told needs prompts, which are drawn at random: pass rng=0"):
        ms.segment(image(), method=Told([0.1]))
    by = Told([0.9], [0.1], needs_prompts=False)
    with pytest.raises(InputError, match="every mask covers more than .* pass rng=0, for example, to try prompts"):
        ms.segment(image(), method=by)
    assert by.asked == [None]
    for rng in (-1, True, "0", 1.5):
        with pytest.raises(InputError, match="expected a seed"):
            ms.segment(image(), method=Told([0.1]), rng=rng)
    with pytest.raises(InputError, match="rng is None; expected a seed"):
        ms.power_prompts(project(image()), rng=None)
    assert ms.segment(image(), method=Told([0.1]), prompts=ASKED).inside.mean() == pytest.approx(0.1)


def test_segment_draws_where_both_bands_are_bright():
    by = Told([0.1])
    coarse = ms.VoxelGrid.regular((0, 0, 0), (0.56, 0.6, 0), 0.02)
    values = np.zeros(coarse.shape, complex)
    values[coarse.x < 0.18] = 1  # row 72 and below, of the 50 to 100 that are bright
    ms.segment(image(), other_band=ms.SarImage(grid=coarse, values=values), method=by, rng=0)
    drawn = by.asked[0].points[by.asked[0].positive]
    assert 5 < len(drawn) < 11
    assert (drawn[:, 0] <= 72).all()


def test_segment_refuses_what_cannot_be():
    blank = ms.SarImage(grid=GRID, values=np.zeros(GRID.shape))
    even = ms.SarImage(grid=GRID, values=np.ones(GRID.shape))
    for method in ("classical", "wave"):
        with pytest.raises(InputError, match="equally bright everywhere"):
            ms.segment(even, method=method)
    with pytest.raises(InputError, match="blank"):
        ms.segment(blank, method="classical", rng=0)
    away = ms.VoxelGrid(x=GRID.x + 2, y=GRID.y, z=GRID.z)
    with pytest.raises(InputError, match="do not overlap"):
        ms.segment(image(), other_band=image(away), method="classical", rng=0)
    other = image(bright=(slice(120, 130), slice(60, 120)))
    with pytest.raises(InputError, match="in both bands"):
        ms.segment(image(), other_band=other, method="classical", rng=0)
    with pytest.raises(UnknownNameError, match="Known: .*classical, sam, threshold, wave"):
        ms.segment(image(), method="sem")
    few = ms.VoxelGrid.regular((0, 0, 0), (0.1, 0.1, 0), 0.01)
    values = np.ones(few.shape)
    values[3, 4] = 0.99
    with pytest.raises(InputError, match="every mask covers more than"):  # all pixels are above every threshold
        ms.segment(ms.SarImage(grid=few, values=values), method="classical", rng=0)


def test_a_mask_on_a_photo_lies_on_no_grid():
    photo = Picture(rgb=np.zeros((9, 9, 3), np.uint8))
    found = find_mask(Told([0.1]), photo, prompts=ASKED)
    assert found.inside.sum() == 8
    with pytest.raises(InputError, match="photo"):
        _ = found.mask


def test_segmenters_have_names():
    assert segmenter("classical").name == "classical"
    with pytest.raises(UnknownNameError, match="Did you mean 'wave'"):
        segmenter("wavelet")
