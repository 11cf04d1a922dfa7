"""Every augmentation of a classifier's training, each alone, on one object's simulated images: a picture.

python examples/augmentations.py [OBJECT] [PICTURE]
"""

import sys

import numpy as np

from millisight.perception.training_scenes import Scenes, make_scene
from millisight.viz.figures_training import plot_augmentations
from millisight.viz.plots import save_figure

name = sys.argv[1] if len(sys.argv) > 1 else "mustard_bottle"
# The first seeds whose scenes have something below and above the object.
for seed in range(20):
    scene = make_scene(name, Scenes(widest=0.32), rng=np.random.default_rng(seed))
    if all(part.any() for part in scene.images["77_ghz"]):
        break
save_figure(plot_augmentations(scene), sys.argv[2] if len(sys.argv) > 2 else "augmentations.png")
