"""How a mesh in its pose would look by the simulator, beside what was measured, and the weights of its echoes."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from millisight.core import check_known, checked_array, checked_record, share_of
from millisight.core.errors import CoverageError, InputError, MeshError
from millisight.data import Capture, Scene, Trajectory, TriangleMesh, VoxelGrid
from millisight.imaging import CLUTTER, at_usual_scale, form_image, remove_sheets
from millisight.simulation import simulate

_MODELS = ("specular", "edge")
_VERTICES = 10_000  # as scenes have, so that weights mean the same
_MARGIN = 0.015  # of the voxels around the mesh [m]
_STEPS = 0.65, 0.2  # of voxels: across, in wavelengths; along z, in range resolutions, but no more than
_DEEPEST = 0.01  # [m]
_MOST = 10**8  # voxels
_FEW = 4000, 1600, 2_000_000  # vertices, poses, and most voxels where several meshes are compared
_BLOCKS = 3  # along x and along y, of which one at a time is left out


class Appearance(NamedTuple):
    """What the simulator's image of a mesh says of a measured one.

    Attributes
    ----------
    agreement : 0 to 1, of the magnitudes of both images, blurred by a wavelength
    alpha : (a1, a2) weights of the specular and of the edge echoes, whose sum is 1, as of `ms.combine`; (0, 0) where
        nothing of the mesh is lit, or nothing was measured there
    alpha_sigma : standard deviation of either weight, by leaving out a ninth of the image at a time, and by what
        neither kind of echo explains; near 0.5, so nothing is known, where a mesh has no edges
    """

    agreement: float
    alpha: tuple[float, float]
    alpha_sigma: float


def appearance(
    capture: Capture,
    mesh: TriangleMesh,
    *,
    clutter: Literal["none", "lid", "auto"] | str = "none",
    progress: Callable[[int, int], None] | None = None,
) -> Appearance:
    """Compare a capture's image with the simulator's image of a mesh, and fit the weights of its echoes (primer 28).

    Specular and edge echoes are simulated at the capture's own poses and imaged on voxels around the mesh. Their
    powers, weighted by a1² and a2², are fitted to the measured power by least squares without negative weights. Powers
    are blurred by a wavelength first: a pose is seldom known to less, and phases say nothing beyond it.

    Parameters
    ----------
    capture : of one radar that is carried along a trajectory
    mesh : in its pose in the world [m]
    clutter : "lid" or "auto" to take lids and other sheets off before (`remove_sheets`)
    progress : called with (done, total)

    Raises
    ------
    InputError
        The capture has layers or antennas of its own at each pose, which the simulator does not know; the mesh is too
        large to be imaged.
    MeshError
        The mesh cannot be resampled.
    CoverageError
        An antenna lies in the mesh's bounding box.

    Examples
    --------
    >>> from millisight.data import Radar, Trajectory
    >>> scene = Scene.from_mesh("rubiks_cube", vertices=4000)
    >>> path = Trajectory.raster(size=(0.08, 0.08), step=0.003)
    >>> capture = simulate(scene, Radar.preset("mito-sim-77ghz"), path, model="edge")
    >>> found = appearance(capture, scene.mesh)
    >>> found.agreement > 0.9, round(sum(found.alpha), 6)
    (True, 1.0)
    """
    check_known("clutter", clutter, CLUTTER)
    checked_record(mesh, TriangleMesh, name="mesh")
    capture, _ = at_usual_scale(checked_record(capture, Capture, name="capture"))
    check_simulated(capture)
    grid = _around(capture, mesh.bounds)
    if grid.size > _MOST:
        raise InputError(
            f"the mesh is {mesh.extent.max():.3g} m long, which makes {grid.size:.2g} voxels; expected {_MOST:.0e} at "
            "most: check its unit"
        )
    powers = _powers(capture, mesh, grid, _VERTICES, progress)
    if clutter != "none":
        capture = remove_sheets(capture, clutter=clutter, grid=grid).result
    return fitted(_power(capture, grid, share_of(progress, 2, 3)), *powers)


def agreements(
    capture: Capture,
    meshes: Mapping[str, TriangleMesh],
    points: np.ndarray,
    *,
    clutter: str = "none",
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, float]:
    """How well the simulator's image of each of several meshes agrees with the measured one (primer 28).

    On the same voxels, around all meshes and points: what a mesh does not explain counts, and what it shows in vain. By
    1600 poses at most: ghosts of the gaps between them are in all these images alike.

    Parameters
    ----------
    capture : of one radar that is carried along a trajectory
    meshes : by name, in their poses in the world [m]
    points : (n, 3) where anything was seen, as of `surface_points` [m]
    clutter : "lid" or "auto" to take lids and other sheets off before (`remove_sheets`)
    progress : called with (done, total)

    Returns
    -------
    dict
        By name, 0 to 1; 0 of a mesh in which an antenna lies. Empty where meshes and points are so far apart that the
        image would have over two million voxels.

    Raises
    ------
    InputError
        See `appearance`.
    """
    check_known("clutter", clutter, CLUTTER)
    capture, _ = at_usual_scale(checked_record(capture, Capture, name="capture"))
    check_simulated(capture)
    there = checked_array(points, name="points", shape=("n", 3), unit="m")
    boxes = [checked_record(mesh, TriangleMesh, name="a mesh").bounds for mesh in meshes.values()]
    corners = np.concatenate([there, *boxes])
    grid = _around(capture, np.stack([corners.min(axis=0), corners.max(axis=0)]))
    vertices, poses, voxels = _FEW
    if grid.size > voxels:
        return {}
    if clutter != "none":
        capture = remove_sheets(capture, clutter=clutter, grid=grid).result
    path, chosen = capture.trajectory, slice(None, None, -(-len(capture.trajectory) // poses))
    turned = None if path.orientations is None else path.orientations[chosen]
    few = replace(
        capture,
        trajectory=Trajectory(times=path.times[chosen], positions=path.positions[chosen], orientations=turned),
        frames=capture.frames[chosen],
    )
    measured, found = _power(few, grid, None), dict[str, float]()
    for number, (name, mesh) in enumerate(meshes.items(), 1):
        try:
            found[name] = fitted(measured, *_powers(few, mesh, grid, vertices)).agreement
        except (CoverageError, InputError, MeshError):  # an antenna within it, say, where no object lies
            found[name] = 0.0
        if progress is not None:
            progress(number, len(meshes))
    return found


def can_be_simulated(capture: Capture) -> bool:
    """Whether the simulator can make captures like this one."""
    return capture.layers is None and capture.tx_points is None and capture.rx_points is None


def check_simulated(capture: Capture) -> None:
    """Raise InputError where the simulator cannot make captures like this one."""
    if not can_be_simulated(capture):
        raise InputError(
            "the capture has layers, or antennas of its own at each pose (tx_points, rx_points), which the simulator "
            "does not know; appearance expects a radar carried along a trajectory"
        )


def fitted(measured: np.ndarray, specular: np.ndarray, edge: np.ndarray) -> Appearance:
    """The appearance, of blurred powers (X, Y, Z) on one grid."""
    parts = np.stack([specular, edge])
    scales = np.maximum(parts.max(axis=(1, 2, 3)), 1e-30)
    if not measured.max() > 0 or not parts.max() > 0:
        return Appearance(0.0, (0.0, 0.0), 0.0)
    target, columns = measured / measured.max(), parts / scales[:, None, None, None]

    def weights(chosen: np.ndarray) -> np.ndarray:
        from scipy.optimize import nnls

        return nnls(columns[:, chosen].reshape(len(columns), -1).T, target[chosen].ravel())[0]

    def shares(found: np.ndarray) -> np.ndarray:
        amplitudes = np.sqrt(found / scales)
        return amplitudes / max(amplitudes.sum(), 1e-30)

    whole = np.ones(target.shape[:2], bool)
    best = weights(whole)
    magnitudes = np.sqrt(np.tensordot(best, columns, axes=1)), np.sqrt(target)
    norm = np.linalg.norm(magnitudes[0]) * np.linalg.norm(magnitudes[1])
    agreement = float((magnitudes[0] * magnitudes[1]).sum() / norm) if norm > 0 else 0.0
    others = []
    for rows in np.array_split(np.arange(target.shape[0]), _BLOCKS):
        for along in np.array_split(np.arange(target.shape[1]), _BLOCKS):
            kept = whole.copy()
            kept[np.ix_(rows, along)] = False
            others.append(shares(weights(kept))[0])
    # The jackknife of groups: the variance of n estimates that each lack one, times n - 1.
    scatter = float(np.std(others) * np.sqrt(len(others) - 1))
    a1, a2 = shares(best).tolist()
    misfit = _misfit(columns.reshape(len(columns), -1), target.ravel(), best)
    bent = [shares(np.maximum(best + change, 0))[0] for change in (*np.diag(misfit), *-np.diag(misfit))]
    return Appearance(min(agreement, 1.0), (a1, a2), float(np.hypot(scatter, np.std(bent))))


def _misfit(columns: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(2,) by how much each weight may be off if all that is left belongs to it: of a pose that is off, say."""
    left = np.linalg.norm(target - weights @ columns)
    gram = columns @ columns.T
    # Of each column's square what is not along the other one.
    alone = np.diag(gram) - gram[0, 1] ** 2 / np.maximum(np.diag(gram)[::-1], 1e-30)
    return left / np.sqrt(np.maximum(alone, 1e-12))


def _around(capture: Capture, bounds: np.ndarray) -> VoxelGrid:
    """Voxels around a box (2, 3), as fine as the waveform asks for."""
    waveform = capture.radar.waveform
    across, deep = _STEPS[0] * waveform.wavelength, min(_DEEPEST, _STEPS[1] * waveform.range_resolution)
    return VoxelGrid.regular(bounds[0] - _MARGIN, bounds[1] + _MARGIN, (across, across, deep))


def _powers(
    capture: Capture,
    mesh: TriangleMesh,
    grid: VoxelGrid,
    vertices: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[np.ndarray]:
    """The blurred powers of a mesh's specular and edge echoes, at the capture's poses."""
    scene = Scene.from_mesh(mesh, vertices=vertices, center=False)
    return [
        _power(simulate(scene, capture.radar, capture.trajectory, model=model), grid, share_of(progress, number, 3))
        for number, model in enumerate(_MODELS)
    ]


def _power(capture: Capture, grid: VoxelGrid, progress: Callable[[int, int], None] | None) -> np.ndarray:
    """(X, Y, Z) |I|² blurred by a wavelength."""
    from scipy.ndimage import gaussian_filter

    image = form_image(capture, grid, window="taylor", progress=progress)
    wavelength = capture.radar.waveform.wavelength
    axes = (grid.x, grid.y, grid.z)
    # By no more than the image's length: of waves longer than the scene all is alike.
    blurs = [min(wavelength / (axis[1] - axis[0]), len(axis)) if len(axis) > 1 else 0.0 for axis in axes]
    return gaussian_filter((np.abs(image.values) ** 2).astype(float), blurs, mode="constant")
