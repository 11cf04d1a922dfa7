"""What tests of the annotator annotate, and by what: a small image, and a segmenter that needs no thought."""

import numpy as np

import millisight as ms
from millisight.perception.segmentation import Candidates


def radar_image():
    """24 x 16 x 2 voxels, the brightest at (17, 4)."""
    grid = ms.VoxelGrid.regular((0, 0.1, -0.2), (0.046, 0.13, -0.19), (0.002, 0.002, 0.01))
    i, j, _ = np.indices(grid.shape)
    return ms.SarImage(grid=grid, values=np.exp(-((i - 17) ** 2 + (j - 4) ** 2) / 20).astype(np.complex64))


class Discs:
    """A disc of three pixels around each positive point, less one of two around each negative."""

    name = "discs"
    needs_prompts = True

    def segment(self, picture, prompts):
        pixels = np.stack(np.indices(picture.shape), axis=-1)

        def near(points, radius):
            apart = np.linalg.norm(pixels[:, :, None] - points, axis=-1)
            return (apart <= radius).any(axis=-1)

        on, off = prompts.points[prompts.positive], prompts.points[~prompts.positive]
        return Candidates(masks=(near(on, 3) & ~near(off, 2))[None], scores=np.array([0.5]))
