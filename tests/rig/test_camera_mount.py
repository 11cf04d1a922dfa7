"""How a rig file says where the camera sits, both ways."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from millisight.core import euler_deg_from_rotation, rotation_from_euler_deg, turn_between_deg
from millisight.core.errors import InputError
from millisight.rig import CameraMount
from millisight.rig.drivers import RealSenseCamera, RealSenseSettings
from millisight.rig.virtual import CameraSettings


@pytest.mark.parametrize("tilt", [(0, 0, 0), (3, -2, 90), (170, 40, -120), (-20, -89, 15)])
def test_keys_and_pose_are_each_other_s_inverse(tilt):
    mount = CameraMount(np.array([0.01, 0.07, 0.02]), np.array(tilt, dtype=float))
    back = CameraMount.of(mount.pose)
    assert back.offset == pytest.approx(mount.offset)
    assert back.tilt_deg == pytest.approx(tilt)
    # It is the pose that drivers give the camera.
    camera = RealSenseCamera(RealSenseSettings(offset=tuple(back.offset), tilt_deg=tuple(back.tilt_deg)))
    place, turn = np.array([0.4, -0.1, 0.3]), Rotation.from_euler("xyz", [10, 20, 30], degrees=True)
    camera.place = lambda: (place, turn.as_quat())
    told = camera.pose()
    assert told[:3, :3] == pytest.approx(turn.as_matrix() @ mount.pose[:3, :3])
    assert told[:3, 3] == pytest.approx(place + turn.apply(mount.offset))
    settings = CameraSettings(offset=tuple(back.offset), tilt_deg=tuple(back.tilt_deg))
    assert settings.pose(np.zeros(3)) == pytest.approx(mount.pose)


def test_without_a_tilt_it_looks_down():
    pose = CameraMount(np.zeros(3), np.zeros(3)).pose
    assert pose[:3, 2].tolist() == [0, 0, -1]
    assert pose[:3, 0].tolist() == [1, 0, 0]


def test_angles_that_are_not_its_own():
    turned = rotation_from_euler_deg((20, 90, -30))
    angles = euler_deg_from_rotation(turned)
    assert angles[1:] == pytest.approx([90, 0], abs=1e-5)
    assert rotation_from_euler_deg(angles) == pytest.approx(turned, abs=1e-7)
    mount = CameraMount(np.zeros(3), angles)
    assert np.isinf(mount.tilt_sigma_deg(1e-6 * np.eye(3))).tolist() == [True, False, True]
    with pytest.raises(InputError, match="rotation has shape"):
        euler_deg_from_rotation(np.eye(4))


def test_uncertain_angles():
    """As many turned a little, at random, have them."""
    rng = np.random.default_rng(0)
    spread = np.radians(0.05) ** 2 * np.array([[1, 0.3, 0], [0.3, 2, 0.1], [0, 0.1, 0.5]])
    tilt = np.array([12.0, 35.0, 80.0])
    mount = CameraMount(np.zeros(3), tilt)
    turns = Rotation.from_rotvec(rng.multivariate_normal(np.zeros(3), spread, 2000)).as_matrix()
    angles = [CameraMount.of(pose_of(turn @ mount.pose[:3, :3])).tilt_deg for turn in turns]
    assert np.std(angles, axis=0) == pytest.approx(mount.tilt_sigma_deg(spread), rel=0.06)


def pose_of(rotation):
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return pose


def test_angles_between_turns():
    quaternions = Rotation.from_euler("z", [[0], [40], [-90]], degrees=True).as_quat()
    assert turn_between_deg(quaternions, quaternions[0]) == pytest.approx([0, 40, 90], abs=1e-5)
    assert turn_between_deg(2 * quaternions, -quaternions) == pytest.approx([0, 0, 0], abs=1e-5)
