"""Plot each augmentation of a classifier's training alone, on one object's simulated images.

python examples/augmentations.py mug augmentations.png
"""

import sys

import numpy as np

from millisight.perception.training import SCENE_PARTS, SceneSettings, make_scene
from millisight.viz import plot_augmentations, save_figure


def main(name: str, picture: str) -> None:
    # The first of some scenes that has something below the object.
    for seed in range(20):
        scene = make_scene(name, SceneSettings(widest=0.32), rng=np.random.default_rng(seed))
        if scene.scales["77_ghz"][SCENE_PARTS.index("plate")] > 0:
            break
    save_figure(plot_augmentations(scene), picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print("usage: python examples/augmentations.py OBJECT PICTURE", file=sys.stderr)
        sys.exit(2)
    main(*sys.argv[1:])
