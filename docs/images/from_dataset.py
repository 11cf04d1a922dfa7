"""Makes the pictures of this folder that show a generated dataset; hidden.png is `carton.png` of `millisight demo`.

millisight generate examples/recipes/bench24.toml -o bench24
python docs/images/from_dataset.py bench24
"""

import sys
from pathlib import Path

import numpy as np

from millisight.data import SarImage
from millisight.io.mito import read_published
from millisight.perception import NLOS, power_prompts, project
from millisight.perception.segmentation import segment
from millisight.viz import (
    cut_out,
    plot_depth_holes,
    plot_multispectral,
    plot_samples,
    plot_segmentation_steps,
    save_figure,
)

HERE = Path(__file__).parent
SHOWN = ("037_scissors", "042_adjustable_wrench", "035_power_drill", "025_mug")


class Experiment:
    """One object's files under the published layout."""

    def __init__(self, root: Path, name: str):
        self.folder = root / name / "robot_collected" / "0_0_0" / "exp1"

    def image(self, where: str, band: int) -> SarImage:
        return read_published(self.folder / where / f"processed/radars/{band}_ghz/processed_image.pkl").record

    def frame(self, where: str):
        return read_published(next((self.folder / where / "unprocessed/camera").glob("*.pkl"))).record

    @property
    def mask(self):
        return read_published(self.folder / "los/processed/camera/camera_masks.pkl").record


def samples(root: Path):
    rows = {}
    for name in SHOWN:
        of = Experiment(root, name)
        rows[name.partition("_")[2]] = {
            "camera": cut_out(of.frame("los").rgb, of.mask.pixels),
            **{f"{band} GHz {where.upper()}": of.image(where, band) for band in (77, 24) for where in ("los", "nlos")},
        }
    return plot_samples(rows)


def multispectral(of: Experiment, colormap: str):
    los, nlos = ({f"{band} GHz": of.image(where, band) for band in (77, 24)} for where in ("los", "nlos"))
    return plot_multispectral(los, nlos, colormap=colormap)


def segmentation(of: Experiment):
    picture = project(of.image("nlos", 77))
    prompts = power_prompts(picture, thresholds=NLOS, rng=0)
    return plot_segmentation_steps(picture, prompts, segment(picture.image, method="classical", prompts=prompts))


def depth_holes(of: Experiment):
    image = of.image("los", 77)
    mask = segment(image, method="classical", rng=0)
    return plot_depth_holes(of.frame("los"), image, mask, pixels=of.mask.pixels)


def main(root: Path) -> None:
    scissors, padlock = Experiment(root, "037_scissors"), Experiment(root, "038_padlock")
    made = {
        "samples": samples(root),
        "multispectral": multispectral(padlock, "inferno"),
        "multispectral_jet": multispectral(padlock, "jet"),
        "segmentation": segmentation(scissors),
        "depth_holes": depth_holes(scissors),
    }
    for name, axes in made.items():
        save_figure(np.ravel(axes)[0].figure, HERE / f"{name}.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
