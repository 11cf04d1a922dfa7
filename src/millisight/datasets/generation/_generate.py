"""A dataset from a recipe: planned, checked, its cost told, then made on any engine, and resumable at any point."""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from functools import partial
from itertools import count
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import attempt, make_folder, printable, record, sha256_of
from millisight.core.errors import FileError, InputError
from millisight.datasets import DatasetObject, Manifest, ManifestEntry, prepare_objects
from millisight.datasets.generation._card import write_card
from millisight.datasets.generation._cost import Cost, Remaining, Slowness, Total, slowness, slowness_of, total
from millisight.datasets.generation._engine import Engine
from millisight.datasets.generation._jobs import Job, jobs_of
from millisight.datasets.generation._ledger import Ledger
from millisight.datasets.generation._recipe import Recipe
from millisight.datasets.generation._relay import Relay
from millisight.datasets.generation._rig_job import PHYSICS as RIG_PHYSICS
from millisight.datasets.generation._rig_job import RigJob
from millisight.datasets.generation._simulator_job import PHYSICS as SIMULATOR_PHYSICS
from millisight.datasets.generation._splits import write_splits
from millisight.datasets.generation._work import PARTIAL_NAME, description_of, entry_of, make_in_place, version
from millisight.io import SCHEMA_VERSION

Progress = Callable[[int, int], None]

_VERSION = 1  # of the generator: another one, and everything is made anew
_SHOWN = 5  # problems of a recipe
_MUCH = 600.0  # core-seconds, from which on scans of the recipe are tried
_SAMPLES, _MOST, _EACH = 5, 24, 80.0  # how many, at least and at most; core-seconds that one stands for
_FEW = 10  # jobs that one process has checked before others have started


@record
class Plan:
    """The jobs of a dataset.

    Attributes
    ----------
    recipe, out : Recipe, and the dataset's folder
    things : its objects by name
    jobs : all of them
    todo : those that are not done already
    costs : of these
    texts : of all jobs' descriptions, by key
    slowness : Slowness of this machine; all 1 where it was not measured
    """

    recipe: Recipe
    out: Path
    things: Mapping[str, DatasetObject]
    jobs: tuple[Job, ...]
    todo: tuple[Job, ...]
    costs: tuple[Cost, ...]
    texts: Mapping[str, str]
    slowness: Slowness
    ledger: Ledger

    def total(self, workers: int) -> Total:
        """Total cost for a number of workers with one core each, with the range in which the times are likely to be."""
        return total(self.costs, workers, self.slowness)


@record
class Generated:
    """What came of a plan."""

    manifest: Manifest  # of all that is in the dataset now
    made: int  # jobs
    kept: int  # jobs that were done already
    failures: tuple[tuple[str, str], ...]  # (job, why it was not done)
    others: tuple[str, ...]  # jobs of an earlier recipe whose files are there still


def plan_dataset(
    recipe: Recipe,
    out: str | os.PathLike[str],
    *,
    meshes: str | os.PathLike[str] | None = None,
    engine: Engine | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Plan the jobs of a recipe: check each, and find those that are done.

    Parameters
    ----------
    recipe : Recipe
    out : the dataset's folder, which is only read; valid results of an earlier run are kept
    meshes : folder of real scans, which replace shapes of the catalogue
    engine : checks the jobs, on this machine; None: this process
    progress : called with (done, total) of jobs to check and of scans that are tried

    Raises
    ------
    InputError
        Jobs are impossible; the message lists the first and the reason.
    FormatError, FileError, MeshError, UnknownNameError
        The recipe, a mesh or the folder cannot be used.
    """
    out = Path(out)
    ledger = Ledger(out, {"generator": _VERSION, "recipe": recipe.name, "seed": recipe.seed})
    things = prepare_objects(recipe, meshes=meshes)
    jobs = jobs_of(recipe, things)
    texts = _texts(recipe, jobs)
    todo = tuple(job for job in jobs if not ledger.kept(description_of(job), sha256_of(texts[job.key])))
    with tempfile.TemporaryDirectory() as workspace:
        for thing in things.values():
            thing.write(Path(workspace))
        here = Engine("threads", 1, 1) if engine is None or len(todo) < _FEW else engine
        # Scans are tried after all jobs are checked, for about as long.
        checked = None if progress is None else lambda done, jobs: progress(done, 2 * jobs)
        costs, problems = _checked(todo, Path(workspace), here, checked)
        slow = Slowness() if problems else _slowness(todo, costs, Path(workspace), checked)
    if problems:
        more = f"; and {len(problems) - _SHOWN} more" if len(problems) > _SHOWN else ""
        raise InputError(f"{recipe.source}: cannot be generated: {'; '.join(problems[:_SHOWN])}{more}")
    return Plan(
        recipe=recipe, out=out, things=things, jobs=jobs, todo=todo, costs=costs, texts=texts, ledger=ledger,
        slowness=slow,
    )  # fmt: skip


def _slowness(todo: Sequence[Job], costs: Sequence[Cost], root: Path, progress: Progress | None) -> Slowness:
    """Of this machine: by a few scans of the recipe, each of which stands for as much of the work, or where there is
    little to do by a small one."""
    rig = [(job, cost.seconds) for job, cost in zip(todo, costs, strict=True) if isinstance(job, RigJob)]
    if not rig:
        return Slowness()
    rig.sort(key=lambda pair: pair[1])
    until = np.cumsum([seconds for _, seconds in rig])
    if until[-1] < _MUCH:
        return slowness()
    tried = int(np.clip(until[-1] / _EACH, _SAMPLES, _MOST))
    picks = np.searchsorted(until, until[-1] * (np.arange(tried) + 0.5) / tried)
    done = count(1)
    return slowness_of(
        ((rig[pick][0].stage(root), rig[pick][1]) for pick in picks),
        lambda: progress and progress(len(todo) + len(todo) * next(done) // tried, len(todo)),
    )


def _checked(
    jobs: Sequence[Job], root: Path, engine: Engine, progress: Progress | None
) -> tuple[tuple[Cost, ...], list[str]]:
    """What each job will cost; and why some are impossible."""
    costs: dict[int, Cost] = {}
    problems: dict[int, str] = {}
    with closing(engine.run(methodcaller("check", root), jobs)) as outcomes:
        for count, outcome in enumerate(outcomes, 1):
            if outcome.failure:
                problems[outcome.number] = f"{jobs[outcome.number].key}: {outcome.failure}"
            else:
                costs[outcome.number] = outcome.result
            if progress is not None:
                progress(count, len(jobs))
    return tuple(costs[i] for i in sorted(costs)), [problems[i] for i in sorted(problems)]


def run_plan(plan: Plan, engine: Engine, *, store: str | None = None, progress: Progress | None = None) -> Generated:
    """Run the jobs of a plan; a job that fails does not stop the others, and finished jobs are kept.

    After an interruption, make a new plan to run the remaining jobs. The final bytes are the same as without
    interruption, with every engine.

    Parameters
    ----------
    plan : as `plan_dataset` in the dataset's own folder
    engine : runs the jobs
    store : URL of an object store, such as s3://bucket/prefix, through which workers get meshes and hand over files;
        for a cluster whose workers do not see the dataset's folder. None: they see it under the same path
    progress : called with (core-seconds done, core-seconds in all): those done as measured, the others estimated,
        and corrected by what finished jobs of their kind took

    Raises
    ------
    FileError
        There is not enough disk space, another run is using the folder, or the store cannot be used.
    DeviceError
        The package for the store is not installed: `pip install "millisight[store]"`.
    """
    check_room(plan, engine.workers)
    relay = None if store is None else Relay(store, plan.out)
    failures: dict[str, str] = {}
    costs = {job.key: cost.seconds for job, cost in zip(plan.todo, plan.costs, strict=True)}
    remaining = Remaining({job.key: (_kind_of(job), costs[job.key]) for job in plan.todo}, plan.slowness.median)
    expensive_first = sorted(plan.todo, key=lambda job: (-costs[job.key], job.key))
    with plan.ledger.writing():
        shutil.rmtree(plan.out / PARTIAL_NAME, ignore_errors=True)
        make_folder(plan.out / PARTIAL_NAME)
        for thing in plan.things.values():
            thing.write(plan.out, plan.ledger.listed)
        try:
            for phase in (True, False):  # the empty scenes first: others subtract them
                jobs = [job for job in expensive_first if _is_empty(job) == phase]
                with closing(_done(plan, engine, jobs, relay)) as outcomes:
                    for job, entries, took, failure in outcomes:
                        if failure:
                            failures[job.key] = failure
                        else:
                            plan.ledger.add(entries)
                        count = remaining.finish(job.key, took)
                        if progress is not None:
                            progress(*count)
        finally:
            if relay is not None:
                relay.close()
            shutil.rmtree(plan.out / PARTIAL_NAME, ignore_errors=True)
            manifest = _closed(plan)
    return Generated(
        manifest=manifest,
        made=len(plan.todo) - len(failures),
        kept=len(plan.jobs) - len(plan.todo),
        failures=tuple(sorted(failures.items())),
        others=tuple(plan.ledger.others(map(description_of, plan.jobs))),
    )


def _done(
    plan: Plan, engine: Engine, jobs: Sequence[Job], relay: Relay | None
) -> Generator[tuple[Job, Sequence[ManifestEntry], float | None, str], None, None]:
    """Jobs as they are done: the files that each tells of, the processor time it took [s], and why it failed."""
    if relay is None:
        function = partial(make_in_place, plan.out.absolute(), version())
        items = [(job, plan.texts[job.key], plan.ledger.known(job.folders)) for job in jobs]
    else:
        function, items = relay.work(jobs, plan.texts)
    with closing(engine.run(function, items)) as outcomes:
        for number, result, failure in outcomes:
            entries, took = result or ((), None)
            if relay is not None and not failure:
                job = jobs[number]
                entries, failure = attempt(partial(relay.take, job, plan.ledger.known(job.folders)), entries)
            yield jobs[number], entries, took, failure


def check_room(plan: Plan, workers: int) -> None:
    """Refuse a plan that needs more disk space than there is.

    Raises
    ------
    FileError
    """
    place = next(folder for folder in (plan.out.absolute(), *plan.out.absolute().parents) if folder.exists())
    free, needed = shutil.disk_usage(place).free, plan.total(workers)
    if free < needed.kept + needed.spool:
        raise FileError(
            f"{printable(plan.out)}: the disk has {free / 1e6:.0f} MB left; the dataset needs {needed.kept / 1e6:.0f} "
            f"MB, and {needed.spool / 1e6:.0f} MB more while it is made: free some space, or keep fewer files "
            "(rig.keep)"
        )


def _closed(plan: Plan) -> Manifest:
    """The manifest, card and splits of what is there."""
    meshes = [entry_of(plan.out, thing.path, "mesh", ()) for thing in plan.things.values()]
    manifest = plan.ledger.close([description_of(job) for job in plan.jobs], meshes)
    made = [job for job in plan.jobs if description_of(job) in manifest.entries]
    write_splits(plan.out, plan.recipe, made)
    write_card(plan.out, plan.recipe, plan.things.values(), made, manifest)
    return manifest


def _is_empty(job: Job) -> bool:
    return isinstance(job, RigJob) and not job.world.objects


def _kind_of(job: Job) -> str:
    """Jobs of one kind err alike in what they are estimated to take."""
    return f"{type(job).__name__} {job.radars if isinstance(job, RigJob) else job.radar}"


def _made_by(recipe: Recipe, job: Job) -> dict[str, Any]:
    """Provenance, as every file tells it that has room for it."""
    return {
        "simulated": True,
        "physics": RIG_PHYSICS if isinstance(job, RigJob) else SIMULATOR_PHYSICS,
        "made_by": f"millisight generate {version()}",
        "dataset": recipe.name,
        "job": job.key,
    }


def _texts(recipe: Recipe, jobs: Sequence[Job]) -> dict[str, str]:
    """Of each job the text of its description: all that its files follow from, those of the empty scenes too."""
    texts: dict[str, str] = {}
    empty: dict[str, str] = {}
    for job in jobs:
        described = {"made_by": _made_by(recipe, job), "generator": _VERSION, "schema": SCHEMA_VERSION}
        described |= job.description()
        if isinstance(job, RigJob):
            described["empty"] = {radar: [folder, empty[f"{folder}/{radar}"]] for radar, folder in job.empty.items()}
        texts[job.key] = json.dumps(described, indent=1, sort_keys=True) + "\n"
        if isinstance(job, RigJob) and _is_empty(job):
            empty |= {f"{job.folder}/{radar}": sha256_of(texts[job.key]) for radar in job.radars}
    return texts
