"""How well scores of the classifier's outputs tell shapes of no class from objects of its classes: AUROC of each.

    python benchmarks/novelty_scores.py DATASET --odd DATASET [DATASET ...]

The first holds whole scenes of objects of the classes, the others those of shapes of none, as benchmarks/odd_shapes.py
makes them. In the masks of `wave`, both bands. None of these scores but the first is a part of `novelty`. "Of a class"
are the scenes of the first, in sight or not, whose class is not "other".
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

import millisight as ms
from millisight import datasets
from millisight.evaluation import HIGH, LOW, LabelledScene, classes_of
from millisight.meshes import NO_SHAPE_CLASS
from millisight.perception import HIGH_BAND, LOW_BAND, open_network, run_network, without_sheets
from millisight.perception.classification import (
    CLASSIFIER_CHANNELS,
    CLASSIFIER_WEIGHTS,
    classifier,
    classifier_input,
    classify,
    square_symmetries,
)
from millisight.perception.segmentation import segment
from millisight.perception.training import area_under_curve


def softmax(logits: np.ndarray) -> np.ndarray:
    shares = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return shares / shares.sum(axis=-1, keepdims=True)


def entropy(shares: np.ndarray) -> np.ndarray:
    return -(shares * np.log(shares + 1e-12)).sum(axis=-1)


class Scores:
    """Scores of scenes: higher for what seems to be of no class."""

    def __init__(self) -> None:
        self._by = classifier()
        self._classes = classes_of(self._by.description, self._by.class_names)
        sha256 = self._by.description["sha256"]
        self._session = open_network(CLASSIFIER_WEIGHTS, sha256, needed_by="this", channels=len(CLASSIFIER_CHANNELS))

    def knows(self, scene: LabelledScene) -> bool:
        """Whether its object is of a class, and not of "other"."""
        return self._classes.get(scene.object, NO_SHAPE_CLASS) != NO_SHAPE_CLASS

    def of(self, scene: LabelledScene) -> dict[str, float]:
        """By the score's name; none where nothing was found."""
        condition = "los" if scene.sight == "los" else "nlos"
        image, low = scene.images[HIGH], scene.images.get(LOW)
        mask = segment(image, other_band=low, condition=condition)
        if not mask.inside.any():
            return {}
        found = classify(image, mask, other_band=low, condition=condition, method=self._by)
        views, alone = self._views(image, mask, low), self._views(image, mask, None)
        each, mean, one = softmax(views), softmax(views.mean(axis=0)), softmax(alone.mean(axis=0))
        return {
            "novelty": float(found.novelty),
            "probability of other": float(found.probabilities[found.class_names.index(NO_SHAPE_CLASS)]),
            "other or none": float(mean[-2:].sum()),
            "1 - highest probability": float(1 - mean[:-1].max()),
            "entropy": float(entropy(mean)),
            "energy": float(-np.log(np.exp(views.mean(axis=0)).sum())),
            "symmetries: mutual information": float(entropy(each.mean(axis=0)) - entropy(each).mean()),
            "symmetries: spread of the outputs": float(views.std(axis=0).mean()),
            "bands: Jensen-Shannon divergence": float(entropy((mean + one) / 2) - (entropy(mean) + entropy(one)) / 2),
        }

    def _views(self, image: ms.SarImage, mask: ms.Mask, low: ms.SarImage | None) -> np.ndarray:
        """(8, C + 1) outputs for the symmetries of a square."""
        other = None if low is None else without_sheets(low, frequency=LOW_BAND)
        channels = classifier_input(without_sheets(image, frequency=HIGH_BAND), mask, other_band=other)
        return run_network(self._session, square_symmetries(channels))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("known", type=Path)
    parser.add_argument("--odd", type=Path, nargs="+", required=True)
    options = parser.parse_args()
    scores, found = Scores(), defaultdict(lambda: defaultdict(list))
    for root in (options.known, *options.odd):
        for files in datasets.find_scenes(datasets.open(root)):
            scene = files.read(truth="exact", view=False)
            kinds = ["odd"] if root in options.odd else [scene.sight, *(["of a class"] if scores.knows(scene) else [])]
            for name, value in scores.of(scene).items():
                for kind in kinds:
                    found[name][kind].append(value)
    for name, by_kind in found.items():
        odd = np.array(by_kind.pop("odd"))
        areas = (f"{kind} {area_under_curve(np.array(known), odd):.2f}" for kind, known in by_kind.items())
        print(f"{name}: {', '.join(areas)}")


if __name__ == "__main__":
    main()
