"""What antennas see of many scatterers, from rays that neighbouring antennas share.

Space is cut into cells that appear an eighth of their distance wide. Rays are cast from the corners of a cell, and
what an antenna in the cell sees of a scatterer is interpolated between them, so a shadow's rim is soft over the few
millimetres that it moves across a cell. A wave's shadow is no harder than that: it is soft over sqrt(λ d), 14 mm at
77 GHz and d = 5 cm behind the rim. A hard rim would even be wrong, and would send out a wave of its own.
"""

import numpy as np

from millisight.meshes import RayCaster
from millisight.rig.virtual._kernels import FULL
from millisight.rig.virtual._shadow_kernels import blend_views, doubtful_places

_CELLS = 8  # in the distance to the scatterers

Cell = tuple[int, ...]


class ShadowCells:
    """The views of scatterers at `places` (V, 3) [m] that block one another, seen from about `antennas` (P, A, 3) [m].

    `normals` (2, V, 3) are those of the one or two faces that a scatterer lies on.
    """

    def __init__(self, caster: RayCaster, places: np.ndarray, normals: np.ndarray, antennas: np.ndarray):
        self._caster, self._places, self._normals = caster, places, normals
        around = antennas.reshape(-1, 3)
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        self._side = float(np.median(np.linalg.norm(around - middle, axis=1))) / _CELLS
        # A layer of antennas thinner than a cell has its corners in the layer's middle.
        self._flat = np.ptp(around, axis=0) < self._side
        self._anchor = (around.min(axis=0) + around.max(axis=0)) / 2
        steps = [[0] if flat else [0, 1] for flat in self._flat]
        self._steps = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        self._views: dict[Cell, np.ndarray] = {}
        cells = np.unique(self._cells(antennas.mean(axis=1)), axis=0)
        corners = np.unique((cells[:, None] + self._steps).reshape(-1, 3), axis=0)
        self._each = len(corners) >= len(around)

    def cells_of(self, antennas: np.ndarray) -> tuple[np.ndarray, list[Cell]]:
        """(P,) an order of the poses (P, A, 3) by the cells they are in, and the cell of each in that order."""
        cells = self._cells(antennas.mean(axis=1))
        order = np.lexsort(cells.T)
        return order, [tuple(cell) for cell in cells[order].tolist()]

    def center(self, cell: Cell) -> np.ndarray:
        """(3,) [m]"""
        return self._anchor + self._side * np.where(self._flat, 0.0, np.array(cell) + 0.5)

    def seen_about(self, cell: Cell) -> np.ndarray:
        """(V,) bool: what some corner of a cell sees, or may see; what none does is hidden from within, too."""
        if self._each:
            return np.ones(len(self._places), dtype=bool)
        return np.any([self._corner(np.array(cell) + step) for step in self._steps], axis=0)

    def light(self, antennas: np.ndarray) -> np.ndarray:
        """(A, V) uint8: how much of each scatterer antennas (A, 3) see, 255: all."""
        if self._each:
            return np.stack([self._view(antenna) for antenna in antennas])
        cells = self._cells(antennas)
        places = ((antennas - self._anchor) / self._side - cells)[:, None]
        weights = np.where(self._flat, 1.0, np.where(self._steps == 1, places, 1 - places)).prod(axis=2)
        shares = np.floor(FULL * weights).astype(np.uint8)
        # They add up to 255, so that what all corners see is seen in full.
        shares[np.arange(len(shares)), shares.argmax(axis=1)] += (FULL - shares.sum(axis=1)).astype(np.uint8)
        corners, which = np.unique((cells[:, None] + self._steps).reshape(-1, 3), axis=0, return_inverse=True)
        views = np.stack([self._corner(corner) for corner in corners])
        light = np.empty((len(antennas), len(self._places)), dtype=np.uint8)
        blend_views(views, which.reshape(shares.shape), shares, light)
        return light

    def _cells(self, places: np.ndarray) -> np.ndarray:
        """(n, 3) the cells of places (n, 3) [m]."""
        return np.where(self._flat, 0, np.floor((places - self._anchor) / self._side)).astype(np.int64)

    def _corner(self, corner: np.ndarray) -> np.ndarray:
        """(V,) the view from a corner of cells; kept, since neighbouring cells share it."""
        key = tuple(corner.tolist())
        if key not in self._views:
            self._views[key] = self._view(self._anchor + self._side * corner)
        return self._views[key]

    def _view(self, place: np.ndarray) -> np.ndarray:
        # What faces away answers nobody, so nothing is asked about it; to antennas beside the corner it may face.
        asked = np.empty(len(self._places), dtype=bool)
        doubtful_places(np.asarray(place, dtype=float), self._places, self._normals, *self._caster.bounds, asked)
        view = np.full(len(self._places), FULL, dtype=np.uint8)
        view[asked] = np.where(self._caster.blocked(self._places[asked], place), 0, FULL)
        return view
