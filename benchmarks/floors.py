"""What must be computed at least, counted while the work is done: the floors of docs/explanation/performance.md.

A core of 2.6 GHz with AVX-512 does 16 lanes of float32, two instructions a clock. Counting costs time: a run that is
counted is not timed.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np

CORE = 16 * 2 * 2.6e9  # operations of float32 a second and core
PAIR = 40 / CORE + 0.5e-9  # direct backprojection: 40 operations, and two reads from the range profile [s]
MIDDLE = 16 / CORE  # a voxel of a field, interpolated along its first axis by eight taps [s]
MERGED = 44 / CORE  # the same along the other axis, its phase turned, and summed [s]
PRODUCT = 8 / CORE  # a complex product and sum [s]
PATCH_PAIR = 117 / CORE  # a patch and a channel that it faces (see test_rig.py) [s]
# A double bounce and a channel, of which four receivers in a line have two nodes and one transmitter [s]: 118 for the
# way to the second plane, 163 a node for what returns, 100 a channel for its path, phase and moments.
BOUNCE_PAIR = (118 + 2 * 163 + 4 * 100) / 4 / CORE
ANGLE = 15 / CORE  # a vertex and a position: the specular angle [s]
RAY = 1 / 3e6  # Embree on one core [s]
NEAR_RAY = 1 / 6e6  # the same, of rays that start or end side by side, as the rig's do [s]
BYTE = 1 / 20e9  # read or written [s]

COSTS = {
    "pairs": PAIR,
    "interpolated voxels": MIDDLE,
    "merged voxels": MERGED,
    "complex products": PRODUCT,
    "patch pairs": PATCH_PAIR,
    "bounce pairs": BOUNCE_PAIR,
    "near rays": NEAR_RAY,
    "angles": ANGLE,
    "rays": RAY,
    "bytes": BYTE,
}
"""Seconds of one core for each of what is counted."""


def core_seconds(counted: Counter[str]) -> float:
    """The floor: what was counted at what each costs."""
    return sum(COSTS[name] * number for name, number in counted.items())


@contextmanager
def counting() -> Iterator[Counter[str]]:
    """Count what images, simulated signals and the rig's optics compute in this block."""
    from millisight.imaging import _backprojection, _fast
    from millisight.meshes import RayCaster
    from millisight.rig.virtual import _scatterers
    from millisight.simulation import _simulate
    from millisight.simulation._scatterers import Scatterers

    counted: Counter[str] = Counter()

    def around(owner: Any, name: str, count: Callable[..., None]) -> Any:
        original = getattr(owner, name)

        def counts(*args: Any, **settings: Any) -> Any:
            count(*args, **settings)
            return original(*args, **settings)

        return mock.patch.object(owner, name, counts)

    def rays(_: Any, origins: np.ndarray, vertices: np.ndarray) -> None:
        counted["rays"] += len(vertices)

    def signals(_: Any, weights: np.ndarray, *args: Any, band: Any) -> None:
        frames, nodes = args[-1], len(band.nodes)
        channels = weights.shape[0] * weights.shape[1] * weights.shape[2]
        # Real numbers times complex ones: half a product for each sample.
        counted["complex products"] += nodes * (np.count_nonzero(weights) + channels * frames.shape[-1] // 2)
        counted["angles"] += weights.size
        counted["bytes"] += 8 * channels * frames.shape[-1]

    def facing(scatterers: Any, antennas: np.ndarray, *rest: Any) -> None:
        real = scatterers._areas > 0
        normals, places = scatterers._normals[real], scatterers._centroids[real]
        heights = np.einsum("ni,ni->n", normals, places)
        some = antennas[:: max(1, len(antennas) // 20), 0]
        share = (some @ normals.T > heights).mean()
        channels = len(antennas) * (antennas.shape[1] - 1)
        counted["patch pairs"] += round(share * len(places) * channels)
        counted["bounce pairs"] += sum(run * len(first) for run, (first, _) in rest[-1]) * (antennas.shape[1] - 1)

    class Caster(RayCaster):
        """The rig's, which counts its rays."""

        def first(self, starts: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            counted["near rays"] += len(directions)
            return super().first(starts, directions)

        def blocked(self, starts: np.ndarray, stop: np.ndarray) -> np.ndarray:
            counted["near rays"] += len(starts)
            return super().blocked(starts, stop)

    with (
        around(Scatterers, "sees", rays),
        around(_simulate, "_add_signals", signals),
        around(_scatterers.SurfaceScatterers, "frames", facing),
        mock.patch.object(_scatterers, "RayCaster", Caster),
        mock.patch.object(_fast, "kernels_on", _counted(_fast.kernels_on, counted)),
        mock.patch.object(_backprojection, "kernels_on", _counted(_backprojection.kernels_on, counted)),
    ):
        yield counted


class _Counted:
    """Kernels that count what they are asked for."""

    def __init__(self, kernels: Any, counted: Counter[str]):
        self._kernels, self._counted = kernels, counted

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kernels, name)

    def leaf_fields(self, *args: Any) -> None:
        profiles, members, x = args[0], args[5], args[8]
        self._counted["pairs"] += len(x) * len(members) * profiles.shape[1] * profiles.shape[2]
        self._kernels.leaf_fields(*args)

    def backproject(self, *args: Any) -> None:
        profiles, x = args[0], args[6]
        self._counted["pairs"] += len(x) * profiles.shape[0] * profiles.shape[1] * profiles.shape[2]
        self._kernels.backproject(*args)

    def merge(self, *args: Any) -> None:
        fields, out = args[0], args[-1]
        _, _, rows, columns, depth = out.shape
        self._counted["interpolated voxels"] += fields.shape[1] * rows * min(columns, fields.shape[3]) * depth
        self._counted["merged voxels"] += fields.shape[1] * rows * columns * depth
        self._kernels.merge(*args)

    def compress(self, frames: Any, steering: Any, out: Any = None) -> Any:
        # A quarter of the matrix, whose halves mirror each other, does.
        self._counted["complex products"] += frames.size * steering.shape[1] / 4
        self._counted["bytes"] += 8 * frames.size
        return self._kernels.compress(frames, steering, out)


def _counted(kernels_on: Callable[[str], Any], counted: Counter[str]) -> Callable[[str], Any]:
    return lambda device: _Counted(kernels_on(device), counted)
