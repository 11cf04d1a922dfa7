"""Which of the two phase signs gives the sharper image, where that can be told."""

from dataclasses import replace
from typing import Any

import numpy as np

from millisight.data import Capture, Trajectory, VoxelGrid

_TERMS = 4e8  # voxels times channels that are looked at, at most
_MOST = 2_000_000  # voxels
_CLEAR = 1.1  # so many times sharper is told


def sign_line(capture: Capture) -> str | None:
    """A line on the sharpness of the capture's image with its phase sign against the other; None: no grid is stated.

    The sharpness is sum |I|^4 / (sum |I|^2)^2 over the stated grid; of large captures some poses are looked at, drawn
    at random. Of a scan on a circle both signs focus, the other one to a picture that is turned by 180 degrees.
    """
    stated: Any = capture.metadata.get("image_grid")
    if stated is None:
        return None
    grid = VoxelGrid.regular(**stated)
    stride = int(np.ceil((grid.size / _MOST) ** (1 / 3)))
    grid = VoxelGrid(x=grid.x[::stride], y=grid.y[::stride], z=grid.z[::stride])
    count = len(capture.trajectory)
    few = int(_TERMS / grid.size * count / capture.channels)
    poses = np.sort(np.random.default_rng(0).permutation(count)[: max(100, few)])
    some = _part(capture, poses)
    ours, other = (_sharpness(one, grid) for one in (some, replace(some, frames=some.frames.conj())))
    if not (ours > 0 and other > 0):
        return "phase sign: undetermined, the image is empty"
    ratio = ours / other
    if max(ratio, 1 / ratio) < _CLEAR:
        return (
            f"phase sign: undetermined, the image is as sharp with the opposite sign ({1 / ratio:.2f} times); on a "
            "circle both signs focus, and the wrong one rotates the picture by 180 degrees"
        )
    if ratio > 1:
        return f"phase sign: as stated, the image is {ratio:.2f} times sharper than with the opposite sign"
    return f"warning: with the opposite phase_sign the image is {1 / ratio:.2f} times sharper; is the stated one right?"


def _part(capture: Capture, poses: np.ndarray) -> Capture:
    """The capture of some of its poses alone, in memory."""
    way, points = capture.trajectory, {"tx_points": capture.tx_points, "rx_points": capture.rx_points}
    return replace(
        capture,
        frames=capture.frames_of(slice(None))[poses],
        trajectory=Trajectory(
            times=way.times[poses],
            positions=way.positions[poses],
            orientations=None if way.orientations is None else way.orientations[poses],
        ),
        **{name: None if places is None else places[poses] for name, places in points.items()},
    )


def _sharpness(capture: Capture, grid: VoxelGrid) -> float:
    from millisight.imaging import form_image

    power = form_image(capture, grid, method="backprojection").magnitude.astype(float) ** 2
    return float(power.size * (power**2).sum() / max(power.sum() ** 2, 1e-300))
