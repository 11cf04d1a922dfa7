"""What a dataset costs in three sizes: core-hours, bytes and money, as in docs/how-to/scale-out.md.

    python benchmarks/plan.py                                       the table, from the unit costs below
    python benchmarks/plan.py --dataset paper24 --core-seconds 3600     unit costs of a dataset that was made

Unit costs are of one capture, images included. A dataset's bytes are in its manifest; its core-seconds, user and
system, are what `/usr/bin/time -v millisight generate RECIPE.toml -o FOLDER` says; give them by --core-seconds.

    compute = captures x core-seconds / 3600 x price of a core-hour
    storage = captures x bytes / 1e9 x price of a GB-month
"""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from millisight.datasets import read_manifest


class Unit(NamedTuple):
    """Of one capture: what the table is made of."""

    core_seconds: float
    captures: float  # bytes that keep = "captures" leaves
    images: float  # bytes that keep = "images" leaves
    longest: float = 0.0  # seconds of the longest job, which no number of workers shortens


UNITS = {
    "reduced": Unit(20, 45e6, 4.3e6),  # measured: bench24.toml
    "half": Unit(30, 65e6, 13.5e6, 150),  # estimated: half of full, but for the images
    "full": Unit(60, 130e6, 13.5e6, 300),  # 24 captures of paper.toml measured, the rest by --dry-run
}
COUNTS = {"reduced": (10_000, 1_000_000), "half": (10_000, 1_000_000), "full": (912, 10_000, 1_000_000)}

CORE_HOUR = 0.01, 0.05  # US dollars, assumed: spare capacity, and on demand
GB_MONTH = 0.02  # US dollars, assumed: object storage

HEADER = (
    "", "captures", "core-hours", "100 workers", "1000 workers", "with captures", "images only", "compute",
    "captures, a month", "images, a month",
)  # fmt: skip


def rows() -> Iterable[Sequence[str]]:
    for size, counts in COUNTS.items():
        unit = UNITS[size]
        for count in counts:
            hours = count * unit.core_seconds / 3600
            kept = count * unit.captures, count * unit.images
            yield (
                size, f"{count:,}".replace(",", " "), whole(hours), wall(unit, hours, 100), wall(unit, hours, 1000),
                *map(size_of, kept), f"${whole(CORE_HOUR[0] * hours)} to {whole(CORE_HOUR[1] * hours)}",
                *(f"${whole(GB_MONTH * of / 1e9)}" for of in kept),
            )  # fmt: skip


def table() -> str:
    """In Markdown."""
    lines = [HEADER, ["---"] * len(HEADER), *rows()]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def whole(value: float) -> str:
    """Two digits, with a space between thousands."""
    digits = float(f"{value:.2g}")
    return f"{digits:,.0f}".replace(",", " ") if digits >= 10 else f"{digits:g}"


def wall(unit: Unit, hours: float, workers: int) -> str:
    """How long so many workers take."""
    return duration(max(hours / workers, unit.longest / 3600))


def duration(hours: float) -> str:
    if hours < 1:
        return f"{whole(60 * hours)} min"
    return f"{whole(hours)} h" if hours < 100 else f"{whole(hours / 24)} days"


def size_of(count: float) -> str:
    return f"{whole(count / 1e9)} GB" if count < 0.1e12 else f"{whole(count / 1e12)} TB"


def unit_of(folder: Path, core_seconds: float) -> str:
    """The unit costs of a dataset that was made; the work for empty scenes is shared by all captures."""
    manifest = read_manifest(folder)
    if manifest is None:
        raise SystemExit(f"{folder} has no manifest; expected a dataset made by `millisight generate`")
    entries = manifest.entries.values()
    images = [e for e in entries if e.kind == "image" and not e.path.partition("/")[0].endswith("_EMPTY")]
    if not images:
        raise SystemExit(f"{folder} holds no images")
    raw = sum(e.size for e in entries if e.kind == "raw")
    other = sum(e.size for e in entries if e.kind != "raw")
    return (
        f"{len(images)} captures with images: {core_seconds / len(images):.0f} core-seconds each, "
        f"{raw / len(images) / 1e6:.0f} MB of raw files or captures, {other / len(images) / 1e6:.1f} MB of all else"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", type=Path, metavar="FOLDER", help="print the unit costs of this dataset instead")
    parser.add_argument("--core-seconds", type=float, default=float("nan"), help="that it took, user and system")
    options = parser.parse_args()
    print(unit_of(options.dataset, options.core_seconds) if options.dataset else table())


if __name__ == "__main__":
    main()
