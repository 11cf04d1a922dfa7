"""The live image at full size: how far it is behind an arm that passes 100 poses a second.

    python benchmarks/live.py

Rows of problem R (see problems.py), 100 poses each, come once a second, 109 of them; the image has 1.2 million voxels.
Reports the lag of each image and the last image's error against the one made afterwards from the whole capture.
"""

import argparse
import threading
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from problems import real_size

import millisight as ms
from millisight.rig import LiveImaging, Recording

POSES = 100  # of a row
FRAMES_A_SECOND = 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=109)
    rows = parser.parse_args().rows
    capture, grid = real_size()
    path = capture.trajectory
    taken = np.arange(len(path)) / FRAMES_A_SECOND
    writer = SimpleNamespace(
        path=Path("nowhere"),
        recording=lambda radars: nullcontext(),
        rows_done=0,
        add_row=lambda *_: None,
        end_row=lambda _: None,
        finish=lambda: None,
    )
    radar = SimpleNamespace(radar=capture.radar, name="77_ghz", mount=np.zeros(3))
    part, small = real_size(1 / 64)
    ms.form_image(part, small)  # compile
    statuses = []
    live = LiveImaging(writer, {"77_ghz": grid}, shown=statuses.append)
    print(f"{rows} rows of {POSES} poses, {FRAMES_A_SECOND} a second; threads: {threading.active_count()}", flush=True)
    with live.recording([radar]):
        began = time.monotonic()
        for row in range(rows):
            some = slice(row * POSES, (row + 1) * POSES)
            time.sleep(max(0.0, began + (row + 1) * POSES / FRAMES_A_SECOND - time.monotonic()))
            frames = capture.frames[some]
            live.add_row(radar, Recording(
                samples=frames, first_time=taken[some][0], period=1 / FRAMES_A_SECOND,
                lost=np.zeros(len(frames), dtype=bool),
            ))  # fmt: skip
            live.end_row(ms.Trajectory(times=taken[some], positions=path.positions[some]))
        live.finish()
    lags = np.array([status.lag for status in statuses])
    print(f"{len(lags)} images; lag: median {np.median(lags):.2f} s, 95 % {np.quantile(lags, 0.95):.2f} s, "
          f"most {lags.max():.2f} s; the last {lags[-1]:.2f} s")  # fmt: skip
    last = live.images["77_ghz"]
    used = ms.Capture(
        radar=capture.radar,
        trajectory=ms.Trajectory(times=taken[: rows * POSES], positions=path.positions[: rows * POSES]),
        frames=capture.frames[: rows * POSES],
    )
    whole = ms.form_image(used, grid)
    error = np.linalg.norm(last.values - whole.values) / np.linalg.norm(whole.values)
    print(f"{last.metadata['poses']} of {rows * POSES} poses; the last image differs by {error:.3%} from the whole's")


if __name__ == "__main__":
    main()
