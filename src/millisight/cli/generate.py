"""`millisight generate`: a dataset from a recipe."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import duration, end_with_failures, in_options, progress, say

if TYPE_CHECKING:
    from millisight.datasets.generation import Engine, Plan


def generate(
    recipe: Annotated[
        Path, typer.Argument(metavar="RECIPE.toml", help="Recipe: objects, poses, radars and images to make.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Dataset folder. [default: the name of the recipe]"),
    ] = None,
    meshes: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of YCB scans, which replace the shapes of the catalogue."),
    ] = None,
    scheduler: Annotated[
        str,
        typer.Option(
            help="processes: one job per core. threads: one job at a time, all cores. tcp://HOST:PORT: a Dask cluster "
            "whose workers see DIR under the same path, or a store."
        ),
    ] = "processes",
    store: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Object store through which workers that do not see DIR hand over files: s3://BUCKET/PREFIX.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes or threads. [default: one per core, at most eight]")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the recipe, print the jobs and their cost, and write nothing.")
    ] = False,
) -> None:
    """Make a dataset from a recipe. It has captures by the virtual rig, images by the paper's simulator, or both.

    The recipe is checked and the cost printed before the work begins. Run it again to continue after an interruption:
    finished jobs are kept. A job that fails does not stop the rest; the exit code is 1 if any failed. The same recipe
    gives the same files with every scheduler.

    Example: millisight generate examples/recipes/tiny.toml -o tiny --dry-run

    Example: millisight generate RECIPE.toml -o data --scheduler tcp://HOST:8786 --store s3://BUCKET/PREFIX
    """
    from millisight.core import check_folder
    from millisight.datasets.generation import check_room, engine_of, plan_dataset, read_recipe, run_plan

    described = read_recipe(recipe)
    output = output or Path(described.name)
    check_folder(output)
    engine = engine_of(scheduler, workers)
    with progress("check the recipe") as report:
        plan = plan_dataset(described, output, meshes=meshes, engine=engine_of(), progress=report)
    for line in _summary(plan, engine):
        say(line)
    check_room(plan, engine.workers)
    if dry_run:
        return
    with progress("generate") as report:
        done = run_plan(plan, engine, store=store, progress=report)
    size = sum(entry.size for entry in done.manifest.entries.values())
    say(f"made {done.made} of {len(plan.jobs)} jobs; {done.kept} were done before; "
        f"{len(done.manifest.entries)} files, {size / 1e6:.1f} MB in {output}")  # fmt: skip
    if done.others:
        say(f"note: files of {len(done.others)} jobs of an earlier recipe remain, such as {done.others[0]}")
    end_with_failures([f"{job}: {in_options(reason)}" for job, reason in done.failures])


def _summary(plan: "Plan", engine: "Engine") -> list[str]:
    """Objects, jobs and cost of a plan."""
    recipe, total = plan.recipe, plan.total(engine.workers)
    sources = [thing.source for thing in plan.things.values()]
    kinds = {"built": "from the catalogue", "scan": "real scans", "file": "from files"}
    counts = ", ".join(f"{sources.count(source)} {text}" for source, text in kinds.items() if source in sources)
    lines = [
        f"{recipe.name}: {len(plan.things)} objects ({counts})",
        f"jobs: {len(plan.jobs)}, of which {len(plan.jobs) - len(plan.todo)} are done",
    ]

    def between(seconds: float) -> str:
        return " to ".join(dict.fromkeys(duration(factor * seconds) for factor in (total.low, total.high)))

    if total.jobs:
        lines.append(
            f"estimate: {between(total.core_seconds)} on one core, {between(total.wall / engine.threads)} on "
            f"{engine.cores}, where nothing else runs; {_size(total.kept)}, and {_size(total.spool)} of temporary files"
        )
    return lines


def _size(count: float) -> str:
    return f"{count / 1e6:.0f} MB" if count < 1e9 else f"{count / 1e9:.1f} GB"
