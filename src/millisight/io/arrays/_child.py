"""The child process that reads HDF5 and MATLAB files: it lists the arrays as JSON, then sends the bytes of some."""

import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from millisight.io._children import limit_process

_MOST = 10_000  # groups and data sets
_DEEPEST = 16  # structures inside structures


class _Found(NamedTuple):
    """An array of the file: its NumPy type, what it is instead of an array that is read, and its values."""

    name: str
    shape: tuple[int, ...]
    dtype: str
    refusal: str
    read: Callable[[], np.ndarray]  # MATLAB's with their axes in reverse


def _nothing() -> np.ndarray:
    return np.empty(0)


def main(path: str, limit: int, names: list[str] | None) -> None:
    """Write to the standard output what `_from_child` reads there; `names` are sent, None: all."""
    limit_process(limit)
    with open(path, "rb") as raw:
        start = raw.read(10)
    matlab = start.startswith(b"MATLAB")
    found = list(_hdf5(path, matlab) if start == b"MATLAB 7.3" or not matlab else _matlab(path, limit, names))
    told: list[dict[str, Any]] = []
    for one in found:
        size = 0 if one.refusal else int(np.prod(one.shape, dtype=object)) * np.dtype(one.dtype).itemsize
        refusal = one.refusal
        if size > limit:
            refusal = f"not read: it takes {size} bytes, over the limit of {limit}; pass a larger max_bytes"
        told.append(
            {
                "name": one.name,
                "shape": [int(n) for n in one.shape],
                "dtype": one.dtype,
                "bytes": 0 if refusal else size,
                "matlab": matlab,
                "refusal": refusal,
                "sent": not refusal and (names is None or one.name in names),
            }
        )
    if sum(entry["bytes"] for entry in told if entry["sent"]) > limit:
        raise ValueError(f"it would unpack to more than {limit} bytes; pass a larger max_bytes")
    sys.stdout.buffer.write(json.dumps(told).encode() + b"\n")
    for entry, one in zip(told, found, strict=True):
        if entry["sent"]:
            try:
                values = np.ascontiguousarray(one.read())
            except (OSError, RuntimeError, ValueError) as error:
                raise ValueError(f"array {one.name!r}: {error}") from error
            sys.stdout.buffer.write(values.reshape(-1).view(np.uint8).data)
            sys.stdout.buffer.flush()


def _matlab(path: str, limit: int, names: list[str] | None) -> Iterator[_Found]:
    """The variables of a MATLAB file of version 5, fields of structures as "data.frames"."""
    from scipy.io import loadmat, whosmat

    kinds = {name: (shape, kind) for name, shape, kind in whosmat(path, appendmat=False)}
    large = [name for name, (shape, kind) in kinds.items() if np.prod(shape, dtype=object) * _width(kind) > limit]
    roots = None if names is None else {name.split(".")[0] for name in names}
    some = [
        name
        for name, (_, kind) in kinds.items()
        if name not in large and (kind == "struct" or (_width(kind) and (roots is None or name in roots)))
    ]
    # Without mat_dtype, which takes the imaginary part off what is complex and single.
    loaded: dict[str, Any] = loadmat(path, appendmat=False, variable_names=some) if some else {}
    for name, (shape, kind) in kinds.items():
        if name in loaded:
            yield from _variable(name, _of_class(loaded[name], kind), 0)
        elif not _width(kind):
            yield _Found(name, shape, "", f"{_OTHERS.get(kind, 'of an unknown class')}, no array of numbers", _nothing)
        else:
            yield _Found(name, shape, f"u{_width(kind)}", "", _nothing)  # not asked for: only its shape is told


_OTHERS = {"cell": "a cell array", "char": "text", "sparse": "a sparse matrix", "object": "an object"}


def _width(kind: str) -> int:
    """Bytes of a value of a MATLAB class; 0 for what is no array of numbers."""
    return {"double": 8, "single": 4, "logical": 1}.get(kind) or int(
        {"8": 1, "16": 2, "32": 4, "64": 8}.get(kind.removeprefix("u").removeprefix("int"), 0)
    )


def _of_class(value: Any, kind: str) -> Any:
    """The numbers of a MATLAB class, which may be stored as a smaller type."""
    if not _width(kind) or not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc":
        return value
    dtype = {"double": "f8", "single": "f4", "logical": "?"}.get(kind, kind)
    return value.astype(np.result_type(dtype, np.complex64) if value.dtype.kind == "c" else dtype, copy=False)


def _variable(name: str, value: Any, depth: int) -> Iterator[_Found]:
    """The arrays of a variable that SciPy has read."""
    if isinstance(value, np.ndarray) and value.dtype.names and type(value) is np.ndarray:
        if value.size != 1 or depth == _DEEPEST:
            reason = "an array of structures, or one too deep; save its fields one by one"
            yield _Found(name, value.shape, "", reason, _nothing)
            return
        for field in value.dtype.names:
            yield from _variable(f"{name}.{field}", value.flat[0][field], depth + 1)
        return
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc":
        kind = getattr(getattr(value, "dtype", None), "kind", "")
        what = "text" if kind == "U" else "a cell array" if kind == "O" else "an object"
        yield _Found(name, np.shape(value), "", f"{what}, no array of numbers", _nothing)
        return
    native = value.astype(value.dtype.newbyteorder("="), copy=False)
    yield _Found(name, native.shape, native.dtype.str, "", lambda: native.T)


def _hdf5(path: str, matlab: bool) -> Iterator[_Found]:
    """The data sets of an HDF5 file, which stays open until all are read."""
    import h5py

    file = h5py.File(path, "r")
    for key, item in _datasets(file, h5py):
        dtype, refusal = _type(item)
        shape = item.shape or ()
        yield _Found(
            key.replace("/", ".") if matlab else key,
            shape[::-1] if matlab else shape,
            dtype,
            refusal or _storage(item, h5py.h5z),
            lambda item=item: _values(item, h5py.h5z),
        )


def _values(dataset: Any, filters: Any) -> np.ndarray:
    stored = dataset.id.get_storage_size()
    if filters.FILTER_DEFLATE not in _filters(dataset) and stored < dataset.nbytes:  # missing is read as zeros
        raise ValueError(f"{stored} bytes are stored of {dataset.nbytes}")
    return dataset[...]


def _datasets(file: Any, h5py: Any) -> Iterator[tuple[str, Any]]:
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


def _storage(dataset: Any, filters: Any) -> str:
    """Why the data set's bytes are not read: they lie elsewhere, or are packed in an unknown way."""
    if dataset.is_virtual or dataset.id.get_create_plist().get_external_count():
        return "not read: its bytes lie in another file"
    packed = _filters(dataset)
    if packed - {filters.FILTER_DEFLATE, filters.FILTER_SHUFFLE, filters.FILTER_FLETCHER32}:
        return f"not read: it is packed by the filters {sorted(packed)}; expected deflate, shuffle or Fletcher-32"
    return ""


def _filters(dataset: Any) -> set[int]:
    layout = dataset.id.get_create_plist()
    return {layout.get_filter(i)[0] for i in range(layout.get_nfilters())}


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3]))
    except Exception as problem:
        sys.exit(" ".join(f"{problem or type(problem).__name__}".split()))
