"""The one ray caster: what rays meet first, and what lies between two places. Embree does the work, in float32."""

import mmap
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from millisight.core.errors import MeshError
from millisight.data import TriangleMesh

_RAYS = 100_000  # in one call of Embree, which nothing interrupts: a second or two where thousands of faces overlap

_FEWEST = 2_000  # for which a thread of its own is worth while
# Addresses that Embree takes, and for each triangle [bytes]: a little more than measured.
_RESERVED, _EACH = 280_000_000, 400

_SMALLEST = 1e-6  # [m]; rays of single precision meet all faces of what is smaller, which takes minutes

LIFT = 1e-5
"""Rays start and end so far above a surface [m]: a hundredth of a wave at most, and a hundred times float32's error."""


class RayCaster:
    """A search tree over triangles; without any, nothing is met.

    Parameters
    ----------
    triangles : (F, 3, 3) corners [m]
    centered : count from the middle of all, where float32 is finest, at the price of an addition a ray
    each : called after every hundred thousand rays

    Attributes
    ----------
    bounds : (2, 3) smallest and largest coordinates of the triangles, with `LIFT` to spare; inf, -inf without any [m]

    Raises
    ------
    MeshError
        All triangles together are under a micrometre long, which no unit of a mesh makes.
    MemoryError
        Embree would not find the memory that it needs.
    """

    def __init__(self, triangles: np.ndarray, *, centered: bool = False, each: Callable[[], object] = lambda: None):
        self._scene: Any = None
        self._middle, self._each = None, each
        self.bounds: np.ndarray = np.multiply.outer([np.inf, -np.inf], np.ones(3))
        if not len(triangles):
            return
        from embreex.mesh_construction import TriangleMesh as EmbreeMesh
        from embreex.rtcore_scene import EmbreeScene

        corners = triangles.reshape(-1, 3)
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        self.bounds = np.stack([lower - LIFT, upper + LIFT]).astype(float)
        # No ray need be longer to meet anything.
        size = float(np.linalg.norm(upper - lower))
        if 0 < size < _SMALLEST:
            raise MeshError(f"the mesh is {size:.2g} m long; expected {_SMALLEST:g} m at least: check its unit")
        self._longest = size + 4 * LIFT
        self._middle = (lower + upper) / 2 if centered else None
        _check_memory(_RESERVED + _EACH * len(triangles))
        self._scene = EmbreeScene()
        EmbreeMesh(self._scene, self._placed(triangles))
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # the first ray builds the tree

    @classmethod
    def of(cls, meshes: Sequence[TriangleMesh]) -> "RayCaster":
        """Over the faces of several meshes, numbered one after the other."""
        return cls(np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes]))

    def _placed(self, points: np.ndarray) -> np.ndarray:
        return _float32(points if self._middle is None else points - self._middle)

    def first(self, starts: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which triangle rays meet first, -1 for none, and where: (n,) each.

        Parameters
        ----------
        starts : (n, 3) or (3,) [m]
        directions : (n, 3) of any length

        Returns
        -------
        face : (n,) int64
        reach : (n,) in lengths of the direction, so [m] where that is a unit vector; inf for none
        """
        starts = np.broadcast_to(starts, directions.shape)
        if self._scene is None:
            return np.full(len(directions), -1), np.full(len(directions), np.inf)
        face, reach = np.empty(len(directions), dtype=np.int64), np.empty(len(directions))

        def cast(some: slice) -> None:
            rays = self._scene.run(self._placed(starts[some]), _float32(directions[some]), output=True)
            face[some], reach[some] = rays["primID"], rays["tfar"]

        self._by_blocks(cast, len(directions))
        reach[face < 0] = np.inf
        return face, reach

    def crosses(self, starts: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """(n,) bool: whether the segments from `starts` to `stops` (n, 3) [m] meet a triangle."""
        ways = stops - starts
        lengths = np.linalg.norm(ways, axis=1)
        return self.first(starts, ways / np.maximum(lengths, 1e-12)[:, None])[1] < lengths

    def blocked(self, starts: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """(n,) bool: whether something lies between each of `starts` (n, 3) and one `stop` (3,) [m], by the million."""
        blocked = np.zeros(len(starts), dtype=bool)
        if self._scene is None:
            return blocked

        def cast(some: slice) -> None:
            ways = stop - starts[some]
            lengths = np.sqrt(np.einsum("ni,ni->n", ways, ways))  # a third of the time of NumPy's norm
            ways *= np.minimum(1, self._longest / lengths)[:, None]
            # Not normalised: the ray's parameter is 1 at its end.
            ends = np.ones(len(ways), np.float32)
            hits = self._scene.run(self._placed(starts[some]), _float32(ways), dists=ends, query="OCCLUDED")
            blocked[some] = hits == 0

        self._by_blocks(cast, len(starts))
        return blocked

    def _by_blocks(self, cast: Callable[[slice], None], count: int) -> None:
        """Cast `count` rays, block by block, on as many cores as Numba has."""
        threads = 1
        if count >= 2 * _FEWEST:
            from millisight.core import numba  # not where there is little to do

            threads = min(numba.get_num_threads(), count // _FEWEST)
        size = min(_RAYS, -(-count // threads))
        blocks = [slice(start, start + size) for start in range(0, count, size)] if count else []
        if threads == 1:
            for some in blocks:
                cast(some)
                self._each()
            return
        with ThreadPoolExecutor(threads) as pool:
            try:
                for _ in pool.map(cast, blocks):
                    self._each()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _check_memory(count: int) -> None:
    """Raise MemoryError where `count` bytes cannot be had: Embree would end the process."""
    try:
        mmap.mmap(-1, count).close()  # addresses alone
    except OSError as error:
        raise MemoryError(f"the search for what rays meet needs {count / 1e6:.0f} MB") from error


def _float32(vectors: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(vectors, dtype=np.float32)
