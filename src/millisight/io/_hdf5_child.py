"""The child process that reads HDF5 for `hdf5_arrays`: it lists the data sets as JSON, then sends the bytes of some."""

import json
import sys
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

_DEFLATE, _REVERSIBLE = h5py.h5z.FILTER_DEFLATE, {h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_MOST = 10_000  # groups and data sets
_OVERHEAD = 2 << 30  # of the libraries' own address space


def main(path: str, limit: int, names: list[str] | None) -> None:
    """Write to the standard output what `hdf5_arrays` reads there; `names` are sent, None: all."""
    _limit_memory(limit)
    with open(path, "rb") as raw:
        matlab = raw.read(10) == b"MATLAB 7.3"
    with h5py.File(path, "r") as file:
        found = {key.replace("/", ".") if matlab else key: item for key, item in _datasets(file)}
        told = [_told(name, item, matlab, limit, names) for name, item in found.items()]
        if sum(entry["bytes"] for entry in told if entry["sent"]) > limit:
            raise ValueError(f"it would unpack to more than {limit} bytes; pass a larger max_bytes")
        sys.stdout.buffer.write(json.dumps(told).encode() + b"\n")
        for entry in told:
            if entry["sent"]:
                _send(found[entry["name"]], entry["name"])


def _limit_memory(limit: int) -> None:
    try:
        import resource
    except ImportError:  # not on Windows
        return
    most = _OVERHEAD + 3 * limit
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _send(dataset: Any, name: str) -> None:
    stored = dataset.id.get_storage_size()
    if _DEFLATE not in _filters(dataset) and stored < dataset.nbytes:  # what is missing would be read as zeros
        raise ValueError(f"array {name!r}: {stored} bytes are stored of {dataset.nbytes}")
    try:
        values = np.ascontiguousarray(dataset[...])
    except (OSError, RuntimeError, ValueError) as error:
        raise ValueError(f"array {name!r}: {error}") from error
    sys.stdout.buffer.write(values.view(np.uint8).data)
    sys.stdout.buffer.flush()


def _datasets(file: Any) -> Iterator[tuple[str, Any]]:
    """The data sets of a file, each group visited once; no link that leads elsewhere is followed."""
    groups, seen, number = [("", file)], set(), 0
    while groups:
        prefix, group = groups.pop()
        if group in seen:  # by another of its names
            continue
        seen.add(group)
        for name in group:
            number += 1
            if number > _MOST:
                raise ValueError(f"it holds more than {_MOST} objects")
            if not isinstance(group.get(name, getlink=True), h5py.HardLink) or name in ("#refs#", "#subsystem#"):
                continue
            item = group[name]
            if isinstance(item, h5py.Dataset):
                yield prefix + name, item
            elif isinstance(item, h5py.Group):
                groups.append((f"{prefix}{name}/", item))


def _told(name: str, dataset: Any, matlab: bool, limit: int, names: list[str] | None) -> dict[str, Any]:
    shape = dataset.shape or ()
    dtype, refusal = _type(dataset)
    refusal = refusal or _storage(dataset, limit)
    return {
        "name": name,
        "shape": shape[::-1] if matlab else shape,
        "dtype": dtype,
        "bytes": 0 if refusal else dataset.nbytes,
        "matlab": matlab,
        "refusal": refusal,
        "sent": not refusal and (names is None or name in names),
    }


def _type(dataset: Any) -> tuple[str, str]:
    """The NumPy name of the data set's type, and what it is instead of an array of numbers."""
    dtype, kind = dataset.dtype, dataset.attrs.get("MATLAB_class", b"")
    if kind == b"char":
        return "", "text, no array of numbers"
    if "MATLAB_empty" in dataset.attrs or dataset.shape is None:
        return "", "empty"
    if dtype.names == ("real", "imag") and dtype[0] == dtype[1] and dtype[0].kind == "f":
        return dtype[0].byteorder.replace("=", "") + f"c{2 * dtype[0].itemsize}", ""
    if dtype.kind not in "biufc":
        return "", f"of the type {str(dtype)[:80]}, no array of numbers"
    return ("?" if kind == b"logical" else dtype.str), ""


def _storage(dataset: Any, limit: int) -> str:
    """Why the data set's bytes are not read: they lie elsewhere, are packed in an unknown way, or are too many."""
    filters = _filters(dataset)
    if dataset.is_virtual or dataset.id.get_create_plist().get_external_count():
        return "not read: its bytes lie in another file"
    if filters - _REVERSIBLE - {_DEFLATE}:
        return f"not read: it is packed by the filters {sorted(filters)}; expected deflate, shuffle or Fletcher-32"
    if dataset.nbytes > limit:
        return f"not read: it takes {dataset.nbytes} bytes, over the limit of {limit}; pass a larger max_bytes"
    return ""


def _filters(dataset: Any) -> set[int]:
    layout = dataset.id.get_create_plist()
    return {layout.get_filter(i)[0] for i in range(layout.get_nfilters())}


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3]))
    except Exception as problem:
        sys.exit(" ".join(f"{problem or type(problem).__name__}".split()))
