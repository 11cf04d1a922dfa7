"""One table of speed: before and now, the floor and the error; growth; other packages. For idle cores.

    git worktree add --detach ../before 1e60bb9
    python benchmarks/table.py --before ../before --out build/table.md
    python benchmarks/table.py --scale 0.02 --rounds 1 --rows r,s        a quick try; its figures mean little

or, with the same settings as variables:

    make bench TESTS=benchmarks/test_table.py BEFORE=../before

`--before` is a checkout of an older version; without it only today's is measured. Every measurement is a process of its
own, which warms up, works once by the clock and ends; versions take turns, and a ratio is the median of the pairs. Rows
whose step an old version cannot do say "–". What is measured, and how floors are counted, is in benchmarks/steps.py
and floors.py.

Other packages are compared where they are installed: `pip install fastsar==0.1.8`; torchbp is built from its sources.
`--others PYTHON` names the Python of an environment that has them, and what millisight needs. Progress goes to standard
error. At full size it takes some 25 minutes on two cores.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
NOW = HERE.parent

VERSIONS = {
    "rig": "rig: a mug, 77 GHz",
    "rig-carton": "rig: a mug in a carton, 77 GHz",
    "rig-whole": "rig: the same from 15 000 positions, a whole capture",
    "r": "R, the real-size image",
    "s-specular": "S, specular: signals and image",
    "s-edge": "S, edge: signals and image",
    "generate": "generate: four captures, one worker",
}
"""Steps that are measured before and now, and what the table calls them."""

GROWTH = {"1/16": 1 / 16, "1/4": 1 / 4, "1": 1.0, "4": 4.0}
"""Of R's pairs. `real_size` scales voxels and channels alike, so its scale is the square root."""

OTHERS = {"fastsar": "a part of R", "torchbp": "a plane, one antenna"}
HEADER = ("what", "before", "now", "ratio", "floor", "error")


def main(arguments: Sequence[str] | None = None) -> str:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, metavar="FOLDER", help="a checkout of an older version, to compare with")
    parser.add_argument("--scale", type=float, default=1.0, help="of all problems: 1 by default, 0.02 for a quick try")
    parser.add_argument("--rounds", type=int, default=3, help="pairs of processes, of which the median counts")
    parser.add_argument(
        "--rows", default="rig,r,s,generate,growth,others", help="which: these, by default all, separated by commas"
    )
    parser.add_argument("--others", default=sys.executable, metavar="PYTHON", help="that other packages are run by")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write the table, too")
    options = parser.parse_args(arguments)
    wanted = options.rows.split(",")
    known = ("rig", "r", "s", "generate", "growth", "others")
    if unknown := set(wanted) - set(known):
        parser.error(f"--rows {','.join(sorted(unknown))}; expected some of {','.join(known)}")
    if options.before and not (options.before / "src" / "millisight").is_dir():
        parser.error(f"--before {options.before} has no src/millisight; expected a checkout of millisight")
    rows: list[Sequence[str]] = []
    for step, title in VERSIONS.items():
        if step.partition("-")[0] in wanted:
            rows.append(compared(step, title, options.before, options.scale, options.rounds))
    if "growth" in wanted:
        rows += growth(options.scale, options.rounds)
    if "others" in wanted:
        rows += [beside(package, title, options.scale, options.others) for package, title in OTHERS.items()]
    text = markdown(rows)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text, encoding="utf-8")
    print(text)
    return text


def markdown(rows: Iterable[Sequence[str]]) -> str:
    lines = [HEADER, ["---"] * len(HEADER), *rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)


def run(script: str, *arguments: str, package: Path, python: str = sys.executable) -> dict[str, Any] | None:
    """What a script of this folder tells with the package in a folder; None where it fails."""
    environment = {**os.environ, "PYTHONPATH": str(package / "src")}
    environment |= {"OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [python, str(HERE / script), *arguments], capture_output=True, text=True, check=False, env=environment
    )
    told = f"{package.name or 'now'}: {script} {' '.join(arguments)}"
    if done.returncode:
        print(f"{told}: failed: {(done.stderr.strip() or 'no message').splitlines()[-1]}", file=sys.stderr, flush=True)
        return None
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    print(f"{told}: {answer}", file=sys.stderr, flush=True)
    return answer


def measured(step: str, scale: float, package: Path, *more: str) -> dict[str, Any] | None:
    return run("steps.py", step, "--scale", repr(scale), "--package", str(package.resolve()), *more, package=package)


def compared(step: str, title: str, before: Path | None, scale: float, rounds: int) -> Sequence[str]:
    """The row of a step: both versions in turn. Frames, floor and errors are those of the first round."""
    takes: dict[str, list[dict[str, Any] | None]] = {"before": [], "now": []}
    with tempfile.TemporaryDirectory() as folder:
        files = {name: Path(folder, f"{name}.npy") for name in takes}
        for number in range(rounds):
            # Who comes first changes, so that what warms the machine up favours none.
            for name in ("before", "now") if number % 2 == 0 else ("now", "before"):
                package = before if name == "before" else NOW
                if package is None or (takes[name] and takes[name][0] is None):
                    takes[name].append(None)
                    continue
                more = ["--frames", str(files[name])] if number == 0 else []
                if name == "now" and number == 0:
                    more += ["--errors", "--floor"]
                takes[name].append(measured(step, scale, package, *more))
        error = "–"
        if all(file.exists() for file in files.values()):
            error = frames_differ(*(np.load(file) for file in files.values()))
    first = takes["now"][0]
    if first is None:
        return title, *["–"] * (len(HEADER) - 1)
    if "errors" in first:
        error = " / ".join(f"{100 * e:.2f} %" for e in first["errors"])
    pairs = [(a["seconds"], b["seconds"]) for a, b in zip(*takes.values(), strict=True) if a and b]
    ratio = f"{np.median([a / b for a, b in pairs]):.2f}" if pairs else "–"
    return title, median(takes["before"]), median(takes["now"]), ratio, seconds(first["floor"]), error


def median(takes: Iterable[Mapping[str, Any] | None]) -> str:
    known = [take["seconds"] for take in takes if take]
    return seconds(float(np.median(known))) if known else "–"


def seconds(value: float) -> str:
    return f"{value:.3g} s" if value < 100 else f"{value:.0f} s"


def frames_differ(before: np.ndarray, now: np.ndarray) -> str:
    """How far frames (P, T, R, N) lie apart: as a whole, and of single channels in dB and degrees.

    Of a channel, the factor that takes one version's best to the other's. The weak ones, whose energy is less than a
    thousandth of the median, are left out.
    """
    if before.shape != now.shape:
        return "other frames"
    before, now = (frames.reshape(-1, frames.shape[-1]).astype(np.complex128) for frames in (before, now))
    energies = (abs(before) ** 2).sum(axis=1)
    strong = energies > 1e-3 * np.median(energies)
    factors = ((before.conj() * now).sum(axis=1)[strong]) / energies[strong]
    apart = np.linalg.norm(now - before) / np.linalg.norm(before)
    decibels = 20 * np.log10(np.abs(factors))
    return (
        f"{apart:.1e} of before's; a channel at most {np.abs(decibels).max():.1g} dB, "
        f"{np.degrees(np.abs(np.angle(factors))).max():.1g}°"
    )


def growth(scale: float, rounds: int) -> list[Sequence[str]]:
    """Rows of R at four sizes, in turn; the ratio is that to the size before, of four times fewer pairs."""
    takes: dict[str, list[dict[str, Any]]] = {name: [] for name in GROWTH}
    for number in range(rounds):
        for name, pairs in GROWTH.items():
            more = ["--errors", "--floor"] if number == 0 else []
            take = measured("r", scale * pairs**0.5, NOW, *more)
            if take is None:
                return [("growth of R", "–", "–", "–", "–", "–")]
            takes[name].append(take)
    rows: list[Sequence[str]] = []
    before: list[float] = []
    for name, some in takes.items():
        times = [take["seconds"] for take in some]
        steps = [b / a for a, b in zip(before, times, strict=True)] if before else []
        step = f"x {np.median(steps):.1f} for x 4 pairs" if steps else "–"
        error = " / ".join(f"{100 * e:.2f} %" for e in some[0]["errors"])
        rows.append((f"R, {name} of its pairs", "–", median(some), step, seconds(some[0]["floor"]), error))
        before = times
    return rows


def beside(package: str, title: str, scale: float, python: str) -> Sequence[str]:
    """The row of another package: theirs under `before`, ours under `now`, of a pair and core."""
    told = run("others.py", package, "--scale", repr(scale), package=NOW, python=python)
    name = f"direct backprojection of {title}: {package}, ours"
    if told is None or "missing" in told:
        return name, "failed" if told is None else "not installed", *["–"] * (len(HEADER) - 2)
    from floors import PAIR

    theirs, ours = (f"{told[key]:.2f} ns a pair" for key in ("theirs", "ours"))
    errors = " / ".join(f"{100 * e:.2f} %" for e in told["errors"])
    title = f"direct backprojection of {title}: {package} {told['version']}, ours"
    return title, theirs, ours, f"{told['ratio']:.1f}", f"{1e9 * PAIR:.2f} ns a pair", errors


if __name__ == "__main__":
    main()
