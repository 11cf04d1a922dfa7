"""The RealSense camera's driver, on frames of its maker's software device."""

import numpy as np
import pytest

from helpers import boards
from millisight.calibration import find_corners
from millisight.core.errors import DeviceError
from millisight.data import Intrinsics
from millisight.rig import Camera, Device
from millisight.rig.drivers import DRIVERS, RealSenseCamera, RealSenseSettings, picture_of

rs = pytest.importorskip("pyrealsense2", reason="needs pyrealsense2 and libusb-1.0: make setup", exc_type=ImportError)

WIDTH, HEIGHT = 64, 48


OPTICS = Intrinsics(fx=61.8, fy=61.7, cx=32.1, cy=24.1, width=WIDTH, height=HEIGHT)


def stream(kind, number, bytes_per_pixel, form, optics):
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = optics.width, optics.height
    intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = optics.fx, optics.fy, optics.cx, optics.cy
    intrinsics.model = rs.distortion.none
    video = rs.video_stream()
    video.type, video.index, video.uid, video.fmt = kind, 0, number, form
    video.width, video.height, video.fps = optics.width, optics.height, 30
    video.bpp, video.intrinsics = bytes_per_pixel, intrinsics
    return video


def frames_of(depth, color, optics=OPTICS):
    """The two pictures, as a device would give them together."""
    device = rs.software_device()
    made, profiles = [], []
    for name, kind, data, form in (
        ("Depth", rs.stream.depth, depth, rs.format.z16),
        ("Color", rs.stream.color, color, rs.format.rgb8),
    ):
        sensor = device.add_sensor(name)
        size = data.itemsize * (data.shape[2] if data.ndim == 3 else 1)
        profiles.append(sensor.add_video_stream(stream(kind, len(made) + 1, size, form, optics)))
        if name == "Depth":
            sensor.add_read_only_option(rs.option.depth_units, 0.001)
        made.append((sensor, data, size))
    same = rs.extrinsics()
    same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
    profiles[0].register_extrinsics_to(profiles[1], same)
    device.create_matcher(rs.matchers.default)
    syncer = rs.syncer()
    for (sensor, _, _), profile in zip(made, profiles, strict=True):
        sensor.open(profile)
        sensor.start(syncer)
    for count in range(1, 6):
        for (sensor, data, size), profile in zip(made, profiles, strict=True):
            frame = rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp = (
                np.ascontiguousarray(data).reshape(-1).view(np.uint8),
                optics.width * size,
                size,
            )
            frame.timestamp, frame.domain, frame.frame_number = 33.0 * count, rs.timestamp_domain.hardware_clock, count
            frame.profile = profile.as_video_stream_profile()
            if data.ndim == 2:
                frame.depth_units = 0.001
            sensor.on_video_frame(frame)
        frames = syncer.wait_for_frames(2000)
        if frames.get_depth_frame() and frames.get_color_frame():
            return frames
    raise AssertionError("the software device gives no pair of pictures")


def test_a_picture_has_depth_colour_and_its_camera():
    rng = np.random.default_rng(0)
    depth = np.full((HEIGHT, WIDTH), 400, np.uint16)
    depth[10:20, 30:40] = 300
    depth[:, :3] = 0
    color = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    picture = picture_of(frames_of(depth, color), np.eye(4))
    assert np.array_equal(picture.rgb, color)
    # Alignment rounds to pixels: borders move by one, and some pixels get none.
    for part, distance in ((picture.depth[11:19, 31:39], 300), (picture.depth[25:45, 5:60], 400)):
        assert set(np.unique(part)) <= {0, distance}
        assert (part == distance).mean() > 0.9
    assert (picture.depth[25:45, :2] == 0).all()
    assert picture.depth_unit == pytest.approx(0.001)
    assert (picture.intrinsics.fx, picture.intrinsics.cy) == pytest.approx((61.8, 24.1))
    assert picture.points[30, 32, 2] == pytest.approx(0.4)


@pytest.mark.slow
def test_a_board_is_found_in_a_picture_of_its():
    """As `millisight rig photo` saves it, with the intrinsics that the library tells."""
    told = boards.setup(np.random.default_rng(0), 1)
    (color,) = boards.pictures_of(told, np.random.default_rng(1))
    picture = picture_of(frames_of(np.full(color.shape[:2], 400, np.uint16), color, boards.OPTICS), np.eye(4))
    found = find_corners(picture.rgb, boards.BOARD)
    assert np.sqrt(((found - boards.corners_of(told)[0]) ** 2).sum(axis=1).mean()) < 0.1
    assert (picture.intrinsics.fx, picture.intrinsics.cx) == pytest.approx((618.2, 321.3))


def test_where_the_picture_is_taken_from():
    camera = RealSenseCamera(RealSenseSettings(offset=(0.0, 0.07, 0.02)))
    assert isinstance(camera, Camera)
    assert isinstance(camera, Device)
    with pytest.raises(DeviceError, match="does not know where the arm is"):
        camera.pose()
    half = np.sqrt(0.5)
    camera.place = lambda: (np.array([0.5, -0.1, 0.3]), np.array([0, 0, half, half]))  # a quarter turn about z
    pose = camera.pose()
    assert pose[:3, 3] == pytest.approx([0.43, -0.1, 0.32])
    assert pose[:3, 2] == pytest.approx([0, 0, -1])
    assert pose[:3, 0] == pytest.approx([0, 1, 0], abs=1e-12)


def test_no_camera_is_told():
    camera = RealSenseCamera(RealSenseSettings(serial="000"))
    with pytest.raises(
        DeviceError, match="no RealSense camera with the serial number 000 is there; cameras that are: "
    ):
        camera.open()
    with pytest.raises(DeviceError, match="the camera is not open"):
        camera.check()
    camera.close()
    assert DRIVERS["realsense"].kind == "camera"
