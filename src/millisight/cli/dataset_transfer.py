"""`millisight dataset download | push`: from and to the Hugging Face Hub and object stores."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from millisight import datasets
from millisight.cli.console import end_with_failures, in_options, progress, say
from millisight.cli.options import Objects
from millisight.core.errors import InputError


def download(
    output: Annotated[Path, typer.Argument(metavar="OUT", help="Output folder.")],
    objects: Objects = None,
    repo: Annotated[
        str,
        typer.Option(
            metavar="PLACE", help="OWNER/NAME on the Hugging Face Hub, or URL of an object store: s3://BUCKET/PREFIX."
        ),
    ] = "SignalKinetics/MITO_Dataset",
    revision: Annotated[str, typer.Option(help="Branch, tag or commit, on the hub.")] = "main",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would be downloaded, with sizes.")] = False,
    workers: Annotated[int, typer.Option(min=1, help="Number of parallel downloads.")] = 4,
) -> None:
    """Download the published dataset from the Hugging Face Hub. It holds processed files, no raw ones.

    Or download a dataset that was pushed, from the hub or an object store. Run it again to continue after an
    interruption.

    Example: millisight dataset download MITO_Dataset --object 004_sugar_box --object mug

    Example: millisight dataset download data --repo s3://BUCKET/PREFIX
    """
    settings = {"repository": repo, "revision": revision, "dry_run": dry_run, "workers": workers}
    with progress("download", compiles=False) as report:
        try:
            done = datasets.download(output, objects or [], progress=report, **settings)
        except ImportError as error:
            raise InputError(str(error)) from error
    say(f"{done.repository} at {done.commit}: {len(done.files)} files, {done.size / 1e6:.1f} MB; "
        f"{done.there} files existed already")  # fmt: skip
    if dry_run:
        _say_sizes(done.files)
        return
    say(f"wrote {output}")
    end_with_failures([f"{path}: {in_options(reason)}" for path, reason in done.failures])


def push(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Dataset that was generated or converted.")],
    repository: Annotated[
        str,
        typer.Argument(
            metavar="PLACE",
            help="OWNER/NAME on the Hugging Face Hub, made if missing; or URL of an object store: s3://BUCKET/PREFIX.",
        ),
    ],
    licence: Annotated[
        str | None, typer.Option("--license", help="Licence, by its name on the hub, such as cc-by-4.0.")
    ] = None,
    public: Annotated[
        bool,
        typer.Option("--public", help="Make a new repository on the hub public. [default: only its owner sees it]"),
    ] = False,
    revision: Annotated[str, typer.Option(help="Branch, on the hub.")] = "main",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the dataset card and what would be pushed; send nothing.")
    ] = False,
) -> None:
    """Push a dataset made here to the Hugging Face Hub. Its card says what is simulated, and how.

    Log in first: `hf auth login`. With a URL, push it to an object store, byte for byte. Run it again to continue after
    an interruption: what is there is not sent again.

    Example: millisight dataset push data OWNER/NAME --license cc-by-4.0 --dry-run

    Example: millisight dataset push data s3://BUCKET/PREFIX
    """
    with progress("push", compiles=False) as report:
        try:
            done = datasets.push(
                folder, repository, licence=licence, public=public, revision=revision, dry_run=dry_run, progress=report
            )
        except ImportError as error:
            raise InputError(str(error)) from error
    if dry_run and done.card:
        for line in done.card.splitlines():
            say(line)
    elif dry_run:
        _say_sizes(done.sent)
    for path in done.left_out:
        say(f"not pushed, since the manifest does not list it: {path}")
    if done.card and licence is None:
        say("note: the card names no licence, so nobody may use the data; choose one with --license")
    told = f"{done.repository}: {done.files} files, {done.size / 1e6:.1f} MB"
    told += f"; {done.there} files existed already" if done.there or not dry_run else ""
    say(f"{told}; nothing was sent" if dry_run else told)
    if not dry_run:
        say(f"pushed to {done.address}")


def _say_sizes(files: Iterable[tuple[str, int]]) -> None:
    """How much there is of every folder."""
    sizes: Counter[str] = Counter()
    for path, size in files:
        sizes[path.split("/")[0] if "/" in path else "."] += size
    for folder, size in sorted(sizes.items()):
        say(f"{folder}: {size / 1e6:.1f} MB")
