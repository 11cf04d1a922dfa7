"""What files hold for the viewer: images, and what belongs around each of them."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import check_readable, checked_numbers, checked_record, printable, put, record
from millisight.core.errors import DamagedFileError, FileError, FormatError, InputError
from millisight.data import (
    Capture,
    Mask,
    PointCloud,
    SarImage,
    Scene,
    SceneObject,
    Surface,
    Trajectory,
    TriangleMesh,
    VolumeMask,
    VoxelGrid,
)
from millisight.io import holds_points, load, load_extras, mito, open_capture, open_image, provenance, read_point_cloud
from millisight.meshes import FORMATS, load_mesh
from millisight.viz import grid_box
from millisight.viz.viewer._cover import MOST_SEARCHED, Cover, cover_of
from millisight.viz.viewer._levels import MOST_VOXELS, Levels, levels_of, mixed_levels
from millisight.viz.viewer._titles import titles_of

_LARGEST_PICKLE = 1 << 30  # [bytes]: a pickle can only be read whole
_SAME = 1e-3  # between the boxes of a mesh and of the scene that was simulated of it [m]
_HDF5 = b"\x89HDF\r\n\x1a\n"
_SHOWN = "SarImage, Mask, VolumeMask, Capture, Trajectory, TriangleMesh, Surface, SceneObject, Scene and PointCloud"
_MODELS = {"_specular": "specular", "_edges": "edge"}


@record
class Exhibit:
    """One thing to look at: an image and what is around it, or what is around alone."""

    title: str
    levels: Levels | None  # of the image as it is shown first
    pair: tuple[SarImage, SarImage] | None = None  # specular and edge, which the viewer weighs anew
    share: float = 0.0  # of the edge image in `levels`, a2 / (a1 + a2)
    masks: tuple[Mask, ...] = ()
    meshes: tuple[TriangleMesh, ...] = ()  # in the image's frame, as the masks
    paths: tuple[np.ndarray, ...] = ()  # (P, 3) each, positions of the radar [m]
    points: tuple[PointCloud, ...] = ()
    cover: Cover | None = None  # what lies over the object in the image, such as a lid

    def __post_init__(self) -> None:
        checked_record(self.title, str, name="title")
        put(self, masks=tuple(self.masks), meshes=tuple(self.meshes), paths=tuple(self.paths))
        put(self, points=tuple(self.points))
        if self.levels is None and not self.meshes and not self.paths and not self.points:
            raise InputError("an exhibit without image, mesh, points and path; expected at least one of them")

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) the box of the image, or else of what is around it [m]."""
        if self.levels is not None:
            return grid_box(self.levels.grid)
        boxes = [mesh.bounds for mesh in self.meshes]
        boxes += [np.array([path.min(axis=0), path.max(axis=0)]) for path in self.paths]
        boxes += [np.array([p.points.min(axis=0), p.points.max(axis=0)]) for p in self.points if len(p)]
        return np.array([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])


class Contents(NamedTuple):
    """What to show, and what there is to say about the files."""

    exhibits: tuple[Exhibit, ...]
    notes: tuple[str, ...]


class _Image(NamedTuple):
    path: Path
    grid: VoxelGrid
    metadata: Mapping[str, Any]
    image: SarImage | None  # None: too large, its levels alone were read
    levels: Levels | None  # None: not yet asked for
    path_beside: np.ndarray | None  # positions of the radar that its file holds


class _Found(NamedTuple):
    images: list[_Image]
    masks: list[tuple[Path, Mask]]
    meshes: list[TriangleMesh]  # in the world frame
    mesh_files: list[Path]
    paths: list[tuple[np.ndarray, Mapping[str, Any]]]  # positions, and the metadata of their capture
    points: list[PointCloud]


def gather(
    shown: Sequence[Any],
    *,
    combine: bool = True,
    alpha: tuple[float, float] = (0.5, 0.5),
    unit: str | None = None,
    clutter: str = "auto",
) -> Contents:
    """Take records and read files for the viewer, and group those that belong together.

    Images in HDF5 that have more than 32 million voxels are read in slabs and looked at in blocks. A mask goes over
    the image in its folder, or else over every image with its pixels. A capture goes around the images made of it, or
    else around all. A mesh of a file stands where the image's metadata say that it was simulated, unless it is
    there already.

    Parameters
    ----------
    shown : records: images, captures, trajectories, masks, meshes, scenes; and paths of files: such records in HDF5,
        images and masks as pickles of the published layout, mesh files
    combine : make one exhibit of the specular and the edge image of a simulation
    alpha : their weights at first (paper Eq. 8)
    unit : of mesh files whose unit is not clear
    clutter : "auto", "lid": look for lids over the objects, as `remove_sheets` does; "none": do not

    Raises
    ------
    FileError, FormatError, DamagedFileError, MeshError
        A file cannot be read, or holds nothing to look at.
    InputError
        Nothing was given, or a record that has no place in the viewer, or the weights cannot be right.
    """
    a1, a2 = checked_numbers(alpha, name="alpha", count=2, minimum=0)
    if not a1 + a2 > 0:
        raise InputError("alpha is (0, 0); expected at least one weight above zero")
    share = a2 / (a1 + a2)
    found = _Found([], [], [], [], [], [])
    for number, one in enumerate(shown, start=1):
        if isinstance(one, str | os.PathLike):
            _read(check_readable(one), found)
        elif not _add(Path(f"{type(one).__name__} {number}"), one, found):
            raise InputError(f"the viewer got {type(one).__name__}; expected {_SHOWN}, or a file's path")
    if not shown:
        raise InputError("nothing to show; expected at least one record or file")
    notes: list[str] = []
    groups = _pairs(found.images) if combine else [(image,) for image in found.images]
    masks = _masks_of(found, notes)
    titles = iter(titles_of([group[0].path for group in groups], [len(group) == 2 for group in groups]))
    exhibits = []
    for group in groups:
        first = group[0]
        images = [one.image for one in group if one.image is not None]
        pair = (images[0], images[1]) if len(group) == 2 else None
        exhibits.append(
            Exhibit(
                title=next(titles),
                levels=mixed_levels(*pair, share) if pair else first.levels or levels_of(first.grid, images[0].values),
                pair=pair,
                share=share if pair else 0.0,
                masks=tuple(masks.get(first.path, ())),
                meshes=(*found.meshes, *(_placed(path, first.metadata, unit) for path in found.mesh_files)),
                paths=_paths_of(first, found),
                points=tuple(found.points),
                cover=None if pair or first.image is None else cover_of(first.image, clutter, low_band=_is_low(first)),
            )
        )
    for exhibit in exhibits:
        if exhibit.levels is not None and exhibit.levels.grid.size > MOST_SEARCHED and clutter == "auto":
            notes.append(f"{exhibit.title} is large: no lid was looked for; --clutter lid does")
        if exhibit.levels is not None and exhibit.levels.peak == 0:
            notes.append(f"{exhibit.title} is 0 everywhere: there is nothing to show")
    if not exhibits:
        if not found.meshes and not found.mesh_files and not found.paths and not found.points:
            raise InputError("only masks were given; pass the images that they belong to as well")
        meshes = (*found.meshes, *(_placed(path, {}, unit) for path in found.mesh_files))
        names = [Path(one).name if isinstance(one, str | os.PathLike) else type(one).__name__ for one in shown]
        title = " + ".join(map(printable, names))
        paths = tuple(path for path, _ in found.paths)
        exhibits = [Exhibit(title=title, levels=None, meshes=meshes, paths=paths, points=tuple(found.points))]
    for image, exhibit in zip((g[0] for g in groups), exhibits, strict=False):
        if exhibit.levels is not None and exhibit.levels.block != (1, 1, 1):
            whole, block = " x ".join(map(str, image.grid.shape)), " x ".join(map(str, exhibit.levels.block))
            notes.append(
                f"{printable(image.path.name)} has {whole} voxels: read in slabs, and the strongest of each {block} "
                "voxels is shown"
            )
    return Contents(tuple(exhibits), tuple(notes))


# Reading ---------------------------------------------------------------------------------------------------------


def _read(path: Path, found: _Found) -> None:
    """Put what a file holds where it belongs in `found`."""
    with open(path, "rb") as file:
        start = file.read(8)
    if start == _HDF5:
        _read_hdf5(path, found)
    elif path.suffix == ".pkl":
        _read_pickle(path, found)
    elif path.suffix.lower() == ".ply" and holds_points(path):
        found.points.append(read_point_cloud(path))
    elif path.suffix.lower().removeprefix(".") in FORMATS:
        found.mesh_files.append(path)
    else:
        raise FormatError(
            f"{printable(path)} cannot be shown (it starts with {start!r}); expected an image, "
            "capture, mask, mesh or scene that millisight wrote (HDF5), processed_image*.pkl or radar_masks*.pkl of "
            f"the published dataset, or a mesh file ({', '.join(FORMATS)})"
        )


def _read_hdf5(path: Path, found: _Found) -> None:
    kind = provenance(path)["record"]
    if kind == "Capture":
        with open_capture(path) as capture:
            _add(path, capture, found)
    elif kind == "SarImage":
        found.images.append(_hdf5_image(path))
    elif not _add(path, load(path), found):
        raise FormatError(f"{printable(path)} holds a {kind}; the viewer shows {_SHOWN}")


def _add(path: Path, record: Any, found: _Found) -> bool:
    """Put a record where it belongs in `found`; False: it belongs nowhere. `path` names it, whether a file or not."""
    if isinstance(record, SarImage):
        found.images.append(_Image(path, record.grid, record.metadata, record, None, None))
    elif isinstance(record, Mask):
        found.masks.append((path, record))
    elif isinstance(record, Capture):
        found.paths.append((record.trajectory.positions, record.metadata))
    elif isinstance(record, Trajectory):
        found.paths.append((record.positions, {}))
    elif isinstance(record, TriangleMesh):
        found.meshes.append(record)
    elif isinstance(record, VolumeMask):
        found.meshes.append(record.surface())
    elif isinstance(record, Surface | Scene | SceneObject):
        found.meshes.append(record.mesh)
    elif isinstance(record, PointCloud):
        found.points.append(record)
    else:
        return False
    return True


def _hdf5_image(path: Path) -> _Image:
    """An image; of one with too many voxels for memory the levels, read in slabs."""
    with open_image(path) as (grid, values):
        if values.size > MOST_VOXELS:
            try:
                levels = levels_of(grid, values, most=MOST_VOXELS)
            except FileError:
                raise
            except (OSError, TypeError, ValueError) as error:
                reason = " ".join(str(error).split())
                raise DamagedFileError(f"{printable(path)} is damaged: {reason}; make or copy it again") from error
            return _Image(path, grid, {}, None, levels, None)
    image = load(path)
    positions = _antennas(load_extras(path)) if mito.kind_of("radars", path.name) else None
    return _Image(path, image.grid, image.metadata, image, None, positions)


def _read_pickle(path: Path, found: _Found) -> None:
    size = os.path.getsize(path)
    if size > _LARGEST_PICKLE:
        raise FileError(
            f"{printable(path)} has {size / 1e9:.1f} GB; a pickle must be read whole, and is shown up to 1 GB: convert "
            "it with `millisight dataset convert` and pass the HDF5 file, which is read in slabs"
        )
    published = mito.read_published(path)
    if isinstance(published.record, SarImage):
        image = published.record
        found.images.append(_Image(path, image.grid, image.metadata, image, None, _antennas(published.extras)))
    elif not _add(path, published.record, found):
        raise FormatError(
            f"{printable(path)} holds a {type(published.record).__name__}; of the published dataset the viewer shows "
            "processed_image*.pkl and radar_masks*.pkl"
        )


def _antennas(extras: Mapping[str, Any]) -> np.ndarray | None:
    """(P, 3) where a published image's file says that the antennas were [m], in the image's frame."""
    for name, table in extras.items():
        shape = getattr(table, "shape", ())
        if not name.startswith("antenna_locs") or len(shape) != 2 or shape[0] < 2 or shape[1] not in (3, 7):
            continue
        positions = np.asarray(table[:, :3], dtype=float)
        if np.isfinite(positions).all():
            return positions if name == "antenna_locs" else positions - mito.BASE_ORIGIN
    return None


# What belongs to what ----------------------------------------------------------------------------------------------


def _model(image: _Image) -> str | None:
    """ "specular" or "edge", where it is the image of one of the two and nothing else."""
    history = image.metadata.get("history", ())
    if any(step.get("step") == "combine" for step in history):
        return None
    stated = [step.get("model") for step in history if step.get("step") == "simulate"]
    if stated:
        return stated[-1] if stated[-1] in ("specular", "edge") else None
    kind = mito.kind_of("radars", image.path.name)
    return _MODELS.get(kind[1]) if kind else None


def _is_low(image: _Image) -> bool:
    """Whether it is of 24 GHz, by its place in the published layout or where it says that it was made from."""
    return "24_ghz" in (*image.path.resolve().parts, *str(image.metadata.get("source", "")).split("/"))


def _stem(image: _Image) -> tuple[Path, str]:
    """The folder, and the file's name less the word for the model."""
    name = image.path.name.lower()
    for word in ("specular", "edges", "edge"):
        name = name.replace(word, "")
    return image.path.resolve().parent, name


def _pairs(images: list[_Image]) -> list[tuple[_Image, ...]]:
    """Specular and edge images of one simulation together, everything else alone, in the order given."""
    left, groups = list(images), []
    while left:
        image = left.pop(0)
        model = _model(image)
        fitting = [o for o in left if {model, _model(o)} == {"specular", "edge"} and _same_run(image, o)]
        fitting = [other for other in fitting if _stem(other) == _stem(image)] or (fitting if len(fitting) == 1 else [])
        if fitting:
            left = [other for other in left if other is not fitting[0]]
            groups.append((image, fitting[0]) if model == "specular" else (fitting[0], image))
        else:
            groups.append((image,))
    return groups


def _same_run(a: _Image, b: _Image) -> bool:
    """Whether two images are in memory, on one grid and, where they tell, of one scene."""
    if a.image is None or b.image is None:
        return False
    same_grid = all(np.array_equal(getattr(a.grid, name), getattr(b.grid, name)) for name in "xyz")
    return same_grid and a.metadata.get("scene_bounds") == b.metadata.get("scene_bounds")


def _masks_of(found: _Found, notes: list[str]) -> dict[Path, list[Mask]]:
    """The masks over each image, by its path."""
    over: dict[Path, list[Mask]] = {}
    for path, mask in found.masks:
        grid = mask.grid_xy
        fitting = [i for i in found.images if np.array_equal(i.grid.x, grid.x) and np.array_equal(i.grid.y, grid.y)]
        near = [image for image in fitting if image.path.resolve().parent == path.resolve().parent]
        for image in near or fitting:
            over.setdefault(image.path, []).append(mask)
        if not fitting:
            notes.append(f"{printable(path.name)} is left out: no given image has the same grid of pixels")
    return over


def _paths_of(image: _Image, found: _Found) -> tuple[np.ndarray, ...]:
    """The radar's paths that belong to an image, and its file's own."""
    own = () if image.path_beside is None else (image.path_beside,)
    return (*(path for path, metadata in found.paths if _belongs(image, metadata, found.images)), *own)


def _belongs(image: _Image, capture: Mapping[str, Any], images: list[_Image]) -> bool:
    """Whether an image was made of a capture, or no image was, or the capture does not tell."""
    made = [other for other in images if capture and _made_of(other.metadata, capture)]
    return not made or any(other is image for other in made)


def _made_of(image: Mapping[str, Any], capture: Mapping[str, Any]) -> bool:
    """Whether an image's metadata continue those of a capture."""
    done = list(capture.get("history", ()))
    plain = all(image.get(key) == value for key, value in capture.items() if key != "history")
    return plain and list(image.get("history", ()))[: len(done)] == done


def _placed(path: Path, metadata: Mapping[str, Any], unit: str | None) -> TriangleMesh:
    """The mesh of a file, where `millisight simulate` put it if the image says so, or else as the file has it.

    A mesh that millisight wrote, such as a surface that was seen, is there already unless it is the simulated one.
    """
    placed, ours = metadata.get("placed"), _is_ours(path)
    if not isinstance(placed, Mapping):
        return load_mesh(path, unit=unit)
    unit = unit or ("m" if ours else placed.get("unit"))
    turned = placed.get("rotate_deg", (0.0, 0.0, 0.0))
    own = load_mesh(path, unit=unit)
    moved = Scene.from_mesh(own, vertices=None, rotate_deg=turned).mesh
    scene: Any = metadata.get("scene_bounds", ())
    if np.shape(scene) != (2, 3):
        return own if ours else moved
    far, near = (np.abs(mesh.bounds - np.asarray(scene, dtype=float)).max() for mesh in (own, moved))
    return own if far <= near or (ours and near > _SAME) else moved


def _is_ours(path: Path) -> bool:
    """Whether a PLY file says that millisight wrote it, in metres."""
    with open(path, "rb") as file:
        return b"comment in metres, made by millisight\n" in file.read(200)
