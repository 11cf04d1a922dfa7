"""Oriented points of what a capture or an image shows."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from millisight.core import check_known, checked_number, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, PointCloud, SarImage, VoxelGrid
from millisight.geometry._from_image import moments_of_image
from millisight.geometry._moments import Moments, directions, moments_of
from millisight.imaging import CLUTTER, at_usual_scale, grid_around, remove_leakage, remove_sheets, window_pair

FALSE_ALARMS = 1e-6
"""Probability that a voxel of noise alone is taken for a surface, where none is stated."""

_ABOVE = 0.002  # what lies no higher above the support is its own [m]
_NEIGHBOURS = 0.006  # radius in which scatter is measured [m]


def surface_points(
    source: Capture | SarImage,
    grid: VoxelGrid | None = None,
    *,
    clutter: Literal["none", "lid", "auto"] | str = "none",
    false_alarms: float = FALSE_ALARMS,
    window: str | tuple[str | None, str | None] | None = "taylor",
    method: str = "fast",
    tolerance: float | None = None,
    frequency: float | None = None,
    support: float | None = None,
    device: Literal["cpu", "cuda"] | str = "cpu",
    progress: Callable[[int, int], None] | None = None,
) -> PointCloud:
    """Find oriented points on the surfaces that a capture, or an image, shows (primer 19 to 23).

    Of a capture, images of weighted frames are formed beside the image itself: weighted by the coordinates of each
    channel's middle between TX and RX they tell where a voxel's echo comes to, and so the normal; weighted by the
    frequency they tell the echo's delay, and so by how much the surface lies in front of the voxel. A voxel with a
    surface within it becomes a point, moved along its normal by that distance. The normal is mmNorm's (Dodds et al.,
    MobiSys 2025), computed by five fast images in place of a sum over antennas at each voxel, and put right for the
    pull of the aperture's end. What leaks between the antennas is taken off before (`remove_leakage`).

    An image alone tells less. Normals follow from the gradient of its phase along x and y; places are maxima of |I|
    along z. What is lost: |I| grows towards the centre of curvature, so a surface of radius R lies up to centimetres
    in front of its maximum; surfaces must face up; and voxels wider than half a wavelength make steep slopes ambiguous.

    Parameters
    ----------
    source : Capture; or SarImage, seen from above along z
    grid : of a capture: voxels in which surfaces are searched, 2 mm wide and up to 5 mm deep at 77 GHz; None: around
        its scene, as `grid_around`
    clutter : "lid" or "auto" to take lids and other sheets over the objects off before (`remove_sheets`); "none"
    false_alarms : probability that a voxel of noise alone passes the threshold -ln(p) times the noise's power. The
        noise is measured in each slice of voxels across the range, by the lower quartile of |I|²: sidelobes count as
        noise, and what is looked for must leave a quarter of each slice free
    window : over range and aperture; of a capture. "hann" gives normals of small bodies to a degree where they shine
        towards the aperture's inner half, and loses its rim; None has sidelobes that are taken for surfaces
    method, tolerance, device : of the images, as for `form_image`; of a capture
    frequency : centre of the band of an image whose history does not tell [Hz]
    support : height of what the objects lie on [m]: points under 2 mm above it are left out; None: unknown
    progress : called with (done, total); of a capture

    Returns
    -------
    PointCloud
        Points, |I|, normals, and standard deviations of both: of noise, and of the scatter among neighbours within
        6 mm. Empty where nothing stands out of the noise.

    Raises
    ------
    InputError
        The capture has a single frequency, layers, or antennas in one place or on one line; the image is real, or has
        fewer than 3 voxels along an axis; an argument is of the other kind of source, or cannot be right.
    UnknownNameError

    Examples
    --------
    >>> from millisight.data import Radar, Scene, Trajectory
    >>> from millisight.simulation import simulate
    >>> scene = Scene.from_mesh("golf_ball", vertices=4000)
    >>> radar = Radar.preset("mito-sim-77ghz")
    >>> capture = simulate(scene, radar, Trajectory.raster(size=(0.06, 0.06), step=0.003))
    >>> found = surface_points(capture, VoxelGrid.regular((-0.01, -0.01, 0), (0.01, 0.01, 0.04), 0.002))
    >>> bool(abs(found.normals[:, 2]).min() > 0.9)
    True
    """
    check_known("clutter", clutter, CLUTTER)
    chance = checked_false_alarms(false_alarms)
    settings: dict[str, Any] = {"clutter": clutter, "false_alarms": chance}
    if support is not None:
        settings["support"] = support = checked_number(support, name="support", unit="m")
    if isinstance(source, SarImage):
        if grid is not None:
            raise InputError("an image has its own grid; leave grid out")
        source, scale = at_usual_scale(source)
        cleaned = remove_sheets(source, clutter=clutter, frequency=frequency).result if clutter != "none" else source
        moments = moments_of_image(cleaned, frequency)
    else:
        capture, scale = at_usual_scale(checked_record(source, Capture, name="source"))
        if frequency is not None:
            raise InputError("a capture states its own frequencies; leave frequency out")
        voxels = grid_around(capture) if grid is None else checked_record(grid, VoxelGrid, name="grid")
        tapers = window_pair(window)
        cleaned = remove_sheets(capture, clutter=clutter, grid=voxels).result if clutter != "none" else capture
        cleaned = remove_leakage(cleaned)  # whose sidelobes are stronger than weak objects
        moments = moments_of(
            cleaned, voxels, method=method, window=tapers, tolerance=tolerance, device=device, progress=progress
        )
        settings["window"] = list(tapers)
    found = points_of(moments, chance, with_step(cleaned.metadata, "surface_points", **settings), scale)
    return found if support is None else above(found, support)


def checked_false_alarms(value: float) -> float:
    """A probability over 0 and under 1; InputError for others."""
    chance = checked_number(value, name="false_alarms", above=0)
    if not chance < 1:
        raise InputError(f"false_alarms is {chance:g}; expected a probability under 1, such as 1e-6")
    return chance


def above(points: PointCloud, support: float) -> PointCloud:
    """The points that lie over a support's height [m], along z."""
    return points.chosen(points.points[:, 2] > support + _ABOVE)


def points_of(moments: Moments, false_alarms: float, metadata: dict[str, Any], scale: float = 1.0) -> PointCloud:
    """The points of voxels with a surface within them, of moments of `scale` times what was measured."""
    axes = [moments.grid.x, moments.grid.y, moments.grid.z]
    power = np.abs(moments.values) ** 2
    normals = directions(moments.grid, moments.antenna)
    inside = moments.alone & (power > -np.log(false_alarms) * moments.noise)
    for k, axis in enumerate(axes):
        shape = [-1 if k == i else 1 for i in range(3)]
        lower, upper = _cells(axis)
        step = moments.ahead * normals[..., k]
        inside &= (step >= lower.reshape(shape)) & (step < upper.reshape(shape))
    where = np.nonzero(inside)
    if not len(where[0]):
        return PointCloud(
            points=np.empty((0, 3)), normals=np.empty((0, 3)), place_sigma=np.empty(0), normal_sigma_deg=np.empty(0),
            metadata=metadata,
        )  # fmt: skip
    voxels = np.stack([axis[i] for axis, i in zip(axes, where, strict=True)], axis=1)
    points = voxels + moments.ahead[where][:, None] * normals[where]
    away = np.linalg.norm(moments.antenna[where] - voxels, axis=1)
    # Of a signal with complex noise of power n, relative errors in phase and in amplitude are sqrt(n / 2) / |I|.
    relative = np.sqrt((moments.noise / np.maximum(power, 1e-30))[where] / 2)
    return _with_scatter(
        points, normals[where], np.abs(moments.values[where]) / scale, moments.delay_spread * relative,
        moments.spread * relative / away, metadata,
    )  # fmt: skip


def _cells(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each voxel reaches down and up from its centre [m]; without end along an axis with a single one."""
    if len(axis) == 1:
        return np.array([-np.inf]), np.array([np.inf])
    half = np.diff(axis) / 2
    return -np.r_[half[0], half], np.r_[half, half[-1]]


def _with_scatter(
    points: np.ndarray, normals: np.ndarray, magnitude: np.ndarray, place: np.ndarray, turn: np.ndarray, metadata: Any
) -> PointCloud:
    """Points with the scatter among neighbours, by which place and normal differ from their mean, added to the noise.

    `place` [m] and `turn` [rad] are standard deviations by noise alone.
    """
    from scipy.sparse import csr_array
    from scipy.spatial import KDTree

    pairs = KDTree(points).query_pairs(_NEIGHBOURS, output_type="ndarray")
    itself = np.arange(len(points))
    one, other = np.r_[itself, pairs[:, 0], pairs[:, 1]], np.r_[itself, pairs[:, 1], pairs[:, 0]]
    alike = (normals[one] * normals[other]).sum(axis=1) > 0
    one, other = one[alike], other[alike]
    shape, count = (len(points), len(points)), np.bincount(one)
    mean = _unit(csr_array((np.ones(len(one)), (one, other)), shape=shape) @ normals)
    heights = ((points[other] - points[one]) * normals[one]).sum(axis=1)
    offset = np.bincount(one, heights) / count
    apart = np.arccos(np.clip((mean * normals).sum(axis=1), -1, 1))
    return PointCloud(
        points=points,
        magnitude=magnitude,
        normals=normals,
        place_sigma=np.hypot(place, offset),
        normal_sigma_deg=np.degrees(np.hypot(turn, apart)),
        metadata=metadata,
    )


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
