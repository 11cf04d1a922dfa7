"""Makes fewer-rows.png: images from all rows of a scan, from half and from a quarter, plain and sparse.

python docs/images/fewer_rows.py
"""

import sys
from pathlib import Path

from millisight.viz import plot_sheet, save_figure

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "benchmarks"))
SHOWN = ("medium_clamp", "padlock", "large_marker")
TITLES = {
    (1, "fast"): "all rows", (2, "fast"): "half", (2, "sparse"): "half, sparse",
    (4, "fast"): "a quarter", (4, "sparse"): "a quarter, sparse",
}  # fmt: skip


def picture(scenes):
    """Scenes' images by (share of the rows, method): a row of the sheet each."""
    named = {f"{name}, {title}": images[key] for name, images in scenes.items() for key, title in TITLES.items()}
    return plot_sheet(named, columns=len(TITLES))


if __name__ == "__main__":
    from test_sparse import measured, scanned

    save_figure(picture({name: measured(*scanned(name))[0] for name in SHOWN}), HERE / "fewer-rows.png")
