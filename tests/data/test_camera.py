"""Camera records: pinhole geometry in closed form, depths kept as they were stored, and what is refused."""

import copy

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.data import CameraFrame, CameraMask, Intrinsics

SMALL = Intrinsics(fx=50.0, fy=60.0, cx=3.5, cy=2.0, width=8, height=6)


def frame(**changes):
    depth = np.full((6, 8), 400, dtype=np.uint16)
    depth[0, 0] = 0
    values = {"rgb": np.zeros((6, 8, 3), np.uint8), "depth": depth, "pose": np.eye(4), "intrinsics": SMALL}
    return CameraFrame(**{**values, **changes})


def test_points_project_back_to_their_pixels():
    points = frame().points
    assert points.shape == (6, 8, 3)
    assert np.isnan(points[0, 0]).all()
    assert np.isfinite(points).sum() == 3 * (6 * 8 - 1)
    x, y, z = np.moveaxis(points.reshape(-1, 3)[1:], -1, 0)
    rows, columns = np.divmod(np.arange(1, 48), 8)
    assert z == pytest.approx(np.full(47, 0.4))
    assert SMALL.fx * x / z + SMALL.cx == pytest.approx(columns)
    assert SMALL.fy * y / z + SMALL.cy == pytest.approx(rows)


def test_x_is_right_and_y_is_down():
    points = frame().points
    assert points[3, 7, 0] > points[3, 1, 0]
    assert points[5, 3, 1] > points[1, 3, 1]


def test_the_published_camera():
    published = Intrinsics.published()
    point = published.points(np.ones((480, 640)))[0, 0]
    assert point == pytest.approx([-321.274 / 618.174, -241.059 / 617.759, 1.0])


@pytest.mark.parametrize("dtype", ["uint16", "float32", "float64"])
def test_depths_stay_as_they_were_stored(dtype):
    depth = np.arange(48).reshape(6, 8).astype(dtype)
    if dtype != "uint16":
        depth[2, 2] = np.nan
    kept = frame(depth=depth).depth
    assert kept.dtype == dtype
    assert kept.tobytes() == depth.tobytes()
    assert not kept.flags.writeable
    depth[1, 1] = 0
    assert kept[1, 1] == 9
    assert copy.deepcopy(frame(depth=kept)).depth.tobytes() == kept.tobytes()


def test_a_mask_holds_what_it_is_given():
    pixels = np.zeros((6, 8), bool)
    pixels[2:4, 3:5] = True
    points = np.where(pixels[..., None], [0.1, 0.2, 0.4], np.nan)
    mask = CameraMask(pixels=pixels, depth=np.where(pixels, 400.0, np.nan), points=points, pose=np.eye(4))
    assert repr(mask) == "CameraMask(8 x 6 pixels, 4 on the object)"
    assert np.array_equal(mask.points, points, equal_nan=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rgb": np.zeros((6, 8), np.uint8)}, r"rgb has shape \(6, 8\)"),
        ({"rgb": np.full((6, 8, 3), 0.5)}, "rgb .* not whole"),
        ({"depth": np.zeros((8, 6))}, r"depth has shape \(8, 6\); expected \(6, 8\)"),
        ({"depth": np.full((6, 8), np.inf)}, "depth has infinite values"),
        ({"depth": np.full((6, 8), "deep")}, "depth is an array of <U4"),
        ({"pose": np.eye(3)}, "pose has shape"),
        ({"pose": np.diag([1.0, 1, -1, 1])}, "pose is .*; expected a rotation"),
        ({"pose": 2 * np.eye(4)}, "pose is .*; expected a rotation"),
        ({"depth_unit": 0}, "depth_unit is 0 m"),
        ({"intrinsics": None}, "intrinsics is of type NoneType"),
    ],
)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        frame(**changes)


def test_impossible_intrinsics_are_refused():
    with pytest.raises(InputError, match="fx is 0 pixels"):
        Intrinsics(fx=0, fy=1, cx=0, cy=0, width=1, height=1)
    with pytest.raises(InputError, match=r"depth has shape \(6, 7\)"):
        SMALL.points(np.ones((6, 7)))
