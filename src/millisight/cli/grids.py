"""The grid of an image and the outline drawn over it, from what the command line and the capture say."""

from collections.abc import Mapping

import numpy as np

from millisight.capture.capture import Capture
from millisight.cli.console import length
from millisight.errors import InputError
from millisight.imaging.grid import VoxelGrid
from millisight.records import checked_array
from millisight.scene.mesh import TriangleMesh
from millisight.scene.scene import Scene

# Around the scene's bounding box the default grid stands out by this much on every side [m].
_MARGIN = 0.02
# By so much may the box of an outline differ from that of the simulated scene, which was resampled [m].
_MISFIT = 0.01


def parse_grid(text: str | None, capture: Capture) -> VoxelGrid:
    """The grid that --grid names, or that the capture's description states, or the default around its scene.

    Raises
    ------
    InputError
        The text is no grid, or a spacing stands alone and the capture does not say where its scene is, or leaves
        two voxels along each axis at most.
    """
    if text is not None and ":" in text:
        axes = [part.split(":") for part in text.split(",")]
        if len(axes) != 3 or any(len(axis) != 3 for axis in axes):
            raise InputError(f"--grid is {text!r}; expected lower:upper:spacing three times, for x,y,z")
        lower, upper, spacing = zip(*[[length(v, option="--grid") for v in axis] for axis in axes], strict=True)
        return VoxelGrid.regular(lower, upper, spacing)
    spacing = None if text is None else length(text, option="--grid")
    stated = capture.metadata.get("image_grid")
    if isinstance(stated, Mapping):
        steps = stated["spacing"] if spacing is None else spacing
        grid = VoxelGrid.regular(stated["lower"], stated["upper"], steps)
    else:
        grid = around_scene(capture, spacing)
    if spacing is not None and max(grid.shape) <= 2:
        # Nobody wants eight voxels: "2" was meant as millimetres, and would take the place of an older image.
        raise InputError(
            f"--grid is {text!r}: voxels {spacing:g} m wide, two along each axis at most; pass a spacing such as 2mm"
        )
    return grid


def outline_mesh(outline: str, capture: Capture) -> TriangleMesh:
    """The mesh where `millisight simulate` put it.

    Raises
    ------
    InputError
        It does not fill the box that the capture's scene filled.
    """
    placed = capture.metadata.get("placed", {})
    rotate_deg = placed.get("rotate_deg", (0.0, 0.0, 0.0))
    mesh = Scene.from_mesh(outline, vertices=None, unit=placed.get("unit"), rotate_deg=rotate_deg).mesh
    bounds = _bounds(capture)
    if bounds is not None and np.abs(mesh.bounds - bounds).max() > _MISFIT:
        there, here = (" x ".join(f"{e * 100:.1f}" for e in np.ptp(b, axis=0)) for b in (bounds, mesh.bounds))
        raise InputError(
            f"--outline {outline} is {here} cm large, but the capture's scene was {there} cm; pass the mesh that was "
            "simulated"
        )
    return mesh


def _bounds(capture: Capture) -> np.ndarray | None:
    """(2, 3) the box [m] that the capture's scene fills, where the capture says."""
    bounds = capture.metadata.get("scene_bounds")
    return None if bounds is None else checked_array(bounds, name="scene_bounds", shape=(2, 3), unit="m")


def around_scene(capture: Capture, spacing: float | None = None) -> VoxelGrid:
    """A grid 2 cm around the simulated scene; `spacing` [m], or by default half a wavelength, twice that in depth.

    Raises
    ------
    InputError
        The capture does not say where its scene is, as real ones do not.
    """
    bounds = _bounds(capture)
    if bounds is None:
        raise InputError("the capture does not say where its scene is; pass --grid lower:upper:spacing for x,y,z")
    wavelength = capture.radar.waveform.wavelength
    steps = (spacing,) * 3 if spacing is not None else (wavelength / 2, wavelength / 2, wavelength)
    return VoxelGrid.regular(bounds[0] - _MARGIN, bounds[1] + _MARGIN, steps)
