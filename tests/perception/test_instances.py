"""Several objects in one image: peaks apart by their saddles, outlines by what is seen, nothing where nothing is."""

import time

import numpy as np
import pytest

import millisight as ms
from helpers.form_images import GRID, flat
from millisight.core.errors import InputError, UnknownNameError
from millisight.perception.segmentation import InstanceSettings, split_instances

STEP = 0.0025


def image_of(*discs, size=80, noise=1e-3, seed=0, slices=4):
    """Flat discs (i, j, radius [pixels], amplitude) in noise of random phase."""
    rng = np.random.default_rng(seed)
    axis = STEP * np.arange(size)
    values = noise * (rng.normal(size=(size, size, slices)) + 1j * rng.normal(size=(size, size, slices)))
    i, j = np.indices((size, size))
    for a, b, radius, amplitude in discs:
        values[np.hypot(i - a, j - b) < radius, 1] += amplitude
    grid = ms.VoxelGrid(x=axis, y=axis, z=-0.3 + 0.01 * np.arange(slices))
    return ms.SarImage(grid=grid, values=values.astype(np.complex64))


def disc(a, b, radius, size=80):
    i, j = np.indices((size, size))
    return np.hypot(i - a, j - b) < radius


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def test_three_objects_get_three_masks_a_dim_one_too():
    discs = [(20, 20, 9, 1.0), (20, 58, 8, 0.5), (58, 40, 10, 0.1)]
    found = ms.segment_instances(image_of(*discs))
    assert len(found) == 3
    for mask, (a, b, radius, _) in zip(found, discs, strict=True):  # by falling brightness
        assert iou(mask.inside, disc(a, b, radius)) > 0.8
    assert (np.diff(found.scores) < 0).all()
    assert found.mask.inside.sum() == sum(mask.inside.sum() for mask in found)


def test_two_that_touch_are_parted_at_the_saddle():
    """Two glints 4 cm apart whose flanks meet far below their peaks; a ripple on one of them is no object."""
    i = STEP * np.arange(80)[:, None]
    j = STEP * np.arange(80)
    flanks = [np.exp(-np.hypot(i - a, j - 0.1) / 0.008) for a in (0.08, 0.12)]
    ripple = 1 + 0.2 * np.cos(2 * np.pi * i / 0.01)
    values = (np.maximum(*flanks) * ripple + 1e-4)[..., None]
    grid = ms.VoxelGrid(x=i[:, 0], y=j, z=np.array([-0.3]))
    found = ms.segment_instances(ms.SarImage(grid=grid, values=values.astype(np.complex64)))
    assert len(found) == 2
    first, second = sorted(found, key=lambda mask: np.argwhere(mask.inside)[:, 0].mean())
    assert np.argwhere(first.inside)[:, 0].max() == pytest.approx(40, abs=2)
    assert np.argwhere(second.inside)[:, 0].min() == pytest.approx(40, abs=2)


@pytest.mark.parametrize("slices", [1, 4])
@pytest.mark.parametrize("seed", range(5))
def test_an_empty_scene_has_no_objects(seed, slices):
    assert len(ms.segment_instances(image_of(noise=0.3, seed=seed, slices=slices))) == 0


def test_a_blank_image_has_no_objects():
    found = ms.segment_instances(image_of(noise=0.0))
    assert (len(found), found.labels.any(), found.masks) == (0, False, ())


def test_what_covers_the_picture_is_no_object():
    """A lid that was not taken off."""
    assert len(ms.segment_instances(image_of((40, 40, 38, 1.0)))) == 0
    assert len(ms.segment_instances(image_of((40, 40, 38, 1.0)), largest=1.0)) == 1


def test_the_result_follows_gain_and_turns():
    discs = [(20, 20, 9, 1.0), (58, 40, 10, 0.2)]
    image = image_of(*discs)
    louder = ms.SarImage(grid=image.grid, values=image.values * np.float32(1e-9))
    turned = ms.SarImage(grid=image.grid, values=np.ascontiguousarray(np.rot90(image.values)))
    found = ms.segment_instances(image)
    assert np.array_equal(ms.segment_instances(louder).labels, found.labels)
    assert np.array_equal(ms.segment_instances(turned).labels, np.rot90(found.labels))


def test_a_segmenters_mask_restricts_the_objects():
    class Half:
        name, needs_prompts = "half", False

        def segment(self, picture, prompts):
            inside = np.zeros((1, *picture.shape), bool)
            inside[:, :40] = True
            return ms.Candidates(masks=inside, scores=[1.0])

    image = image_of((20, 20, 9, 1.0), (58, 40, 10, 0.5))
    (mask,) = ms.segment_instances(image, method=Half())
    assert iou(mask.inside, disc(20, 20, 9)) > 0.8
    with pytest.raises(UnknownNameError, match="unknown segmenter"):
        ms.segment_instances(image, method="none")


def test_settings_say_what_an_object_is():
    image = image_of((20, 20, 9, 1.0), (58, 40, 10, 0.05), (60, 10, 2.5, 0.5))
    assert [len(ms.segment_instances(image, settings=InstanceSettings(**changes))) for changes in (
        {"dimmest_db": 40}, {"dimmest_db": 12}, {"dimmest_db": 40, "smallest": 5e-4},
    )] == [3, 2, 2]  # fmt: skip
    with pytest.raises(InputError, match="smoothing is -1"):
        InstanceSettings(smoothing=-1)


def test_any_map_of_scores_can_be_split():
    """Probabilities: peaks of 0.9 and 0.6 with a saddle of 0.4, and one of 0.3 that is too low."""
    i = np.arange(60)[:, None] + 0 * np.arange(8)
    bumps = [peak * np.exp(-(((i - at) / 6) ** 2)) for peak, at in ((0.9, 10), (0.6, 24), (0.3, 50))]
    chances = np.maximum.reduce(bumps)
    labels, peaks = split_instances(chances, lowest=0.2, prominence=0.15)
    assert peaks.round(2).tolist() == [0.9, 0.6]
    assert [int(labels[at, 0]) for at in (10, 24, 50)] == [1, 2, 0]
    saddle = int(chances[10:24, 0].argmin()) + 10
    assert abs(int(np.flatnonzero(labels[:, 0] == 1).max()) - saddle) <= 1
    assert split_instances(chances, lowest=0.2, prominence=0.45)[1].round(2).tolist() == [0.9]
    holes = np.where(i == 10, np.nan, chances)
    assert split_instances(holes, lowest=0.2, prominence=0.15)[0][10].tolist() == [0] * 8
    for wrong in ({"prominence": -1}, {"prominence": 0, "smallest": -1}, {"prominence": 0, "drops": (-1, 2)}):
        with pytest.raises(InputError, match="expected 0 or more"):
            split_instances(chances, lowest=0.2, **wrong)
    with pytest.raises(InputError, match="expected \\(A, B\\)"):
        split_instances(chances[0], lowest=0.2, prominence=0)


def test_what_encloses_another_keeps_it_apart():
    i, j = np.indices((60, 60))
    away = np.hypot(i - 30, j - 30)
    ring, spot = (abs(away - 18) < 4) * 10.0, (away < 5) * 9.0
    labels, peaks = split_instances(ring + spot, lowest=1, prominence=3)
    assert peaks.tolist() == [10, 9]
    assert (labels[30, 30], labels[30, 48]) == (2, 1)
    assert labels[30, 39] == 1  # a hole of the ring is the ring's


def test_a_face_in_what_is_left_of_a_lid_is_found():
    """Down to a glint's flanks it would cover the picture."""
    rng = np.random.default_rng(0)
    values = 0.1 * np.abs(rng.normal(size=(80, 80, 4)))
    values[20:40, 30:60] = 1.0
    values[:20] *= 1e-2
    image = ms.SarImage.from_array(values, STEP)
    found = ms.segment_instances(image)
    truth = np.zeros((80, 80), bool)
    truth[20:40, 30:60] = True
    assert [iou(mask.inside, truth) > 0.8 for mask in found] == [True]


def test_one_of_them_by_its_number():
    found = ms.segment_instances(image_of((20, 20, 9, 1.0), (58, 40, 10, 0.5)))
    assert np.array_equal(found[1].inside, found.masks[1].inside)
    with pytest.raises(IndexError):
        found[2]


def test_another_band_without_a_segmenter_is_refused():
    image = image_of((20, 20, 9, 1.0))
    with pytest.raises(InputError, match="other_band is for the segmenter"):
        ms.segment_instances(image, other_band=image)


def at(frequency):
    image = image_of((20, 20, 9, 1.0))
    told = {"history": [{"step": "form_image", "frequency": frequency}]}
    return ms.SarImage(grid=image.grid, values=image.values, metadata=told)


@pytest.mark.parametrize("bands", [(24e9, 79e9), (79e9, 79e9)])
def test_the_other_band_is_the_lower_one(bands):
    image, other = map(at, bands)
    with pytest.raises(InputError, match=f"of {bands[0] / 1e9:.0f} GHz and other_band of 79 GHz"):
        ms.segment(image, other_band=other, method="classical", rng=0)
    assert ms.segment(at(79e9), other_band=at(24e9), method="classical", rng=0).inside.any()


def test_a_table_at_a_known_height_is_taken_off():
    table, box, shadow = (
        flat(sides, (x, y, z), (0.5, 0)).values
        for sides, x, y, z in (((0.15, 0.19), 0, 0, -0.06), ((0.06, 0.04), 0.03, -0.02, -0.02),
                               ((0.06, 0.04), 0.03, -0.02, -0.06))
    )  # fmt: skip
    image = ms.SarImage(grid=GRID, values=table - shadow + 3 * box)
    truth = (abs(GRID.x[:, None] - 0.03) <= 0.03) & (abs(GRID.y + 0.02) <= 0.02)

    def best(**settings):
        return max(
            (iou(mask.inside, truth) for mask in ms.segment_instances(image, largest=1.0, **settings)), default=0
        )

    assert best() < 0.5
    assert best(support=-0.06) > 0.8
    assert best(support=-0.1) < 0.5  # what is flat lies elsewhere


def test_a_record_of_instances_is_checked_and_kept(tmp_path):
    found = ms.segment_instances(image_of((20, 20, 9, 1.0), (58, 40, 10, 0.5)))
    ms.save(tmp_path / "found.h5", found)
    again = ms.load(tmp_path / "found.h5")
    assert np.array_equal(again.labels, found.labels)
    assert np.array_equal(again.scores, found.scores)
    assert repr(again) == repr(found)
    assert repr(found).startswith("Instances(2 on 80 x 80 pixels")
    none = ms.segment_instances(image_of(noise=0.0))
    ms.save(tmp_path / "none.h5", none)
    assert len(ms.load(tmp_path / "none.h5")) == 0
    with pytest.raises(InputError, match="expected 0 and every number from 1"):
        ms.Instances(grid_xy=found.grid_xy, labels=2 * found.labels, scores=found.scores)
    with pytest.raises(InputError, match="expected the highest first"):
        ms.Instances(grid_xy=found.grid_xy, labels=found.labels, scores=found.scores[::-1])
    with pytest.raises(InputError, match="scores"):
        ms.Instances(grid_xy=found.grid_xy, labels=found.labels, scores=found.scores[:1])


def test_voxels_of_ten_nanometres_take_no_time():
    """The smoothing was 100 000 times as wide as the picture."""
    grid = ms.VoxelGrid(x=np.arange(60) * 1e-8, y=np.arange(60) * 1e-8, z=np.arange(2) * 0.01)
    noise = np.random.default_rng(0).normal(size=(*grid.shape, 2)) @ [1, 1j]
    began = time.process_time()
    ms.segment_instances(ms.SarImage(grid=grid, values=noise, metadata={"frequency": 79e9}))
    assert time.process_time() - began < 5
