"""Images of a bright rectangle on speckle, 30 x 40 pixels, and a dataset of them in the published layout."""

import numpy as np

import millisight as ms
from millisight.io.mito import experiment_folder, radar_folder, write_published

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.145, 0.195, 0.01), (0.005, 0.005, 0.01))
BRIGHT = (slice(8, 16), slice(10, 24))


def image(seed=0):
    values = np.full(GRID.shape, 0.01)
    values[BRIGHT] = 1
    return ms.SarImage(grid=GRID, values=values * np.random.default_rng(seed).rayleigh(size=GRID.shape))


def publish(root):
    """Two sights of one object by both radars; out of sight the 24 GHz image is blank. The name of the experiment.

    Beside it an empty scene, which is no image of an object.
    """
    empty = radar_folder(experiment_folder(root, "tripod_EMPTY", (0, 0, 0), 1, "los"), "77_ghz", processed=True)
    empty.mkdir(parents=True)
    write_published(empty / "processed_image.pkl", image())
    for sight in ("los", "nlos"):
        folder = experiment_folder(root, "004_sugar_box", (0, 0, 0), 1, sight)
        for radar in ("77_ghz", "24_ghz"):
            to = radar_folder(folder, radar, processed=True)
            to.mkdir(parents=True)
            blank = sight == "nlos" and radar == "24_ghz"
            one = ms.SarImage(grid=GRID, values=np.zeros(GRID.shape)) if blank else image()
            write_published(to / "processed_image.pkl", one)
    return "004_sugar_box.0_0_0.exp1"
