"""Meshes from files or from trimesh: read, checked, mended where that is safe, and scaled to metres.

What comes out is fit to simulate: vertices shared, every edge on at most two faces, faces of one part wound alike,
closed parts facing outward. What had to be mended is said in one line on the logger `millisight.meshes._load`.
"""

import io
import logging
import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from millisight.core import check_known, printable
from millisight.core.errors import FileError, MeshError, UnknownNameError
from millisight.data import TriangleMesh, check_mesh_reach
from millisight.meshes._glb import check_glb

if TYPE_CHECKING:
    import trimesh

logger = logging.getLogger(__name__)

FORMATS = ("stl", "obj", "ply", "off", "glb")
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}  # [m]
NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches"}
EVERYDAY = (0.005, 2.0)  # largest extent of an everyday object [m]
_LARGEST_FILE = 1 << 30  # [bytes]; some twenty million triangles, which take many times that in memory
MENDABLE = 0.01  # share of edges on three or more faces: up to here a flaw of a scan, above it another kind of mesh


def load_mesh(
    source: "str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene", *, unit: str | None = None
) -> TriangleMesh:
    """Load a mesh from a file (STL, OBJ, PLY, OFF or GLB) or a trimesh object, in metres.

    Materials and textures are skipped, nothing is fetched from elsewhere, and the parts of a scene are put together
    in their places. Equal vertices become one; repeated faces, and faces with a corner twice, are dropped; a few
    edges on three or more faces, as scans have, are mended. Faces are turned so that each connected part is wound
    consistently, a closed part outward, an open one as most of its faces were.

    Parameters
    ----------
    source : path of a file, or a trimesh.Trimesh or trimesh.Scene
    unit : "m", "cm", "mm" or "in". None takes the unit that the source states (GLB: metres), else metres where
        that makes the mesh 5 mm to 2 m in size

    Raises
    ------
    FileError
        There is no such file, or it cannot be opened.
    UnknownNameError
        The suffix is not that of a mesh format, or `unit` is not known.
    MeshError
        The file cannot be parsed; the mesh is empty, flat to nothing, not finite, or branches; its unit is unclear.
    """
    return _loaded(source, unit, in_table=False)


def mesh_of_table(path: Path, *, unit: str | None) -> TriangleMesh:
    """As `load_mesh`, for a mesh that a table of a TOML file names: errors about its unit name the table's key."""
    return _loaded(path, unit, in_table=True)


def _loaded(source: Any, unit: str | None, *, in_table: bool) -> TriangleMesh:
    if unit is not None:
        check_known("unit of length", unit, UNITS)
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        name, scene = printable(path), _read(path)
    else:
        name, scene = f"the {type(source).__name__}", source
    vertices, faces = _flattened(scene, name)
    scale = UNITS[unit] if unit is not None else _stated(source, scene.units, name, in_table=in_table)
    vertices, faces = _mended(vertices, faces, name)
    return TriangleMesh(vertices=vertices * (scale or _guessed(vertices, name, in_table=in_table)), faces=faces)


def _read(path: Path) -> Any:
    """The trimesh scene in a file."""
    import trimesh

    if not os.path.isfile(path):
        kind = "is a folder" if os.path.isdir(path) else "does not exist"
        raise FileError(f"{printable(path)} {kind}; expected a mesh file ({', '.join(FORMATS)})")
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise UnknownNameError("mesh format", suffix or path.name, FORMATS)
    if (size := path.stat().st_size) > _LARGEST_FILE:
        raise MeshError(
            f"{printable(path)} has {size / 1e9:.1f} GB; expected a mesh of at most {_LARGEST_FILE / 1e9:.1f} GB: "
            "reduce it, since a radar image needs some ten thousand triangles"
        )
    try:
        with open(path, "rb") as file, warnings.catch_warnings(), _silent("trimesh"):
            # An open file and no resolver: whatever else the file names cannot be read or fetched.
            warnings.simplefilter("ignore")
            if suffix == "glb":
                check_glb(path)
            content = _without_materials(file) if suffix == "obj" else file
            scene = trimesh.load_scene(content, file_type=suffix, process=False, skip_materials=True)
            declared = _declared_faces(file) if suffix == "off" else 0
    except OSError as error:
        raise FileError(f"cannot read {printable(path)}: {error.strerror or error}; check its permissions") from error
    except ImportError as error:
        # trimesh looks for a package to guess the encoding: the file is no text, after it was no binary mesh.
        raise MeshError(
            f"{printable(path)} is neither text nor a whole binary {suffix.upper()}; export it again"
        ) from error
    except Exception as error:  # each of trimesh's readers fails in its own way
        raise MeshError(
            f"{printable(path)} cannot be read as {suffix.upper()} "
            f"({type(error).__name__}: {_one_line(error)}): it is truncated, damaged, or of another format; "
            "export it again"
        ) from error
    found = sum(len(getattr(part, "faces", ())) for part in scene.geometry.values())
    if not found or found < declared:
        raise MeshError(
            f"{printable(path)} gives {found} faces{f' of {declared}' if declared else ''}; expected a surface in "
            f"{suffix.upper()} format: it is empty, truncated, or of another format; export it again as triangles"
        )
    return scene


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """For a block, what a library logs is not shown: such as normals, which are not needed, that it cannot read."""
    log = logging.getLogger(name)
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


def _without_materials(file: BinaryIO) -> BinaryIO:
    """An OBJ file without its `usemtl`: trimesh makes a mesh for each material, in time that grows with their square.

    Lines are joined first, as trimesh joins them, and left so that it can join no others.
    """
    from trimesh.util import decode_text

    text = decode_text(file.read()).replace("\r\n", "\n").replace("\\\n", "")
    if "usemtl " not in text:
        file.seek(0)
        return file
    lines = (line.partition("usemtl ")[0].rstrip("\\\r") for line in text.split("\n"))
    return io.BytesIO("\n".join(lines).encode())


def _declared_faces(file: BinaryIO) -> int:
    """The number of faces that the head of an OFF file states: trimesh reads a truncated one without a word."""
    file.seek(0)
    words = b" ".join(line.split(b"#")[0] for line in file.readlines(4096)).split()
    return int(words[2]) if words[0].upper().endswith(b"OFF") else 0


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or "no details"


def _flattened(scene: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) vertices and (F, 3) faces of all meshes of a scene in their places."""
    import trimesh

    if isinstance(scene, trimesh.Trimesh):
        placed = [(np.eye(4), scene)]
    elif isinstance(scene, trimesh.Scene):
        nodes = [scene.graph[node] for node in scene.graph.nodes_geometry]
        placed = [(transform, scene.geometry[key]) for transform, key in nodes]
        placed = [(t, part) for t, part in placed if isinstance(part, trimesh.Trimesh)]
    else:
        raise MeshError(f"source is a {type(scene).__name__}; expected a path, a trimesh.Trimesh or a trimesh.Scene")
    vertices, faces, start = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for transform, part in placed:
        if np.ndim(part.vertices) != 2 or np.shape(part.vertices)[1] != 3:
            raise MeshError(
                f"{name} has vertices {np.shape(part.vertices)}; expected x, y and z of each: export it again"
            )
        corners = np.asarray(part.faces, dtype=np.int64).reshape(-1, 3)
        if len(corners) and (corners.min() < 0 or corners.max() >= len(part.vertices)):
            raise MeshError(
                f"{name} has a face with vertex {corners.max()}, but {len(part.vertices)} vertices: "
                "it is truncated or damaged; export it again"
            )
        with np.errstate(invalid="ignore", over="ignore"):  # infinite vertices are refused later, if a face uses them
            mirrored = np.linalg.det(transform[:3, :3]) < 0
            faces.append(start + (corners[:, ::-1] if mirrored else corners))
            vertices.append(np.asarray(part.vertices, dtype=float) @ transform[:3, :3].T + transform[:3, 3])
        start += len(part.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def _stated(source: Any, units: str | None, name: str, *, in_table: bool) -> float | None:
    """Metres for one unit of the vertices, if the source states it; a .glb always does."""
    import trimesh

    if isinstance(source, str | os.PathLike) and Path(source).suffix.lower() == ".glb":
        return 1.0  # by the specification of glTF 2.0, section 3.4
    if units is None:
        return None
    try:
        return float(trimesh.units.unit_conversion(units, "meters"))
    except (KeyError, ValueError) as error:
        told = _advice(UNITS, in_table=in_table)
        raise MeshError(f"{name} states the unit {units!r}, which is not known; {told}") from error


def _guessed(vertices: np.ndarray, name: str, *, in_table: bool) -> float:
    """Metres for one unit of the vertices: 1 if the mesh then has an everyday size, else an error that guesses."""
    extent = float(np.ptp(vertices, axis=0).max())
    if EVERYDAY[0] <= extent <= EVERYDAY[1]:
        return UNITS["m"]
    fitting = [u for u in ("mm", "cm", "in") if EVERYDAY[0] <= extent * UNITS[u] <= EVERYDAY[1]]
    wide = f"{name} is {_length(extent)} wide when read in metres"
    if not fitting:
        raise MeshError(
            f"{wide}, and no usual unit makes it an everyday object of 5 mm to 2 m; "
            f"{_advice(['m'], in_table=in_table)} to keep it, or scale it first"
        )
    told = _advice([*fitting, "m"], in_table=in_table).capitalize()
    guesses = " or ".join(f"{NAMES[u]} ({_length(extent * UNITS[u])} wide)" for u in fitting)
    raise MeshError(f"{wide}; did you mean {guesses}? {told} to keep it")


def _advice(units: Iterable[str], *, in_table: bool) -> str:
    """How to say that the unit is one of these."""
    *others, last = (f'unit = "{unit}"' if in_table else f"unit={unit!r}" for unit in units)
    said = f"{' or '.join(others)}, or {last}" if others else last
    return f"in its table, write {said}" if in_table else f"pass {said}"


def _length(metres: float) -> str:
    scale, unit = next(((s, u) for s, u in ((1, "m"), (0.01, "cm")) if metres >= s), (0.001, "mm"))
    value = metres / scale
    return f"{value:.0f} {unit}" if 100 <= value < 1e6 else f"{value:.3g} {unit}"


# Mending -------------------------------------------------------------------------------------------------------


def _mended(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Shared vertices, no repeated or branching faces, consistent winding; says in one line what was changed."""
    if not len(faces):
        raise MeshError(f"{name} has {len(vertices)} vertices but no faces; expected a surface: export it as triangles")
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    unfit = int((~np.isfinite(vertices).all(axis=1)).sum())
    if unfit:
        raise MeshError(f"{name} has {unfit} vertices that are NaN or infinite; remove them or export it again")
    check_mesh_reach(vertices, name)
    vertices, faces = _merged(vertices, faces)

    done = []
    a, b, c = faces.T
    sound = (a != b) & (b != c) & (c != a)
    if not sound.any() or not _areas(vertices, faces).any():
        raise MeshError(f"every face of {name} has zero area; expected a surface: check how it was exported")
    faces = faces[sound]
    _note(done, int((~sound).sum()), "dropped {} degenerate face{s}")
    first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    _note(done, len(faces) - len(first), "dropped {} repeated face{s}")
    faces = faces[np.sort(first)]

    faces, removed = _unbranched(vertices, faces, name)
    _note(done, removed, "removed {} face{s} from edges shared by three or more")
    faces, turned = _wound(vertices, faces, name)
    _note(done, turned, "turned {} face{s} to wind all alike and outward")
    if done:
        logger.warning("%s was repaired: %s", name, ", ".join(done))
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def _note(done: list[str], count: int, text: str) -> None:
    if count:
        done.append(text.format(count, s="" if count == 1 else "s"))


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exactly equal vertices made one. STL, and meshes with texture seams, repeat them."""
    order = np.lexsort(vertices.T)
    ordered = vertices[order]
    new = np.r_[True, (ordered[1:] != ordered[:-1]).any(axis=1)]
    index = np.empty(len(vertices), dtype=np.int64)
    index[order] = np.cumsum(new) - 1
    return ordered[new], index[faces]


def _areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _sides(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the sides 0-1, 1-2, 2-0 of each face: (F, 3) the number of its edge; (F, 3) bool, whether it runs from
    the smaller index to the larger; and (E,) how many sides each edge has."""
    start, stop = faces, np.roll(faces, -1, axis=1)
    codes = np.minimum(start, stop) * (int(faces.max()) + 1) + np.maximum(start, stop)
    _, edge, count = np.unique(codes, return_inverse=True, return_counts=True)
    return edge.reshape(-1, 3), start < stop, count


def _unbranched(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, int]:
    """Faces without those that make an edge branch, and how many were removed; an error if over 1 % of edges branch.

    Where three or more faces share an edge, a flap (a face that ends in the open) goes first, then the smallest.
    """
    before = len(faces)
    while True:
        if not len(faces):
            raise MeshError(
                f"no face of {name} is left without those on edges that three or more share; expected at most two "
                "faces on an edge: repair the mesh, for example in Blender or MeshLab ('non-manifold edges')"
            )
        edge, _, count = _sides(faces)
        branching = count > 2
        if not branching.any():
            return faces, before - len(faces)
        if len(faces) == before and branching.mean() > MENDABLE:
            raise MeshError(
                f"{branching.sum()} of {len(count)} edges of {name} are shared by three or more faces; expected at "
                "most two: repair the mesh, for example in Blender or MeshLab ('non-manifold edges')"
            )
        at_fault = branching[edge].any(axis=1)
        flaps = at_fault & (count[edge] == 1).any(axis=1)
        if flaps.any():
            faces = faces[~flaps]
            continue
        candidates = np.flatnonzero(at_fault)
        candidates = candidates[np.argsort(_areas(vertices, faces[candidates]), kind="stable")]
        # The smallest face of each branching edge.
        beside = np.where(branching[edge[candidates]], edge[candidates], -1)
        edges, first = np.unique(beside.ravel(), return_index=True)
        faces = np.delete(faces, candidates[first[edges >= 0] // 3], axis=0)


def _wound(vertices: np.ndarray, faces: np.ndarray, name: str) -> tuple[np.ndarray, int]:
    """Faces turned to agree with their neighbours, closed parts outward, and how many were turned.

    Each face is two nodes of a graph, as it is and turned over. Neighbours that agree link like with like, others
    crosswise. Then one connected component holds a part wound one way, and another holds it wound the other way.
    """
    edge, upward, count = _sides(faces)
    order = np.argsort(edge.ravel(), kind="stable")
    pairs = order[(count == 2)[edge.ravel()[order]]].reshape(-1, 2)
    f, g = (pairs // 3).T
    agree = upward.ravel()[pairs[:, 0]] != upward.ravel()[pairs[:, 1]]
    total = len(faces)
    links = np.concatenate(
        [np.stack([f, np.where(agree, g, g + total)]), np.stack([f + total, np.where(agree, g + total, g)])], axis=1
    )
    graph = coo_array((np.ones(links.shape[1], dtype=np.int8), links), shape=(2 * total, 2 * total))
    labels = connected_components(graph, directed=False)[1]
    as_is, turned = labels[:total], labels[total:]
    if (as_is == turned).any():
        logger.warning("%s has a part with one side only, like a Moebius strip: its winding is left as it is", name)
    flip = as_is > turned
    part = np.unique(np.minimum(as_is, turned), return_inverse=True)[1]

    closed = np.ones(part.max() + 1, dtype=bool)
    closed[part[(count[edge] == 1).any(axis=1)]] = False
    corners = vertices[faces] - vertices.mean(axis=0)
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    volume = np.bincount(part, np.where(flip, -volumes, volumes))
    mostly_flipped = np.bincount(part, np.where(flip, 1, -1)) > 0
    flip ^= np.where(closed & (volume != 0), volume < 0, mostly_flipped)[part]
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())
