"""How path lengths are counted so that float32 keeps their phase, however far off the antennas are.

The kernels work in float32. A path of 20 km at 77 GHz is 5 million waves: float32 would lose its phase. So the path to
the middle of the grid is taken in float64, once an antenna, and the kernels add what a voxel lies beyond it:

    |v - a| - |a| = v . (v - 2 a) / (|v - a| + |a|),

whose float32 error grows with |v|, the size of the grid, and not with |a|. Grids of many waves are done in boxes.
"""

from typing import Any

import numpy as np

from millisight.data import VoxelGrid

EXACT_CYCLES = 1000.0
"""Waves from antenna to grid up to which a difference of two float32 lengths is good enough: 6e-5 of a wave."""

_BOX_CYCLES = 2000.0  # waves from a box's middle to its corner


def antenna_rows(positions: Any, start: Any, per_metre: float, carrier: float) -> np.ndarray:
    """(..., 6) float32 rows of antennas (..., 3) [m] as the kernels take them, worked out in float64.

    Position, distance from the origin [m], and what that distance adds to the entry of the range profile and to the
    phase [cycles]. `start`, one for all or (...,), is the antenna's part of the path length of entry 0 [m].
    """
    positions = np.asarray(positions, dtype=np.float64)
    far = np.linalg.norm(positions, axis=-1)
    turns = far * float(carrier)
    rows = [far, (far - start) * float(per_metre), turns - np.rint(turns)]
    return np.concatenate([positions, np.stack(rows, axis=-1)], axis=-1).astype(np.float32)


def rows_of_pairs(tx: Any, rx: Any, nearest: Any, per_metre: float, carrier: float) -> tuple[np.ndarray, np.ndarray]:
    """`antenna_rows` of transmitters and of receivers; `nearest` is the path length of entry 0 [m], or the parts of it
    that are the transmitters' (P, T) and the receivers' (P, R)."""
    starts = nearest if isinstance(nearest, tuple) else (nearest / 2, nearest / 2)
    to, back = (antenna_rows(a, start, per_metre, carrier) for a, start in zip((tx, rx), starts, strict=True))
    return to, back


def grid_in(grid: VoxelGrid, box: tuple[slice, slice, slice]) -> VoxelGrid:
    """The part of a grid that an index box holds."""
    return VoxelGrid(x=grid.x[box[0]], y=grid.y[box[1]], z=grid.z[box[2]])


def boxes(grid: VoxelGrid, carrier: float) -> list[tuple[slice, slice, slice]]:
    """Index boxes of a grid, each so small that float32 holds a place in it to some ten-thousandths of a wave."""
    pending, done = [tuple(slice(0, n) for n in grid.shape)], []
    axes = grid.x, grid.y, grid.z
    while pending:
        box = pending.pop()
        spans = [axis[part.stop - 1] - axis[part.start] for axis, part in zip(axes, box, strict=True)]
        widest = int(np.argmax(spans))
        part = box[widest]
        if np.linalg.norm(spans) / 2 * carrier <= _BOX_CYCLES or part.stop - part.start == 1:
            done.append(box)
            continue
        middle = (part.start + part.stop) // 2
        for half in (slice(middle, part.stop), slice(part.start, middle)):
            pending.append((*box[:widest], half, *box[widest + 1 :]))
    return done
