"""What is annotated: a radar image or a photograph, and how it lies on the screen.

A picture's pixel [i, j] is (x_i, y_j) of a radar image and row and column of a photo. On the screen x runs to the right
and y upwards, as in every figure; a photo is shown as it was taken. A place on the screen is (column, row) from the
upper left.
"""

import os
from pathlib import Path

import numpy as np

from millisight.core import PUBLISHED_COLORMAP, check_readable, colormap_names, printable, record
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import CameraFrame, Picture, SarImage
from millisight.datasets import checksum
from millisight.io import read_photo
from millisight.io.mito import origin, read_published
from millisight.perception import coloured, project

PHOTO_SUFFIXES = (".png", ".jpg", ".jpeg")
_LARGEST_FILE = 1 << 30  # bytes; an image of 130 million voxels


@record
class OpenedPicture:
    """A picture to annotate.

    Attributes
    ----------
    path : the file it came from
    sha256 : of that file, hexadecimal
    picture : Picture, what segmenters look at
    other_band : the file of the same scene at the radar's other frequency; None: there is none
    frame : the camera frame whose picture it is; None: it is of none
    """

    path: Path
    sha256: str
    picture: Picture
    other_band: Path | None = None
    frame: CameraFrame | None = None

    @property
    def origin(self) -> str:
        """The file's name; within a dataset its path from the object's folder on, the same on every machine."""
        return origin(self.path)

    @property
    def is_radar(self) -> bool:
        return self.picture.grid_xy is not None

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows on the screen."""
        a, b = self.picture.shape
        return (a, b) if self.is_radar else (b, a)

    @property
    def colormaps(self) -> tuple[str, ...]:
        """Names of colour maps to look at it in; segmenters look at the first, whatever is shown. A photo has none."""
        return tuple(dict.fromkeys((PUBLISHED_COLORMAP, *colormap_names()))) if self.is_radar else ()

    @property
    def spacing(self) -> tuple[float, float]:
        """Of columns and rows: of a radar image in metres, of a photo 1."""
        grid = self.picture.grid_xy
        if grid is None:
            return 1.0, 1.0
        steps = [float(np.diff(axis).mean()) if len(axis) > 1 else 0.0 for axis in (grid.x, grid.y)]
        return steps[0] or steps[1] or 1e-3, steps[1] or steps[0] or 1e-3

    def shown(self, pixels: np.ndarray) -> np.ndarray:
        """(rows, columns, ...) on the screen of an array (A, B, ...) over the picture's pixels."""
        return np.ascontiguousarray(pixels.swapaxes(0, 1)[::-1]) if self.is_radar else pixels

    def on_screen(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) places [column, row] on the screen of the picture's pixels (n, 2) [i, j]."""
        i, j = np.asarray(points).reshape(-1, 2).T
        return np.stack([i, self.picture.shape[1] - 1 - j] if self.is_radar else [j, i], axis=1)

    def on_picture(self, places: np.ndarray) -> np.ndarray:
        """(n, 2) the picture's pixels [i, j] at places (n, 2) [column, row] on the screen."""
        column, row = np.asarray(places).reshape(-1, 2).T
        return np.stack([column, self.picture.shape[1] - 1 - row] if self.is_radar else [row, column], axis=1)

    def coloured(self, colours: str) -> np.ndarray:
        """(rows, columns, 3) uint8 for the screen; `colours` is a colour map for radar images, ignored for photos.

        Raises
        ------
        InputError
            No colour map goes by that name.
        """
        power = self.picture.power
        return self.shown(self.picture.rgb if power is None else coloured(power, colours))


def open_picture(path: str | os.PathLike[str], *, other_band: str | os.PathLike[str] | None = None) -> OpenedPicture:
    """Open what can be annotated: PNG or JPEG, HDF5 files of ours, pickles of the published layout.

    Radar images are projected along z as published; camera frames give their picture.

    Parameters
    ----------
    path : the file
    other_band : an image of the same scene at the radar's other frequency, for segmenters that look at both

    Raises
    ------
    FileError, FormatError, DamagedFileError
        There is no such file, it holds no picture, or is damaged.
    InputError
        `other_band` with a photograph.
    """
    path = _of_bearable_size(check_readable(path))
    read = read_photo if path.suffix.lower() in PHOTO_SUFFIXES else _recorded
    content = read(path)
    if isinstance(content, SarImage):
        picture = project(content, other_band=None if other_band is None else _image(Path(other_band)))
    elif other_band is not None:
        raise InputError(f"{printable(path)} is a photograph, which has no other band; leave the other band out")
    else:
        picture = Picture(rgb=content.rgb if isinstance(content, CameraFrame) else content)
    other = None if other_band is None else Path(other_band)
    frame = content if isinstance(content, CameraFrame) else None
    return OpenedPicture(path=path, sha256=checksum(path), picture=picture, other_band=other, frame=frame)


def _of_bearable_size(path: Path) -> Path:
    size = os.path.getsize(path)
    if size > _LARGEST_FILE:
        raise FileError(
            f"{printable(path)} has {size / 1e9:.1f} GB; files are read whole, up to "
            f"{_LARGEST_FILE / 1e9:.1f} GB: make an image of fewer voxels (`millisight image --grid`)"
        )
    return path


def _image(path: Path) -> SarImage:
    content = _recorded(_of_bearable_size(check_readable(path)))
    if not isinstance(content, SarImage):
        raise FormatError(f"{printable(path)} holds a camera's picture; expected a radar image")
    return content


def _recorded(path: Path) -> SarImage | CameraFrame:
    """A radar image or a camera frame of a file of ours or of the published layout."""
    if path.suffix.lower() == ".pkl":
        content = read_published(path).record
    else:
        from millisight.io import load

        content = load(path)
    if not isinstance(content, SarImage | CameraFrame):
        raise FormatError(
            f"{printable(path)} holds a {type(content).__name__}, which is not a picture; expected an image that "
            "`millisight image` wrote, a camera frame, or a PNG or JPEG file"
        )
    return content
