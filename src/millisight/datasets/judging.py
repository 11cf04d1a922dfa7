"""Many scenes judged by several segmenters, in several processes; what is done is kept, so that a run can go on."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from millisight.datasets.scenes import SceneFiles, read_scene
from millisight.datasets.workers import each
from millisight.errors import InputError
from millisight.evaluation.masks import MaskScores
from millisight.evaluation.segmentation import Judge, Trial
from millisight.files import make_folder, write_text
from millisight.perception.segmentation import Segmenter, segmenter
from millisight.records import put, record

_FORMAT = 1


@record
class Settings:
    """How scenes are judged.

    Attributes
    ----------
    seeds : of the prompts
    reading : for `read_scene`
    options : of segmenters, by their names
    """

    seeds: tuple[int, ...] = (0, 1, 2)
    reading: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    options: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        put(self, seeds=tuple(self.seeds), reading=dict(self.reading), options=dict(self.options))

    def segmenter(self, name: str) -> Segmenter:
        """The segmenter of that name with its options; one for all scenes of a process."""
        return _made(name, json.dumps(dict(self.options.get(name, {})), sort_keys=True))


@lru_cache(maxsize=2)
def _made(name: str, options: str) -> Segmenter:
    return segmenter(name, **json.loads(options))


class Judged(NamedTuple):
    """Trials, by method and scene; (scene, method, why) of what could not be judged; how many were there already."""

    trials: list[Trial]
    failures: list[tuple[str, str, str]]
    kept: int


class _Job(NamedTuple):
    files: SceneFiles
    method: str
    settings: Settings
    network: str | None


def judge(
    scenes: Sequence[SceneFiles],
    methods: Sequence[str],
    folder: Path,
    settings: Settings,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Judged:
    """Every segmenter on every scene; results go to `folder`, a file each, and are taken from there the next time.

    A scene that cannot be read is a failure of its own, and stops no other. A result is used again while the scene's
    files, the segmenter and the settings are the same.

    Parameters
    ----------
    workers : processes; None: one a core
    progress : called with (done, in all)

    Raises
    ------
    FileError
        The folder cannot be written to.
    """
    folder = make_folder(folder)
    networks = {method: _network(settings.segmenter(method)) for method in methods}
    jobs = [_Job(files, method, settings, networks[method]) for method in methods for files in scenes]
    places = [folder / f"{job.method}.{job.files.name.replace('/', '.')}.json" for job in jobs]
    keys = [_key(job) for job in jobs]
    found = {n: trials for n in range(len(jobs)) if (trials := _kept(places[n], keys[n])) is not None}
    kept, failures = len(found), []
    left = [n for n in range(len(jobs)) if n not in found]
    with closing(each(_judged, [jobs[n] for n in left], workers=workers)) as outcomes:
        for count, outcome in enumerate(outcomes, 1):
            n = left[outcome.number]
            if outcome.failure:
                failures.append((jobs[n].files.name, jobs[n].method, outcome.failure))
            else:
                found[n] = outcome.result
                plain = [dataclasses.asdict(one) | {"scores": list(one.scores)} for one in outcome.result]
                write_text(places[n], json.dumps({"key": keys[n], "trials": plain}, indent=1))
            if progress is not None:
                progress(kept + count, len(jobs))
    return Judged([one for n in sorted(found) for one in found[n]], sorted(failures), kept)


def _judged(job: _Job) -> list[Trial]:
    by = job.settings.segmenter(job.method)
    if _network(by) != job.network:
        raise InputError(f"the weights of {job.method} have changed since the run began; run it again")
    return Judge(by, read_scene(job.files, **job.settings.reading)).trials(job.settings.seeds)


def _network(by: Segmenter) -> str | None:
    """The checksum of its weights, where it has some."""
    return getattr(by, "description", {}).get("sha256")


def _key(job: _Job) -> str:
    """What the result follows from; files are known by size and time, networks by the checksum of their weights."""
    stats = [path.stat() if path.exists() else None for path in job.files.paths]
    content = {
        "format": _FORMAT,
        "version": version("millisight"),
        "method": job.method,
        "network": job.network,
        "options": dict(job.settings.options.get(job.method, {})),
        "seeds": job.settings.seeds,
        "reading": dict(job.settings.reading),
        "files": [(one.st_size, one.st_mtime_ns) if one else None for one in stats],
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _kept(place: Path, key: str) -> list[Trial] | None:
    """The trials of an earlier run; None where there are none of this key, or the file is damaged."""
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
        if content["key"] != key:
            return None
        return [Trial(**{**one, "scores": MaskScores(*one["scores"])}) for one in content["trials"]]
    except (OSError, ValueError, KeyError, TypeError):
        return None
