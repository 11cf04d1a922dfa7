"""Images larger than memory: slabs along x, each kept in a file until the last is done.

Voxels do not depend on each other, so an image is formed a slab at a time, each by `form_image` with a plan of its own.
What is done is kept beside the image: an interrupted run goes on where it stopped.
"""

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_record_suffix, check_writable, checked_number, make_folder, printable, share_of
from millisight.core.errors import DamagedFileError, InputError
from millisight.data import Capture, SarImage, VoxelGrid
from millisight.imaging._form import form_image

PROGRAM_BYTES = 600_000_000
"""Of the program, its libraries and blocks of frames."""
PROFILE_BYTES = 1_000_000_000
"""Of range profiles at a time, at most."""
VOXEL_BYTES = 96
"""Of a voxel while its slab is formed: the image in parts and whole, and its places by direct backprojection."""

_BLOCK = 1 << 26  # of frames that are read at once to tell one capture from another [bytes]


def memory_needed(capture: Capture, grid: VoxelGrid) -> float:
    """About how much memory the image on a grid takes to form, all at once [bytes]."""
    return _fixed(capture) + VOXEL_BYTES * grid.size


def image_slabs(capture: Capture, grid: VoxelGrid, *, memory: float) -> tuple[slice, ...]:
    """Along x, the slabs of an image that each fit into `memory` [bytes], of equal thickness but for a voxel.

    Raises
    ------
    InputError
        Not even a slab one voxel thick fits.
    """
    memory = checked_number(memory, name="memory", unit="bytes", above=0)
    one = VOXEL_BYTES * len(grid.y) * len(grid.z)
    thickest = int((memory - _fixed(capture)) // one)
    if thickest < 1:
        raise InputError(
            f"memory is {memory / 1e9:.2f} GB; expected at least {(_fixed(capture) + one) / 1e9:.2f} GB for one layer "
            f"of {len(grid.y)} x {len(grid.z)} voxels: allow more, or ask for fewer voxels along y and z"
        )
    count = -(-len(grid.x) // thickest)
    edges = np.linspace(0, len(grid.x), count + 1).round().astype(int)
    return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))


def form_image_to(
    path: str | os.PathLike[str],
    capture: Capture,
    grid: VoxelGrid,
    *,
    memory: float,
    asked: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> tuple[float, np.ndarray]:
    """Form an image that may be larger than memory, and write it to an HDF5 file, which `ms.load` reads.

    Slabs that are done are kept in the folder `path` + ".slabs" until the image is whole; a later call for the same
    image goes on with them. It takes twice the image's size on disk meanwhile.

    Parameters
    ----------
    path : of the image
    capture : frames in memory, or on disk (`ms.open_capture`)
    grid : voxels of the image, in the world frame
    memory : that may be used in all [bytes]; an estimate, which was 1.1 to 2 times what was measured
    asked : added to the image's metadata
    progress : called with (work done, work in all)
    settings : of `form_image`: `method`, `window`, `tolerance`, `device`

    Returns
    -------
    tuple
        Magnitude of the brightest voxel, and its centre (3,) [m].

    Raises
    ------
    InputError
        The memory does not suffice for one layer of voxels, or as `form_image`.
    UnknownNameError, FileError
        The name has another format's suffix, or cannot be written.
    """
    from millisight.io import save, save_image

    check_record_suffix(path)
    slabs = image_slabs(capture, grid, memory=memory)
    check_writable(path)
    path = Path(path)
    folder = make_folder(path.with_name(path.name + ".slabs"))
    image_of = _digest(capture, grid, slabs, settings)
    files, whole = [folder / f"{number}.h5" for number in range(len(slabs))], _Whole()
    for number, (slab, file) in enumerate(zip(slabs, files, strict=True)):
        formed = _kept(file, image_of)
        if formed is None:
            part = VoxelGrid(x=grid.x[slab], y=grid.y, z=grid.z)
            formed = form_image(capture, part, progress=share_of(progress, number, len(slabs)), **settings)
            save(file, formed, extras={"image_of": image_of})
        whole.add(formed)
        del formed  # before the next one is formed
    history = [*whole.history[:-1], {**whole.history[-1], "slabs": len(slabs)}]
    metadata = {**capture.metadata, "history": history, **({} if asked is None else {"asked": dict(asked)})}
    save_image(path, grid, _Values(files, slabs, grid.shape, image_of), metadata)
    for file in folder.iterdir():
        if file.suffix == ".h5" and file.stem.isdecimal():  # also of slabs that were cut otherwise
            file.unlink()
    with suppress(OSError):  # somebody keeps other files there
        folder.rmdir()
    return whole.peak, whole.place


class _Whole:
    """What is told of an image, slab after slab: its history as of the first, with the largest error of all."""

    def __init__(self) -> None:
        self.peak, self.place, self.history = -1.0, np.zeros(3), []

    def add(self, slab: SarImage) -> None:
        history = [dict(one) for one in slab.metadata["history"]]
        known = self.history[-1].get("error") if self.history else None
        self.history = self.history or history
        if known is not None:
            self.history[-1]["error"] = max(known, history[-1]["error"])
        magnitude = slab.magnitude
        if magnitude.max() > self.peak:
            self.peak, self.place = float(magnitude.max()), slab.peak


class _Values:
    """The values of an image in slabs on disk, as an array that is read along x; one slab is in memory at a time."""

    def __init__(self, files: Sequence[Path], slabs: Sequence[slice], shape: tuple[int, ...], image_of: str):
        self._files, self._slabs, self._image_of = files, slabs, image_of
        self.shape, self.dtype, self.size = shape, np.dtype(np.complex64), int(np.prod(shape))
        self._held: tuple[int, np.ndarray] = (-1, np.zeros(0))

    def __getitem__(self, rows: slice) -> np.ndarray:
        start, stop, _ = rows.indices(self.shape[0])
        parts = []
        for number, slab in enumerate(self._slabs):
            low, high = max(start, slab.start), min(stop, slab.stop)
            if low < high:
                parts.append(self._slab(number)[low - slab.start : high - slab.start])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _slab(self, number: int) -> np.ndarray:
        if self._held[0] != number:
            image = _kept(self._files[number], self._image_of)
            if image is None:
                raise DamagedFileError(f"{printable(self._files[number])} was changed meanwhile; run the same again")
            self._held = number, image.values
        return self._held[1]


def _kept(file: Path, image_of: str) -> SarImage | None:
    """The slab in a file, where it is whole and of this image."""
    from millisight.io import load, load_extras

    try:
        return load(file, SarImage) if file.exists() and load_extras(file).get("image_of") == image_of else None
    except DamagedFileError:
        return None


def _fixed(capture: Capture) -> float:
    """What does not grow with the image [bytes]: the program, range profiles, positions."""
    poses, transmitters, receivers, samples = capture.frames.shape
    profiles = min(PROFILE_BYTES, 8.0 * 4 * samples * poses * transmitters * receivers)
    return PROGRAM_BYTES + profiles + 200.0 * poses * (transmitters + receivers)


def _digest(capture: Capture, grid: VoxelGrid, slabs: Sequence[slice], settings: Mapping[str, Any]) -> str:
    """What an image is made of, as text: the frames, the antennas' places, the voxels, the settings."""
    found = hashlib.sha256()
    poses, values = len(capture.trajectory), 8 * int(np.prod(capture.frames_of(slice(0, 1)).shape))
    some = max(1, _BLOCK // values)
    for start in range(0, poses, some):  # a gigabyte a second; forming an image of one takes minutes
        found.update(np.ascontiguousarray(capture.frames_of(slice(start, start + some))).data)
    for array in (
        capture.tx_positions,
        capture.rx_positions,
        capture.radar.waveform.frequencies,
        grid.x,
        grid.y,
        grid.z,
    ):
        found.update(np.ascontiguousarray(array).tobytes())
    told = {name: str(value) for name, value in sorted(settings.items())}
    layers = None if capture.layers is None else asdict(capture.layers)
    rest = [capture.radar.path_offset, [slab.start for slab in slabs], told, layers]
    found.update(json.dumps(rest, default=np.ndarray.tolist).encode())
    return found.hexdigest()
