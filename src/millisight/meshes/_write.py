"""Write meshes to files."""

import os

import numpy as np

from millisight.core import atomic_path, checked_array, checked_path, checked_record
from millisight.core.errors import UnknownNameError
from millisight.data import TriangleMesh

_CODES = {"double": "<f8", "float": "<f4", "uchar": "u1"}


def write_mesh(
    path: str | os.PathLike[str],
    mesh: TriangleMesh,
    *,
    sigma: np.ndarray | None = None,
    colours: np.ndarray | None = None,
    seen: np.ndarray | None = None,
) -> None:
    """Write a mesh as a binary PLY file in metres.

    Parameters
    ----------
    path : ends in .ply
    mesh : TriangleMesh
    sigma : (V,) standard deviation of each vertex [m], written as `place_sigma`, with the normals nx, ny, nz
    colours : (V, 3) red, green and blue of each vertex, 0 to 255
    seen : (V,) bool, whether each vertex was seen, or guessed; written as `seen`, 1 or 0

    Raises
    ------
    UnknownNameError
        The suffix is not .ply.
    InputError
        `sigma`, `colours` or `seen` is not of the vertices.
    FileError
        The file cannot be written.
    """
    path, mesh = checked_path(path), checked_record(mesh, TriangleMesh, name="mesh")
    if path.suffix.lower() != ".ply":
        raise UnknownNameError("mesh format", path.suffix or path.name, (".ply",))
    columns: dict[str, tuple[str, np.ndarray]] = {
        name: ("double", values) for name, values in zip("xyz", mesh.vertices.T, strict=True)
    }
    count = len(mesh.vertices)
    if sigma is not None:
        for name, values in zip(("nx", "ny", "nz"), mesh.vertex_normals.T, strict=True):
            columns[name] = "float", values
        columns["place_sigma"] = "float", checked_array(sigma, name="sigma", shape=(count,), unit="m")
    if colours is not None:
        rgb = checked_array(colours, name="colours", shape=(count, 3), dtype=np.uint8)
        columns |= {name: ("uchar", rgb[:, i]) for i, name in enumerate(("red", "green", "blue"))}
    if seen is not None:
        columns["seen"] = "uchar", checked_array(seen, name="seen", shape=(count,), dtype=bool).astype(np.uint8)
    corners = np.empty(count, dtype=[(name, _CODES[kind]) for name, (kind, _) in columns.items()])
    for name, (_, values) in columns.items():
        corners[name] = values
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    places = "".join(f"property {kind} {name}\n" for name, (kind, _) in columns.items())
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment in metres, made by millisight\n"
        f"element vertex {len(corners)}\n{places}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + corners.tobytes() + faces.tobytes())
