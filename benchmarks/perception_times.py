"""How long the search for sheets, segmentation and classification of an image take, one image after another.

    python benchmarks/perception_times.py DATASET

Of the 77 GHz images of a dataset's scenes, those in shut cartons apart: medians and the most, in milliseconds. Networks
are opened before. Both later steps look at an image whose sheets are known; classification searches once more for a lid
that was not told of where a mask may be one.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import millisight as ms
from millisight import datasets
from millisight.evaluation import HIGH, LabelledScene
from millisight.perception import HIGH_BAND, sheets_in

STEPS = "sheets", "segmentation", "classification"


def times(scene: LabelledScene) -> list[float]:
    """How long the three steps take [ms]; empty where nothing is found."""
    image, covered = scene.images[HIGH], scene.sight != "los"
    condition = "nlos" if covered else "los"
    sheets_in.cache_clear()
    clock = [time.perf_counter()]
    sheets_in(image, frequency=HIGH_BAND, covered=covered)
    clock.append(time.perf_counter())
    mask = ms.segment(image, condition=condition)
    clock.append(time.perf_counter())
    if not mask.inside.any():
        return []
    ms.classify(image, mask, condition=condition)
    clock.append(time.perf_counter())
    return list(1e3 * np.diff(clock))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    options = parser.parse_args()
    scenes = [files.read(truth="exact", view=False) for files in datasets.find_scenes(datasets.open(options.dataset))]
    took: dict[str, list[list[float]]] = {"in sight": [], "in a carton": []}
    for warm in (False, True):  # what is compiled, opened or read for the first time does not count
        for scene in scenes:
            row = times(scene)
            if warm and row:
                took["in sight" if scene.sight == "los" else "in a carton"].append(row)
    voxels = np.median([scene.images[HIGH].values.size for scene in scenes])
    print(f"images of {voxels:.0f} voxels (median)")
    for place, rows in took.items():
        if rows:
            each = np.array(rows)
            both = each[:, 1:].sum(axis=1)
            steps = ", ".join(f"{step} {value:.0f}" for step, value in zip(STEPS, np.median(each, axis=0), strict=True))
            print(f"{place}, {len(rows)}: {steps} ms; the last two {np.median(both):.0f}, at most {both.max():.0f} ms")


if __name__ == "__main__":
    main()
