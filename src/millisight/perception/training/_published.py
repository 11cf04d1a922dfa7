"""Scenes from simulated images that a dataset in the published layout holds, beside those that recipes make.

A scene is a pair of images, specular and edge, of an object turned one way, cut about its mask. It has no plate. Images
are sampled at the nearest voxels of the scenes' lattice, since their phase turns many times between slices. Masks are
those beside the images: in the published dataset they were drawn by a network, and the two may differ; a pixel of
either is the object's.
"""

import hashlib
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from millisight.core import printable
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import Mask, SarImage, grid_difference
from millisight.io import load, mito
from millisight.perception import SPACING
from millisight.perception.training._bands import BANDS, DEPTH
from millisight.perception.training._scenes import SCENE_PARTS, SceneParts
from millisight.perception.training._sources import SIMULATED_STEMS

T = TypeVar("T")

_AROUND = 0.05  # of the mask, what a scene shows [m]
_SAME_PLACE = 1e-6  # of two bands' pixels [m]
_ALIKE = 0.3  # IoU of two bands' masks, below which their images do not show the object at one place


def read_simulation(folder: Path, *, widest: float) -> SceneParts:
    """The scene of a simulation's images, cut 5 cm around its mask.

    Images at 24 GHz are taken where they show the object on the same pixels, which published ones need not.

    Parameters
    ----------
    folder : `<id>_<name>/simulation/<ax>_<ay>_<az>`
    widest : of the image [m]

    Raises
    ------
    InputError
        The images and masks do not fit each other, or the mask is empty.
    FileError, FormatError, DamagedFileError
    """
    angles = mito.angles_of(folder.name)
    if angles is None:
        raise InputError(f"{printable(folder)} is no folder of a simulation; expected <ax>_<ay>_<az>")
    (specular, edges), inside = _read_band(folder, "77_ghz")
    if not inside.any():
        raise InputError(f"the masks of {printable(folder)} are empty; expected an object")
    x, y, z = specular.grid.x, specular.grid.y, specular.grid.z
    along_x, along_y = (_around(np.any(inside, axis=1 - axis), known, widest) for axis, known in enumerate((x, y)))
    values = {"77_ghz": np.stack([specular.values, edges.values])[:, along_x, along_y]}
    low = _low_band(folder, x[along_x], y[along_y], inside[along_x, along_y])
    if low is not None:
        values["24_ghz"] = low[0]
    x, y, inside = x[along_x], y[along_y], inside[along_x, along_y]
    nearest = [_nearest(known, step) for known, step in ((x, SPACING), (y, SPACING), (z, DEPTH))]
    images, scales = {}, {}
    for band, pair in values.items():
        deep = nearest[2] if low is None or band == "77_ghz" else _matched(low[1], z[nearest[2]])
        sampled = pair[:, nearest[0][:, None, None], nearest[1][:, None], deep]
        whole = np.concatenate([sampled, np.zeros((len(SCENE_PARTS) - 2, *sampled.shape[1:]), pair.dtype)])
        peaks = abs(whole).max(axis=(1, 2, 3))
        scales[band] = peaks.astype(float)
        images[band] = (whole / np.where(peaks > 0, peaks, 1)[:, None, None, None]).astype(np.complex64)
    seen = inside[np.ix_(*nearest[:2])]
    power = (abs(images["77_ghz"][0]) ** 2)[seen].sum(axis=0)
    return SceneParts(
        x[nearest[0]],
        y[nearest[1]],
        seen,
        np.array(angles, float),
        images,
        scales,
        int(power.argmax()) if seen.any() else 0,
    )


def simulation_digest(folder: Path, *, widest: float) -> str:
    """Of what `read_simulation` reads, as 12 hexadecimal digits, the same of published and of converted files."""
    parts, digest = read_simulation(folder, widest=widest), hashlib.sha256()
    for array in (parts.x, parts.y, parts.inside, *parts.images.values(), *parts.scales.values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:12]


def _nearest(known: np.ndarray, step: float) -> np.ndarray:
    """Indices of coordinates (n,) nearest to places `step` apart about their middle."""
    count = max(1, int(np.floor((known[-1] - known[0]) / step + 1e-6)) + 1)
    return _matched(known, (known[0] + known[-1]) / 2 + step * (np.arange(count) - (count - 1) / 2))


def _matched(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Indices of coordinates (n,) nearest to wanted ones."""
    return abs(known - wanted[:, None]).argmin(axis=1)


def _read_band(folder: Path, band: str) -> tuple[tuple[SarImage, SarImage], np.ndarray]:
    """Both images of a band, and the pixels (X, Y) of either mask."""
    place = mito.radar_folder(folder, band, processed=True)
    specular, edges = (_read(place, stem, SarImage) for stem in SIMULATED_STEMS[:2])
    masks = [_read(place, stem, Mask) for stem in SIMULATED_STEMS[2:]]
    for grid in (edges.grid, *(mask.grid_xy for mask in masks)):
        if differs := grid_difference(specular.grid, grid):
            raise InputError(f"{printable(place)}: the images and masks lie on different grids, along {differs}")
    return (specular, edges), masks[0].inside | masks[1].inside


def _read(place: Path, stem: str, kind: type[T]) -> T:
    path = next((path for path in (place / f"{stem}.pkl", place / f"{stem}.h5") if path.exists()), None)
    if path is None:
        raise FileError(f"{printable(place)} has no {stem}.pkl; expected the images and masks of both parts")
    held = load(path) if path.suffix == ".h5" else mito.read_published(path).record
    if not isinstance(held, kind):
        raise FormatError(f"{printable(path)} holds a {type(held).__name__}; expected a {kind.__name__}")
    return held


def _around(covered: Any, known: np.ndarray, widest: float) -> slice:
    """Of coordinates (n,) [m] those near the covered ones, `widest` at most."""
    places = known[covered]
    middle = (places[0] + places[-1]) / 2
    half = min((places[-1] - places[0]) / 2 + _AROUND, widest / 2)
    inner = np.flatnonzero(abs(known - middle) <= half + _SAME_PLACE)
    return slice(int(inner[0]), int(inner[-1]) + 1)


def _low_band(folder: Path, x: np.ndarray, y: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """(2, X, Y, Z) images at 24 GHz on these pixels, and their z; None where none show the object there."""
    place = mito.radar_folder(folder, BANDS[1], processed=True)
    held = {path.stem for path in place.iterdir()} if place.is_dir() else set()
    if not held.issuperset(SIMULATED_STEMS):
        return None
    (specular, edges), mask = _read_band(folder, BANDS[1])
    cut = []
    for wanted, known in ((x, specular.grid.x), (y, specular.grid.y)):
        start = int(np.argmin(abs(known - wanted[0])))
        there = known[start : start + len(wanted)]
        if len(there) != len(wanted) or abs(there - wanted).max() > _SAME_PLACE:
            return None
        cut.append(slice(start, start + len(wanted)))
    shown = mask[cut[0], cut[1]]
    if (shown & inside).sum() < _ALIKE * (shown | inside).sum():
        return None
    return np.stack([specular.values, edges.values])[:, cut[0], cut[1]], specular.grid.z
