"""Photographs: PNG and JPEG files as arrays of colours."""

import io
import os
import struct
import warnings
from typing import Any

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError

_MOST_PIXELS, _MOST_BYTES = 50_000_000, 1 << 28
_ANY, _BY_BYTE = 16_000_000, 50  # pixels of any file; and for each byte: photographs have one to ten


def read_photo(path: str | os.PathLike[str]) -> np.ndarray:
    """(H, W, 3) uint8 of a PNG or JPEG file, turned as its camera was held; transparency is shown on white.

    Raises
    ------
    FileError
        It cannot be read.
    FormatError, DamagedFileError
        It is no such picture, or a part of one.
    InputError
        It has more than 5e7 pixels, or more than 1.6e7 of which most are alike: 50 for each byte of the file.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError

    path = check_readable(path)
    name = printable(path)
    if path.stat().st_size > _MOST_BYTES:
        raise FormatError(f"{name} has {path.stat().st_size} bytes; expected a picture of under {_MOST_BYTES}")
    most = min(_MOST_PIXELS, max(_ANY, _BY_BYTE * path.stat().st_size))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its size, which is judged here; of odd metadata
            # In memory, where a part that claims gigabytes is no longer than the file.
            opened = Image.open(io.BytesIO(path.read_bytes()), formats=("PNG", "JPEG"))
        with opened:
            if opened.width * opened.height > most:
                raise Image.DecompressionBombError
            upright = ImageOps.exif_transpose(_eight_bits(opened))
            if upright.has_transparency_data:
                upright = Image.alpha_composite(Image.new("RGBA", upright.size, "white"), upright.convert("RGBA"))
            return np.asarray(upright.convert("RGB"))
    except UnidentifiedImageError as error:
        raise FormatError(f"{name} is not a PNG or JPEG picture, although its name says so; convert it") from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{name} has more than {most:.2g} pixels; make a smaller one") from error
    except (OSError, SyntaxError, ValueError, LookupError, TypeError, struct.error) as error:
        raise DamagedFileError(f"{name} is damaged: {error}; make or copy it again") from error


def _eight_bits(opened: Any) -> Any:
    """A picture of 16 bits a pixel in 8, over its own range; others as they are."""
    from PIL import Image

    if not opened.mode.startswith("I"):
        return opened
    values = np.asarray(opened, dtype=np.float32)  # which holds 16 bits
    least = float(values.min())
    span = (float(values.max()) - least) or 1.0
    values = (values - least) / np.float32(span) * np.float32(255)
    return Image.fromarray(np.round(values, out=values).astype(np.uint8))
