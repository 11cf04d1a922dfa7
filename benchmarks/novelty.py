"""How well the classifier tells what it knows from what it does not: AUROC of the novelty, and sure answers.

    python benchmarks/novelty.py DATASET [DATASET ...] --odd DATASET --newer DATASET --third DATASET --sparse DATASET
        [-o novelty.md]

DATASETs hold whole scenes of objects of its classes, and empty cartons; `odd`, `newer`, `third` and `sparse` are
made as benchmarks/odd_shapes.py says. Masks are those of `wave`, as of a user's. Lids are scenes of a shut carton that
is not told of: in the mask of all of the lid, as it is found where it is told of, and in the mask of `wave` where the
two overlap by more than half of what both cover.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import millisight as ms
from millisight import datasets
from millisight.core.errors import InputError
from millisight.evaluation import HIGH, LOW, LabelledScene, wilson_interval
from millisight.perception import HIGH_BAND, project, sheets_in
from millisight.perception.classification import classifier, classify
from millisight.perception.segmentation import WaveSegmenter, find_mask
from millisight.perception.training import area_under_curve

_ALIKE = 0.5


class Answer(NamedTuple):
    """Of a scene that was answered: novelty, and the class where the answer is sure, "" where it is not."""

    novelty: float
    sure: str


class Answers:
    """Answers by what the scenes show; and how many of these were refused because nothing was found."""

    def __init__(self) -> None:
        self.given: dict[str, list[Answer]] = {}
        self.nothing: dict[str, int] = {}
        self._segmenter, self._by = WaveSegmenter(), classifier()

    def untold(self, scene: LabelledScene) -> ms.Mask:
        """The mask that `wave` finds where it does not know that the scene is covered."""
        return find_mask(self._segmenter, project(scene.images[HIGH], other_band=scene.images.get(LOW))).mask

    def add(self, kind: str, scene: LabelledScene, mask: ms.Mask | None = None) -> None:
        """Of a scene with both bands; in the mask that `wave` finds, or another."""
        image, other = scene.images[HIGH], scene.images.get(LOW)
        condition = "nlos" if scene.sight != "los" and mask is None else "los"
        given, nothing = self.given.setdefault(kind, []), self.nothing.setdefault(kind, 0)
        mask = mask or find_mask(self._segmenter, project(image, other_band=other), condition=condition).mask
        try:
            found = classify(image, mask, other_band=other, condition=condition, method=self._by)
        except InputError:  # nothing under the mask
            self.nothing[kind] = nothing + 1
            return
        given.append(Answer(found.novelty, found.label if found.sure else ""))
        print(f"{kind}: {scene.name}: {found!r}, novelty {found.novelty:.2f} {'; '.join(found.reasons)}", flush=True)


def scenes_of(root: Path, *, empty: bool) -> Iterator[LabelledScene]:
    dataset = datasets.open(root)
    for files in datasets.find_empties(dataset) if empty else datasets.find_scenes(dataset):
        yield files.read(truth="exact", view=False)


def add_lids(answers: Answers, scene: LabelledScene) -> None:
    """Of a scene in a shut carton."""
    lid = lid_of(scene)
    if lid is None:
        return
    answers.add("a lid", scene, lid)
    try:
        found = answers.untold(scene)
    except InputError:  # every mask is too large
        return
    if (found.inside & lid.inside).sum() > _ALIKE * (found.inside | lid.inside).sum():
        answers.add("a lid in wave's mask", scene, found)


def lid_of(scene: LabelledScene) -> ms.Mask | None:
    """The lid that is known to lie over a scene, as a mask; None: none was found."""
    image = scene.images[HIGH]
    sheets = sheets_in(image, frequency=HIGH_BAND, covered=True).sheets
    if not sheets:
        return None
    inside = sheets[0].box_on(image.grid.xy)
    return ms.Mask(grid_xy=image.grid.xy, inside=inside) if inside.any() else None


def share(count: int, of: int) -> str:
    low, high = wilson_interval(count, of)
    return f"{count} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"


def table(answers: Answers, limit: float) -> str:
    known = np.array([one.novelty for sight in ("in sight", "hidden") for one in answers.given.get(sight, ())])
    lines = [
        "| shown | nothing found | AUROC | refused as novel | sure answers | of a class but other |",
        "|---|---|---|---|---|---|",
    ]
    for kind, given in answers.given.items():
        novelty, total = np.array([one.novelty for one in given]), len(given) + answers.nothing[kind]
        area = "" if kind in ("in sight", "hidden") or not len(given) else f"{area_under_curve(known, novelty):.2f}"
        refused = share(int((novelty > limit).sum()), len(given)) if len(given) else ""
        sure, named = sum(bool(one.sure) for one in given), sum(one.sure not in ("", "other") for one in given)
        lines.append(
            f"| {kind} | {answers.nothing[kind]} of {total} | {area} | {refused} | {share(sure, total)} | {named} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--odd", type=Path)
    parser.add_argument("--newer", type=Path)
    parser.add_argument("--third", type=Path)
    parser.add_argument("--sparse", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    answers = Answers()
    for root in options.datasets:
        for scene in scenes_of(root, empty=False):
            answers.add("in sight" if scene.sight == "los" else "hidden", scene)
            if scene.sight != "los":
                add_lids(answers, scene)
        for scene in scenes_of(root, empty=True):
            answers.add("an empty carton", scene)
            add_lids(answers, scene)
    further = {
        "shapes of no class": options.odd, "newer ones": options.newer, "a third set": options.third,
        "sparse scans": options.sparse,
    }  # fmt: skip
    for kind, root in further.items():
        for scene in scenes_of(root, empty=False) if root else ():
            answers.add(kind, scene)
    text = table(answers, classifier().description["novelty"]["limit"])
    if options.output:
        options.output.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
