"""A seal at the end of our HDF5 files: a checksum of all but the arrays' values, whose chunks carry their own.

HDF5's older structures have no checksums: a single damaged byte can send the library into an endless loop, or crash the
process. So the seal is checked before HDF5 opens the file. It follows HDF5's own last byte, where every other reader
leaves it alone:

    extents   (n, 2) uint64, little-endian: first byte and length of the values of each chunk, in order
    n         uint64
    SHA-256   32 bytes, of the bytes of the file outside the extents, in order, and of the extents
    magic     8 bytes

The chunks' own checksums, Fletcher-32 of 4 bytes behind the values, lie outside the extents: so a chunk of zeros, whose
checksum is 0, and one that was exchanged for another are found without reading a value. Files of before leave them out.
"""

import hashlib
import os
from typing import Any, BinaryIO

import numpy as np

_MAGIC = b"MSIGHT\x01\n"
_TAIL = 8 + 32 + len(_MAGIC)
_FLETCHER = 4  # bytes


def chunk_extents(file: Any) -> np.ndarray:
    """Where the values of the chunks of an open h5py file lie: (n, 2) uint64, first byte and length, in order."""
    import h5py

    found: list[tuple[int, int]] = []

    def visit(_name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.chunks is not None:
            own = _FLETCHER if item.fletcher32 else 0
            item.id.chunk_iter(lambda chunk: found.append((chunk.byte_offset, chunk.size - own)))

    file.visititems(visit)
    return np.array(sorted(found), dtype="<u8").reshape(-1, 2)


def seals_checksums(raw: BinaryIO, file: Any) -> bool:
    """Whether the seal of an open h5py file covers the chunks' checksums, which those of before leave out."""
    end = raw.seek(0, os.SEEK_END) - _TAIL
    raw.seek(end)
    many = 16 * int.from_bytes(raw.read(8), "little")
    raw.seek(end - many)
    return raw.read(many) == chunk_extents(file).tobytes()


def chunks_of_zeros(raw: BinaryIO, file: Any) -> dict[str, list[int]]:
    """By array of an open h5py file, the first rows of chunks of which every byte is 0, the checksum's as well.

    Only where the checksum is 0, which it is of few values else, are these read.
    """
    import h5py

    found: dict[str, list[int]] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.chunks is None or not item.fletcher32:
            return
        places: list[tuple[int, int, int]] = []
        item.id.chunk_iter(lambda chunk: places.append((chunk.chunk_offset[0], chunk.byte_offset, chunk.size)))
        for row, start, length in places:
            raw.seek(start + length - _FLETCHER)
            if any(raw.read(_FLETCHER)):
                continue
            raw.seek(start)
            if not any(raw.read(length)):
                found.setdefault(name, []).append(row)

    file.visititems(visit)
    return found


def write_seal(raw: BinaryIO, extents: np.ndarray) -> None:
    """Append the seal to a file, open for reading and writing, that HDF5 has closed."""
    size = raw.seek(0, os.SEEK_END)
    digest = _digest(raw, extents, size)
    raw.seek(size)
    raw.write(extents.tobytes() + len(extents).to_bytes(8, "little") + digest + _MAGIC)


def seal_holds(raw: BinaryIO) -> bool | None:
    """Whether the file is as it was sealed; None where there is no seal."""
    size = raw.seek(0, os.SEEK_END)
    if size < _TAIL:
        return None
    raw.seek(size - _TAIL)
    tail = raw.read(_TAIL)
    if not tail.endswith(_MAGIC):
        return None
    size -= _TAIL + 16 * int.from_bytes(tail[:8], "little")
    if size < 0:
        return False
    raw.seek(size)
    extents = np.frombuffer(raw.read(16 * int.from_bytes(tail[:8], "little")), dtype="<u8").reshape(-1, 2)
    edges = _edges(extents, size)
    return edges == sorted(edges) and _digest(raw, extents, size) == tail[8:40]


def _digest(raw: BinaryIO, extents: np.ndarray, size: int) -> bytes:
    """SHA-256 of the first `size` bytes but for the extents, and of the extents."""
    digest = hashlib.sha256()
    edges = _edges(extents, size)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        raw.seek(start)
        while start < stop and (block := raw.read(min(stop - start, 1 << 20))):
            digest.update(block)
            start += len(block)
    digest.update(extents.tobytes())
    return digest.digest()


def _edges(extents: np.ndarray, size: int) -> list[int]:
    """First and last byte, by turns, of what lies between the extents."""
    inner = [edge for first, length in extents.tolist() for edge in (first, first + length)]
    return [0, *inner, size]
