"""Every record in HDF5: `save`, `load`, and `open_capture` for captures larger than memory.

A record is a group: arrays are its datasets, numbers and texts its attributes, records in it its groups. Complex
numbers are the compound {r, i} that h5py, MATLAB, Julia and C++ read. Arrays carry Fletcher-32 checksums a chunk; a
seal covers the rest, and is checked before HDF5 opens a file. Files are written to a temporary name, then renamed.
"""

import importlib.metadata
import json
import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from millisight import data
from millisight.core import atomic_path, check_record_suffix, check_shape, printable, was_cut
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError
from millisight.data import Capture
from millisight.io._about import ABOUT
from millisight.io._opened import PLACED_VERSION, SCHEMA_VERSION, opened, plain, reason
from millisight.io._seal import chunk_extents, write_seal
from millisight.io._sink import Sink

T = TypeVar("T")

RECORDS = {
    cls.__name__: cls
    for cls in (
        data.Waveform, data.AntennaArray, data.Radar, data.Trajectory, data.Layers, Capture, data.VoxelGrid,
        data.PixelGrid, data.SarImage, data.Mask, data.VolumeMask, data.Instances, data.Prediction, data.PointCloud,
        data.TriangleMesh, data.Surface, data.Material, data.SceneObject, data.Scene, data.Intrinsics,
        data.CameraFrame, data.CameraMask,
    )
}  # fmt: skip

_CHUNK_BYTES = 1 << 20
_EXTRAS = "extras"
_JSON = "json:"


def save(
    path: str | os.PathLike[str],
    record: Any,
    *,
    extras: Mapping[str, Any] | None = None,
    reproducible: bool = False,
) -> None:
    """Write a record to an HDF5 file; an old file at `path` is replaced only when the new one is complete.

    Parameters
    ----------
    path : the file
    record : a record of millisight
    extras : further data by name: arrays of numbers, and values that JSON can hold; see `load_extras`
    reproducible : leave out date and command, so that equal records give equal bytes

    Raises
    ------
    InputError
        It is not a record of millisight, or an extra cannot be stored.
    UnknownNameError
        The suffix is that of another format.
    FileError
        The folder is missing, read-only, or full.
    """
    if type(record).__name__ not in RECORDS:
        advice = (
            ": write its `plain` as JSON, or the mask with extras={...: its `plain`}"
            if hasattr(record, "plain")
            else ""
        )
        raise InputError(f"save got {type(record).__name__}; expected one of {', '.join(sorted(RECORDS))}{advice}")
    check_record_suffix(path)
    if extras is not None and not isinstance(extras, Mapping):
        raise InputError(f"extras is of type {type(extras).__name__}; expected a dictionary of values by name")
    if isinstance(record, Capture):
        record.frames_of(slice(0, 1))  # refuses, before anything is written, one whose file was closed
    newer = ("tx_points", "rx_points", "layers")
    placed = isinstance(record, Capture) and any(getattr(record, name) is not None for name in newer)
    with _sealed(path, PLACED_VERSION if placed else SCHEMA_VERSION, reproducible=reproducible) as (file, sink):
        _write(file, record, sink)
        for name, value in (extras or {}).items():
            _write_extra(file, name, value, sink)


def save_image(
    path: str | os.PathLike[str], grid: data.VoxelGrid, values: Any, metadata: Mapping[str, Any] | None = None
) -> None:
    """Write an image whose values need not be in memory, as `save` writes a SarImage.

    Parameters
    ----------
    path : the file
    grid : of the image
    values : (X, Y, Z) complex64: anything with `shape`, `dtype`, `size` and slices along x, read a part at a time
    metadata : provenance; what JSON can hold

    Raises
    ------
    InputError
        The values are of another shape than the grid.
    UnknownNameError, FileError
        As `save`.
    """
    check_shape(values.shape, name="values", shape=grid.shape)
    check_record_suffix(path)
    with _sealed(path, SCHEMA_VERSION) as (file, sink):
        file.attrs["record"] = data.SarImage.__name__
        _write(file.create_group("grid"), grid, sink)
        about = _write_array(file, "values", values, sink).attrs
        for name, text in ABOUT["values"].items():
            about[name] = text
        file.attrs["metadata"] = _JSON + json.dumps(dict(metadata or {}))


@contextmanager
def _sealed(path: str | os.PathLike[str], version: int, *, reproducible: bool = False) -> Iterator[tuple[Any, Sink]]:
    """A new file with its provenance, to be written; sealed and renamed once all of it is there."""
    import h5py

    with atomic_path(path) as temporary, open(temporary, "w+b") as raw:
        with Sink(raw) as sink, h5py.File(sink, "w") as file:
            file.attrs["format"] = "millisight"
            file.attrs["schema_version"] = version
            file.attrs["code_version"] = importlib.metadata.version("millisight")
            if not reproducible:
                file.attrs["command"] = printable(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]))
                file.attrs["created"] = datetime.now(UTC).isoformat(timespec="seconds")
            yield file, sink
            extents = chunk_extents(file)
        write_seal(raw, extents)


@overload
def load(path: str | os.PathLike[str]) -> Any: ...


@overload
def load(path: str | os.PathLike[str], kind: type[T]) -> T: ...


def load(path: str | os.PathLike[str], kind: type[Any] | None = None) -> Any:
    """Read a record from an HDF5 file of `save` into memory.

    Parameters
    ----------
    path : the file
    kind : the class of record that is expected, such as `ms.SarImage`: any other is refused before it is read, and
        editors know what is returned; None: any

    Raises
    ------
    FileError
        There is no such file, or it cannot be opened.
    FormatError
        It is not HDF5, was not written by millisight, has a newer schema, or holds another record than `kind`.
    DamagedFileError
        It was written by millisight, but is truncated or corrupted.
    InputError
        `kind` is no record that files hold.
    """
    if kind is not None and (not isinstance(kind, type) or kind not in RECORDS.values()):
        raise InputError(f"kind is {kind!r}; expected one of {', '.join(sorted(RECORDS))}")
    with opened(path) as file:
        if kind is not None:
            _expect(file, path, kind.__name__)
        record = _read(file, path)
        _check_uncut(file, path)
        return record


@contextmanager
def open_capture(path: str | os.PathLike[str]) -> Iterator[Capture]:
    """A capture whose frames stay on disk while the `with` block runs; `ms.form_image` reads them in blocks.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `load`; FormatError also where the file holds another record.
    """
    with opened(path) as file:
        _expect(file, path, "Capture")
        yield _read(file, path, lazy=("frames",))


@contextmanager
def open_image(path: str | os.PathLike[str]) -> Iterator[tuple[data.VoxelGrid, Any]]:
    """Grid and values of an image; the values, (X, Y, Z) complex64, stay on disk while the `with` block runs.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `load`; FormatError also where the file holds another record. DamagedFileError also from reading values,
        where the file is cut short meanwhile.
    """
    with opened(path) as file:
        _expect(file, path, data.SarImage.__name__)
        found = {name: _read_item(file[name], path, lazily=True) for name in ("grid", "values") if name in file}
        grid, values = found.get("grid"), found.get("values")
        if not isinstance(grid, data.VoxelGrid) or getattr(values, "shape", None) != grid.shape:
            raise DamagedFileError(f"{path} is damaged: its values do not fit its grid; make or copy it again")
        _check_uncut(file, path)
        yield grid, _OnDisk(values, path)


def load_extras(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The `extras` that were passed to `save`, by name; empty if there were none.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `load`.
    """
    with opened(path) as file:
        extras: dict[str, Any] = {}
        try:
            for name, item in file.get(_EXTRAS, {}).items():
                array = _read_item(item, path, lazily=False)
                extras[name] = json.loads(array.tobytes()) if "json" in item.attrs else array
        except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise DamagedFileError(f"{path} is damaged at {_EXTRAS}: {reason(error)}; make or copy it again") from error
        _check_uncut(file, path)
        return extras


def provenance(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Provenance of a file: record, schema_version, code_version, command, created; or "unknown"."""
    with opened(path) as file:
        names = ("record", "schema_version", "code_version", "command", "created")
        try:
            told = {name: plain(file.attrs.get(name, "unknown")) for name in names}
        except (ValueError, RecursionError) as error:
            raise DamagedFileError(f"{printable(path)} is damaged: {error}; make or copy it again") from error
        return {name: value if isinstance(value, int | str) else str(value) for name, value in told.items()}


def _write(group: Any, record: Any, sink: Sink) -> None:
    group.attrs["record"] = type(record).__name__
    for field in fields(record):
        value = getattr(record, field.name)
        if value is None:
            continue
        if type(value).__name__ in RECORDS:
            _write(group.create_group(field.name), value, sink)
            about = group[field.name].attrs
        elif isinstance(value, tuple) and value and type(value[0]).__name__ in RECORDS:
            for i, item in enumerate(value):
                _write(group.create_group(f"{field.name}/{i}"), item, sink)
            about = group[field.name].attrs
            about["count"] = len(value)
        elif not isinstance(value, tuple) and np.shape(value):
            about = _write_array(group, field.name, value, sink).attrs
        else:
            as_it_is = isinstance(value, int | float | complex | np.number) or _is_plain_text(value)
            group.attrs[field.name] = value if as_it_is else _JSON + json.dumps(value)
            continue
        own = f"{type(record).__name__}.{field.name}"
        for name, text in ABOUT.get(own, ABOUT.get(field.name, {})).items():
            about[name] = text


def _write_array(group: Any, name: str, array: Any, sink: Sink) -> Any:
    """A chunked, checksummed dataset, copied a chunk's worth of first-axis rows at a time (it may lie on disk)."""
    if not array.size:  # of which there are no chunks
        return group.create_dataset(name, data=array)
    row = max(1, array.dtype.itemsize * int(np.prod(array.shape[1:])))
    rows = min(array.shape[0], max(1, _CHUNK_BYTES // row))
    dataset = group.create_dataset(
        name, shape=array.shape, dtype=array.dtype, chunks=(rows, *array.shape[1:]), fletcher32=True
    )
    many = rows * 64
    for start in range(0, array.shape[0], many):
        dataset[start : start + many] = array[start : start + many]
        sink.check()
    # Its place in the file is settled here, not when its last handle closes: that is as late as any thread that looks
    # at our frames (a profiler) has it, and equal records are to give equal bytes.
    dataset.flush()
    return dataset


def _write_extra(file: Any, name: str, value: Any, sink: Sink) -> None:
    """An array as it is, anything else as JSON in a checksummed array of bytes."""
    if not name or "/" in name or name == "." or "\0" in name or printable(name) != name:
        raise InputError(f"extras has the name {name!r}; expected a text without / and NUL")
    group = file.require_group(_EXTRAS)
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        if value.size and value.ndim:
            _write_array(group, name, value, sink)
        else:
            group[name] = value
        return
    try:
        text = json.dumps(value, allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"extras' {name} is neither an array of numbers nor what JSON can hold: {error}") from error
    dataset = _write_array(group, name, np.frombuffer(text, dtype=np.uint8), sink)
    dataset.attrs["json"] = 1


def _read(group: Any, path: str | os.PathLike[str], lazy: tuple[str, ...] = ()) -> Any:
    """Build the record of a group; whatever does not fit is a damaged file."""
    name = _kind(group, path)
    if name not in RECORDS:
        raise FormatError(f"{path} holds {name!r}; expected one of {', '.join(sorted(RECORDS))}")
    values: dict[str, Any] = {}
    try:
        for field in fields(RECORDS[name]):
            if field.name in group.attrs:
                values[field.name] = plain(group.attrs[field.name])
            elif field.name in group:
                values[field.name] = _read_item(group[field.name], path, lazily=field.name in lazy)
        return RECORDS[name](**values)
    except FileError:
        raise
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise DamagedFileError(f"{path} is damaged at {group.name}: {reason(error)}; make or copy it again") from error


def _read_item(item: Any, path: str | os.PathLike[str], *, lazily: bool) -> Any:
    if hasattr(item, "keys"):
        if "count" in item.attrs:
            return tuple(_read(item[str(i)], path) for i in range(int(item.attrs["count"])))
        return _read(item, path)
    if lazily:
        return item
    array = item[...]
    array.flags.writeable = False  # so that the record takes it as it is
    return array


class _OnDisk:
    """An array of an open file, read a part at a time; the file is checked after each, since it may be cut."""

    def __init__(self, dataset: Any, path: str | os.PathLike[str]):
        self._dataset, self._path = dataset, path
        self.shape: tuple[int, ...] = dataset.shape
        self.dtype: np.dtype = dataset.dtype
        self.size: int = dataset.size
        self.ndim: int = dataset.ndim

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, index: Any) -> np.ndarray:
        values = self._dataset[index]
        _check_uncut(self._dataset.file, self._path)
        return values


def _check_uncut(file: Any, path: str | os.PathLike[str]) -> None:
    """Raise where an open file became shorter since it was opened: what was read beyond its end is zeros, not data.

    Raises
    ------
    DamagedFileError
    """
    if was_cut(file):
        raise DamagedFileError(
            f"{printable(path)} cannot be trusted: the file was cut short while it was read; make or copy it again"
        )


def _is_plain_text(value: Any) -> bool:
    """Whether a text can be an attribute as it is: HDF5 holds no NUL and only UTF-8; and `_JSON` marks JSON."""
    return isinstance(value, str) and not value.startswith(_JSON) and "\0" not in value and printable(value) == value


def _kind(group: Any, path: str | os.PathLike[str]) -> str:
    """The name of the record that a group holds."""
    try:
        name = plain(group.attrs.get("record"))
    except (ValueError, RecursionError):
        name = None
    if not isinstance(name, str):
        raise DamagedFileError(f"{path} is damaged at {group.name}: it names no record; make or copy it again")
    return name


def _expect(group: Any, path: str | os.PathLike[str], kind: str) -> None:
    """Raise `FormatError` unless a group holds a record of that kind."""
    if _kind(group, path) != kind:
        raise FormatError(f"{path} holds a {_kind(group, path)}; expected a {kind}")
