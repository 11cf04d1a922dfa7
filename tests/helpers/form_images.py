"""Images of a ball and of a cylinder, as plane waves from their centres of curvature, and of flat and bent tops."""

import numpy as np
from scipy.ndimage import gaussian_filter

import millisight as ms
from millisight.core import SPEED_OF_LIGHT

WAVENUMBER = 4 * np.pi * 79e9 / SPEED_OF_LIGHT
RESOLUTION = 0.04  # along a line of sight [m]
DISTANCE = 0.25  # of the antennas [m]
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


def flat(sides, centre, tilt_deg=(0.0, 0.0), turn_deg=0.0, kind="rectangle", grid=GRID):
    """An image of a flat rectangle or ellipse, its normal tilted towards x and y."""
    n = np.sin(np.radians(tilt_deg))
    normal = np.array([*n, np.sqrt(1 - n @ n)])
    fine = 5
    x, y = (
        (axis[:, None] + (np.arange(fine) - fine // 2) / fine * (axis[1] - axis[0])).ravel()
        for axis in (grid.x, grid.y)
    )
    x, y = x[:, None] - centre[0], y - centre[1]
    rise = -(normal[0] * x + normal[1] * y) / normal[2]
    angle = np.radians(turn_deg)
    along = np.array(
        [np.cos(angle), np.sin(angle), -(normal[0] * np.cos(angle) + normal[1] * np.sin(angle)) / normal[2]]
    )
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    u, v = (
        abs(one[0] * x + one[1] * y + one[2] * rise) / side * 2
        for one, side in zip((along, across), sides, strict=True)
    )
    inside = np.maximum(u, v) <= 1 if kind == "rectangle" else np.hypot(u, v) <= 1
    shape = (len(grid.x), fine, len(grid.y), fine)
    level = gaussian_filter(inside.reshape(shape).mean(axis=(1, 3)), 0.5)
    places = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1) - centre
    above = places @ normal
    values = level[..., None] * np.exp(-1j * WAVENUMBER * above - (above / RESOLUTION) ** 2)
    values *= 1 - (grid.z - centre[2]) / DISTANCE  # antennas weigh alike, and farther slices are brighter
    return ms.SarImage(grid=grid, values=values)


def bulging(sides, centre, radius, *, dome=True, grid=GRID):
    """An image of a rectangle that bends about the axes x and y, or y alone; hollow where the radius is below 0."""
    offsets = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1) - centre
    from_axis = offsets * [1, float(dome), 1] + [0, 0, radius]
    away = np.linalg.norm(from_axis, axis=-1)
    above = np.copysign(away, radius) - radius
    seen_from = abs(radius) / away
    u, v = offsets[..., 0] * seen_from, offsets[..., 1] * (seen_from if dome else 1)
    inside = np.maximum(abs(u) / sides[0], abs(v) / sides[1]) <= 0.5
    level = gaussian_filter(inside.astype(float), (0.5, 0.5, 0))
    spread = seen_from if dome else np.sqrt(seen_from)  # the same power over a larger area
    values = spread * level * np.exp(-1j * WAVENUMBER * above - (above / RESOLUTION) ** 2)
    return ms.SarImage(grid=grid, values=values * (1 - (grid.z - centre[2]) / DISTANCE))


def lit(image, drop=-20):
    """What is brighter than so much below the maximum [dB]."""
    level = image.magnitude.mean(axis=2)
    return ms.Mask(grid_xy=image.grid.xy, inside=level > level.max() * 10 ** (drop / 20))
