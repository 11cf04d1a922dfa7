"""Snell's law for the imagers: what refraction adds to the straight paths from a capture's antennas (primer 2).

The excess is one smooth function of two numbers, how far voxel and antenna are apart along the layers and normal to
them. The exact imager works it out for each pair; the others interpolate it in a table.
"""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.core.errors import InputError
from millisight.data import Capture, Layers, VoxelGrid

_WAVES = 2e-4  # error of the table, of a wavelength
_FEWEST, _MOST = 64, 2048  # entries along a side


class Excess(NamedTuple):
    """A table of excesses of one way, float32.

    Attributes
    ----------
    table : (D, A) over depth and across [m]
    frame : (6,) the normal, the depth of the first row [m], rows per metre, columns per metre
    most : the largest magnitude in it [m]
    """

    table: np.ndarray
    frame: np.ndarray
    most: float


class ExactLayers(NamedTuple):
    """What the exact imager needs of layers: (L,) thicknesses [m] and indices, (5,) normal, moved and offset [m]."""

    thicknesses: np.ndarray
    indices: np.ndarray
    frame: np.ndarray


def exact_layers(layers: Layers) -> ExactLayers:
    """Layers as the exact imager takes them."""
    return ExactLayers(layers.thicknesses, layers.indices, np.append(layers.normal, [layers.moved, layers.offset / 2]))


def check_behind(capture: Capture, grid: VoxelGrid) -> None:
    """Refuse a grid that does not lie behind the capture's layers.

    Raises
    ------
    InputError
    """
    layers = capture.layers
    if layers is None:
        return
    closest = np.where(layers.normal > 0, grid.bounds[0], grid.bounds[1]) @ layers.normal
    antennas = max(float((a @ layers.normal).max()) for a in (capture.tx_positions, capture.rx_positions))
    depth = closest - antennas + layers.moved
    if depth < layers.thicknesses.sum() - 1e-9:
        raise InputError(
            f"the grid begins {depth:.4g} m from the antennas along {np.round(layers.normal, 3).tolist()}, and the "
            f"layers are {layers.thicknesses.sum():.4g} m thick; expected a grid behind them, or another direction "
            "towards it"
        )


def excess_over(
    capture: Capture, tx: np.ndarray, rx: np.ndarray, box: np.ndarray, order: tuple[int, ...]
) -> Excess | None:
    """The table for antennas (P, A, 3) and all points of a box (2, 3), their axes the world's in this `order`.

    None: there are no layers.
    """
    layers = capture.layers
    if layers is None:
        return None
    from millisight.imaging._kernels import refraction_table

    normal = layers.normal[np.array(order)]
    antennas = np.concatenate([tx.reshape(-1, 3), rx.reshape(-1, 3)])
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
    away = [corner - antennas for corner in corners]
    depths = np.stack([a @ normal for a in away])
    across = np.sqrt(max(float((np.square(a).sum(axis=1) - d**2).max()) for a, d in zip(away, depths, strict=True)))
    first, last = max(layers.nearest, float(depths.min())), max(layers.nearest, float(depths.max()))
    wave = SPEED_OF_LIGHT / capture.radar.waveform.frequencies[-1]

    def filled(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        out = np.empty((len(rows), len(columns)))
        refraction_table(columns, rows, *exact_layers(layers), out)
        return out

    shape = [_FEWEST, _FEWEST]
    for _ in range(12):
        rows, columns = (np.linspace(a, b, n) for a, b, n in zip((first, 0), (last, across), shape, strict=True))
        table = filled(rows, columns)
        errors = [
            np.abs(filled((rows[1:] + rows[:-1]) / 2, columns) - (table[1:] + table[:-1]) / 2).max(),
            np.abs(filled(rows, (columns[1:] + columns[:-1]) / 2) - (table[:, 1:] + table[:, :-1]) / 2).max(),
        ]
        coarse = [i for i in (0, 1) if errors[i] > _WAVES / 2 * wave and shape[i] < _MOST]
        if not coarse:
            break
        for i in coarse:
            shape[i] *= 2
    per_metre = [(n - 1) / max(span, 1e-9) for n, span in zip(shape, (last - first, across), strict=True)]
    frame = np.array([*normal, first, *per_metre], dtype=np.float32)
    return Excess(table.astype(np.float32), frame, float(np.abs(table).max()))
