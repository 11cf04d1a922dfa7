"""Where the rig's files place things in the robot's base frame, by numbers that are not the library's.

Whatever the rig writes and reads by one constant agrees with itself, however wrong the constant is. So the files are
read here without the library's readers of paths, and compared with the origin that the published code states.
"""

import numpy as np
import pytest

from millisight.evaluation import published_radar_from_camera
from millisight.io.mito import BASE_ORIGIN, experiment_folder, published_grid, radar_folder, read_published
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import (
    ArmSettings,
    CameraSettings,
    RadarSettings,
    ScanSettings,
    VirtualRig,
    World,
    WorldObject,
    experiment_info,
    visible_pixels,
)

ORIGIN = np.array([0.42, -0.23, 0.23])
"""Of the published images, in the base frame, as the published code has it [m]."""
CORNER, SIZE, CUBE = np.array([0.04, 0.05]), np.array([0.12, 0.16]), np.array([0.10, 0.13])
TOP = -0.30 + 0.0579  # of the cube on the tripod


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A rig whose arm strays nowhere, and the folder of its experiment."""
    world = World(
        objects=(WorldObject(object="rubiks_cube", at=tuple(CUBE)),),
        scan=ScanSettings(size=tuple(SIZE), corner=tuple(CORNER), row_spacing=0.06),
        arm=ArmSettings(speed=0.2, path_error=0.0, encoder_noise=0.0),
        radars=(RadarSettings(preset="position2go", mount=(0, 0, 0)),),
        camera=CameraSettings(depth_noise=0.0, holes=False),
    )

    def silent(settings, trajectory):
        waveform, receivers = settings.radar.waveform, len(settings.radar.array.rx_positions)
        return np.zeros((len(trajectory), 1, receivers, waveform.samples_per_chirp), complex)

    rig = VirtualRig(world, frames=silent)
    out = experiment_folder(tmp_path_factory.mktemp("origin"), "077_rubiks_cube", (0, 0, 0), 1, "los")
    record_scan(rig.arm, rig.radars, rig.camera, rig.plan, PublishedWriter(out, info=experiment_info(world)))
    return rig, out


@pytest.mark.slow
def test_the_log_holds_the_aperture_in_the_base_frame(recorded):
    _, out = recorded
    with np.load(radar_folder(out, "24_ghz", processed=False) / "antenna.npz") as log:
        places = log["tx_24_locs"][:, :3]
    rows = places[np.abs(places[:, 2] - ORIGIN[2]) < 1e-3]  # the others are on the way from where the picture is taken
    assert len(rows) > 50
    assert rows[:, :2].min(axis=0) == pytest.approx(ORIGIN[:2] + CORNER, abs=1e-3)
    assert rows[:, :2].max(axis=0) == pytest.approx(ORIGIN[:2] + CORNER + SIZE, abs=1e-3)
    assert places[:, 2].min() == pytest.approx(ORIGIN[2], abs=1e-3)


def test_the_picture_shows_the_object_at_its_place_in_the_base_frame(recorded):
    rig, out = recorded
    frame = read_published(out / "unprocessed" / "camera" / "continuous.pkl").record
    seen = visible_pixels(rig.layout, rig.photo_pose)
    points = frame.points[seen] @ frame.pose[:3, :3].T + frame.pose[:3, 3]
    top = points[points[:, 2] > ORIGIN[2] + TOP - 2e-3]
    assert len(top) > 3000
    assert top[:, 2].mean() == pytest.approx(ORIGIN[2] + TOP, abs=1e-3)
    assert (top.min(axis=0) + top.max(axis=0))[:2] / 2 == pytest.approx(ORIGIN[:2] + CUBE, abs=1.5e-3)


def test_the_published_camera_looks_at_the_middle_of_the_published_images():
    """Two published facts that meet only in the right origin: a pose in the base frame, and the images' own frame."""

    def missed(origin):
        """How far from the middle of the images the camera's axis meets the tripod's top [m]."""
        transform, grid = published_radar_from_camera(2, np.eye(4), origin), published_grid("77_ghz", "tripod")
        depth = (-0.30 - transform[2, 3]) / transform[2, 2]
        return np.linalg.norm((transform[:3, 3] + depth * transform[:3, 2])[:2] - [grid.x.mean(), grid.y.mean()])

    assert missed(BASE_ORIGIN) < 0.04
    for wrong in ([-0.42, -0.23, 0.23], [0.42, 0.23, 0.23], [-0.23, 0.42, 0.23], [0.0, 0.0, 0.0]):
        assert missed(wrong) > 0.15
