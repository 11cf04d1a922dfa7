"""Where a voxel's echo comes to and how long it took: images of weighted frames (primer 19 to 21).

An image is a sum over channels and frequencies, and linear in the frames. So frames weighted by a coordinate of each
channel's antenna, or by the frequency, give images A_x, A_y, A_z and F beside the image I itself, and of any voxel

    Re(A_k conj I) / |I|²  is the coherent mean of the antennas' coordinate k, towards which the surface faces;
    Im(F conj I) / |I|²    is proportional to the echo's delay against that of the voxel.

Where a surface bends strongly, many antennas share its echo, and the aperture's end pulls their mean to the middle of
the aperture. Of a smooth taper the imaginary part tells by how much, and the mean is put right by it.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, share_of, widths_in_samples
from millisight.core.errors import InputError
from millisight.data import Capture, VoxelGrid
from millisight.imaging import aperture_weights, form_image, range_weights, window_pair

_TINY = 1e-30  # of a power, where the image is 0
_LEAST_SPREAD = 1e-3  # of the antennas, along the second widest direction [m]
_CONSTANT = 1e-9  # spread of a coordinate that is the same for all channels [m]
_TOGETHER = 0.004  # standard deviation of the weights of voxels whose means are put right together [m]
_SLOPE = (0.5, 1.6)  # of the distance to the surface, over the way to it; 1 where there is nothing else near by
_QUARTILE = 0.25
_MOST_PULL = 1.0  # t², beyond which the aperture sees too little of an echo

Progress = Callable[[int, int], None]


class Moments(NamedTuple):
    """An image, and of each voxel where its echo comes to and how far in front of it the echo's surface lies.

    Attributes
    ----------
    grid : VoxelGrid
    values : (X, Y, Z) complex64, the image
    antenna : (X, Y, Z, 3) middle between TX and RX of the channels that a mirror in its place is seen by [m]
    ahead : (X, Y, Z) distance of the surface from the voxel, towards the antennas [m]; true where it is small
    alone : (X, Y, Z) bool, whether `ahead` changes from voxel to voxel as that of a single surface does
    noise : (X, 1, 1), (1, Y, 1) or (1, 1, Z), the mean power of noise in slices across the range
    spread : root mean square distance of the channels' middles from their mean [m]
    delay_spread : standard deviation of `ahead` over that of the image's phase [m]
    """

    grid: VoxelGrid
    values: np.ndarray
    antenna: np.ndarray
    ahead: np.ndarray
    alone: np.ndarray
    noise: np.ndarray
    spread: float
    delay_spread: float


def moments_of(
    capture: Capture,
    grid: VoxelGrid,
    *,
    method: str = "fast",
    window: tuple[str | None, str | None] = (None, None),
    tolerance: float | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
) -> Moments:
    """The image of a capture and its first moments over antennas and frequencies: five images at most.

    Raises
    ------
    InputError
        The capture has layers, a single frequency, or antennas in one place or on one line.
    """
    places = channel_middles(capture)
    check_moments(capture, places)
    origin = grid.bounds.mean(axis=0)
    made = weighted_images(
        capture, grid, method=method, window=window, tolerance=tolerance, device=device, progress=progress
    )
    values, power = made.values, np.maximum(np.abs(made.values) ** 2, _TINY)
    across = values.conj() / power
    coordinates = [image * across for image in made.by_place]
    places = places - origin
    aperture = (places * _shares(capture, window)[:, None, None, None]).reshape(-1, 3)
    middle = aperture.mean(axis=0)
    variances = ((places - middle) ** 2).mean(axis=(0, 1, 2))
    noise = noise_of(power, int(np.argmax(np.abs(places.mean(axis=(0, 1, 2))))))
    for k, along in enumerate(coordinates):
        coordinates[k] = _unpulled(along - middle[k], power, noise * variances[k], grid) + middle[k] + origin[k]
    taper, frequencies = _about_mean(capture, window)
    variance = np.average(frequencies**2, weights=taper)
    ahead = SPEED_OF_LIGHT / (4 * np.pi) / variance * (made.by_frequency * across).imag
    delay_spread = SPEED_OF_LIGHT / (4 * np.pi) / np.sqrt(variance)
    antenna = np.stack(coordinates, axis=-1)
    return Moments(
        grid=grid,
        values=values,
        antenna=antenna,
        ahead=ahead,
        alone=_alone(ahead, directions(grid, antenna), grid),
        noise=noise,
        spread=float(np.sqrt(variances.sum())),
        delay_spread=float(delay_spread),
    )


class WeightedImages(NamedTuple):
    """An image, and those of the same frames weighted.

    Attributes
    ----------
    values : (X, Y, Z) complex64
    by_place : three (X, Y, Z): each channel's frames times a coordinate of its middle, from the middle of the grid [m]
    by_frequency : (X, Y, Z): each sample times its frequency less the mean of all [Hz]
    """

    values: np.ndarray
    by_place: tuple[np.ndarray, ...]
    by_frequency: np.ndarray


def weighted_images(
    capture: Capture,
    grid: VoxelGrid,
    *,
    method: str = "fast",
    window: tuple[str | None, str | None] = (None, None),
    tolerance: float | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
) -> WeightedImages:
    """The images of a capture that its moments follow from; a coordinate that all channels share needs none."""
    # Counted from the grid's middle, so that A_k - x_k I loses no digits where the world's origin is far away.
    places = channel_middles(capture) - grid.bounds.mean(axis=0)
    frequencies = _about_mean(capture, window)[1]
    highest = float(np.abs(frequencies).max())
    constant = np.ptp(places, axis=(0, 1, 2)) < _CONSTANT
    weights = [places[..., k, None] for k in range(3) if not constant[k]] + [frequencies / highest]

    def image(of: Capture, number: int) -> np.ndarray:
        return form_image(
            of, grid, method=method, window=window, tolerance=tolerance, device=device,
            progress=share_of(progress, number, len(weights) + 1),
        ).values  # fmt: skip

    values = image(capture, 0)
    frames = capture.frames_of(slice(0, len(capture.trajectory)))
    made = []
    for number, weight in enumerate(weights, 1):
        weighted = np.multiply(frames, weight.astype(np.float32), dtype=np.complex64)
        weighted.flags.writeable = False
        made.append(image(replace(capture, frames=weighted), number))
    moving = iter(made)
    by_place = tuple(values * places[0, 0, 0, k] if constant[k] else next(moving) for k in range(3))
    return WeightedImages(values, by_place, made[-1] * highest)


def _about_mean(capture: Capture, window: tuple[str | None, str | None]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) weights of the samples in the image, and their frequencies less the mean of all [Hz]."""
    waveform = capture.radar.waveform
    taper = range_weights(window_pair(window)[0], waveform.samples_per_chirp)
    return taper, waveform.frequencies - np.average(waveform.frequencies, weights=taper)


def directions(grid: VoxelGrid, antenna: np.ndarray) -> np.ndarray:
    """(X, Y, Z, 3) unit vectors from the voxels towards the antennas."""
    towards = antenna - np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1)
    return towards / np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), _TINY)


def _alone(ahead: np.ndarray, normals: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    """(X, Y, Z) bool: a step along the normal towards a lone surface brings it nearer by that step."""
    slope = np.zeros(grid.shape)
    for k, axis in enumerate((grid.x, grid.y, grid.z)):
        if len(axis) > 1:
            slope -= np.gradient(ahead, axis, axis=k) * normals[..., k]
    return (slope > _SLOPE[0]) & (slope < _SLOPE[1])


def noise_of(power: np.ndarray, axis: int) -> np.ndarray:
    """Mean power of noise and sidelobes in each slice of voxels across an axis, by the lower quartile of the slice.

    The power of complex normal noise is exponentially distributed, and a quarter of it lies under ln(4/3) times its
    mean. Up to three quarters of a slice may hold something else.
    """
    others = tuple(k for k in range(3) if k != axis)
    return np.quantile(power, _QUARTILE, axis=others, keepdims=True) / -np.log(1 - _QUARTILE)


def _shares(capture: Capture, window: tuple[str | None, str | None]) -> np.ndarray:
    """(P,) weights of the poses in the image, of mean 1."""
    return aperture_weights(window_pair(window)[1], capture.trajectory.positions)


def _unpulled(along: np.ndarray, power: np.ndarray, noise: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    """(X, Y, Z) coordinate of the antennas that a mirror would be seen from, of the coherent mean (complex) [m].

    Of a taper exp(-p² / 2 w²) and an echo whose phase is a (p - p_0)² over the aperture the mean is p_0 / (1 - i t),
    with t = 1 / (2 a w²): its real part is p_0 / (1 + t²), and t is the ratio of its parts (primer 20).
    """
    from scipy.ndimage import gaussian_filter

    widths = widths_in_samples(_TOGETHER, grid.x, grid.y, grid.z)
    real, imaginary = np.real(along), np.imag(along)
    aside = gaussian_filter(power * imaginary**2, widths) - noise / 2
    straight = gaussian_filter(power * real**2, widths)
    pull = np.clip(aside / np.maximum(straight, _TINY), 0, _MOST_PULL)
    return real * (1 + pull)


def channel_middles(capture: Capture) -> np.ndarray:
    """Middles between transmitter and receiver of each channel, the antennas that `locate` and `complete` ask for.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    array
        (P, T, R, 3) [m], in the frame of the trajectory.
    """
    return (capture.tx_positions[:, :, None] + capture.rx_positions[:, None]) / 2


def check_moments(capture: Capture, places: np.ndarray) -> None:
    """Refuse a capture that tells no normals or no ranges.

    Raises
    ------
    InputError
    """
    if capture.layers is not None:
        raise InputError("the capture looks through layers, which bend paths; surface_points knows straight ones only")
    if np.ptp(capture.radar.waveform.frequencies) == 0:
        raise InputError(
            "the capture has a single frequency, which tells no range; form an image, and pass that to surface_points"
        )
    flat = places.reshape(-1, 3)
    extents = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False) / np.sqrt(len(flat))
    if len(extents) < 2 or extents[1] < _LEAST_SPREAD:
        raise InputError(
            f"the {len(flat)} channels of the capture lie in one place or on one line; expected antennas over an area, "
            "which tell which way a surface faces"
        )
