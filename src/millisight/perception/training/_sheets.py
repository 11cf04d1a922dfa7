"""Images of sheets to train with: lids, cloths and floors, simulated in closed form.

A sheet is a mirror of layers: an echo as of the antenna's image in it (primer 18), with the interference of its two
faces, a tilt, a bow, and edges by Fresnel's integral. `form_image` makes images of these echoes.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, printable
from millisight.core.errors import DamagedFileError
from millisight.data import Capture, Radar, Trajectory, VoxelGrid
from millisight.imaging import form_image
from millisight.perception import SPACING
from millisight.perception.training._bands import (
    BANDS,
    DEPTH,
    check_arrays,
    level_of,
    read_parts,
    simulated_radar,
    strayed,
    write_parts,
)

_SIDE = 0.36  # of the images along x and y [m]
_BELOW, _ABOVE = 0.16, 0.075  # of the images, from the sheet's middle [m]
_STEPS = {"77_ghz": 0.5, "24_ghz": 0.45}  # wavelengths between positions
_SMALL = 0.35  # of the sheets end on all sides within a scene
_STEEPEST = 5.0  # [degrees]


class SheetParts(NamedTuple):
    """Images of a sheet whose middle is at x = y = 0.

    Attributes
    ----------
    level : index along z of the voxels next to the sheet's middle
    reach : (4,) where it ends: its lowest and highest x, lowest and highest y [m]
    images : by band complex64 (A, B, Z), voxels `SPACING` apart along x and y and `DEPTH` along z, 1 at the maximum
    """

    level: int
    reach: np.ndarray
    images: dict[str, np.ndarray]


def cached_sheet(number: int, *, seed: int, folder: str | os.PathLike[str], kind: str = "sheet") -> SheetParts:
    """The sheet, or the stand, of this number: read from `folder`, or made and written there.

    Raises
    ------
    DamagedFileError
    """
    path = Path(folder) / f"{kind}-{number}-{seed}.npz"
    if not path.exists():
        level, reach, images = make_sheet(np.random.default_rng([seed, number, *kind.encode()]), stand=kind == "stand")
        write_parts(path, images, level=np.array(level), reach=reach)
    images, held = read_parts(path, "level", "reach")
    check_arrays(path, held, {"reach": (np.floating, (4,))})
    if len({values.shape for values in images.values()}) > 1 or images[BANDS[0]].ndim != 3:
        raise DamagedFileError(f"{printable(path)}: its images differ in size, or are not of a volume; delete it")
    return SheetParts(level_of(path, held, images), held["reach"], images)


def make_sheet(rng: np.random.Generator, *, stand: bool = False) -> SheetParts:
    """A sheet drawn from `rng`: 13 to 30 cm below the aperture, tilted, perhaps bowed, large or with edges.

    A `stand` is what objects lie on where there is none: a level plate of a tripod, 1.5 to 3.5 cm wide.
    """
    height = -rng.uniform(0.13, 0.30)
    slope = np.tan(np.radians(np.clip(rng.normal(0, 1.5, 2), -_STEEPEST, _STEEPEST)))
    bow = rng.uniform(-0.0015, 0.0015, 2) if rng.random() < 0.3 else np.zeros(2)
    beyond = np.where(rng.random(4) < 0.5, rng.uniform(0.06, 0.2, 4), 0.4)
    small = np.repeat(rng.uniform(0.05, 0.14, 2), 2)  # a carton's lid, within the scene
    reach = (small if rng.random() < _SMALL else beyond) * [-1, 1, -1, 1]
    if stand:
        slope, bow = slope / 5, np.zeros(2)
        reach = np.repeat(rng.uniform(0.0075, 0.0175, 2), 2) * [-1, 1, -1, 1]
    thick, strong = rng.uniform(0.002, 0.005), rng.uniform(0.3, 1)
    size, stray = rng.uniform(0.26, 0.38, 2), rng.uniform(0, 0.00004)
    half = round(_SIDE / SPACING / 2) * SPACING
    lattice = DEPTH * np.arange(-round(_BELOW / DEPTH), round(_ABOVE / DEPTH) + 1) + rng.uniform(0, DEPTH)
    axis = SPACING * np.arange(-round(half / SPACING), round(half / SPACING) + 1)
    grid, images = VoxelGrid(x=axis, y=axis, z=height + lattice), {}
    for band in BANDS:
        radar = simulated_radar(band)
        step = _STEPS[band] * SPEED_OF_LIGHT / radar.waveform.start_frequency
        path = Trajectory.raster(size=(size[0], size[1]), step=step, center=(0.0, 0.0, 0.0))
        frames = _echo(radar, path, height, slope, bow, reach, (thick, strong))
        capture = Capture(radar=radar, trajectory=strayed(path, stray, rng), frames=frames)
        values = form_image(capture, grid, tolerance=0.02).values
        images[band] = values / abs(values).max()
    return SheetParts(int(abs(lattice).argmin()), reach, images)


def _echo(
    radar: Radar, path: Trajectory, height: float, slope: np.ndarray, bow: np.ndarray, reach: np.ndarray,
    faces: tuple[float, float],
) -> np.ndarray:  # fmt: skip
    """(P, T, R, N) the echo of a sheet at the height [m] that rises by `slope` (2,) along x and y.

    At 10 cm from its middle it is `bow` (2,) lower [m]; its two faces lie faces[0] apart [m], the second as bright as
    faces[1].
    """
    from scipy.special import fresnel

    tx = path.placed(radar.array.tx_positions)[:, :, None]
    rx = path.placed(radar.array.rx_positions)[:, None]
    middle: np.ndarray = (tx + rx) / 2
    across = middle[..., :2]
    above = middle[..., 2] - height - across @ slope + (across / 0.1) ** 2 @ bow
    distance = above / np.sqrt(1 + (slope**2).sum())
    length = np.sqrt((2 * distance) ** 2 + ((tx - rx) ** 2).sum(axis=-1)) + radar.path_offset
    wave_numbers = 2 * np.pi * radar.waveform.frequencies / SPEED_OF_LIGHT
    echo = np.exp(-1j * wave_numbers * length[..., None])
    echo *= 1 - faces[1] * np.exp(-2j * wave_numbers * 1.2 * faces[0])  # board is mostly air: an index of 1.2
    scale = 2 / np.sqrt(SPEED_OF_LIGHT / radar.waveform.center_frequency * distance)
    for axis, (low, high) in enumerate(reach.reshape(2, 2)):
        lit: Any = 0
        for place, sign in ((low, 1), (high, -1)):
            sine, cosine = fresnel(sign * (across[..., axis] - place) * scale)
            lit = lit + (0.5 + cosine - 1j * (0.5 + sine)) / (1 - 1j)
        echo *= (lit - 1)[..., None]  # what lies beyond neither edge
    return echo.astype(np.complex64)
