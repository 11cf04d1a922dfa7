"""Splits: disjoint, complete, in about their shares, and siblings together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from millisight.datasets.generation import Shares
from millisight.datasets.generation._splits import SIDES, family, split, splits_of
from millisight.meshes import CATALOGUE

SHARES = Shares()
FOLDERS = [entry.ycb_id for entry in CATALOGUE.values()]


def dataset(objects=FOLDERS, poses=4):
    """Folders of a dataset: of every object so many poses, each in two sights and simulated."""
    return [
        f"{name}/{rest}"
        for name in objects
        for pose in range(poses)
        for rest in (
            f"robot_collected/0_0_{pose}/exp{pose + 1}/los",
            f"robot_collected/0_0_{pose}/exp{pose + 1}/nlos",
            f"simulation/0_0_{pose}",
        )
    ]


@pytest.mark.slow
@given(
    count=st.integers(0, 200),
    train=st.floats(0, 1),
    val=st.floats(0, 1),
    seed=st.integers(0, 5),
)
def test_sides_have_their_shares(count, train, val, seed):
    shares = Shares(train=train, val=(1 - train) * val, test=1 - train - (1 - train) * val)
    names = [f"{i:03d}_thing" for i in range(count)]
    sides = split(names, shares, seed)
    assert sorted(sides) == names
    wanted = [getattr(shares, side) for side in SIDES]
    numbers = np.array([list(sides.values()).count(side) for side in SIDES])
    assert (np.abs(numbers - count * np.array(wanted)) <= 2).all()
    if count >= 3:
        assert all(number > 0 for number, share in zip(numbers, wanted, strict=True) if share > 0)
    assert all(number == 0 for number, share in zip(numbers, wanted, strict=True) if share == 0)


def test_by_object_no_object_and_no_sibling_is_on_two_sides():
    found = splits_of(dataset(), SHARES, 1)["by_object"]
    everything = [folder for side in found.values() for folder in side]
    assert sorted(everything) == sorted(dataset())
    assert len(everything) == 76 * 12
    families = {side: {family(folder.split("/")[0]) for folder in found[side]} for side in SIDES}
    assert all(families.values())
    assert found["mixed"] == []
    assert not families["train"] & families["val"]
    assert not families["train"] & families["test"]
    assert not families["val"] & families["test"]
    assert family("065-a_cups") == family("065-j_cups") == "065"
    assert family("000_mine") != family("000_yours")


def test_by_pose_no_pose_of_an_object_is_on_two_sides_and_each_object_is_on_all():
    found = splits_of(dataset(), SHARES, 1)["by_pose"]
    assert sorted(folder for side in found.values() for folder in side) == sorted(dataset())
    poses = {side: {tuple(np.array(f.split("/"))[[0, 2]]) for f in found[side]} for side in SIDES}
    assert not poses["train"] & poses["val"]
    assert not poses["train"] & poses["test"]
    assert not poses["val"] & poses["test"]
    for side in SIDES:
        assert {name for name, _ in poses[side]} == set(FOLDERS)
        # Line of sight, not of it, and simulation of a pose stay together.
        assert len(found[side]) == 3 * len(poses[side])


def test_a_scene_of_objects_from_two_sides_is_on_neither():
    folders = dataset(poses=1)
    of = splits_of(folders, SHARES, 1)["by_object"]
    train, test = ([f.split("/")[0] for f in of[side]] for side in ("train", "test"))
    scenes = [f"{a}+{b}/robot_collected/0_0_0/exp1/los" for a, b in ((train[0], train[3]), (train[0], test[0]))]
    found = splits_of([*folders, *scenes], SHARES, 1)["by_object"]
    assert scenes[0] in found["train"]
    assert found["mixed"] == [scenes[1]]
    # And the scenes move no object to another side.
    assert {side: [f for f in found[side] if "+" not in f] for side in SIDES} == {side: of[side] for side in SIDES}


@pytest.mark.parametrize("seed", [0, 1])
def test_splits_follow_from_the_seed(seed):
    one, same = (splits_of(folders, SHARES, seed) for folders in (dataset(), dataset()[::-1]))
    assert one == same
    assert one != splits_of(dataset(), SHARES, seed + 1)
