"""What the search for the clock looks at: where a scene is bright, and how sharp some channels see it by a clock."""

from typing import Any, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, product
from millisight.data import Capture, ClockCorrection, Trajectory, VoxelGrid
from millisight.imaging._backprojection import OVERSAMPLING, path_bounds, range_steering
from millisight.imaging._form import form_image
from millisight.imaging._kernels import backproject

BLOCK = 2000  # frames read at a time
_PAIRS = 1e9  # voxel-channel pairs of all parts' images together
_MOST_VOXELS = 2e5  # of one of them
_FAINTEST = 0.2  # of the brightest cell's power, for a cell to be looked at
_MOST_POINTS = 3_000


class Scene(NamedTuple):
    """Where a scene is bright: points (V, 3) [m], and the number (V,) of the cell that each lies in."""

    points: np.ndarray
    cells: np.ndarray


class Focus(NamedTuple):
    """Some channels, range-compressed once, and the points at which their image is wanted for any clock.

    Attributes
    ----------
    times : (C,) of the channels' frames, on the radar's clock [s]
    antennas : (C, 2) numbers of transmitter and receiver
    profiles : (C, 1, 1, M) complex64 range profiles
    scale : path length of a profile's entry 0 [m], entries per metre, centre frequency over c [1/m]
    ways : spline from the robot's time to the places (T + R, 3) of all antennas [m]
    points : (3, V) float32 [m]
    """

    times: np.ndarray
    antennas: np.ndarray
    profiles: np.ndarray
    scale: tuple[np.float32, np.float32, np.float32]
    ways: Any
    points: np.ndarray

    @classmethod
    def on(cls, points: np.ndarray, capture: Capture, channels: np.ndarray, log: Trajectory) -> "Focus":
        """Some channels of a capture, (C, 3) numbers of pose, transmitter and receiver, at `points` (V, 3) [m]."""
        from scipy.interpolate import CubicSpline

        array = capture.radar.array
        # Distances are float32: count coordinates from the points' middle.
        origin = points.mean(axis=0)
        ways = log.placed(np.concatenate([array.tx_positions, array.rx_positions])) - origin
        tx, rx = np.split(ways, [len(array.tx_positions)], axis=1)
        # Bounds for any clock: those of the whole log, and what a spline may go beyond its knots.
        nearest, furthest = path_bounds(tx, rx, np.stack([points.min(axis=0), points.max(axis=0)]) - origin)
        slack = 2 * np.abs(np.diff(ways, axis=0)).max()
        nearest, furthest = max(nearest - slack, 0.0), furthest + slack
        steering, per_metre = range_steering(capture, nearest, furthest, OVERSAMPLING, None)
        carrier = capture.radar.waveform.center_frequency / SPEED_OF_LIGHT
        return cls(
            times=capture.trajectory.times[channels[:, 0]],
            antennas=channels[:, 1:] + [0, len(array.tx_positions)],
            profiles=_profiles(capture, channels, steering)[:, None, None],
            scale=(np.float32(nearest), np.float32(per_metre), np.float32(carrier)),
            ways=CubicSpline(log.times, ways),
            points=np.ascontiguousarray((points - origin).T, dtype=np.float32),
        )

    def some(self, chosen: np.ndarray) -> "Focus":
        """The same with the `chosen` ones (C,) of the channels alone."""
        return self._replace(times=self.times[chosen], antennas=self.antennas[chosen], profiles=self.profiles[chosen])

    def image(self, clock: ClockCorrection) -> np.ndarray:
        """(V,) complex64 sum over channels at the points, with the poses that the log gives by this clock."""
        ways = self.ways(clock.robot_times(self.times)).astype(np.float32)
        tx, rx = (ways[np.arange(len(ways)), antenna][:, None] for antenna in self.antennas.T)
        sums = np.zeros((2, self.points.shape[1]), dtype=np.float32)
        (nearest, per_metre, carrier), (x, y, z) = self.scale, self.points
        backproject(self.profiles, nearest, per_metre, carrier, tx, rx, x, y, z, sums[0], sums[1])
        return sums[0] + np.complex64(1j) * sums[1]


def _profiles(capture: Capture, channels: np.ndarray, steering: np.ndarray) -> np.ndarray:
    """(C, M) range profiles of channels (C, 3), in the order of their poses; read in blocks: they may lie on disk."""
    blocks = channels[:, 0] // BLOCK
    made = []
    for block in np.unique(blocks):
        pose, tx, rx = channels[blocks == block].T
        frames = capture.frames_of(slice(block * BLOCK, (block + 1) * BLOCK))
        made.append(product(frames[pose - block * BLOCK, tx, rx], steering))
    return np.concatenate(made)


def pick(capture: Capture, poses: np.ndarray) -> np.ndarray:
    """(n, T, R, N) complex64 frames of the poses (n,), increasing; read in blocks, as they may lie on disk."""
    blocks = poses // BLOCK
    return np.concatenate([
        capture.frames_of(slice(block * BLOCK, (block + 1) * BLOCK))[poses[blocks == block] - block * BLOCK]
        for block in np.unique(blocks)
    ])  # fmt: skip


def mean_frame(capture: Capture) -> np.ndarray:
    """(T, R, N) complex128 mean of the frames over all poses; read in blocks, as they may lie on disk."""
    poses = len(capture.trajectory)
    starts = range(0, poses, BLOCK)
    return sum(capture.frames_of(slice(i, i + BLOCK)).sum(axis=0, dtype=complex) for i in starts) / poses


def bright_scene(
    capture: Capture,
    poses: np.ndarray,
    parts: np.ndarray,
    log: Trajectory,
    clock: ClockCorrection,
    box: np.ndarray,
) -> Scene:
    """Where in a box (2, 3) [m] the parts of the aperture see most power; poses (n,) and the parts (n,) they are of.

    The powers of the parts' images are added, each of a few neighbouring rows: too coarse for a clock that is a little
    wrong to matter, so that what is chosen does not favour the clock it was chosen with.
    """
    centre = box.mean(axis=0)
    numbers = np.unique(parts)
    ways = [log.at(clock.robot_times(capture.trajectory.times[poses[parts == number]])) for number in numbers]
    lobe = np.median([_lobe(capture, way, centre) for way in ways], axis=0)
    size = 0.7 * lobe
    size = size * max(1.0, (np.prod((box[1] - box[0]) / size + 1) / _MOST_VOXELS) ** (1 / 3))
    grid = VoxelGrid.regular(box[0], box[1], size)
    channels = int(np.prod(capture.frames.shape[1:3]))
    many = max(int(_PAIRS / (len(numbers) * grid.size * channels)), 20)
    power = np.zeros(grid.shape)
    for number, way in zip(numbers, ways, strict=True):
        few = np.unique(np.linspace(0, len(way) - 1, min(many, len(way))).astype(int))
        part = Capture(
            radar=capture.radar, trajectory=log.at(way.times[few]), frames=pick(capture, poses[parts == number][few])
        )
        power += form_image(part, grid, method="backprojection").magnitude ** 2
    order = np.argsort(power, axis=None)[::-1]
    order = order[power.ravel()[order] > _FAINTEST * power.max()]
    fine = 0.7 * _lobe(capture, log.at(clock.robot_times(capture.trajectory.times[poses])), grid.points[order[0]])
    counts = np.ceil(size / fine)
    inside = VoxelGrid.regular(
        -(counts - 1) / 2 * size / counts, (counts - 1) / 2 * size / counts, size / counts
    ).points
    cells = grid.points[order[: max(1, int(_MOST_POINTS / len(inside)))]]
    return Scene((cells[:, None] + inside).reshape(-1, 3), np.repeat(np.arange(len(cells)), len(inside)))


def local_frequencies(capture: Capture, trajectory: Trajectory, place: np.ndarray) -> np.ndarray:
    """(n, 3) f grad d / c at a place [cycles/m], of every channel of a capture's radar, for both ends of its band."""

    def towards(antennas: np.ndarray) -> np.ndarray:
        away = place - trajectory.placed(antennas)
        return away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)

    array, frequencies = capture.radar.array, capture.radar.waveform.frequencies
    gradient = towards(array.tx_positions)[:, :, None] + towards(array.rx_positions)[:, None, :]
    return np.concatenate([f / SPEED_OF_LIGHT * gradient.reshape(-1, 3) for f in frequencies[[0, -1]]])


def _lobe(capture: Capture, trajectory: Trajectory, place: np.ndarray) -> np.ndarray:
    """(3,) width of the main lobe at a place [m]: one over the span of the local frequencies."""
    return 1 / np.maximum(np.ptp(local_frequencies(capture, trajectory, place), axis=0), 1e-3)


def box_below(capture: Capture, positions: np.ndarray, paths: np.ndarray) -> np.ndarray:
    """(2, 3) box under the aperture where the reflectors with the path lengths `paths` (n,) can lie [m].

    Above and below look the same from a plane, so below serves for both.
    """
    lower, upper = positions.min(axis=0), positions.max(axis=0)
    depth = int(np.argmin(upper - lower))
    margin = min(capture.radar.waveform.range_resolution, paths.max() / 2)
    near, far = max(paths.min() / 2 - margin, 0.03), paths.max() / 2 + margin
    lower[depth], upper[depth] = lower[depth] - far, lower[depth] - near
    return np.stack([lower, upper])
