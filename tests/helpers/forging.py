"""Files of ours, changed and sealed again."""

import h5py
import numpy as np

from millisight.io._seal import _TAIL as TAIL
from millisight.io._seal import chunk_extents, seal_holds, write_seal


def forge(path, change):
    """Change a file of ours and seal it again, as only somebody who knows how would."""
    with h5py.File(path, "r+") as file:
        change(file)
        file.flush()
        extents = chunk_extents(file)
    with open(path, "r+b") as raw:
        assert seal_holds(raw) is None
        write_seal(raw, extents)
        assert seal_holds(raw)


def patch(path, change):
    """Change the bytes of a file of ours, a bytearray of the same length, and seal it again."""
    with open(path, "r+b") as raw:
        assert seal_holds(raw)
        size = raw.seek(0, 2)
        raw.seek(size - TAIL)
        count = int.from_bytes(raw.read(8), "little")
        size -= TAIL + 16 * count
        raw.seek(size)
        extents = np.frombuffer(raw.read(16 * count), dtype="<u8").reshape(-1, 2)
        raw.seek(0)
        data = bytearray(raw.read(size))
        change(data)
        assert len(data) == size
        raw.seek(0)
        raw.write(data)
        raw.truncate()
        write_seal(raw, extents)
        assert seal_holds(raw)
