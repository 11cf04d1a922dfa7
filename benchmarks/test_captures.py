"""Measured captures by others (examples/captures): `fast` is never slower than `backprojection` by more than 10 %.

    MILLISIGHT_CAPTURES=FOLDER make bench TESTS=benchmarks/test_captures.py

FOLDER holds the files that the descriptions name; beside the repository they are found by themselves. Both are timed in
turn, at least twice and for ten seconds or more, and the least of seconds of all threads is compared, which other work
on the machine changes least.
"""

import os
import time
from pathlib import Path

import pytest

import millisight as ms
from millisight.calibration import read_capture

HERE = Path(__file__).resolve()
DATA = Path(os.environ.get("MILLISIGHT_CAPTURES", HERE.parents[2] / "shared" / "data" / "captures"))
FOLDERS = {"letter_r": ".", "foam": ".", "aeroplane": ".", "phantom": "merit"}
LEAST_ROUNDS, LEAST_SECONDS = 2, 10


def seconds(capture, grid, method):
    start = time.process_time()
    image = ms.form_image(capture, grid, method=method)
    return time.process_time() - start, image


@pytest.mark.parametrize("name", FOLDERS)
def test_fast_is_no_slower(name):
    try:
        capture = read_capture(HERE.parents[1] / "examples" / "captures" / f"{name}.toml", data=DATA / FOLDERS[name])
    except FileNotFoundError:
        pytest.skip(f"needs the files of {name}.toml in MILLISIGHT_CAPTURES")
    grid = ms.grid_around(capture)
    taken = {"fast": [], "backprojection": []}
    for method in taken:
        _, image = seconds(capture, grid, method)  # compiles
        if method == "fast":
            done_by = image.metadata["history"][-1]["done_by"]
    while len(taken["fast"]) < LEAST_ROUNDS or sum(map(sum, taken.values())) < LEAST_SECONDS:
        for method, times in taken.items():
            times.append(seconds(capture, grid, method)[0])
    fast, direct = (min(times) for times in taken.values())
    print(
        f"\n| {name} | {grid.size} | {capture.channels} | {fast:.3f} s | {direct:.3f} s | {fast / direct:.2f} "
        f"| {done_by} |"
    )
    assert fast < 1.1 * direct
