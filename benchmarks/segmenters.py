"""Which classical method the segmenter without a network should be: each on a dataset in the published layout.

    python benchmarks/segmenters.py DATASET

Prints a table in Markdown: medians over images and prompt seeds, by the rules of `find_mask`. Each method that has a
level offers a mask for each of several, the largest first, so that the rule of masks can pass one over. GrabCut needs
`opencv-python-headless`, the random walker without priors `scikit-image`: whatever is not installed is left out.
"""

import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy import ndimage

from millisight import datasets
from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.io.mito import read_published
from millisight.perception import project
from millisight.perception.segmentation import Candidates, ClassicalSegmenter, Segmenter, find_mask

SEEDS = range(3)
LEVELS = (0.1, 0.2, 0.4)


class Plain:
    """A segmenter of one function, which gives masks, the best first."""

    needs_prompts = True

    def __init__(self, name: str, masks: Callable[[Picture, np.ndarray], list[np.ndarray]]):
        self.name = name
        self._masks = masks

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """`masks` of the picture and (A, B) labels: 2 on the object, 1 beside it, 0 unknown."""
        if prompts is None:
            raise InputError(f"{self.name} needs prompts")
        labels = np.zeros(picture.shape, np.int32)
        labels[tuple(prompts.points.T)] = np.where(prompts.positive, 2, 1)
        if prompts.positive.all():
            raise InputError(f"{self.name} needs negative prompts")
        masks = np.array(self._masks(picture, labels))
        return Candidates(masks=masks, scores=-np.arange(len(masks)))


def watershed(picture: Picture, labels: np.ndarray) -> list[np.ndarray]:
    """From the prompts up the steepness of the logarithm of power (SciPy)."""
    smooth = ndimage.gaussian_filter(_decades(picture), 1)
    steep = np.hypot(ndimage.sobel(smooth, 0), ndimage.sobel(smooth, 1))
    flooded = ndimage.watershed_ift((65535 * steep / steep.max()).astype(np.uint16), labels.astype(np.int16))
    return [flooded == 2]


def walker(picture: Picture, labels: np.ndarray) -> list[np.ndarray]:
    """The random walker without priors (scikit-image)."""
    from skimage.segmentation import random_walker

    chances = random_walker(_decades(picture), labels, beta=1000, mode="cg_j", tol=1e-5, return_full_prob=True)
    return [chances[1] > level for level in (0.5, 0.7, 0.9)]


def grabcut(picture: Picture, labels: np.ndarray) -> list[np.ndarray]:
    """On the rainbow's colours; what is above a level is probably the object's (OpenCV)."""
    import cv2

    colours, masks = np.ascontiguousarray(picture.rgb), []
    for level in LEVELS:
        cv2.setRNGSeed(0)
        mask = np.where(picture.power > level, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
        mask[labels == 1], mask[labels == 2] = cv2.GC_BGD, cv2.GC_FGD
        cv2.grabCut(colours, mask, None, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_MASK)
        masks.append((mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD))
    return masks


def power(picture: Picture, _: np.ndarray) -> list[np.ndarray]:
    """What is above a level."""
    return [picture.power > level for level in LEVELS]


def _decades(picture: Picture) -> np.ndarray:
    return np.log10(np.maximum(picture.power, 1e-3))


def methods() -> Iterator[Segmenter]:
    yield Plain("power above a level", power)
    yield Plain("watershed (SciPy)", watershed)
    if find_spec("skimage"):
        yield Plain("random walker (scikit-image)", walker)
    if find_spec("cv2"):
        yield Plain("GrabCut (OpenCV)", grabcut)
    yield ClassicalSegmenter()


def scenes(root: Path) -> Iterator[tuple[str, Picture, np.ndarray]]:
    """In or out of sight, the 77 GHz picture, and its true mask."""
    for experiment in datasets.open(root).experiments:
        items = {item.kind: item.path for item in experiment.items if item.radar == "77_ghz" and not item.ext}
        if {"image", "radar mask"} <= items.keys():
            picture = project(read_published(items["image"]).record)
            yield experiment.sight, picture, read_published(items["radar mask"]).record.inside


def judged(by: Segmenter, picture: Picture, truth: np.ndarray, sight: str, seed: int) -> tuple[float, float, float]:
    """Precision, recall, F1; where nothing is found they are 0."""
    try:
        mask = find_mask(by, picture, condition=sight, rng=seed).inside
    except InputError:
        return 0.0, 0.0, 0.0
    both = (mask & truth).sum()
    return both / max(mask.sum(), 1), both / truth.sum(), 2 * both / (mask.sum() + truth.sum())


def main(root: Path) -> None:
    found = list(scenes(root))
    counts = {sight: sum(one[0] == sight for one in found) for sight in ("los", "nlos")}
    print(f"{counts['los']} images in line of sight, {counts['nlos']} out of it, {len(SEEDS)} prompt seeds\n")
    print("| method | LOS P / R / F1 | mean F1 | NLOS P / R / F1 | mean F1 | ms an image |")
    print("|---|---|---|---|---|---|")
    for by in methods():
        cells = []
        started = time.process_time()
        for sight in counts:
            results = [judged(by, p, truth, s, seed) for s, p, truth in found if s == sight for seed in SEEDS]
            values = 100 * np.array(results)
            cells += [" / ".join(f"{v:.1f}" for v in np.median(values, axis=0)), f"{values[:, 2].mean():.1f}"]
        took = 1e3 * (time.process_time() - started) / (len(found) * len(SEEDS))
        print(f"| {by.name} | {' | '.join(cells)} | {took:.0f} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
