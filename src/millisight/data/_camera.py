"""What a depth camera saw: pictures with depth, and which of their pixels show the object.

The camera frame is right-handed with x right, y down and z forward, in metres; pixels are counted from 0 at the
upper left, and (column, row) is the place of a pixel's centre.
"""

from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import (
    Metadata,
    check_shape,
    checked_array,
    checked_integer,
    checked_metadata,
    checked_number,
    checked_record,
    put,
    record,
)
from millisight.core.errors import InputError


@record
class Intrinsics:
    """A pinhole camera without distortion: column = fx x / z + cx, row = fy y / z + cy.

    Attributes
    ----------
    fx, fy : focal lengths [pixels]
    cx, cy : where the optical axis meets the picture [pixels]
    width, height : of the picture [pixels]
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        put(
            self,
            fx=checked_number(self.fx, name="fx", unit="pixels", above=0),
            fy=checked_number(self.fy, name="fy", unit="pixels", above=0),
            cx=checked_number(self.cx, name="cx", unit="pixels"),
            cy=checked_number(self.cy, name="cy", unit="pixels"),
            width=checked_integer(self.width, name="width"),
            height=checked_integer(self.height, name="height"),
        )

    @classmethod
    def published(cls) -> "Intrinsics":
        """Of the RGB-D pictures of the MITO dataset, 640 x 480."""
        return cls(fx=618.174, fy=617.759, cx=321.274, cy=241.059, width=640, height=480)

    def points(self, depth: np.ndarray) -> np.ndarray:
        """(height, width, 3) points in the camera frame [m] from depths along z (height, width) [m].

        A depth of 0 or NaN, which is none, gives a point of NaN.
        """
        check_shape(np.shape(depth), name="depth", shape=(self.height, self.width))
        z = np.where(np.asarray(depth) > 0, depth, np.nan).astype(float)
        x = (np.arange(self.width) - self.cx) / self.fx * z
        y = (np.arange(self.height) - self.cy)[:, None] / self.fy * z
        return np.stack([x, y, z], axis=-1)


@record
class CameraFrame:
    """A picture with depth.

    Attributes
    ----------
    rgb : (H, W, 3) uint8
    depth : (H, W) along z, as the camera stored it, in steps of `depth_unit`; 0 or NaN where there is none
    pose : (4, 4) camera frame to the robot's base frame [m]
    intrinsics : Intrinsics
    depth_unit : [m]; 0.001 for millimetres
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        Shapes or kinds of numbers do not fit, or the pose is none.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    intrinsics: Intrinsics
    depth_unit: float = 0.001
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        shape = _picture(self.intrinsics)
        put(
            self,
            rgb=checked_array(self.rgb, name="rgb", shape=(*shape, 3), dtype=np.uint8),
            depth=_depths(self.depth, name="depth", shape=shape),
            pose=_pose(self.pose),
            depth_unit=checked_number(self.depth_unit, name="depth_unit", unit="m", above=0),
            metadata=checked_metadata(self.metadata),
        )

    def __repr__(self) -> str:
        return f"CameraFrame({self.intrinsics.width} x {self.intrinsics.height} pixels, depth as {self.depth.dtype})"

    @property
    def points(self) -> np.ndarray:
        """(H, W, 3) in the camera frame [m]; NaN where there is no depth."""
        return self.intrinsics.points(self.depth * self.depth_unit)


@record
class CameraMask:
    """The pixels of the object in a camera frame, and its position.

    Attributes
    ----------
    pixels : (H, W) bool, those that show the object
    depth : (H, W) along z, as stored, in steps of `depth_unit`, mended within the mask; 0 or NaN where there is none
    points : (H, W, 3) in the camera frame [m]; NaN where there is no depth
    pose : (4, 4) camera frame to the robot's base frame [m]
    depth_unit : [m]; 0.001 for millimetres
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        Shapes or kinds of numbers do not fit, or the pose is none.
    """

    pixels: np.ndarray
    depth: np.ndarray
    points: np.ndarray
    pose: np.ndarray
    depth_unit: float = 0.001
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        pixels = checked_array(self.pixels, name="pixels", shape=("H", "W"), dtype=np.bool_)
        put(
            self,
            pixels=pixels,
            depth=_depths(self.depth, name="depth", shape=pixels.shape),
            points=_depths(self.points, name="points", shape=(*pixels.shape, 3)),
            pose=_pose(self.pose),
            depth_unit=checked_number(self.depth_unit, name="depth_unit", unit="m", above=0),
            metadata=checked_metadata(self.metadata),
        )

    def __repr__(self) -> str:
        height, width = self.pixels.shape
        return f"CameraMask({width} x {height} pixels, {int(self.pixels.sum())} on the object)"


def _picture(intrinsics: Intrinsics) -> tuple[int, int]:
    """(height, width)"""
    checked_record(intrinsics, Intrinsics, name="intrinsics")
    return intrinsics.height, intrinsics.width


def _depths(value: ArrayLike, *, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """A read-only array of whole numbers or floats, in the type it came in; NaN is a missing one, infinity none."""
    try:
        array = np.array(value)
    except ValueError as error:  # rows that differ in length
        raise InputError(f"{name} cannot be read as an array: {error}") from error
    if array.dtype.kind not in "uif":
        raise InputError(f"{name} is an array of {array.dtype}; expected numbers")
    check_shape(array.shape, name=name, shape=shape)
    if np.isinf(array).any():
        raise InputError(f"{name} has infinite values; a missing one is NaN or 0")
    array.flags.writeable = False
    return array


def _pose(value: ArrayLike) -> np.ndarray:
    """A (4, 4) pose: an orthonormal, right-handed rotation to 1e-3, and a last row 0 0 0 1."""
    pose = checked_array(value, name="pose", shape=(4, 4))
    rotation = pose[:3, :3]
    proper = np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-3 and np.linalg.det(rotation) > 0
    if not proper or np.abs(pose[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise InputError(f"pose is {pose.tolist()}; expected a rotation, a shift, and 0 0 0 1 as the last row")
    return pose
