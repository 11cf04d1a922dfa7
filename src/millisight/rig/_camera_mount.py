"""How a camera sits on the arm: the keys of a rig file, and the pose that they stand for."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import checked_array, euler_deg_from_rotation, rotation_from_euler_deg

_DOWN = np.diag([1.0, -1.0, -1.0])  # axes of a camera that looks down: x right, y towards -y, z down


class CameraMount(NamedTuple):
    """Where a camera sits, as a rig file's table [camera] has it.

    Attributes
    ----------
    offset : (3,) the camera in the radar frame [m]
    tilt_deg : (3,) how far it is turned from looking straight down, about the fixed axes x, then y, then z [degrees]
    """

    offset: np.ndarray
    tilt_deg: np.ndarray

    @property
    def pose(self) -> np.ndarray:
        """(4, 4) camera frame to radar frame."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_euler_deg(self.tilt_deg) @ _DOWN
        pose[:3, 3] = self.offset
        return pose

    @classmethod
    def of(cls, pose: ArrayLike) -> "CameraMount":
        """From a pose (4, 4), camera frame to radar frame: the inverse of `pose`."""
        matrix = checked_array(pose, name="pose", shape=(4, 4))
        return cls(offset=matrix[:3, 3], tilt_deg=euler_deg_from_rotation(matrix[:3, :3] @ _DOWN))

    def tilt_sigma_deg(self, covariance: ArrayLike) -> np.ndarray:
        """(3,) standard deviations of `tilt_deg` [degrees].

        Parameters
        ----------
        covariance : (3, 3) of a small turn about the axes of the radar frame [rad²]

        Notes
        -----
        A camera that is turned by 90 degrees about y has no angles of its own about x and z: theirs are infinite.
        """
        spread = checked_array(covariance, name="covariance", shape=(3, 3))
        _, y, z = self.tilt_deg
        if abs(np.cos(np.radians(y))) < 1e-6:
            return np.array([np.inf, np.degrees(np.sqrt(spread[1, 1])), np.inf])
        about_z = rotation_from_euler_deg((0.0, 0.0, z))
        # The turn that each angle adds, the later ones turning the axes of the earlier ones along.
        turns = np.stack([rotation_from_euler_deg((0.0, y, z))[:, 0], about_z[:, 1], [0.0, 0.0, 1.0]], axis=1)
        back = np.linalg.inv(turns)
        return np.degrees(np.sqrt(np.diag(back @ spread @ back.T)))
