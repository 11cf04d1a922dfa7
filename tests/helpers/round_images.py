"""Images of a ball and of a cylinder, as plane waves from their centres of curvature."""

import numpy as np

import millisight as ms
from millisight.core import SPEED_OF_LIGHT

WAVENUMBER = 4 * np.pi * 79e9 / SPEED_OF_LIGHT
RESOLUTION = 0.04  # along a line of sight [m]
GRID = ms.VoxelGrid.regular((-0.1, -0.12, -0.1), (0.1, 0.12, 0.06), (0.0025, 0.0025, 0.01))
WIDEST = 0.35  # sine of the angle from which the aperture sees


def waves(across, z, crest, radius):
    """(N, Z) image of an echo from a centre of curvature below a crest: plane waves, as bright as their range lets."""
    kx = 2 * np.pi * np.fft.fftfreq(len(across), across[1] - across[0])
    kz = np.sqrt(WAVENUMBER**2 - kx**2)[:, None]
    shape = np.exp(-((kx / WAVENUMBER / (0.6 * WIDEST)) ** 2))[:, None] * (abs(kx) < WIDEST * WAVENUMBER)[:, None]
    above = z - (crest - radius)
    late = above * WAVENUMBER / kz - radius
    spectrum = shape * np.exp(-1j * kz * above) * np.exp(-((late / RESOLUTION) ** 2))
    return np.fft.fftshift(np.fft.ifft(spectrum, axis=0), axes=0) * len(across)


def ball(radius, centre, grid=GRID):
    """An image of a ball: kx and ky by the distance from the z axis through it."""
    x, y, z = grid.x, grid.y, grid.z
    kx, ky = np.meshgrid(*(2 * np.pi * np.fft.fftfreq(len(a), a[1] - a[0]) for a in (x, y)), indexing="ij")
    away = np.hypot(kx, ky)
    kz = np.sqrt(np.maximum(WAVENUMBER**2 - away**2, 1))[..., None]
    shape = np.exp(-((away / WAVENUMBER / (0.6 * WIDEST)) ** 2)) * (away < WIDEST * WAVENUMBER)
    above = z - centre[2]
    late = above * WAVENUMBER / kz - radius
    shift = np.exp(-1j * (kx * (centre[0] - x[0]) + ky * (centre[1] - y[0])))
    spectrum = (shape * shift)[..., None] * np.exp(-1j * kz * above) * np.exp(-((late / RESOLUTION) ** 2))
    return ms.SarImage(grid=grid, values=np.fft.ifft2(spectrum, axes=(0, 1)))


def cylinder(radius, height, length, tilt_deg=0.0, grid=GRID):
    """An image of a cylinder along y, its axis at this height above the grid's middle."""
    x, y, z = grid.x, grid.y, grid.z
    slope, values = np.tan(np.radians(tilt_deg)), np.zeros(grid.shape, complex)
    for j in np.flatnonzero(abs(y) <= length / 2):
        values[:, j] = waves(x, z, height + y[j] * slope + radius, radius)
    return ms.SarImage(grid=grid, values=values)


def lit(image, drop=-20):
    """What is brighter than so much below the maximum [dB]."""
    level = image.magnitude.mean(axis=2)
    return ms.Mask(grid_xy=image.grid.xy, inside=level > level.max() * 10 ** (drop / 20))
