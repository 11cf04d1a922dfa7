"""The grid of an image, its memory, and the outline drawn over it, as options name them."""

import os

import numpy as np

from millisight.cli.console import SMALL, length, optional_length
from millisight.core.errors import InputError
from millisight.data import Capture, Scene, TriangleMesh, VoxelGrid
from millisight.imaging import grid_around, memory_needed, scene_bounds

# By so much may the box of an outline differ from that of the simulated scene, which was resampled [m].
_MISFIT = 0.01

_BYTES = {"M": 1e6, "G": 1e9, "T": 1e12}


def parse_grid(text: str | None, capture: Capture) -> VoxelGrid:
    """The grid that --grid names, or `grid_around` the capture.

    Raises
    ------
    InputError
        The text is no grid, or a spacing stands alone and there is no grid around the capture with it.
    """
    if text is not None and ":" in text:
        axes = [part.split(":") for part in text.split(",")]
        if len(axes) != 3 or any(len(axis) != 3 for axis in axes):
            raise InputError(f"--grid is {text!r}; expected lower:upper:spacing three times, for x,y,z")
        lower, upper, spacing = zip(*[[length(v, option="--grid") for v in axis] for axis in axes], strict=True)
        return VoxelGrid.regular(lower, upper, spacing)
    spacing = optional_length(text, option="--grid", metres=SMALL)
    if scene_bounds(capture) is None and "image_grid" not in capture.metadata:
        raise InputError("the capture does not say where its scene is; pass --grid lower:upper:spacing for x,y,z")
    try:
        return grid_around(capture, spacing)
    except InputError as error:
        if text is None:
            raise
        raise InputError(f"--grid is {text!r}: {error}") from error


def parse_bytes(text: str) -> float:
    """The size that --memory names, such as 8GB or 500MB [bytes].

    Raises
    ------
    InputError
        It is no size, or has no unit.
    """
    value = text.strip().upper().removesuffix("B")
    number, unit = value.rstrip("KMGT"), value[len(value.rstrip("KMGT")) :]
    try:
        size = float(number) * _BYTES[unit]
    except (KeyError, ValueError):
        size = 0.0
    if not 0 < size < float("inf"):
        raise InputError(f"--memory is {text!r}; expected a size with its unit, such as 8GB or 500MB")
    return size


def check_memory(capture: Capture, voxels: VoxelGrid, *, advice: str = ", or pass --memory") -> None:
    """Refuse, before any work, an image that this machine cannot hold.

    Raises
    ------
    InputError
    """
    needed, there = memory_needed(capture, voxels), _installed_memory()
    if needed > there:
        raise InputError(
            f"the image of {voxels.size:.3g} voxels takes about {needed / 1e9:.2g} GB, and this machine has "
            f"{there / 1e9:.2g} GB; use a coarser --grid{advice}"
        )


def _installed_memory() -> float:
    """Memory of this machine [bytes]; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


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
    bounds = scene_bounds(capture)
    if bounds is not None and np.abs(mesh.bounds - bounds).max() > _MISFIT:
        there, here = (" x ".join(f"{e * 100:.1f}" for e in np.ptp(b, axis=0)) for b in (bounds, mesh.bounds))
        raise InputError(
            f"--outline {outline} is {here} cm large, but the capture's scene was {there} cm; pass the mesh that was "
            "simulated"
        )
    return mesh
