"""What a GLB file asks for, counted before a mesh is made of it.

A file of a few hundred bytes may claim a billion vertices that nothing stores, or place one mesh a hundred thousand
times. glTF 2.0, sections 3.6 (accessors) and 3.5 (nodes), says what is counted.
"""

import json
from pathlib import Path
from typing import Any

from millisight.core import Limits, limits_of

_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # by componentType
_WORK = 4  # times the memory that a mesh takes while it is mended, against what other readers make of a file


def check_glb(path: Path) -> None:
    """Raise a ValueError where the meshes of a GLB file, each as often as it is placed, are too large for the file.

    What is no GLB file passes: whoever reads it says what it is.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        head = file.read(20)
        length = int.from_bytes(head[12:16], "little")
        if head[:4] != b"glTF" or head[16:20] != b"JSON" or length > size:
            return
        try:
            content = json.loads(file.read(length))
        except (ValueError, RecursionError) as error:
            raise ValueError(f"its description is no JSON: {error}") from error
    try:
        asked = _asked(content, limits_of(size))
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"its description cannot be followed: {type(error).__name__}: {error}") from error
    most = limits_of(size).content // _WORK
    if asked > most:
        raise ValueError(f"its meshes take {asked} bytes, each as often as it is placed; expected at most {most}")


def _asked(content: dict[str, Any], limits: Limits) -> int:
    """Bytes of all arrays: those of meshes for each node that places one, others once."""
    arrays = [
        int(one["count"]) * _COMPONENTS[one["type"]] * _BYTES[one["componentType"]]
        for one in content.get("accessors", ())
    ]
    meshes = []
    for mesh in content.get("meshes", ()):
        parts = mesh["primitives"]
        indices = [part["indices"] for part in parts if "indices" in part]
        meshes.append(
            sum(arrays[i] for part in parts for i in part["attributes"].values()) + sum(arrays[i] for i in indices)
        )
    nodes = content.get("nodes", [])
    _check_depth(nodes, limits.depth)
    placed = sum(meshes[node["mesh"]] for node in nodes if "mesh" in node)
    return max(placed, sum(meshes), sum(arrays))


def _check_depth(nodes: list[dict[str, Any]], most: int) -> None:
    """Raise a ValueError where nodes hang below nodes too deep, or in a circle."""
    below = {child for node in nodes for child in node.get("children", ())}
    level, depth, seen = [i for i in range(len(nodes)) if i not in below], 0, 0
    while level:
        seen, depth = seen + len(level), depth + 1
        if depth > most or seen > len(nodes):
            raise ValueError(f"its nodes hang more than {most} deep, or one of them below two others")
        level = [child for i in level for child in nodes[i].get("children", ())]
    if seen < len(nodes):
        raise ValueError("its nodes hang below each other in a circle")
