"""A reader for napari (https://napari.org): images, masks, instances and voxel masks as its layers.

napari finds it by `napari.yaml` of this folder, once both packages are installed. Lengths are millimetres, and the axes
are z, y, x: the slider moves along z, seen from above.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Instances, Mask, SarImage, VolumeMask
from millisight.io import load

Layer = tuple[np.ndarray, dict[str, Any], str]
"""Values, settings, kind of layer: what napari makes a layer of."""

_SUFFIXES = (".h5", ".hdf5")
_MM = 1e3


def napari_reader(path: str | list[str]) -> Callable[[str | list[str]], list[Layer]] | None:
    """The function that reads these files, or None where one of them is no HDF5 file.

    Parameters
    ----------
    path : one, or several for a layer each
    """
    return napari_layers if all(Path(one).suffix.lower() in _SUFFIXES for one in _listed(path)) else None


def napari_layers(path: str | list[str]) -> list[Layer]:
    """A layer for each file.

    - SarImage: |I| as an "image" (Z, Y, X);
    - Mask and Instances: "labels" (Y, X), the objects' numbers;
    - VolumeMask: "labels" (Z, Y, X).

    Raises
    ------
    InputError
        A file holds another kind of record.
    FileError, FormatError, DamagedFileError
        See `ms.load`.
    """
    return [_layer(load(one), one) for one in _listed(path)]


def _listed(path: str | os.PathLike[str] | list[str]) -> list[Any]:
    return path if isinstance(path, list) else [path]


def _layer(held: Any, path: str) -> Layer:
    if isinstance(held, SarImage):
        grid, values, kind = held.grid, held.magnitude, "image"
        settings: dict[str, Any] = {"colormap": "inferno", "metadata": dict(held.metadata)}
    elif isinstance(held, VolumeMask):
        grid, values, kind, settings = held.grid, held.inside.astype(np.uint8), "labels", {}
    elif isinstance(held, Mask):
        grid, values, kind, settings = held.grid_xy, held.inside.astype(np.uint8), "labels", {}
    elif isinstance(held, Instances):
        grid, values, kind, settings = held.grid_xy, held.labels, "labels", {}
    else:
        raise InputError(
            f"{path} holds a {type(held).__name__}; napari shows images, masks, instances and voxel masks: "
            "millisight view shows the rest"
        )
    axes = [getattr(grid, name) for name in "zyx" if hasattr(grid, name)]
    placed = {
        "name": Path(path).name.removesuffix(Path(path).suffix),
        "scale": [_MM * float(np.diff(axis).mean()) if len(axis) > 1 else 1.0 for axis in axes],
        "translate": [_MM * float(axis[0]) for axis in axes],
        "units": ["mm"] * len(axes),
    }
    return np.ascontiguousarray(values.T), {**placed, **settings}, kind
