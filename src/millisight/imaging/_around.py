"""The grid to image a scene or a capture on, where nobody names one."""

from collections.abc import Mapping

import numpy as np

from millisight.core import checked_array, checked_number
from millisight.core.errors import InputError
from millisight.data import Capture, Scene, TriangleMesh, VoxelGrid
from millisight.simulation import VIEW_MARGIN


def grid_around(
    scene: Scene | TriangleMesh | Capture,
    spacing: float | tuple[float, float, float] | None = None,
    *,
    margin: float = VIEW_MARGIN,
) -> VoxelGrid:
    """A regular grid around a scene, a mesh, or the scene of a capture: what `millisight image` does without --grid.

    Parameters
    ----------
    scene : a Scene, a TriangleMesh, or a Capture with a known scene: simulated captures store the bounding box,
        descriptions may state one, which gets no margin
    spacing : of the voxels, one number or three [m]; None: for a capture as its description states, or half a
        wavelength at the centre frequency, twice that in depth
    margin : distance of the grid beyond the scene on every side [m]

    Raises
    ------
    InputError
        The scene of the capture is unknown, as in real captures; a scene or a mesh is given without spacing; or the
        spacing leaves at most two voxels along each axis.

    Examples
    --------
    >>> grid_around(Scene.from_mesh("golf_ball", vertices=200), 0.005).shape
    (17, 17, 17)
    """
    margin = checked_number(margin, name="margin", unit="m", minimum=0)
    if isinstance(scene, Scene | TriangleMesh):
        bounds = scene.mesh.bounds if isinstance(scene, Scene) else scene.bounds
        if spacing is None:
            raise InputError("a scene alone has no wavelength; pass spacing, such as 0.002 [m], or a capture")
        lower, upper, steps = bounds[0] - margin, bounds[1] + margin, spacing
    elif not isinstance(scene, Capture):
        raise InputError(f"scene is of type {type(scene).__name__}; expected Scene, TriangleMesh or Capture")
    elif isinstance(stated := scene.metadata.get("image_grid"), Mapping):
        lower, upper, steps = stated["lower"], stated["upper"], stated["spacing"] if spacing is None else spacing
    else:
        bounds = scene_bounds(scene)
        if bounds is None:
            raise InputError("the capture does not say where its scene is; pass a grid, such as VoxelGrid.regular(...)")
        half = scene.radar.waveform.wavelength / 2
        lower, upper, steps = bounds[0] - margin, bounds[1] + margin, (half, half, 2 * half)
        steps = steps if spacing is None else spacing
    grid = VoxelGrid.regular(lower, upper, steps)
    if spacing is not None and max(grid.shape) <= 2:
        # Nobody wants eight voxels: a spacing of 2 was meant as millimetres.
        raise InputError(
            f"voxels {np.max(spacing):g} m wide leave at most two along each axis; pass a spacing such as 0.002, 2 mm"
        )
    return grid


def scene_bounds(capture: Capture) -> np.ndarray | None:
    """(2, 3) bounding box of the capture's scene [m], if known."""
    bounds = capture.metadata.get("scene_bounds")
    return None if bounds is None else checked_array(bounds, name="scene_bounds", shape=(2, 3), unit="m")
