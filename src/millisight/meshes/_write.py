"""Write meshes to files."""

import os

import numpy as np

from millisight.core import atomic_path, checked_path, checked_record
from millisight.core.errors import UnknownNameError
from millisight.data import TriangleMesh


def write_mesh(path: str | os.PathLike[str], mesh: TriangleMesh) -> None:
    """Write a mesh as a binary PLY file in metres.

    Raises
    ------
    UnknownNameError
        The suffix is not .ply.
    FileError
        The file cannot be written.
    """
    path, mesh = checked_path(path), checked_record(mesh, TriangleMesh, name="mesh")
    if path.suffix.lower() != ".ply":
        raise UnknownNameError("mesh format", path.suffix or path.name, (".ply",))
    corners = np.empty(len(mesh.vertices), dtype=[(name, "<f8") for name in "xyz"])
    for name, values in zip("xyz", mesh.vertices.T, strict=True):
        corners[name] = values
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    places = "".join(f"property double {name}\n" for name in "xyz")
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment in metres, made by millisight\n"
        f"element vertex {len(corners)}\n{places}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + corners.tobytes() + faces.tobytes())
