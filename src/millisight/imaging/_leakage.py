"""What the transmitters leak straight into the receivers: found in frames, and taken off."""

from dataclasses import replace

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_record, with_step
from millisight.data import Capture
from millisight.imaging._scale import at_usual_scale, scaled

_LOOKS = 1000  # poses over which frames are averaged
_RESOLVED = 0.1  # range resolution up to which leakage is told from echoes [m]


def some_poses(capture: Capture) -> range:
    """Indices of at most about 1000 poses, evenly spread."""
    return range(0, len(capture.trajectory), max(1, len(capture.trajectory) // _LOOKS))


def leakage_of(capture: Capture) -> np.ndarray:
    """(T, R, N) complex64 what leaks, alike at all poses; 0 where the range resolution is coarser than 10 cm.

    The mean frame over poses, less the path between the antennas, is averaged over the band. A Hann window keeps out
    what is farther away than two range resolutions.
    """
    waveform = capture.radar.waveform
    frequencies = waveform.frequencies
    tx, rx = capture.tx_positions[:1, :, None], capture.rx_positions[:1, None]
    straight = np.linalg.norm(tx - rx, axis=-1)[0] + capture.radar.path_offset
    if not tells_leakage(capture):
        return np.zeros((*straight.shape, len(frequencies)), np.complex64)
    poses = some_poses(capture)
    mean = np.zeros((*straight.shape, len(frequencies)), complex)
    for pose in poses:
        mean += capture.frames_of(slice(pose, pose + 1))[0] / len(poses)
    wave = np.exp(-2j * np.pi / SPEED_OF_LIGHT * straight[..., None] * frequencies)
    window = np.hanning(len(frequencies) + 2)[1:-1]
    amplitude = (mean * wave.conj()) @ window / window.sum()
    return (amplitude[..., None] * wave).astype(np.complex64)


def tells_leakage(capture: Capture) -> bool:
    """Whether ranges are fine enough to tell leakage from echoes."""
    return capture.radar.waveform.range_resolution <= _RESOLVED


def remove_leakage(capture: Capture) -> Capture:
    """Take off what the transmitters leak straight into the receivers.

    It is often the strongest echo, alike at all poses, and comes from no distance. Its range sidelobes reach into the
    scene: they hide lids in frames, and weak objects in images. Only an echo with the path between the antennas, and
    the same amplitude at all frequencies and poses, is taken.

    Parameters
    ----------
    capture : of a radar whose path offset is calibrated, frames in memory or on disk. Antennas whose distance changes
        from pose to pose (`tx_points`, `rx_points`) keep their leakage

    Returns
    -------
    Capture
        With frames in memory; the given one where the range resolution is coarser than 10 cm, which does not tell
        leakage from echoes.

    Raises
    ------
    InputError
        All values are so small that float32 holds few digits of them.

    Examples
    --------
    >>> from millisight.data import Radar, Scene, Trajectory
    >>> from millisight.simulation import simulate
    >>> capture = simulate(Scene.from_mesh("golf_ball", vertices=2000), Radar.preset("mito-sim-77ghz"),
    ...                    Trajectory.raster(size=(0.03, 0.03), step=0.003))
    >>> remove_leakage(capture).frames.shape == capture.frames.shape
    True
    """
    if not tells_leakage(checked_record(capture, Capture, name="capture")):
        return capture
    usual, scale = at_usual_scale(capture)
    leak = leakage_of(usual)
    if not leak.any():
        return capture
    frames = usual.frames_of(slice(None))
    power = float(np.mean(np.abs(leak) ** 2) / np.mean(np.abs(frames) ** 2))
    cleaned = np.subtract(frames, leak, dtype=np.complex64)
    cleaned.flags.writeable = False
    made = replace(usual, frames=cleaned, metadata=with_step(capture.metadata, "remove_leakage", power=power))
    return made if scale == 1 else scaled(made, 1 / scale)
