"""The published layout's pickles, both ways: processed images, masks, camera frames and masks, raw simulations.

A file becomes a record and `extras`: whatever the record would not give back bit for bit, such as antenna positions
or an array stored as another type. With both, `write_published` writes the same arrays again. Image values are
conjugated at the door: the published ones are of the other phase sign.
"""

import json
import os
import pickle
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import as_array, atomic_path, check_readable, checked_numbers, printable, with_step
from millisight.core.errors import DamagedFileError, FormatError, InputError
from millisight.data import (
    CameraFrame,
    CameraMask,
    Capture,
    Intrinsics,
    Mask,
    Radar,
    SarImage,
    Trajectory,
    VoxelGrid,
)
from millisight.io.arrays import read_pickle
from millisight.io.mito._names import CAMERA_FRAME, CAMERA_MASK, IMAGE, RADAR_MASK, RAW_SIMULATION, kind_of, origin
from millisight.io.mito._setup import SIMULATED_PRESETS, simulated_box

_DEPTH_UNIT = 0.001  # [m] of a step of the published depths


class Published(NamedTuple):
    """A file of the layout: its record, and what else it holds by name."""

    record: Any
    extras: dict[str, Any]


def read_published(path: str | os.PathLike[str]) -> Published:
    """Read a pickle of the published layout; its name tells the kind.

    `processed_image*.pkl` gives a SarImage, `radar_masks*.pkl` a Mask on the pixels of the image beside it,
    `camera_masks*.pkl` a CameraMask, `continuous*.pkl` in a folder `camera` a CameraFrame, and `raw_sim_files*.pkl` in
    a folder `77_ghz` or `24_ghz` a Capture, whose metadata have the grid of the published images (`image_grid`).

    Raises
    ------
    FormatError
        The name is none of these, or the file holds what is not admitted: anything but arrays and plain containers.
    DamagedFileError
        It is truncated, an array is missing or of another shape than expected, or there are NaN in an image.
    FileError
        It cannot be read.
    """
    path = check_readable(path)
    section = "camera" if path.parent.name == "camera" else "radars"
    named = kind_of(section, path.name) or kind_of("simulated", path.name)
    if named is None or path.suffix != ".pkl":
        raise FormatError(
            f"{printable(path)} is not a file of the published layout; expected processed_image*.pkl, "
            "radar_masks*.pkl, raw_sim_files*.pkl, or in a folder camera: camera_masks*.pkl, continuous*.pkl"
        )
    door = _DOORS[named[0]]
    values = _values(path, door.required)
    with _blamed_on(path):
        record = door.read(path, values)
    return Published(record, _extras(path, values, door.values(record)))


def write_published(path: str | os.PathLike[str], record: Any, extras: Mapping[str, Any] | None = None) -> None:
    """Write the pickle from which `read_published` reads this record and these extras.

    Where both hold an array, the extras' is written, since it is the one as stored: leave extras out of a record that
    was changed.

    Raises
    ------
    InputError
        It is no record that the layout has a file for.
    FileError
        The file cannot be written.
    """
    values = next((door.values(record) for door in _DOORS.values() if isinstance(record, door.record)), None)
    if values is None:
        kinds = ", ".join(door.record.__name__ for door in _DOORS.values())
        raise InputError(f"write_published got {type(record).__name__}; expected one of {kinds}")
    for name, value in (extras or {}).items():
        outer, _, inner = name.partition(_NESTED)
        if inner:
            inside = values[outer] if isinstance(values.get(outer), dict) else {}
            values[outer] = {**inside, inner: value}
        else:
            values[outer] = value
    if isinstance(record, SarImage) and isinstance(values["antenna_locs"], dict | list | None):
        values["antenna_locs"] = np.array(values["antenna_locs"], dtype=object)  # as the published files hold them
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        pickle.dump(values, file)


def image_beside(mask: Path) -> Path:
    """The image that a radar mask belongs to: of the same ext, of that without its number, or else the plain one."""
    image = mask.with_name(mask.name.replace("radar_masks", "processed_image", 1))
    unnumbered = image.with_name(_NUMBER.sub("", image.stem) + image.suffix)
    return next((one for one in (image, unnumbered) if one.exists()), mask.with_name("processed_image.pkl"))


def first_turn(extras: Mapping[str, Any]) -> np.ndarray | None:
    """(4,) quaternion x y z w of the robot's tool at a published image's first antenna position; None: it is not told.

    Parameters
    ----------
    extras : of the image, as `read_published` gives them, or of a robot log, as `read_log` does
    """
    for name in _TURNS:
        table = extras.get(name)
        if not isinstance(table, np.ndarray) or table.dtype.kind != "f" or table.shape[1:] not in ((4,), (7,)):
            continue
        if len(table) and np.linalg.norm(table[0, -4:]) > 0.5:  # NaN is not
            return table[0, -4:]
    return None


# Of the scan, see `SarImage.steps`; published files have none.
_STEPS = "steps"
_NUMBER = re.compile(r"_\d+$")
# Where a tool's turns stand: in tables x, y, z, quaternion, and as quaternions in a log of ours.
_TURNS = ("antenna_locs", "antenna_locs.tx_77_locs", "antenna_locs.tx_24_locs", "orientations")

# Of a dictionary within the file each entry is an extra of its own, under both names with this between them.
_NESTED = "."


def _extras(path: Path, values: dict[str, Any], given_back: dict[str, Any]) -> dict[str, Any]:
    """What of the file's `values` the record does not give back as it is stored."""
    extras: dict[str, Any] = {}
    for name, value in values.items():
        value = _unwrapped(value)
        parts = {_named(path, name): value}
        if isinstance(value, dict) and value:
            parts = {f"{name}{_NESTED}{_named(path, inner)}": item for inner, item in value.items()}
        elif _same(value, given_back.get(name)):
            continue
        extras |= {name: _plain(path, name, part) for name, part in parts.items()}
    return extras


def _unwrapped(value: Any) -> Any:
    """An array of objects as what it holds: a value, or lists of None."""
    return value.tolist() if isinstance(value, np.ndarray) and value.dtype == object else value


def _named(path: Path, name: Any) -> str:
    if not isinstance(name, str) or not name or set(name) & {_NESTED, "/", "\0"} or printable(name) != name:
        raise FormatError(f"{printable(path)} has the key {name!r}; expected a name without . and /")
    return name


def _plain(path: Path, name: str, value: Any) -> Any:
    """`value` where it is an array of numbers, or what JSON gives back as it is."""
    value = _unwrapped(value)
    try:
        if not isinstance(value, np.ndarray | np.generic) and json.loads(json.dumps(value, allow_nan=False)) == value:
            return value
    except (TypeError, ValueError, RecursionError):
        pass
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufc":
            return array
    except ValueError:  # lists of differing lengths
        pass
    raise FormatError(f"{printable(path)}: {name} is of type {type(value).__name__}; expected an array of numbers")


def _same(a: Any, b: Any) -> bool:
    """Whether two values are equal to the last bit, as arrays of one type."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        # Bytes, not numbers: NaN equal themselves, and zeros of either sign differ.
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return a is None and b is None


def _values(path: Path, required: tuple[str, ...]) -> dict[str, Any]:
    values = read_pickle(path)
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise FormatError(f"{printable(path)} holds {_what(values)}; expected a dictionary with {', '.join(required)}")
    missing = [name for name in required if name not in values]
    if missing:
        found = ", ".join(map(repr, values)) or "nothing"
        raise DamagedFileError(f"{printable(path)} has no {missing[0]!r} but {found}; expected {', '.join(required)}")
    return values


def _what(value: Any) -> str:
    return "a dictionary with other keys than texts" if isinstance(value, dict) else f"a {type(value).__name__}"


def _array(values: dict[str, Any], name: str, kinds: str) -> np.ndarray:
    """An array of the file, its numbers of one of NumPy's `kinds`."""
    try:
        array = np.asarray(values[name])
    except ValueError as error:  # lists of differing lengths
        raise InputError(f"{name} is not an array: {error}") from error
    if array.dtype.kind not in kinds:
        raise InputError(f"{name} is an array of {array.dtype}; expected {' or '.join(_KINDS[k] for k in kinds)}")
    return array


_KINDS = {"b": "bool", "u": "unsigned", "i": "whole", "f": "real", "c": "complex numbers"}


def _without_first(array: np.ndarray, ndim: int) -> np.ndarray:
    """The one picture of an array that may have a first axis of length one before its `ndim`."""
    return array[0] if array.ndim == ndim + 1 and len(array) == 1 else array


@contextmanager
def _blamed_on(path: Path) -> Iterator[None]:
    """An array that no record takes is the file's fault."""
    try:
        yield
    except InputError as error:
        raise DamagedFileError(f"{printable(path)}: {error}") from error


def _read_image(path: Path, values: dict[str, Any]) -> SarImage:
    axes = {name: _array(values, f"{name}_locs", "iuf") for name in "xyz"}
    published = _array(values, "image", "c")
    told: dict[str, Any] = {"file": origin(path), "conjugated": True}
    if values.get(_STEPS) is not None:  # by an image of ours
        steps = _array(values, _STEPS, "f")
        told["steps"] = checked_numbers(steps, name=_STEPS, count=1 if steps.size == 1 else 2, unit="m", minimum=0)
    return SarImage(grid=VoxelGrid(**axes), values=np.conj(published), metadata=with_step({}, "read_published", **told))


def _image_values(image: SarImage) -> dict[str, Any]:
    grid = image.grid
    locs = {"x_locs": grid.x, "y_locs": grid.y, "z_locs": grid.z}
    steps = {_STEPS: np.array(image.steps)} if image.steps else {}
    return {"image": np.conj(image.values), **locs, "antenna_locs": None, **steps}


def _read_radar_mask(path: Path, values: dict[str, Any]) -> Mask:
    inside = _without_first(_array(values, "radar_mask", "biuf"), 2)
    grid: VoxelGrid = read_published(image_beside(path)).record.grid
    return Mask(grid_xy=grid.xy, inside=inside != 0)


def _read_simulation(path: Path, values: dict[str, Any]) -> Capture:
    """Of (P, N) channels at (P, 3) positions: the preset's frequencies, as many as there are samples."""
    if path.parent.name not in SIMULATED_PRESETS:
        raise InputError(
            f"the folder is {printable(path.parent.name)}; expected 77_ghz or 24_ghz, which name the radar"
        )
    channels = _array(values, "channels", "c")
    positions = _array(values, "radar_shifted_locs", "iuf")
    frames = channels.reshape(len(channels), -1) if channels.ndim == 3 and 1 in channels.shape[1:] else channels
    as_array(frames, name="channels", shape=("P", "N"), dtype=frames.dtype)
    preset = Radar.preset(SIMULATED_PRESETS[path.parent.name])
    waveform = replace(preset.waveform, samples_per_chirp=frames.shape[1])
    metadata = {"image_grid": simulated_box(float(positions[:, 0].max()))} if positions.ndim == 2 else {}
    return Capture(
        radar=replace(preset, waveform=waveform),
        trajectory=Trajectory(times=np.arange(len(frames), dtype=float), positions=positions),
        frames=np.conj(frames)[:, None, None].astype(np.complex64),
        metadata=with_step(metadata, "read_published", file=origin(path), conjugated=True),
    )


def _read_camera_frame(path: Path, values: dict[str, Any]) -> CameraFrame:
    return CameraFrame(
        rgb=_without_first(_array(values, "rgb", "uif"), 3),
        depth=_without_first(_array(values, "depth", "uif"), 2),
        pose=_pose(values),
        intrinsics=Intrinsics.published(),
        depth_unit=_DEPTH_UNIT,
        metadata=with_step({}, "read_published", file=origin(path)),
    )


def _read_camera_mask(path: Path, values: dict[str, Any]) -> CameraMask:
    return CameraMask(
        pixels=_without_first(_array(values, "rgbd_mask", "biuf"), 2) != 0,
        depth=_without_first(_array(values, "masked_depth", "uif"), 2),
        points=_without_first(_array(values, "masked_xyz", "uif"), 3),
        pose=_pose(values),
        depth_unit=_DEPTH_UNIT,
        metadata=with_step({}, "read_published", file=origin(path)),
    )


def _pose(values: dict[str, Any]) -> np.ndarray:
    pose = _array(values, "pose", "iuf")
    return pose.reshape(4, 4) if pose.shape == (16,) else pose


class _Door(NamedTuple):
    """How a kind of file becomes a record, and what of the file the record gives back."""

    record: type
    required: tuple[str, ...]
    read: Callable[[Path, dict[str, Any]], Any]
    values: Callable[[Any], dict[str, Any]]


_DOORS = {
    IMAGE: _Door(SarImage, ("image", "x_locs", "y_locs", "z_locs"), _read_image, _image_values),
    RADAR_MASK: _Door(Mask, ("radar_mask",), _read_radar_mask, lambda mask: {"radar_mask": mask.inside}),
    RAW_SIMULATION: _Door(
        Capture,
        ("channels", "radar_shifted_locs"),
        _read_simulation,
        lambda capture: {
            "channels": np.conj(capture.frames_of(slice(None))[:, 0, 0]),
            "radar_shifted_locs": capture.trajectory.positions,
        },
    ),
    CAMERA_FRAME: _Door(
        CameraFrame,
        ("rgb", "depth", "pose"),
        _read_camera_frame,
        lambda frame: {"rgb": frame.rgb, "depth": frame.depth, "pose": frame.pose},
    ),
    CAMERA_MASK: _Door(
        CameraMask,
        ("rgbd_mask", "masked_depth", "pose", "masked_xyz"),
        _read_camera_mask,
        lambda mask: {
            "rgbd_mask": mask.pixels[None],
            "masked_depth": mask.depth,
            "pose": mask.pose,
            "masked_xyz": mask.points,
        },
    ),
}
