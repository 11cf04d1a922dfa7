"""Point clouds as PLY and PCD files."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import (
    atomic_path,
    check_known,
    check_readable,
    checked_path,
    checked_record,
    lengths_of,
    printable,
)
from millisight.core.errors import FormatError, UnknownNameError
from millisight.data import PointCloud

CLOUD_SUFFIXES = (".ply", ".pcd")

_NORMALS = ("nx", "ny", "nz")
_SIGMAS = ("place_sigma", "normal_sigma_deg")
_MOST_HEAD = 65_536  # bytes of a PLY file's header
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def write_point_cloud(path: str | os.PathLike[str], cloud: PointCloud, *, binary: bool = True) -> None:
    """Write a cloud as PLY or PCD, depending on the suffix: x, y, z as doubles [m] and `intensity`, |I|, as a float.

    Normals follow as nx, ny, nz (PCD: normal_x, normal_y, normal_z), and standard deviations as `place_sigma` [m] and
    `normal_sigma_deg` [degrees], each a float, where the cloud has them.

    Raises
    ------
    UnknownNameError
        The suffix is neither .ply nor .pcd.
    FileError
        The file cannot be written.
    """
    path, cloud = checked_path(path), checked_record(cloud, PointCloud, name="cloud")
    suffix = path.suffix.lower()
    if suffix not in CLOUD_SUFFIXES:
        raise UnknownNameError("point cloud format", suffix or Path(path).name, CLOUD_SUFFIXES)
    columns: dict[str, Any] = dict(zip("xyz", cloud.points.T, strict=True)) | {"intensity": cloud.magnitude}
    if cloud.normals is not None:
        columns |= dict(zip(_NORMALS, cloud.normals.T, strict=True))
    columns |= {name: held for name in _SIGMAS if (held := getattr(cloud, name)) is not None}
    rows = np.empty(len(cloud), dtype=[(name, "<f8" if name in "xyz" else "<f4") for name in columns])
    for name, values in columns.items():
        rows[name] = values
    header = (_ply_header if suffix == ".ply" else _pcd_header)(list(columns), len(cloud), binary)
    if binary:
        body = rows.tobytes()
    else:
        body = "".join(
            " ".join(
                f"{value!r}" if name in "xyz" else f"{value:.9g}" for name, value in zip(columns, row, strict=True)
            )
            + "\n"
            for row in rows.tolist()
        ).encode()
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + body)


def _ply_header(names: list[str], count: int, binary: bool) -> str:
    properties = "".join(f"property {'double' if name in 'xyz' else 'float'} {name}\n" for name in names)
    return (
        f"ply\nformat {'binary_little_endian' if binary else 'ascii'} 1.0\ncomment in metres, made by millisight\n"
        f"element vertex {count}\n{properties}end_header\n"
    )


def _pcd_header(names: list[str], count: int, binary: bool) -> str:
    fields = [name.replace("n", "normal_", 1) if name in _NORMALS else name for name in names]
    sizes = " ".join("8" if name in "xyz" else "4" for name in names)
    return (
        f"# .PCD v0.7 - in metres, made by millisight\nVERSION 0.7\nFIELDS {' '.join(fields)}\nSIZE {sizes}\n"
        f"TYPE {' '.join('F' * len(names))}\nCOUNT {' '.join('1' * len(names))}\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\n"
        f"DATA {'binary' if binary else 'ascii'}\n"
    )


def holds_points(path: str | os.PathLike[str]) -> bool:
    """Whether a PLY file holds points and no faces.

    Raises
    ------
    FileError, FormatError
    """
    counts = re.findall(rb"^element\s+(\w+)\s+(\d+)", _head(check_readable(path))[0], re.MULTILINE)
    return not any(name == b"face" and count.strip(b"0") for name, count in counts)


def read_point_cloud(path: str | os.PathLike[str]) -> PointCloud:
    """Read the vertices of a PLY file as points, with what `write_point_cloud` writes where it is there.

    Raises
    ------
    FileError
        There is no such file, or it cannot be opened.
    FormatError
        It is no PLY file, or its vertices have no x, y and z, or are fewer than its header states.
    """
    path = check_readable(path)
    check_known("point cloud format", path.suffix.lower(), (".ply",))
    head, body = _head(path)
    columns = _vertices(path, head, body)
    if missing := [name for name in "xyz" if name not in columns]:
        raise FormatError(f"{printable(path)}: vertices without {' and '.join(missing)}; expected x, y and z")
    normals = np.stack([columns[n] for n in _NORMALS], axis=1) if set(_NORMALS) <= columns.keys() else None
    if normals is not None and len(normals):
        lengths = lengths_of(normals)[:, None]
        normals = normals / lengths if lengths.min() > 0 else None
    return PointCloud(
        points=np.stack([columns[name] for name in "xyz"], axis=1),
        magnitude=columns.get("intensity"),
        normals=normals,
        **{name: columns.get(name) for name in _SIGMAS},
        metadata={"source": printable(path.name)},
    )


def _count(text: str) -> int | None:
    """The whole number that a text is, of as many digits as files have bytes; None where it is none."""
    return int(text) if re.fullmatch(r"[0-9]{1,15}", text) else None


def _head(path: Path) -> tuple[bytes, bytes]:
    """The header of a PLY file, and what follows it."""
    content = path.read_bytes()
    match = re.search(rb"^end_header\r?\n", content[:_MOST_HEAD], re.MULTILINE)
    if not content.startswith(b"ply") or match is None:
        raise FormatError(f"{printable(path)} is no PLY file (it starts with {content[:8]!r})")
    return content[: match.end()], content[match.end() :]


def _vertices(path: Path, head: bytes, body: bytes) -> dict[str, np.ndarray]:
    """The columns of the element `vertex`, which comes first, as floats."""
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    kind = next((line[1] for line in lines if line[:1] == ["format"] and len(line) == 3), "")
    elements = [i for i, line in enumerate(lines) if line[:1] == ["element"]]
    if kind not in _ORDERS or not elements or lines[elements[0]][1:2] != ["vertex"] or len(lines[elements[0]]) != 3:
        raise FormatError(f"{printable(path)} is no PLY file of points: expected a format, and vertices first")
    count = _count(lines[elements[0]][2])
    if count is None:
        raise FormatError(f"{printable(path)} states no number of vertices: {lines[elements[0]][2][:40]!r}")
    end = elements[1] if len(elements) > 1 else len(lines)
    properties = [line for line in lines[elements[0] + 1 : end] if line[:1] == ["property"]]
    if any(len(line) != 3 or line[1] not in _TYPES for line in properties):
        raise FormatError(f"{printable(path)} has vertices with lists; expected plain numbers")
    names = [line[2] for line in properties]
    short = f"{printable(path)} is truncated: it holds fewer than {count} vertices; make or copy it again"
    if kind == "ascii":
        rows = [row.split() for row in body.decode("ascii", "replace").splitlines()[:count]]
        if len(rows) < count or any(len(row) != len(names) for row in rows):
            raise FormatError(short)
        try:
            table = np.array(rows, dtype=float).reshape(count, len(names))
        except ValueError as error:
            raise FormatError(f"{printable(path)} has a vertex that is no row of numbers: {error}") from error
        return dict(zip(names, table.T, strict=True))
    dtype: np.dtype[Any] = np.dtype([(f"{i}", _ORDERS[kind] + _TYPES[line[1]]) for i, line in enumerate(properties)])
    if len(body) < count * dtype.itemsize:
        raise FormatError(short)
    found = np.frombuffer(body, dtype=dtype, count=count)
    with np.errstate(invalid="ignore"):  # signalling NaNs, of which NumPy warns
        return {name: found[f"{i}"].astype(float) for i, name in enumerate(names)}
