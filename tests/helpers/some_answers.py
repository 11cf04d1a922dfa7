"""Answers of classifiers, made up: one, or what a few variants say of a few objects."""

import numpy as np

from millisight.data import Prediction
from millisight.evaluation import PREDICTED, TRUE, ClassifierAnswer, Variant
from millisight.evaluation._answers import CLOSED, DISJOINT

NAMES = ("can", "handle", "box", "sphere")
BOTH, EDGE = Variant("shipped", "both", "small"), Variant("edges", "edge", "small")
CLASSES = {"mug_can": "can", "fork": "handle", "dice": "box", "peach": "sphere"}


def prediction(label, confidence=0.7, threshold=0.5):
    """The rest of the probability is shared by the other classes."""
    rest = (1 - confidence) / (len(NAMES) - 1)
    values = [confidence if name == label else rest for name in NAMES]
    return Prediction(probabilities=np.array(values), class_names=NAMES, threshold=threshold)


def answer(label="box", confidence=0.7, *, name="dice", pose=0, **changes):
    """By default the right answer about a box in sight, seen in a predicted mask; no label: there was no mask."""
    given = {
        "object": name,
        "sight": "los",
        "shape": "built",
        "truth": CLASSES[name],
        "variant": BOTH,
        "split": DISJOINT,
        "masks": PREDICTED,
        "prediction": None if label is None else prediction(label, confidence),
        "failure": "" if label else "nothing is bright",
        "iou": 0.8,
    } | changes
    return ClassifierAnswer(scene=f"000_{name}/0_0_{pose}/exp1/{given['sight']}", **given)


def several():
    """Four objects in three poses, in sight and out of it, in both masks: `shipped` and `edges`, of new objects and of
    known ones. Right are: `shipped` always in sight, and but for the sphere, of which no mask was found, out of it;
    `edges` of cans and boxes only, and of the sphere in the true mask."""
    found = []
    for split in (CLOSED, DISJOINT):
        for variant in (BOTH, EDGE):
            for name, truth in CLASSES.items():
                for pose in range(3):
                    for sight in ("los", "nlos"):
                        for masks in (PREDICTED, TRUE):
                            place = {"variant": variant, "split": split, "sight": sight, "masks": masks, "pose": pose}
                            place["shape"] = "scan" if name == "dice" else "built"
                            if truth == "sphere" and sight == "nlos" and masks == PREDICTED:
                                label = None
                            elif variant == BOTH or truth in ("can", "box") or (truth, masks) == ("sphere", TRUE):
                                label = truth
                            else:
                                label = "can"
                            found.append(answer(label, 0.9 if variant == BOTH else 0.4, name=name, **place))
    return found
