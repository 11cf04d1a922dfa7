"""An image of an object under a lid, made in no time: a mirror and a spot, each with a main lobe along z."""

import numpy as np

import millisight as ms

FREQUENCY = 79e9


def covered_image(lid=0.03, spot=-0.02, strength=3.0):
    """A lid over 16 x 16 cm at the height `lid`, twice as wide along z as the object's spot under it, and noise."""
    grid = ms.VoxelGrid(x=np.arange(-0.08, 0.0801, 0.004), y=np.arange(-0.08, 0.0801, 0.004),
                        z=np.arange(-0.05, 0.0501, 0.005))  # fmt: skip
    x, y, z = np.meshgrid(grid.x, grid.y, grid.z, indexing="ij")
    wave = 4 * np.pi * FREQUENCY / 299_792_458.0
    tilt = 0.01
    sheet = 5 * np.exp(-(((z - lid - tilt * x) / 0.012) ** 2) + 1j * wave * tilt * x)
    thing = strength * np.exp(-((x**2 + y**2) / 0.006**2) - ((z - spot) / 0.008) ** 2)
    rng = np.random.default_rng(5)
    noise = 0.02 * (rng.normal(size=grid.shape) + 1j * rng.normal(size=grid.shape))
    return ms.SarImage(grid=grid, values=(sheet + thing + noise).astype(np.complex64))
