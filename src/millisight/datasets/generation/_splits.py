"""Who trains and who tests: splits of a dataset by object and by pose, in `splits.json`.

By object, whatever one has of an object goes to one side; siblings such as the cups 065-a to 065-j count as one. By
pose, every object is on all sides, but no pose of it: what was made of one pose, in whatever condition, by whatever
radar, rig or simulator, stays together.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from millisight.core import read_json, sha256_of, write_text
from millisight.datasets.generation._jobs import Job
from millisight.datasets.generation._recipe import Recipe, Shares
from millisight.datasets.generation._rig_job import RigJob
from millisight.io.mito import SPLITS_NAME, object_of

SIDES = ("train", "val", "test")
_CHECKSUM = "sha256"  # key: of all other keys


def split(names: Iterable[str], shares: Shares, seed: int) -> dict[str, str]:
    """Names to sides, in about these shares: every side that has a share has a name, where there are enough.

    The order in which names are dealt out follows from the seed and each name alone.
    """
    order = sorted(set(names), key=lambda name: hashlib.sha256(f"{seed}/{name}".encode()).digest())
    counts = _counts(len(order), [shares.train, shares.val, shares.test])
    sides = [side for side, count in zip(SIDES, counts, strict=True) for _ in range(count)]
    return dict(zip(order, sides, strict=True))


def _counts(total: int, shares: Sequence[float]) -> list[int]:
    """Whole numbers that add up to `total`, about in these shares, none 0 that need not be."""
    counts = [int(total * share) for share in shares]
    wanted = [i for i, share in enumerate(shares) if share > 0]
    while sum(counts) < total:
        i = max(wanted, key=lambda i: (counts[i] == 0, total * shares[i] - counts[i]))
        counts[i] += 1
    for i in wanted:
        richest = max(range(len(counts)), key=counts.__getitem__)
        if counts[i] == 0 and counts[richest] > 1:
            counts[i], counts[richest] = 1, counts[richest] - 1
    return counts


def family(folder: str) -> str:
    """What an object's folder has in common with its siblings': the number before the letter."""
    known = object_of(folder)
    number = known[0] if known else folder
    return folder if number == "000" else number.split("-")[0]


def splits_of(folders: Iterable[str], shares: Shares, seed: int) -> dict[str, dict[str, list[str]]]:
    """The folders of experiments and simulations, by way of splitting and side.

    Parameters
    ----------
    folders : `<id>_<name>/robot_collected/<angles>/exp<N>/<sight>`, `<id>_<name>/simulation/<angles>`; several objects
        of a scene stand in its name, one after the other with +. If these are on different sides, the scene is
        "mixed", on neither.
    shares, seed : as of `split`
    """
    folders = sorted(set(folders))
    families = {family(name) for folder in folders for name in _objects(folder)}
    of_family = split(families, shares, seed)
    angles: dict[str, set[str]] = {}
    for folder in folders:
        angles.setdefault(folder.split("/")[0], set()).add(folder.split("/")[2])
    of_pose = {name: split(turned, shares, seed) for name, turned in angles.items()}
    found: dict[str, dict[str, list[str]]] = {
        "by_object": {side: [] for side in (*SIDES, "mixed")},
        "by_pose": {side: [] for side in SIDES},
    }
    for folder in folders:
        sides = {of_family[family(name)] for name in _objects(folder)}
        found["by_object"][sides.pop() if len(sides) == 1 else "mixed"].append(folder)
        name, _, turned = folder.split("/")[:3]
        found["by_pose"][of_pose[name][turned]].append(folder)
    return found


def write_splits(out: Path, recipe: Recipe, jobs: Sequence[Job]) -> None:
    """Write `splits.json` of the jobs that are done; empty scenes are on no side.

    One that somebody has changed since it was written, as its own checksum tells, stays as it is.
    """
    if (out / SPLITS_NAME).exists() and not _is_ours(out / SPLITS_NAME):
        return
    folders = [job.folder for job in jobs if not isinstance(job, RigJob) or job.world.objects]
    shares = {side: getattr(recipe.splits, side) for side in SIDES}
    content = {"seed": recipe.seed, "shares": shares, **splits_of(folders, recipe.splits, recipe.seed)}
    write_text(out / SPLITS_NAME, json.dumps({**content, _CHECKSUM: _checksum(content)}, indent=1) + "\n")


def _is_ours(path: Path) -> bool:
    """Whether the splits at `path` are as they were written."""
    try:
        content = read_json(path)
        if content.keys() == {"seed", "shares", "by_object", "by_pose"}:  # of before there was a checksum
            return True
        return content.pop(_CHECKSUM) == _checksum(content)
    except ValueError:  # it was cut short, or is no JSON
        return True
    except (OSError, LookupError, TypeError, AttributeError, RecursionError):
        return False


def _checksum(content: dict[str, Any]) -> str:
    return sha256_of(json.dumps(content))


def _objects(folder: str) -> list[str]:
    return folder.split("/")[0].split("+")
