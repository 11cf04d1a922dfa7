"""`millisight generate`: a dataset from a recipe."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import end_with_failures, in_options, progress, say

if TYPE_CHECKING:
    from millisight.datasets.engine import Engine
    from millisight.datasets.generate import Plan


def generate(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="What the dataset is to hold.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="The dataset's folder. [default: the recipe's name, here]"),
    ] = None,
    meshes: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Real scans, named as in the YCB set: they take the places of shapes drawn in code."
        ),
    ] = None,
    scheduler: Annotated[
        str,
        typer.Option(
            help="processes: one a core. threads: one job at a time, on several cores. tcp://HOST:PORT: a Dask "
            "cluster, whose workers see DIR under the same path."
        ),
    ] = "processes",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes, or threads. [default: as many as cores, eight at most]")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the recipe, say what it would make and cost, and write nothing.")
    ] = False,
) -> None:
    """Make a dataset from a recipe: captures by the virtual rig, images by the paper's simulator, or both.

    Everything is checked and its cost told before the work begins. Run it again to go on after an interruption: what is
    done is kept. One job that fails does not stop the rest; the exit code is 1 if any failed. The same recipe gives the
    same files by whatever scheduler.

    Example: millisight generate examples/recipes/tiny.toml -o tiny --dry-run
    """
    from millisight.datasets.engine import engine_of
    from millisight.datasets.generate import carried_out, check_room, planned
    from millisight.datasets.recipefile import read_recipe
    from millisight.files import check_folder

    described = read_recipe(recipe)
    output = output or Path(described.name)
    check_folder(output)
    engine = engine_of(scheduler, workers)
    with progress("check the recipe") as report:
        plan = planned(described, output, meshes=meshes, engine=engine_of(), progress=report)
    for line in _summary(plan, engine):
        say(line)
    check_room(plan, engine.workers)
    if dry_run:
        return
    with progress("generate") as report:
        done = carried_out(plan, engine, progress=report)
    size = sum(entry.size for entry in done.manifest.entries.values())
    say(f"made {done.made} of {len(plan.jobs)} jobs, {done.kept} were done before; "
        f"{len(done.manifest.entries)} files, {size / 1e6:.1f} MB in {output}")  # fmt: skip
    if done.others:
        say(f"note: {len(done.others)} jobs of an earlier recipe are there still, such as {done.others[0]}")
    end_with_failures([f"{job}: {in_options(reason)}" for job, reason in done.failures])


def _summary(plan: "Plan", engine: "Engine") -> list[str]:
    """What there is to do, and what it will cost."""
    recipe, total = plan.recipe, plan.total(engine.workers)
    sources = [thing.source for thing in plan.things.values()]
    kinds = {"built": "drawn in code", "scan": "real scans", "file": "from files"}
    told = ", ".join(f"{sources.count(source)} {text}" for source, text in kinds.items() if source in sources)
    lines = [
        f"{recipe.name}: {len(plan.things)} objects ({told})",
        f"jobs: {len(plan.jobs)}, of which {len(plan.jobs) - len(plan.todo)} are done",
    ]
    if total.jobs:
        lines.append(
            f"estimate: {_duration(total.core_seconds)} of one core, {_duration(total.wall / engine.threads)} on "
            f"{engine.cores}; {_size(total.kept)}, and {_size(total.spool)} besides while it is made"
        )
    return lines


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _size(count: float) -> str:
    return f"{count / 1e6:.0f} MB" if count < 1e9 else f"{count / 1e9:.1f} GB"
