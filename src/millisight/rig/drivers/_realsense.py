"""An Intel RealSense depth camera, by its maker's library pyrealsense2."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from millisight.core import (
    checked_integer,
    checked_numbers,
    put,
    record,
    rotation_from_quaternion,
)
from millisight.core.errors import DeviceError
from millisight.data import CameraFrame, Intrinsics
from millisight.rig import CameraMount
from millisight.rig.drivers._driver import DRIVERS, Driver

_PATIENCE = 4.0  # for one picture [s]
_FIRST = 15  # pictures that the exposure may take to settle


@record
class RealSenseSettings:
    """Keys of a camera with `driver = "realsense"`.

    Attributes
    ----------
    serial : number of the camera; None: the only one there is
    width, height : of its pictures [pixels]
    rate : pictures a second
    offset : the camera in the radar frame [m]
    tilt_deg : how far it is turned from looking straight down, about the fixed axes [degrees]
    """

    serial: str | None = None
    width: int = 640
    height: int = 480
    rate: int = 30
    offset: tuple[float, float, float] = (0.0, 0.07, 0.02)
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        put(
            self,
            offset=checked_numbers(self.offset, name="offset", count=3, unit="m"),
            tilt_deg=checked_numbers(self.tilt_deg, name="tilt_deg", count=3, unit="deg"),
            **{name: checked_integer(getattr(self, name), name=name) for name in ("width", "height", "rate")},
        )


class RealSenseCamera:
    """A RealSense on the arm: a `Camera` and a `Device`.

    Attributes
    ----------
    place : called for where the radar frame is now: its position (3,) [m] and orientation (4,), a quaternion x, y, z,
        w, in the base frame; a `Lab` sets it
    """

    def __init__(self, settings: RealSenseSettings):
        self.settings: RealSenseSettings = settings
        self.place: Callable[[], tuple[np.ndarray, np.ndarray]] | None = None
        self._pipeline: Any = None

    def open(self) -> None:
        if self._pipeline is not None:
            return
        rs, settings = _library(), self.settings
        # Asked first, since the library itself waits 15 s for a camera.
        there = [device.get_info(rs.camera_info.serial_number) for device in rs.context().query_devices()]
        if not there or settings.serial not in (None, *there):
            wanted = f"with the serial number {settings.serial} " if settings.serial else ""
            raise DeviceError(
                f"no RealSense camera {wanted}is there; cameras that are: {', '.join(there) or 'none'}. Plug it into a "
                "USB 3 port, and check serial"
            )
        config = rs.config()
        if settings.serial is not None:
            config.enable_device(settings.serial)
        size = settings.width, settings.height
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, settings.rate)
        config.enable_stream(rs.stream.color, *size, rs.format.rgb8, settings.rate)
        pipeline = rs.pipeline()
        try:
            self._profile = pipeline.start(config)
        except RuntimeError as error:
            raise DeviceError(
                f"cannot start the RealSense camera: {error}; close other programs that use it, and check width, "
                "height and rate"
            ) from error
        self._pipeline = pipeline

    def check(self) -> list[str]:
        rs = _library()
        frame = self._frames()
        device = self._profile.get_device()
        share = float((np.asanyarray(frame.get_depth_frame().get_data()) > 0).mean())
        lines = [
            f"{device.get_info(rs.camera_info.name)}, serial number {device.get_info(rs.camera_info.serial_number)}",
            f"depth in {100 * share:.0f} % of the pixels",
        ]
        if share < 0.5:
            lines.append("warning: most pixels have no depth; is it nearer than 0.3 m, or covered?")
        return lines

    def watch(self) -> None:
        """It works only when it is asked."""

    def shoot(self) -> CameraFrame:
        if self.place is None:
            raise DeviceError("the camera does not know where the arm is; set place, as Lab does")
        for _ in range(_FIRST):
            self._frames()
        return picture_of(self._frames(), self.pose())

    def pose(self) -> np.ndarray:
        """(4, 4) camera frame to base frame, where the arm is now."""
        if self.place is None:
            raise DeviceError("the camera does not know where the arm is; set place, as Lab does")
        position, orientation = self.place()
        (turned,) = rotation_from_quaternion(np.asarray(orientation)[None])
        radar = np.eye(4)
        radar[:3, :3], radar[:3, 3] = turned, position
        return radar @ CameraMount(np.array(self.settings.offset), np.array(self.settings.tilt_deg)).pose

    def close(self) -> None:
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            pipeline.stop()

    def _frames(self) -> Any:
        if self._pipeline is None:
            raise DeviceError("the camera is not open; call open first")
        until = time.monotonic() + _PATIENCE
        try:
            while time.monotonic() < until:
                frames = self._pipeline.wait_for_frames(int(1000 * _PATIENCE))
                if frames.get_depth_frame() and frames.get_color_frame():
                    return frames
        except RuntimeError as error:
            raise DeviceError(f"the RealSense camera gives no picture: {error}; plug it in again") from error
        raise DeviceError("the RealSense camera gives no picture with depth; plug it in again")


def picture_of(frames: Any, pose: np.ndarray) -> CameraFrame:
    """The picture of a set of frames of pyrealsense2, its depth as the colour camera sees it.

    Parameters
    ----------
    frames : a composite frame with depth (z16) and colour (rgb8)
    pose : (4, 4) of the colour camera
    """
    rs = _library()
    aligned = rs.align(rs.stream.color).process(frames)
    color, depth = aligned.get_color_frame(), aligned.get_depth_frame()
    told = color.profile.as_video_stream_profile().get_intrinsics()
    return CameraFrame(
        rgb=np.array(color.get_data()),
        depth=np.array(depth.get_data()),
        pose=pose,
        intrinsics=Intrinsics(fx=told.fx, fy=told.fy, cx=told.ppx, cy=told.ppy, width=told.width, height=told.height),
        depth_unit=depth.get_units(),
        metadata={"distortion": str(told.model)},
    )


def _library() -> Any:
    try:
        import pyrealsense2
    except ImportError as error:
        raise DeviceError(
            f"the camera needs pyrealsense2: pip install 'millisight[realsense]', and the system's libusb-1.0 ({error})"
        ) from error
    return pyrealsense2


DRIVERS.add("realsense", Driver(kind="camera", settings=RealSenseSettings, make=RealSenseCamera))
