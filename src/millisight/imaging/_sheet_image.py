"""The echoes of an image, column by column, as the search for sheets sees them."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from millisight.core import peak_place
from millisight.data import SarImage
from millisight.imaging._sheet_edges import lines_of, sharpened
from millisight.imaging._sheet_fit import Cells, Phase, SheetFit, fit_sheet, spline_matrix, spline_values
from millisight.imaging._sheet_ripples import rippled, spread_on_grid, total_of_grid

_CELL = 0.005  # of columns that are averaged [m]
_BEYOND = 0.04  # a lid's echo goes on so far beyond its edges: sidelobes [m]
_FACTORS = 3  # rounds of factors of rows and columns, or of lines along edges: beyond an edge they fall to nothing


class ImageScene:
    """An image from which sheets are taken."""

    ripples = True

    def __init__(self, image: SarImage):
        self._image = image
        self._values = image.values.astype(np.complex64)
        self._power = float((np.abs(self._values) ** 2).sum())
        self._sizes = tuple(_size(axis) for axis in (image.grid.x, image.grid.y))

    @property
    def cells(self) -> Cells:
        """Columns averaged over about 5 mm."""
        axes = self._image.grid.x, self._image.grid.y
        sizes = [_summed(np.ones(len(axis)), size) for axis, size in zip(axes, self._sizes, strict=True)]
        counts = np.multiply.outer(*sizes)

        def values(phase: Phase | None) -> np.ndarray:
            flat = self._values if phase is None else self._values * self._turn(phase).conj()
            sums = _summed(np.swapaxes(_summed(flat, self._sizes[0]), 0, 1), self._sizes[1])
            return np.swapaxes(sums, 0, 1) / counts[..., None].astype(np.float32)

        middles = [_summed(axis, s) / n for axis, s, n in zip(axes, self._sizes, sizes, strict=True)]
        return Cells(x=middles[0], y=middles[1], counts=counts, values=values)

    def first_fit(self, wave_number: float) -> SheetFit | None:
        """The sheet that all cells tell of, before any is taken off."""
        return _first_fit(self._image, wave_number)

    def sharpened(self, fit: SheetFit) -> SheetFit:
        """The fit, its place as the image shows it, which is finer than the cells."""
        if fit.place is None:
            return fit
        flat = self._values * self._turn(fit.phase).conj()
        amplitude = abs(flat @ (fit.profile.conj() / max(float(np.linalg.norm(fit.profile)), 1e-30)))
        return fit._replace(place=sharpened(fit.place, amplitude, self._image.grid.x, self._image.grid.y))

    def take(self, fit: SheetFit) -> float:
        """Take a sheet's echo; returns its power over the whole image's.

        About the edges of a lid the echo is as at the nearest cells within, times factors of the lines along the edges.
        """
        x, y = self._image.grid.x, self._image.grid.y
        smooth = spline_values((spline_matrix(x, fit.knots[0]), spline_matrix(y, fit.knots[1])), fit.splines)
        weights = self._spread(fit.weights)
        if fit.place is None:
            turn = self._turn(fit.phase)
            flat = self._values * turn.conj()
            echo = turn * rippled(flat, smooth, weights, total_of_grid, spread_on_grid, factors=_FACTORS)
            self._values -= echo
            return float((np.abs(echo) ** 2).sum()) / self._power
        near = fit.place.wider(_BEYOND).inside(x[:, None], y)
        rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        u, v, near = x[box[0], None], y[box[1]], near[box]
        halfway = ((axis[1:] + axis[:-1]) / 2 for axis in (x, y))
        places = fit.place.wider(-_CELL).nearest(u, v)
        nearest = tuple(np.searchsorted(ends, place) for ends, place in zip(halfway, places, strict=True))
        lines = lines_of(*fit.place.along(u, v)) if fit.place.turn else (total_of_grid, spread_on_grid)
        turn = self._turn(fit.phase)[box]
        flat = self._values[box] * turn.conj()
        echo = rippled(flat, smooth[nearest], weights[nearest] * near, *lines, factors=_FACTORS)
        echo *= turn * near[..., None]
        self._values[box] -= echo
        return float((np.abs(echo) ** 2).sum()) / self._power

    def height(self, fit: SheetFit) -> float:
        """z of the strongest echo of a sheet [m], between slices by a parabola."""
        return peak_place(np.abs(fit.profile), self._image.grid.z)

    def told(self) -> dict[str, float]:
        """`taken_db`: the maximum without the sheets over that with them [dB]."""
        before, after = (max(float(np.abs(values).max()), 1e-30) for values in (self._image.values, self._values))
        return {"taken_db": float(20 * np.log10(max(after / before, 1e-9)))}

    def cleaned(self, metadata: Mapping[str, Any]) -> SarImage:
        values = self._values.astype(self._image.values.dtype)
        values.flags.writeable = False
        return SarImage(grid=self._image.grid, values=values, metadata=metadata)

    def _spread(self, of_cells: np.ndarray) -> np.ndarray:
        """(X, Y) a figure of each cell, at its columns."""
        axes = self._image.grid.x, self._image.grid.y
        which = (np.arange(len(axis)) // size for axis, size in zip(axes, self._sizes, strict=True))
        return of_cells[np.ix_(*which)]

    def _turn(self, phase: Phase) -> np.ndarray:
        """(X, Y, 1) exp(i psi)"""
        x, y = self._image.grid.x, self._image.grid.y
        return np.exp(1j * phase.at(x[:, None], y)).astype(np.complex64)[..., None]


@lru_cache(maxsize=2)
def _first_fit(image: SarImage, wave_number: float) -> SheetFit | None:
    """See `ImageScene.first_fit`: kept, as an image may be searched for a lid and for anything."""
    return fit_sheet(ImageScene(image).cells, wave_number, ripples=ImageScene.ripples)


def _size(axis: np.ndarray) -> int:
    """How many places along an axis make a cell of about `_CELL`."""
    return min(len(axis), max(1, round(_CELL / float(np.diff(axis).mean())))) if len(axis) > 1 else 1


def _summed(values: np.ndarray, size: int) -> np.ndarray:
    """Sums of every `size` along the first axis; the last may be of fewer."""
    total = values[::size].copy()
    for offset in range(1, size):
        some = values[offset::size]
        total[: len(some)] += some
    return total
