"""`ms.evaluate`: a task on a dataset, in several processes; results are cached, so that a run can go on."""

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, cast

from millisight.core import (
    alone,
    each,
    file_version,
    files_under,
    make_folder,
    own_folder,
    printable,
    read_json,
    sha256_of,
    write_text,
)
from millisight.core.errors import FileError, InputError, MillisightError
from millisight.datasets import _mito
from millisight.datasets._dataset import Dataset
from millisight.datasets._find_scenes import DatasetFiles, find_empties, find_scenes
from millisight.evaluation import TASKS, EvaluationItem, EvaluationSet, Result, Task

Progress = Callable[[int, int], None]


def evaluate(
    task: str | Task,
    dataset: str | os.PathLike[str] | Dataset,
    *,
    output: str | os.PathLike[str] | None = None,
    objects: Iterable[str] = (),
    sight: str | None = None,
    experiment: int | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Result:
    """Evaluate simulated images, segmenters, classifiers, surfaces or poses on a dataset in the published layout.

    Of the published dataset, images that its authors leave out are left out, and named in the notes. A scene that
    cannot be read does not stop the others: see `Result.failures`. With an `output`, partial results are cached there.
    The next run reuses those with the same files, options and network weights.

    Parameters
    ----------
    task : "simulator", "segmentation", "classification", "surface", "pose", or the name of a plug-in's; or a task with
        its options
    dataset : folder, or a dataset from `ms.datasets.open`
    output : folder for `index.html`, tables as Markdown and CSV, and figures; None: nothing is written
    objects : ids, names or folders of objects; none: all
    sight : "los" or "nlos"; None: both
    experiment : N of `exp<N>`; None: all
    workers : number of processes; None: one per core, eight at most
    progress : called with (done, total)
    options : of the task; see `SimulatorTask`, `SegmentationTask`, `ClassificationTask`, `SurfaceTask`, `PoseTask`

    Raises
    ------
    UnknownNameError
        Unknown task, object, sight or method.
    InputError
        The task has no such option, or the options do not fit the data.
    FileError
        The dataset cannot be read; or the folder cannot be written, holds files of others, or another evaluation is at
        work there.
    """
    data = _opened(dataset, objects, sight, experiment)
    made = _task(task, options)
    _check_folder(output, made)
    planned = made.plan(data)
    planned = replace(planned, notes=(*data.notes, *planned.notes))
    if output is None:
        return _evaluated(made, planned, None, workers, progress)
    folder = own_folder(output)
    with alone(folder, printable(folder)):
        _check_folder(output, made)  # one that was at work may have ended since
        return _evaluated(made, planned, folder, workers, progress)


def _evaluated(
    task: Task, planned: EvaluationSet, folder: Path | None, workers: int | None, progress: Progress | None
) -> Result:
    """What comes out, written where there is a folder."""
    cache = None if folder is None else folder / task.cache
    run = run_items(task.run, planned.items, cache, workers=workers, progress=progress)
    try:
        result = _result(task, planned, run)
    except MillisightError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        # Kept results may be whole, and yet no results of this task: what somebody wrote there.
        if cache is None or not run.cached:
            raise
        for part in (part for item in planned.items for part in item.parts):
            (cache / f"{part}.json").unlink(missing_ok=True)
        result = _result(task, planned, run_items(task.run, planned.items, cache, workers=workers, progress=progress))
    if folder is not None and result.rows:
        result.save(folder)
    return result


def _result(task: Task, planned: EvaluationSet, run: "ItemRun") -> Result:
    rows = task.rows(planned, run.results)
    return Result(
        task=task,
        planned=planned,
        rows=tuple(rows),
        tables=task.tables(planned, rows) if rows else {},
        failures=(*planned.failures, *run.failures),
        cached=run.cached,
    )


def _check_folder(output: str | os.PathLike[str] | None, task: Task) -> None:
    """Raise InputError where the page of another kind of evaluation would be replaced."""
    if output is None:
        return
    for name in TASKS.names():
        if name != task.name and Path(output, f"{name}.md").is_file():
            raise InputError(
                f"{printable(output)} holds an evaluation of the kind {name!r}, whose page this one ({task.name!r}) "
                "would replace; choose another folder"
            )


def _opened(dataset: Any, objects: Iterable[str], sight: str | None, experiment: int | None = None) -> DatasetFiles:
    every = dataset if isinstance(dataset, Dataset) else _mito.open(dataset)
    names = list(objects)
    found = every.only(names)
    scenes = find_scenes(found, sight=sight, experiment=experiment, within=every)
    left_out = [scene.name for scene in scenes if not scene.used]
    empties = () if sight == "los" or names else find_empties(found)
    if not left_out:
        return DatasetFiles(dataset=found, scenes=scenes, empties=empties)
    told = f"the authors of the dataset leave out {', '.join(left_out)}"
    if len(left_out) == len(scenes):
        raise InputError(f"{printable(found.root)} has nothing to evaluate: {told}")
    scenes = tuple(scene for scene in scenes if scene.name not in left_out)
    return DatasetFiles(dataset=found, scenes=scenes, empties=empties, notes=(told,))


def _task(task: str | Task, options: Mapping[str, Any]) -> Task:
    if not isinstance(task, str):
        if options:
            raise InputError(f"{', '.join(options)}: give options to {type(task).__name__}, or the name of a task here")
        return task
    kind = TASKS[task]
    known = [one.name for one in fields(cast(Any, kind))]
    unknown = [name for name in options if name not in known]
    if unknown:
        raise InputError(f"task {task!r} has no option {', '.join(unknown)}; expected some of {', '.join(known)}")
    datasets = {name: options[name] for name in kind.datasets if options.get(name) is not None}
    return kind(**dict(options) | {name: _opened(one, (), None) for name, one in datasets.items()})


class ItemRun(NamedTuple):
    """Result of `run_items`.

    Attributes
    ----------
    results : by part, in the order of the items
    failures : (name, reason)
    cached : number of results that were there already
    """

    results: dict[str, Any]
    failures: list[tuple[str, str]]
    cached: int


def run_items(
    function: Callable[[EvaluationItem], Mapping[str, Any]],
    items: Sequence[EvaluationItem],
    folder: Path | None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> ItemRun:
    """Run a function on every item, in several processes; results are cached in `folder`, a file for each part.

    Parameters
    ----------
    function : gives the results of the item's parts, as JSON holds them; what a new process can import
    items : EvaluationItem
    folder : None: nothing is cached
    workers : number of processes; None: one per core, eight at most
    progress : called with (done, total) of the items that are not cached

    Raises
    ------
    FileError
        The folder cannot be written to.
    """
    keys = {part: _cache_key(item.paths, **settings) for item in items for part, settings in item.parts.items()}
    results: dict[str, Any] = dict.fromkeys(keys)
    if folder is not None:
        folder = make_folder(folder)
        results = {part: _read_cached(folder / f"{part}.json", key) for part, key in keys.items()}
    missing = [(item, {p: settings for p, settings in item.parts.items() if results[p] is None}) for item in items]
    left = [replace(item, parts=parts) for item, parts in missing if parts]
    cached, failures = sum(one is not None for one in results.values()), []
    with closing(each(function, left, workers=workers)) as outcomes:
        for count, (number, found, failure) in enumerate(outcomes, 1):
            if failure:
                failures.append((left[number].name, failure))
            else:
                results |= found
                if folder is not None:
                    for part in found:
                        _write_cached(folder / f"{part}.json", keys[part], found[part])
            if progress is not None:
                progress(count, len(left))
    return ItemRun({part: one for part, one in results.items() if one is not None}, failures, cached)


def _cache_key(paths: Iterable[Path], **settings: Any) -> str:
    """Of what a result follows from: files, those in a folder, too, known by size and times; settings; and the version
    of this package."""
    files = [file for path in paths for file in _files_at(path)]
    content = {
        "version": version("millisight"),
        "files": [file_version(path.stat()) if path.exists() else None for path in files],
        **settings,
    }
    return _checksum(content)


def _files_at(path: Path) -> list[Path]:
    try:
        return files_under(path) if path.is_dir() else [path]
    except FileError:  # as its scene will tell
        return [path]


def _write_cached(path: Path, key: str, result: Any) -> None:
    """Write a result, and the key by which it is known to be still true."""
    write_text(path, json.dumps({"key": key, "checksum": _checksum(result), "result": result}, indent=1))


def _read_cached(path: Path, key: str) -> Any:
    """The result of a file; None where there is none of this key, or the file is damaged."""
    try:
        content = read_json(path)
        result = content["result"]
        return result if (content["key"], content["checksum"]) == (key, _checksum(result)) else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _checksum(content: Any) -> str:
    return sha256_of(json.dumps(content, sort_keys=True))
