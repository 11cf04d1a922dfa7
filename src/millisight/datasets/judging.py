"""Many scenes judged by several segmenters, in several processes; what is done is kept, so that a run can go on."""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from millisight.datasets.kept import checksum_of, keep, kept, key_of
from millisight.datasets.scenes import SceneFiles, read_scene
from millisight.datasets.workers import each
from millisight.errors import InputError
from millisight.evaluation.masks import MaskScores
from millisight.evaluation.segmentation import Judge, Trial
from millisight.files import make_folder
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

    def plain(self, name: str) -> dict[str, Any]:
        """What of them a result of the segmenter of that name follows from, as JSON holds it."""
        options = dict(self.options.get(name, {}))
        return {"method": name, "options": options, "seeds": self.seeds, "reading": self.reading}


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
    network: str


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
    networks = {method: checksum_of(settings.segmenter(method)) for method in methods}
    jobs = [_Job(files, method, settings, networks[method]) for method in methods for files in scenes]
    places = [folder / f"{job.method}.{job.files.name.replace('/', '.')}.json" for job in jobs]
    keys = [_key(job) for job in jobs]
    found = {n: trials for n in range(len(jobs)) if (trials := kept(places[n], keys[n], _trials)) is not None}
    there, failures = len(found), []
    left = [n for n in range(len(jobs)) if n not in found]
    with closing(each(_judged, [jobs[n] for n in left], workers=workers)) as outcomes:
        for count, outcome in enumerate(outcomes, 1):
            n = left[outcome.number]
            if outcome.failure:
                failures.append((jobs[n].files.name, jobs[n].method, outcome.failure))
            else:
                found[n] = outcome.result
                plain = [dataclasses.asdict(one) | {"scores": list(one.scores)} for one in outcome.result]
                keep(places[n], keys[n], trials=plain)
            if progress is not None:
                progress(there + count, len(jobs))
    return Judged([one for n in sorted(found) for one in found[n]], sorted(failures), there)


def _judged(job: _Job) -> list[Trial]:
    by = job.settings.segmenter(job.method)
    if checksum_of(by) != job.network:
        raise InputError(f"the weights of {job.method} have changed since the run began; run it again")
    return Judge(by, read_scene(job.files, **job.settings.reading)).trials(job.settings.seeds)


def _key(job: _Job) -> str:
    return key_of(job.files.paths, format=_FORMAT, network=job.network, **job.settings.plain(job.method))


def _trials(content: dict[str, Any]) -> list[Trial]:
    """The trials that an earlier run kept."""
    return [Trial(**{**one, "scores": MaskScores(*one["scores"])}) for one in content["trials"]]
