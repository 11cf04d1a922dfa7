"""The camera baseline: prompts lie on what is near, whatever it is."""

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.data import CameraFrame, Intrinsics
from millisight.perception import depth_prompts, photo

K = Intrinsics(fx=60, fy=60, cx=32, cy=24, width=64, height=48)
NEAR = np.zeros((48, 64), bool)
NEAR[10:30, 20:50] = True


def frame(depth):
    rgb = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    return CameraFrame(rgb=rgb, depth=depth, pose=np.eye(4), intrinsics=K)


def holed(dtype=np.uint16):
    depth = np.where(NEAR, 350, 480).astype(dtype)
    depth[::5] = 0 if dtype == np.uint16 else np.nan
    return depth


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_prompts_lie_on_what_is_near_and_on_what_is_not(dtype):
    prompts = depth_prompts(frame(holed(dtype)), farthest=0.4, count=30, rng=1)
    assert prompts.positive.tolist() == [True] * 30 + [False] * 30
    rows, columns = prompts.points.T
    assert np.array_equal(NEAR[rows, columns], prompts.positive)
    assert (rows % 5 > 0).all()  # where there is a depth
    assert len(np.unique(prompts.points, axis=0)) == 60


def test_same_seed_same_prompts():
    one, same, other = (depth_prompts(frame(holed()), farthest=0.4, rng=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.points, same.points)
    assert not np.array_equal(one.points, other.points)


def test_as_many_as_there_are():
    depth = np.full((48, 64), 480, np.uint16)
    depth[0, :3] = 300
    prompts = depth_prompts(frame(depth), farthest=0.4, rng=0)
    assert prompts.positive.sum() == 3
    assert (~prompts.positive).sum() == 20
    everything = depth_prompts(frame(depth), farthest=1.0, rng=0)
    assert everything.positive.all()


def test_nothing_near_is_an_error():
    with pytest.raises(InputError, match=r"nearer than 0\.2 m: 0\.35 m is the nearest"):
        depth_prompts(frame(holed()), farthest=0.2, rng=0)
    with pytest.raises(InputError, match="the picture has no depth"):
        depth_prompts(frame(0 * holed()), farthest=0.2, rng=0)


def test_the_photo_is_the_picture():
    picture = photo(frame(holed()))
    assert picture.shape == (48, 64)
    assert np.array_equal(picture.rgb, frame(holed()).rgb)
    assert picture.power is None
