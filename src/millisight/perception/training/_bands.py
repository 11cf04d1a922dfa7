"""What all scenes to train on have in common: both radars, the lattice of their images, the files of their parts."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import atomic_path, printable
from millisight.core.errors import DamagedFileError, FileError
from millisight.data import Radar, Trajectory
from millisight.io.arrays import read_arrays as read_stored

BANDS = ("77_ghz", "24_ghz")
DEPTH = 0.0125
"""Between the voxels of images along z [m]; along x and y they have the spacing of the networks' pixels."""

_PRESETS = {"77_ghz": "mito-sim-77ghz", "24_ghz": "mito-sim-24ghz"}
_SAMPLES = {"77_ghz": 64, "24_ghz": 16}  # a chirp: the object is near, and fewer make no ambiguity


def simulated_radar(band: str) -> Radar:
    """The simulator's radar with few samples."""
    radar = Radar.preset(_PRESETS[band])
    whole, few = radar.waveform, _SAMPLES[band]
    rate = whole.sample_rate * few / whole.samples_per_chirp
    return dataclasses.replace(radar, waveform=dataclasses.replace(whole, samples_per_chirp=few, sample_rate=rate))


def strayed(trajectory: Trajectory, stray: float, rng: np.random.Generator) -> Trajectory:
    """Where the imager believes the positions to be: each row a little off."""
    _, row = np.unique(trajectory.positions[:, 0], return_inverse=True)
    return dataclasses.replace(
        trajectory, positions=trajectory.positions + rng.normal(0, stray, (row.max() + 1, 3))[row]
    )


def write_parts(path: Path, images: dict[str, np.ndarray], **arrays: np.ndarray) -> None:
    """Write complex images of both bands in half precision, and other arrays beside them."""
    for band in BANDS:
        parts = np.ascontiguousarray(images[band], np.complex64)
        arrays[band] = parts.view(np.float32).astype(np.float16)
    write_arrays(path, arrays)


def read_parts(path: Path, *names: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The images of both bands as complex64, and the other arrays of these names.

    Raises
    ------
    DamagedFileError
    """
    held = read_arrays(path, *BANDS, *names)
    for band in BANDS:
        array = held[band]
        if array.dtype != np.float16 or not array.ndim or array.shape[-1] % 2 or not np.isfinite(array).all():
            raise DamagedFileError(f"{printable(path)} is not a scene of this training: {band} is no image; delete it")
    images = {band: held.pop(band).astype(np.float32).view(np.complex64) for band in BANDS}
    return images, held


def check_arrays(
    path: Path, held: Mapping[str, np.ndarray], expected: Mapping[str, tuple[type, tuple[int, ...]]]
) -> None:
    """Raise unless the arrays of these names have the types and shapes that are expected of them, and are finite.

    Raises
    ------
    DamagedFileError
    """
    for name, (kind, shape) in expected.items():
        array = held[name]
        if array.shape != shape or not np.issubdtype(array.dtype, kind) or not np.isfinite(array).all():
            raise DamagedFileError(
                f"{printable(path)} is not a scene of this training: {name} is {array.dtype} of shape {array.shape}; "
                f"expected finite {kind.__name__} of shape {shape}; delete it"
            )


def level_of(path: Path, held: Mapping[str, np.ndarray], images: Mapping[str, np.ndarray]) -> int:
    """The `level` that a file holds: an index along the last axis of its images.

    Raises
    ------
    DamagedFileError
    """
    check_arrays(path, held, {"level": (np.integer, ())})
    level, many = int(held["level"]), min(one.shape[-1] for one in images.values())
    if not 0 <= level < many:
        raise DamagedFileError(
            f"{printable(path)} is not a scene of this training: level is {level}, of {many} along z; delete it"
        )
    return level


def write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)


def read_arrays(path: Path, *names: str) -> dict[str, np.ndarray]:
    """Arrays of a file of `write_arrays`.

    Raises
    ------
    DamagedFileError
    """
    try:
        found = read_stored(path, names=names, finite=False)
    except (FileError, LookupError) as error:
        raise DamagedFileError(f"{printable(path)} is not a scene of this training: {error}; delete it") from error
    return {name: array.copy() for name, array in found.items()}  # which may be written to
