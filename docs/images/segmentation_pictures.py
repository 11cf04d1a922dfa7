"""The pictures of docs/explanation/segmentation-truth.md, from a dataset and what was judged on it; and how many of the
pixels where prompts may lie are on the object.

millisight evaluate segmentation bench24 -o masks
python docs/images/segmentation_pictures.py bench24 masks docs/images
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from millisight import datasets
from millisight.datasets import find_scenes
from millisight.evaluation import BOTH, HIGH, LOW, SegmenterEvaluator
from millisight.perception import NLOS, power_on
from millisight.perception.segmentation import segmenter
from millisight.viz import save_figure

SHOWN = ("050_medium_clamp", "077_rubiks_cube", "065-g_cups", "029_plate")


def bright_in(on: SegmenterEvaluator) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that are bright enough for a positive prompt: at 77 GHz, and in both bands."""
    picture = on.pictures[HIGH]
    bright = picture.power > NLOS.positive
    return bright, bright & (power_on(on.pictures[LOW], picture) > NLOS.positive)


def shares(root: Path) -> None:
    """Say how many of such pixels lie on the object: medians over the scenes."""
    by = segmenter("classical")
    for sight in ("los", "nlos"):
        for crop in ((0, 0), (4, 0)):
            scenes = find_scenes(datasets.open(root), sight=sight)
            all_on = [SegmenterEvaluator(by, files.read(crop=crop)) for files in scenes]
            found = [[100 * on.truth(HIGH).inside[one].mean() for one in bright_in(on)] for on in all_on]
            print(sight, "crop", crop, "on the object [%]: 77 GHz, both:", np.nanmedian(found, axis=0).round(1))  # noqa: T201


def bands(root: Path) -> Figure:
    """Out of sight: where positive prompts may lie, by 77 GHz alone and by both bands, and the masks from both."""
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    axes = figure.subplots(3, len(SHOWN))
    by = segmenter("wave")
    for column, name in enumerate(SHOWN):
        (files,) = find_scenes(datasets.open(root).only([name]), sight="nlos")
        on = SegmenterEvaluator(by, files.read())
        picture, truth = on.pictures[HIGH], on.truth(HIGH)
        bright, both = bright_in(on)
        x, y = truth.grid_xy.x, truth.grid_xy.y
        extent = (x[0], x[-1], y[0], y[-1])
        for row, shown in enumerate((None, bright, both)):
            one = axes[row, column]
            if shown is None:
                one.imshow(picture.rgb.transpose(1, 0, 2), origin="lower", extent=extent)
                one.set_title(name, fontsize=9)
                masks = ((on.attempt(BOTH, 0).mask, "white", "-"),)
            else:
                one.imshow(np.where(shown.T, 0.25, 0.95), cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
                share = truth.inside[shown].mean() if shown.any() else 0
                one.set_title(f"{100 * share:.0f} % on the object", fontsize=8)
                masks = ()
            for mask, colour, style in (*masks, (truth, "#D55E00", "--")):
                one.contour(x, y, mask.inside.T, levels=[0.5], colors=colour, linestyles=style, linewidths=1.3)
            one.set(xticks=[], yticks=[])
    for row, label in enumerate(("77 GHz", "bright at 77 GHz", "bright in both bands")):
        axes[row, 0].set_ylabel(label, fontsize=9)
    return figure


def shrink(path: Path, colours: int = 48) -> None:
    """The picture in few colours."""
    Image.open(path).convert("RGB").quantize(colours).save(path, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    data, judged, out = map(Path, sys.argv[1:])
    shares(data)
    save_figure(bands(data), out / "segmentation-bands.png", dpi=80)
    paths = sorted(judged.glob("worst-*.png"))  # of one segmenter, then of the other
    worst = [Image.open(paths[half + n]).convert("RGB") for n in range(3) for half in (0, len(paths) // 2)]
    width, height = worst[0].size
    sheet = Image.new("RGB", (2 * width, 3 * height), "white")
    for number, picture in enumerate(worst):
        sheet.paste(picture, (number % 2 * width, number // 2 * height))
    sheet.resize((width * 5 // 4, height * 15 // 8)).save(out / "segmentation-worst.png")
    Image.open(judged / "medians.png").save(out / "segmentation-medians.png")
    for name in ("bands", "worst", "medians"):
        shrink(out / f"segmentation-{name}.png")
