"""MATLAB's .mat files of version 5: their numeric arrays, also inside structures.

Layout after "MAT-File Format" (The MathWorks): a header of 128 bytes, then data elements, each a type, a length and
its bytes, one inside the other; a compressed element is a zlib stream that holds one more. Arrays run down the
columns. Every length is held against the bytes around it, so that a damaged file ends in an error and nothing else.
"""

import math
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from millisight.io.arrays import Entry, array_of_bytes, in_array, too_large

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHERS = {1: "a cell array", 3: "an object", 4: "text", 5: "a sparse matrix", 16: "a function", 17: "an object"}
_STRUCTURE, _OPAQUE = 2, 17
_LOGICAL, _COMPLEX = 0x200, 0x800
_DEEPEST = 16  # structures inside structures


def matlab_entries(path: Any, limit: int) -> dict[str, Entry]:
    """The arrays of a file of version 5 by name, fields of structures as "data.frames".

    What is compressed is unpacked here, in all to at most `limit` bytes.

    Raises
    ------
    ValueError, zlib.error, FormatError
        The file is damaged, or unpacks to more.
    """
    data = memoryview(Path(path).read_bytes())
    order = "<" if data[126:128] == b"IM" else ">"
    entries: dict[str, Entry] = {}
    left, position = limit, _HEADER
    while position < len(data):
        with in_array(str(len(entries)), f" at byte {position}"):
            kind, body, position = _element(data, position, order)
            if kind == _COMPRESSED:
                unpacked = _unpacked(body, left, limit)
                left -= len(unpacked)
                kind, body, _ = _element(unpacked, 0, order)
            if kind == _MATRIX:
                entries.update(_matrix(body, order, "", 0))
    return entries


def _element(data: memoryview, position: int, order: str) -> tuple[int, memoryview, int]:
    """The type and bytes of the data element at `position`, and where the next one starts.

    Raises
    ------
    ValueError
        It reaches beyond `data`.
    """
    if position + 8 > len(data):
        raise ValueError(f"it ends after {len(data) - position} bytes where 8 of a tag should be: truncated")
    kind, length = (int(n) for n in np.frombuffer(data[position : position + 8], order + "u4"))
    start, small = position + 8, kind >> 16
    if small:  # up to four bytes in the place of the length
        kind, length, start = kind & 0xFFFF, small, position + 4
        if length > 4:
            raise ValueError(f"a small element claims {length} bytes; expected at most 4")
    if start + length > len(data):
        raise ValueError(f"an element claims {length} bytes, and {len(data) - start} are left: truncated")
    end = start + length if kind == _COMPRESSED else position + 8 + (0 if small else -(-length // 8) * 8)
    return kind, data[start : start + length], end


def _unpacked(body: memoryview, left: int, limit: int) -> memoryview:
    stream = zlib.decompressobj()
    data = stream.decompress(body, left + 1)
    if len(data) > left:
        raise too_large(limit + 1, limit)
    if not stream.eof:
        raise ValueError("its compressed bytes end too early: truncated")
    return memoryview(data)


def _matrix(body: memoryview, order: str, prefix: str, depth: int) -> Iterator[tuple[str, Entry]]:
    """The entry of a matrix element, or those of a structure's fields."""
    if not body:
        return
    flags, dimensions, name, position = _matrix_header(body, order)
    name = prefix + name
    kind = flags & 0xFF
    if kind == _STRUCTURE:
        if math.prod(dimensions) != 1 or depth == _DEEPEST:
            yield name, Entry(dimensions, refusal="an array of structures, or one too deep; save its fields one by one")
        else:
            yield from _fields(body, position, order, name + ".", depth)
    elif kind not in _CLASSES:
        if name or kind not in _OTHERS:
            yield name, Entry(dimensions, refusal=f"{_OTHERS.get(kind, 'of an unknown class')}, no array of numbers")
    elif name:
        with in_array(name):
            parts = [_part(body, position, order)]
            if flags & _COMPLEX:
                parts.append(_part(body, parts[0][2], order))
            for stored, values, _ in parts:
                if len(values) != math.prod(dimensions) * stored.itemsize:
                    raise ValueError(f"{dimensions} values of {stored} do not take {len(values)} bytes")
        yield name, Entry(dimensions, partial(_values, [p[:2] for p in parts], dimensions, flags))


def _matrix_header(body: memoryview, order: str) -> tuple[int, tuple[int, ...], str, int]:
    """Flags with the class, dimensions and name of a matrix, and where what follows them starts."""
    _, flags, position = _element(body, 0, order)
    if len(flags) != 8:
        raise ValueError(f"an array's flags take {len(flags)} bytes; expected 8")
    bits = int(np.frombuffer(flags[:4], order + "u4")[0])
    if bits & 0xFF == _OPAQUE:
        return bits, (), "", position
    _, dimensions, position = _element(body, position, order)
    shape = tuple(int(n) for n in np.frombuffer(dimensions, order + "i4"))
    if not 2 <= len(shape) <= 32 or min(shape) < 0:
        raise ValueError(f"an array's dimensions are {shape[:8]}; expected two or more, none negative")
    _, name, position = _element(body, position, order)
    return bits, shape, bytes(name).decode("latin-1"), position


def _fields(body: memoryview, position: int, order: str, prefix: str, depth: int) -> Iterator[tuple[str, Entry]]:
    _, width, position = _element(body, position, order)
    _, names, position = _element(body, position, order)
    step = int(np.frombuffer(width, order + "i4")[0])
    if step < 1 or len(names) % step:
        raise ValueError(f"{len(names)} bytes of field names do not divide into names of {step}")
    for start in range(0, len(names), step):
        name = bytes(names[start : start + step]).split(b"\0")[0].decode("latin-1")
        kind, field, position = _element(body, position, order)
        if kind == _MATRIX:  # its own name is empty
            yield from _matrix(field, order, prefix + name, depth + 1)


def _part(body: memoryview, position: int, order: str) -> tuple[np.dtype, memoryview, int]:
    """The type as stored and the bytes of an array's real or imaginary part, and where the next element starts."""
    kind, values, position = _element(body, position, order)
    if kind not in _STORED:
        raise ValueError(f"its values are of the type {kind}; expected one of {sorted(_STORED)}")
    return np.dtype(order + _STORED[kind]), values, position


def _values(parts: list[tuple[np.dtype, memoryview]], shape: tuple[int, ...], flags: int) -> np.ndarray:
    """The array of a numeric class, which may be stored as a smaller type."""
    cls = np.dtype("?" if flags & _LOGICAL else _CLASSES[flags & 0xFF])
    real, *imaginary = (array_of_bytes(data, stored, shape, fortran=True) for stored, data in parts)
    if imaginary:
        array = np.empty(shape, np.result_type(cls, np.complex64), order="F")
        array.real, array.imag = real, imaginary[0]
    else:
        array = real.astype(cls, copy=False)
    array.flags.writeable = False
    return array
