"""The child process that copies an HDF5 file without a seal, of schema 1, and seals the copy.

HDF5 can crash or hang on a damaged file: then it does so here.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

from millisight.core.errors import FileError
from millisight.io._children import limit_process
from millisight.io._opened import judge, reason
from millisight.io._seal import chunk_extents, write_seal

_BLOCK = 1 << 24  # read at a time [bytes]


def main(path: str, copy: str) -> dict[str, str]:
    """Copy `path` to `copy`, sealed; what is returned says why not, or is empty."""
    import h5py

    limit_process(os.path.getsize(path))
    try:
        try:
            with h5py.File(path, "r") as file, h5py.File(copy, "w") as target:
                judge(file, Path(path), sealed=False)
                _copy(file, target)
                target.flush()
                extents = chunk_extents(target)
        except (OSError, RuntimeError, LookupError, TypeError, ValueError) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(f"{path} cannot be opened as HDF5: {reason(error)}; make or copy it again") from error
    except FileError as error:
        return {"kind": type(error).__name__, "message": str(error)}
    with open(copy, "r+b") as raw:
        write_seal(raw, extents)
    return {}


def _copy(group: Any, target: Any) -> None:
    """Attributes, arrays and groups of a tree that was judged, as they are."""
    import h5py

    for name, value in group.attrs.items():
        target.attrs[name] = value
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            _copy(item, target.create_group(name))
            continue
        chunks = item.chunks if item.size else None
        made = target.create_dataset(name, item.shape, item.dtype, chunks=chunks, fletcher32=chunks is not None)
        if not item.shape:
            made[()] = item[()]
        elif item.size:
            rows = max(1, _BLOCK * item.shape[0] // item.nbytes)
            for start in range(0, item.shape[0], rows):
                made[start : start + rows] = item[start : start + rows]
        for key, value in item.attrs.items():
            made.attrs[key] = value


if __name__ == "__main__":
    try:
        answer = main(sys.argv[1], sys.argv[2])
    except Exception as problem:
        sys.exit(" ".join(f"{problem or type(problem).__name__}".split()))
    sys.stdout.write(json.dumps(answer))
