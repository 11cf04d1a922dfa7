"""All images of a dataset on sheets, to look at: a row or two an object, the exact mask's outline over each image.

    python examples/dataset_sheet.py DATASET sheet.png

Any dataset of the published layout will do, converted or not. More images than fit a sheet go to sheet-2.png, ...
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import millisight as ms
from millisight.datasets import Dataset, Item
from millisight.io.mito import IMAGE, read_published

COLUMNS, ROWS = 8, 12


def images_of(dataset: Dataset) -> list[tuple[str, str, Item]]:
    """(object, what it is, image) of all images, object by object."""
    found = []
    for one in dataset.objects:
        for part in one.parts:
            kind = f"exp{part.number} {part.sight}" if hasattr(part, "sight") else "sim"
            turned = "" if not any(part.angles) else " " + ",".join(map(str, part.angles))
            for item in part.items:
                if item.kind == IMAGE:
                    found.append((f"{one.id} {one.name}", f"{kind}{item.ext} {item.radar[:2]}{turned}", item))
    return found


def record_of(path: Path):
    return ms.load(path) if path.suffix == ".h5" else read_published(path).record


def draw(axes, name: str, what: str, item: Item) -> None:
    """The mean of |I| along z over its maximum, and the outline of the exact mask where there is one."""
    image = record_of(item.path)
    grid = image.grid
    picture = image.project("z")
    extent = (grid.x[0], grid.x[-1], grid.y[0], grid.y[-1])
    axes.imshow(picture.T / max(picture.max(), 1e-30), origin="lower", extent=extent, cmap="inferno", vmin=0, vmax=1)
    mask = item.path.with_name(item.path.name.replace("processed_image", "radar_masks"))
    if mask.exists():
        inside = record_of(mask).inside
        if 0 < inside.sum() < inside.size:
            axes.contour(grid.x, grid.y, inside.T.astype(float), [0.5], colors="cyan", linewidths=0.5)
    axes.set_title(f"{name}\n{what}", fontsize=6, pad=2)
    axes.tick_params(labelsize=4, length=1.5, width=0.3, pad=1)


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    images, picture = images_of(ms.datasets.open(sys.argv[1])), Path(sys.argv[2])
    step = COLUMNS * ROWS
    for number, start in enumerate(range(0, len(images), step), 1):
        some = images[start : start + step]
        rows = int(np.ceil(len(some) / COLUMNS))
        figure = Figure(figsize=(1.5 * COLUMNS, 1.75 * rows), layout="constrained")
        for i, one in enumerate(some, 1):
            draw(figure.add_subplot(rows, COLUMNS, i), *one)
        path = picture if number == 1 else picture.with_stem(f"{picture.stem}-{number}")
        figure.savefig(path, dpi=130)
        print(f"wrote {path}: {len(some)} images")


if __name__ == "__main__":
    main()
