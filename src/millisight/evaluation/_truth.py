"""The truth about a radar image, from a camera: the object's pixels in a picture with depth, moved to the image's grid.

A pixel and its depth are a point in the camera frame; `T_radar_camera` takes it to the frame of the images; seen along
z, the points cover pixels of the grid. See docs/explanation/segmentation-truth.md.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    check_shape,
    checked_array,
    checked_numbers,
    checked_record,
    rotation_from_euler_deg,
    with_step,
)
from millisight.core.errors import InputError
from millisight.data import CameraFrame, CameraMask, Intrinsics, Mask, PixelGrid

_REACH = 1.0  # a point covers what is nearer to it than the spacing of its neighbours, in spacings
_PINHOLE = 2  # pixels
_HOLE = 400  # pixels of a hole in the depth that is filled: 1.5 cm across at 0.45 m
PUBLISHED_DEPTHS = (0.2, 0.5)
"""Of objects in the published pictures [m]."""


def radar_from_camera(pose: ArrayLike, origin: ArrayLike) -> np.ndarray:
    """(4, 4) `T_radar_camera`, from a camera's pose in the robot's base frame.

    Parameters
    ----------
    pose : (4, 4) `T_base_camera` [m]
    origin : (3,) of the images' frame, in the base frame, axes parallel [m]
    """
    transform = checked_array(pose, name="pose", shape=(4, 4)).copy()
    transform[:3, 3] -= checked_array(origin, name="origin", shape=(3,), unit="m")
    return transform


class _Mount(NamedTuple):
    """How camera and 77 GHz radar hung on the arm, as the published evaluation has it [m]."""

    camera_in_tool: np.ndarray
    tool_in_camera: np.ndarray
    radar_in_tool: np.ndarray
    turn_deg: float


_FIRST_MOUNT = _Mount(
    camera_in_tool=np.array([0.017, 0.086, -0.054]),
    tool_in_camera=np.array([0.06, 0.015, 0.0]),
    radar_in_tool=np.array([-0.186, -0.068, 0.046]),
    turn_deg=-3.0,
)
# Of experiment 2 one pose stands for all pictures, moved by what was found to be missing.
_SECOND_POSE = np.array(
    [
        [0.99948083, -0.00142446, -0.03218756, 0.58516503 - 0.005],
        [-0.0013166, -0.99999345, 0.00337192, -0.00280226 + 0.010],
        [-0.03219215, -0.00332779, -0.99947616, 0.4604748],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
# Of the camera's axes those of the radar's frame, where the arm holds it upright: x is -y, y is -x, z is -z.
_UPRIGHT = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def published_radar_from_camera(
    number: int, pose: ArrayLike, origin: ArrayLike, radar_turn: ArrayLike | None = None
) -> np.ndarray:
    """(4, 4) `T_radar_camera` of an experiment of the published dataset, with the constants of its public evaluation.

    The mount changed between the two experiments. In the first the pose of a file is the tool's, and only shifts are
    taken from it; in the second one pose stands for all pictures.

    Parameters
    ----------
    number : N of `exp<N>`, 1 or 2
    pose : (4, 4) as the file has it [m]
    origin : (3,) of the images' frame, in the base frame [m]
    radar_turn : (3, 3) of the first experiment: the rotation of the tool at the radar's first place; None, where no
        file tells it: that of the pose, as if the tool had been held alike for the picture and the scan

    Raises
    ------
    InputError
        There are no constants for that experiment.
    """
    if number == 2:
        return radar_from_camera(_SECOND_POSE, origin)
    if number != 1:
        raise InputError(f"experiment is {number}; the published transforms are of experiments 1 and 2")
    tool = checked_array(pose, name="pose", shape=(4, 4))
    turned = tool[:3, :3] if radar_turn is None else checked_array(radar_turn, name="radar_turn", shape=(3, 3))
    camera = tool[:3, 3] + tool[:3, :3] @ _FIRST_MOUNT.camera_in_tool
    radar = checked_array(origin, name="origin", shape=(3,), unit="m") + turned @ _FIRST_MOUNT.radar_in_tool
    transform = np.eye(4)
    transform[:3, :3] = rotation_from_euler_deg([0, 0, _FIRST_MOUNT.turn_deg]) @ _UPRIGHT
    transform[:3, 3] = camera - _FIRST_MOUNT.tool_in_camera - radar
    return transform


def camera_truth(
    mask: CameraMask, grid_xy: PixelGrid, T_radar_camera: ArrayLike, *, intrinsics: Intrinsics | None = None
) -> Mask:
    """Project the object's mask from the camera picture onto the grid of a radar image.

    Parameters
    ----------
    mask : the object's pixels, and their depths
    grid_xy : of the image
    T_radar_camera : (4, 4) camera frame to the image's frame [m]
    intrinsics : of the camera; None: the published one's

    Raises
    ------
    InputError
        The mask is empty, has no depth anywhere, or lies off the grid.
    """
    checked_record(mask, CameraMask, name="mask")
    return pixels_on_grid(mask.pixels, mask.depth * mask.depth_unit, grid_xy, T_radar_camera, intrinsics=intrinsics)


def camera_mask_of(
    frame: CameraFrame, inside: ArrayLike, *, depth_range: tuple[float, float] = PUBLISHED_DEPTHS
) -> CameraMask:
    """The ground truth of a camera frame in the published form, from the object's pixels.

    Depths outside the range are taken for errors. Holes in the depth of up to `_HOLE` pixels, within the mask, are
    filled with the nearest depth beside them; larger ones stay NaN, as does what is outside the mask.

    Parameters
    ----------
    frame : the picture, its depth and its pose
    inside : (H, W) bool, the object's pixels
    depth_range : smallest and largest depth of the object [m]; published: 0.2 to 0.5

    Raises
    ------
    InputError
        The mask is empty or of another size, or no pixel of it has such a depth.
    """
    from scipy.ndimage import distance_transform_edt, label

    checked_record(frame, CameraFrame, name="frame")
    pixels = checked_array(inside, name="inside", shape=np.shape(frame.depth), dtype=np.bool_)
    low, high = checked_numbers(depth_range, name="depth_range", count=2, minimum=0, unit="m")
    depth = np.where(pixels, np.asarray(frame.depth, float) * frame.depth_unit, np.nan)
    known = (depth >= low) & (depth <= high)
    if not known.any():
        what = "is empty" if not pixels.any() else f"has no depth from {low:g} to {high:g} m"
        raise InputError(f"the mask in the picture {what}; mark the object where the camera saw it, or pass its depths")
    numbers = np.empty(pixels.shape, np.int32)
    label(pixels & ~known, output=numbers)
    small = np.bincount(numbers.ravel()) <= _HOLE
    small[0] = False
    nearest = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    mended = np.where(known, depth, np.where(small[numbers], depth[tuple(nearest)], np.nan))
    return CameraMask(
        pixels=pixels,
        depth=(mended / frame.depth_unit).astype(np.float32),
        points=frame.intrinsics.points(mended).astype(np.float32),
        pose=frame.pose,
        depth_unit=frame.depth_unit,
        metadata=with_step(frame.metadata, "camera_mask_of", depth_range=[low, high]),
    )


def pixels_on_grid(
    pixels: np.ndarray,
    depth: np.ndarray,
    grid_xy: PixelGrid,
    T_radar_camera: ArrayLike,
    *,
    intrinsics: Intrinsics | None = None,
) -> Mask:
    """Pixels of a picture with depth as a mask on a radar image's grid.

    Holes in the depth, within the mask, are filled with the nearest depth in it. A pixel of the grid is covered where a
    point lies as near to its centre, seen along z, as points on a level surface lie to each other.

    Parameters
    ----------
    pixels : (H, W) bool
    depth : (H, W) along the camera's axis [m]; 0 or NaN where there is none
    grid_xy, T_radar_camera, intrinsics : as for `camera_truth`

    Raises
    ------
    InputError
        No pixel is set, none of them has a depth, or all lie off the grid.
    """
    from scipy.spatial import KDTree

    lens = Intrinsics.published() if intrinsics is None else intrinsics
    transform = checked_array(T_radar_camera, name="T_radar_camera", shape=(4, 4))
    filled = _filled(pixels, depth)
    points = lens.points(filled)[pixels] @ transform[:3, :3].T + transform[:3, 3]
    _check_on_grid(points, grid_xy)
    x, y = np.meshgrid(grid_xy.x, grid_xy.y, indexing="ij")
    spacing = filled[pixels] / min(lens.fx, lens.fy)
    far, nearest = KDTree(points[:, :2]).query(
        np.stack([x.ravel(), y.ravel()], axis=1), distance_upper_bound=_REACH * spacing.max()
    )
    reach = np.append(_REACH * spacing, 0.0)[nearest]  # where none is near, the tree names one past the last
    return Mask(grid_xy=grid_xy, inside=_without_pinholes((far <= reach).reshape(grid_xy.shape)))


def _without_pinholes(inside: np.ndarray) -> np.ndarray:
    """A mask with holes of `_PINHOLE` pixels and less filled: where a slope hides from the camera, points lie apart."""
    from scipy.ndimage import label

    numbers = np.empty(inside.shape, np.int32)
    label(~inside, output=numbers)
    sizes = np.bincount(numbers.ravel())
    edge = np.concatenate([numbers[0], numbers[-1], numbers[:, 0], numbers[:, -1]])
    filled = sizes <= _PINHOLE
    filled[edge] = False
    return inside | filled[numbers]


def _filled(pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(H, W) depth [m] with holes within the mask filled with the nearest depth in it."""
    from scipy.ndimage import distance_transform_edt

    check_shape(np.shape(depth), name="depth", shape=np.shape(pixels))
    known = pixels & (depth > 0)
    if not known.any():
        what = "none of its pixels has a depth" if np.any(pixels) else "it is empty"
        raise InputError(f"the mask in the picture cannot be located: {what}; draw it where the camera saw the object")
    nearest = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    return np.asarray(depth)[tuple(nearest)].astype(float)


def _check_on_grid(points: np.ndarray, grid_xy: PixelGrid) -> None:
    """At least one of (n, 3) points must lie on a grid."""
    lower = np.array([grid_xy.x[0], grid_xy.y[0]])
    upper = np.array([grid_xy.x[-1], grid_xy.y[-1]])
    seen = points[:, :2]
    if not ((seen >= lower) & (seen <= upper)).all(axis=1).any():
        (x0, y0), (x1, y1) = seen.min(axis=0), seen.max(axis=0)
        raise InputError(
            f"the mask lies outside the grid: it covers x {x0:.4g} to {x1:.4g} m and y {y0:.4g} to {y1:.4g} m, the "
            f"grid over x {lower[0]:.4g} to {upper[0]:.4g} m and y {lower[1]:.4g} to {upper[1]:.4g} m; check the "
            "camera's pose and the frame of the image"
        )
