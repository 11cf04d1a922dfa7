"""Segmenters on scenes by hand: what each input is compared with, seeds, and masks that cannot be found."""

import numpy as np
import pytest

import millisight as ms
from helpers.small_scenes import BLOCKS, POSE, grid, image, inside, shot
from millisight.core.errors import InputError, UnknownNameError
from millisight.evaluation import BOTH, CAMERA, HIGH, INPUTS, LOW, CameraView, LabelledScene, SegmenterEvaluator
from millisight.perception.segmentation import Candidates


class Bright:
    """Everything over a share of the maximum, joined to the positive prompts; of a photo, what is as bright as they."""

    name = "bright"
    needs_prompts = True

    def __init__(self):
        self.seen = []

    def segment(self, picture, prompts):
        self.seen.append((picture, prompts))
        shown = picture.rgb.astype(float).mean(axis=2) if picture.power is None else picture.power
        marks = shown[tuple(prompts.points[prompts.positive].T)]
        near = np.abs(shown - np.median(marks)) < 30 if picture.power is None else shown > 0.4
        return Candidates(masks=near[None], scores=[1.0])


class Blind(Bright):
    name = "blind"
    needs_prompts = False

    def segment(self, picture, prompts):
        raise InputError("sees nothing")


def scene(sight="los", block=BLOCKS["074-x_wide"], images=(LOW, HIGH), view=True):
    hidden = sight == "nlos"
    frame, _ = shot(block, hidden=hidden)
    radars = {LOW: "24_ghz", HIGH: "77_ghz"}
    truth = ms.Mask(grid_xy=grid().xy, inside=inside(block))
    return LabelledScene(
        name="s",
        object="wide",
        sight=sight,
        images={name: image(block, radars[name], hidden=hidden) for name in images},
        truth=dict.fromkeys(images, truth),
        view=CameraView(frame=frame, T_radar_camera=POSE, farthest=0.44) if view else None,
    )


def scores(sight):
    return {one.input: one.scores for one in SegmenterEvaluator(Bright(), scene(sight)).trials([0])}


def test_in_sight_all_inputs_find_the_block():
    found = scores("los")
    assert tuple(found) == INPUTS
    assert found[CAMERA].iou > 0.85
    assert found[HIGH].iou > 0.85
    assert found[HIGH] == found[BOTH]  # the same picture, and this segmenter cares little for the prompts
    assert found[LOW].iou > 0.6


def test_out_of_sight_the_camera_takes_the_carton_for_the_object():
    found = scores("nlos")
    assert found[CAMERA].recall == 1
    assert found[CAMERA].precision < 0.5
    assert found[LOW].iou > found[CAMERA].iou


def test_multispectral_prompts_leave_out_what_one_band_alone_sees():
    by = Bright()
    evaluator = SegmenterEvaluator(by, scene("nlos"))
    for seed in range(20):
        evaluator.attempt(HIGH, seed)
        evaluator.attempt(BOTH, seed)
    streak = evaluator.pictures[HIGH].power > 0.4
    streak[8:] = False
    assert streak.sum() > 50
    on_streak = {}
    for picture, prompts in by.seen:
        same = (picture.image, picture.other_band)
        given = next((name for name, made in evaluator.pictures.items() if (made.image, made.other_band) == same), None)
        points = prompts.points[prompts.positive]
        if given in (HIGH, BOTH):
            on_streak[given] = on_streak.get(given, 0) + streak[tuple(points.T)].sum()
    assert on_streak[HIGH] > 5
    assert on_streak[BOTH] == 0
    assert evaluator.pictures[BOTH].other_band is not None


def test_same_seed_same_trials_and_seeds_differ():
    one, two = (Bright(), Bright())
    first, again = SegmenterEvaluator(one, scene()).trials([3, 4]), SegmenterEvaluator(two, scene()).trials([3, 4])
    assert [t.scores for t in first] == [t.scores for t in again]
    assert [t.seed for t in first] == [3, 4] * 4
    drawn = [prompts.points for _, prompts in one.seen]
    assert all(np.array_equal(a, b.points) for a, (_, b) in zip(drawn, two.seen, strict=True))
    assert not np.array_equal(drawn[0], drawn[1])


def test_where_there_is_no_mask_an_empty_one_is_judged_and_the_reason_told():
    trials = SegmenterEvaluator(Blind(), scene()).trials([0])
    assert [one.input for one in trials] == [LOW, HIGH, BOTH]  # without prompts no photos
    assert {one.failure for one in trials} == {"sees nothing"}
    assert {one.scores.f1 for one in trials} == {0}
    blank = scene()
    dark = ms.SarImage(grid=grid(), values=np.zeros(grid().shape, np.complex64))
    blank = LabelledScene(name="s", object="o", sight="los", images={HIGH: dark}, truth={HIGH: blank.truth[HIGH]})
    attempt = SegmenterEvaluator(Bright(), blank).attempt(HIGH, 0)
    assert "blank" in attempt.failure
    assert attempt.found is None
    assert not attempt.mask.inside.any()


@pytest.mark.parametrize(
    ("images", "view", "expected"),
    [
        ((HIGH,), True, (CAMERA, HIGH)),
        ((LOW,), True, (LOW,)),
        ((LOW, HIGH), False, (LOW, HIGH, BOTH)),
    ],
)
def test_inputs_are_what_there_is(images, view, expected):
    assert scene(images=images, view=view).inputs == expected


def test_scenes_are_checked():
    good = scene()
    with pytest.raises(UnknownNameError, match="kind of sight"):
        LabelledScene(name="s", object="o", sight="up", images=good.images, truth=good.truth)
    with pytest.raises(InputError, match="a true mask for each image"):
        LabelledScene(name="s", object="o", sight="los", images=good.images, truth={HIGH: good.truth[HIGH]})
    with pytest.raises(UnknownNameError, match="radar image"):
        LabelledScene(name="s", object="o", sight="los", images={"60 GHz": good.images[HIGH]}, truth=good.truth)
