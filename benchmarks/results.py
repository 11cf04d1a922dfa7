"""The test that nothing here was made on, once a release: every figure of docs/explanation/results.md.

    python benchmarks/results.py DATASET [DATASET ...] --recipe examples/recipes/unseen.toml

The datasets are made by examples/recipes/unseen.toml, or by its parts unseen18.toml and unseen19.toml. Compares `wave`
with blind masks, and with the one threshold that suits these very images best; counts the empty cartons in which
nothing is found; and classifies what was found. The page states date, commit, weights and number of scenes.
"""

import argparse
import dataclasses
import datetime
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import millisight as ms
from millisight import datasets
from millisight.evaluation import HIGH, SIGHTS, accuracy, bootstrap_interval, confusion, score_mask, wilson_interval
from millisight.meshes import PAPER_CLASSES
from millisight.perception import project, without_sheets
from millisight.perception.classification import classifier
from millisight.perception.segmentation import WaveSegmenter

LEVELS = np.round(np.arange(0.05, 0.95, 0.05), 2)
SEEN = ("raw", "cleaned")


def thresholds(roots: Sequence[Path]) -> dict[tuple[str, str, float], dict[str, float]]:
    """F1 of the mask above each level of the projected 77 GHz image, by sight, kind of image and level; by scene."""
    found: dict[tuple[str, str, float], dict[str, float]] = {}
    for root in roots:
        for files in datasets.find_scenes(datasets.open(root)):
            scene = files.read(truth="exact", view=False)
            image, truth = scene.images[HIGH], scene.truth[HIGH]
            cleaned = without_sheets(image, covered=scene.sight != "los")  # as `wave` has it
            for kind, one in zip(SEEN, (image, cleaned), strict=True):
                power = project(one).power
                for level in LEVELS:
                    mask = ms.Mask(grid_xy=truth.grid_xy, inside=power > level)
                    scores = found.setdefault((scene.sight, kind, float(level)), {})
                    scores[f"{root.name}/{scene.name}"] = score_mask(mask, truth).f1
    return found


def figure(values: Iterable[float]) -> str:
    """A median of shares in percent with its 95 % interval."""
    some = 100 * np.array(list(values))
    low, high = bootstrap_interval(some, np.median, rng=0)
    return f"{np.median(some):.1f} ({low:.1f} to {high:.1f})"


def share(right: int, count: int) -> str:
    """A share in percent with Wilson's interval."""
    low, high = wilson_interval(right, count)
    return f"{right} of {count}: {100 * right / count:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def difference(one: dict[str, float], other: dict[str, float]) -> str:
    """Mean paired difference in points with its interval."""
    values = 100 * np.array([one[name] - other[name] for name in one])
    low, high = bootstrap_interval(values, np.mean, rng=0)
    return f"{values.mean():+.1f} ({low:+.1f} to {high:+.1f})"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in lines)


def trials(roots: Sequence[Path], cache: Path, methods: Sequence[str], **options: Any) -> list[tuple[Path, Any]]:
    """The masks of these segmenters, and those of what does not look."""
    rows: list[tuple[Path, Any]] = []
    for root in roots:
        result = ms.evaluate(
            "segmentation", root, output=cache / root.name, methods=methods, seeds=1, truth="exact", failures=4,
            workers=2, **options,
        )  # fmt: skip
        if result.failures:
            sys.exit(f"{root}: {result.failures}")
        rows += [(root, one) for one in result.rows]
    return rows


def segmentation(roots: Sequence[Path], cache: Path, support: float | None) -> str:
    """The tables of masks; where the height of what the objects stand on is given, also those that use it."""
    rows = trials(roots, cache, ("wave", "threshold"))
    if support is not None:
        rows += [
            (root, dataclasses.replace(one, method="wave, support told"))
            for root, one in trials(roots, cache / "support", ("wave",), support=support)
            if one.method == "wave"
        ]
    levels, text = thresholds(roots), []
    for sight, words in SIGHTS.items():
        mine = [(root, one) for root, one in rows if one.sight == sight]
        if not mine:
            continue
        kinds = dict.fromkeys((one.method, one.input) for _, one in mine)
        by_kind = {
            kind: {f"{root.name}/{one.scene}": one.scores for root, one in mine if (one.method, one.input) == kind}
            for kind in kinds
        }
        f1 = {kind: {name: scores.f1 for name, scores in scored.items()} for kind, scored in by_kind.items()}
        best = max((key for key in levels if key[0] == sight), key=lambda key: np.median(list(levels[key].values())))
        lines = []
        for kind, scored in by_kind.items():
            cells = [figure(s[m] for s in scored.values()) for m in ("f1", "precision", "recall", "iou")]
            lines.append((kind[0], "none" if kind[0].startswith("blind") else kind[1], *cells))
        lines.append((f"best single threshold: {best[2]:g} of the maximum, {best[1]}", HIGH,
                      figure(levels[best].values()), "", "", ""))  # fmt: skip
        scenes, objects = len(by_kind["wave", HIGH]), len({one.object for _, one in mine})
        text.append(f"### {words.capitalize()}: {scenes} scenes of {objects} objects\n")
        text.append(table(("segmenter", "input", "F1 [%]", "precision", "recall", "IoU"), lines) + "\n")
        medians = {kind: np.median(list(values.values())) for kind, values in f1.items()}
        blind = max((kind for kind in kinds if kind[0].startswith("blind")), key=lambda kind: medians[kind])
        compared = [(str(kind[1]), kind) for kind in kinds if kind[0] == "wave"]
        header = "wave on", f"over the best blind mask ({blind[0]}) [points]", "over the best single threshold [points]"
        gains = [(name, difference(f1[kind], f1[blind]), difference(f1[kind], levels[best])) for name, kind in compared]
        text.append(table(header, gains) + "\n")
        if sight == "nlos":
            worst = sorted(f1["wave", HIGH].items(), key=lambda item: item[1])[:5]
            named = ", ".join(f"{name.split('/')[1]} {100 * value:.0f} %" for name, value in worst)
            text.append(f"The worst at 77 GHz: {named}.\n")
    empty = [(root, one) for root, one in rows if one.sight == "empty" and not one.method.startswith("blind")]
    if empty:
        text.append("### Empty cartons\n")
        kinds = dict.fromkeys((one.method, one.input) for _, one in empty)
        counted = []
        for kind in kinds:
            found = [one.scores.f1 == 1 for _, one in empty if (one.method, one.input) == kind]
            counted.append((*kind, share(sum(found), len(found))))
        text.append(table(("segmenter", "input", "nothing found"), counted) + "\n")
    if len(roots) > 1:
        text.append("### Each dataset by itself\n")
        text.append("Where a dataset was measured before, rules of today may have been kept because of it.\n")
        text.append(by_dataset(rows) + "\n")
    return "\n".join(text)


def by_dataset(rows: Sequence[tuple[Path, Any]]) -> str:
    """What `wave` reaches in each dataset: some may have been measured before, and others never."""
    lines = []
    for root in dict.fromkeys(root for root, _ in rows):
        for kind in dict.fromkeys(one.input for _, one in rows if one.method == "wave"):
            mine = [one for at, one in rows if at == root and one.method == "wave" and one.input == kind]
            f1 = {sight: [one.scores.f1 for one in mine if one.sight == sight] for sight in (*SIGHTS, "empty")}
            cells = [figure(f1[sight]) if f1[sight] else "" for sight in SIGHTS]
            empty = share(f1["empty"].count(1), len(f1["empty"])) if f1["empty"] else ""
            lines.append((root.name, kind, *cells, empty))
    header = ("dataset", "wave on", *(f"F1 {words} [%]" for words in SIGHTS.values()), "empty: nothing found")
    return table(header, lines)


def classification(roots: Sequence[Path], cache: Path, classes: Sequence[str]) -> str:
    """The table of classes, and what each class was taken for; of objects of these classes, none: of all."""
    rows: list[Any] = []
    by_root: dict[str, list[Any]] = {}
    for root in roots:
        result = ms.evaluate(
            "classification", root, output=cache / f"{root.name}-classes", truth="exact", mistakes=0, workers=2,
            classes=classes,
        )  # fmt: skip
        rows += result.rows
        by_root[root.name] = [one for one in result.rows if one.masks == "predicted"]
    lines = []
    alone = [(f"predicted, {name}", some) for name, some in by_root.items() if len(by_root) > 1]
    together = [(masks, [one for one in rows if one.masks == masks]) for masks in ("predicted", "true")]
    for masks, some in (*together, *alone):
        for sight in (*SIGHTS, None):
            mine = [one for one in some if sight in (None, one.sight)]
            every = accuracy(mine)
            if every is None:
                continue
            right = share(every.right, every.images)
            if every.by_object is not None:
                low, high = every.by_object
                right += f" [{100 * low:.0f} to {100 * high:.0f}]"
            sure = accuracy([one for one in mine if one.prediction is not None and one.prediction.sure])
            told = share(sure.right, sure.images) if sure else "none sure"
            blind = f"{100 * max(Counter(one.truth for one in mine).values()) / every.images:.0f} %"
            lines.append((masks, SIGHTS.get(sight or "", "all"), every.objects, right, told, blind))
    header = ("masks", "sight", "objects", "right", "right where sure", "blind: always the most frequent class")
    answers = [one for one in rows if one.masks == "predicted"]
    found = confusion(answers)
    names = [(truth, *counts) for truth, counts in zip(found.truths, found.counts.tolist(), strict=True)]
    return f"{table(header, lines)}\n\nIn predicted masks, the truth by rows:\n\n{table(('', *found.answers), names)}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/explanation/results.md"))
    parser.add_argument(
        "--recipe",
        nargs="+",
        action="extend",
        help="that the datasets were made by [default: examples/recipes/unseen.toml]",
    )
    parser.add_argument("--support", type=float, help="height of what the objects stand on [m]")
    options = parser.parse_args()
    recipes = " and ".join(f"`{recipe}`" for recipe in options.recipe or ["examples/recipes/unseen.toml"])
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
    weights = {"wave": WaveSegmenter().description["sha256"][:8], "classifier": classifier().description["sha256"][:8]}
    with tempfile.TemporaryDirectory() as cache:
        masks = segmentation(options.datasets, Path(cache), options.support)
        four, seven = (classification(options.datasets, Path(cache), names) for names in (PAPER_CLASSES, ()))
    told = ", ".join(f"{name} {checksum}" for name, checksum in weights.items())
    page = f"""# Results on objects that nothing was made on

Made on {datetime.date.today().isoformat()} at commit {commit.stdout.strip()} by `python benchmarks/results.py`,
weights {told}.

Whole scenes by the virtual rig, simulated, not real: objects that no network, threshold or look used (`test` of
`examples/objects.toml`), off the middle of images that show 9 to 15 cm around them; cartons of random size, thickness,
place and tilt of the lid, drawn by {recipes}. Networks were trained on other objects by other
physics. Medians over scenes; in brackets 95 % bootstrap intervals. "Support told": `--support`, the height of what the
objects stand on, is known. Of other segmenters, `threshold` marks what is brighter than one level, chosen on training
scenes, in the first image given, sheets taken off; the best single threshold is chosen with the truth of these very
images, at 77 GHz. The blind masks are the largest ellipse in the image, a disc of 10 cm in its middle, the middle half
of its width and height, and all of it. Gains are means over scenes of paired differences, not differences of medians.
The classifier's probabilities count with how often each class occurs among the published list's 76 objects.

## Masks

{masks}
## Classes

In round brackets Wilson's 95 % intervals, in square brackets those of a bootstrap over objects.

### The paper's four classes

Objects of other classes are left out, and the answer is one of the four.

{four}
### The published dataset's classes, and others

{seven}"""
    temporary = options.output.with_suffix(".tmp")
    temporary.write_text(page)
    os.replace(temporary, options.output)
    print(page)


if __name__ == "__main__":
    main()
