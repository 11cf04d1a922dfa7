"""The steps that benchmarks/table.py measures, each in a process of its own: `python benchmarks/steps.py STEP`.

Prints one line of JSON. A step warms up first, so that nothing compiles while it is timed. It runs with whatever
version of millisight Python finds, so it keeps to what old versions have, too.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from problems import real_size, simulated_object

import millisight as ms

RANDOM, BRIGHTEST = 1000, 500


class Step:
    """What is timed, the problem made ready; `frames` are what versions are compared by, `errors` against exact."""

    def __init__(self, work: Callable[[], Any], errors: Callable[[Any], list[float]] | None = None, warm: Any = None):
        self.work, self.errors, self.warm = work, errors, warm or work
        self.frames: Callable[[Any], np.ndarray] | None = None


def r(scale: float, method: str = "fast") -> Step:
    """The image of R."""
    capture, grid = real_size(scale)
    return Step(
        lambda: ms.form_image(capture, grid, method=method),
        lambda image: errors_against_exact(capture, image, RANDOM, BRIGHTEST),
    )


def s(scale: float, model: str) -> Step:
    """The signals of S by one model, and their image."""
    scene, radar, trajectory, grid = simulated_object(scale)

    def work() -> Any:
        capture = ms.simulate(scene, radar, trajectory, model=model)
        return capture, ms.form_image(capture, grid)

    return Step(work, lambda made: errors_against_exact(*made, RANDOM // 5, BRIGHTEST // 5))


def rig(scale: float, cover: str) -> Step:
    """One capture of a mug at 77 GHz by the rig's optics: 3000 poses and four receivers, or a share of the poses."""
    from test_rig import ANTENNA, RADAR, aperture

    from millisight.data import LAYERED
    from millisight.rig.virtual import Part, box_sheets, echoes

    mesh = ms.Scene.from_mesh("mug", vertices=None).mesh
    lower, upper = mesh.bounds
    trajectory = aperture(round(3000 * scale), upper[2] + 0.2)
    sheets = box_sheets(lower - [0.02, 0.02, 0], upper + 0.02, LAYERED["carton"])[1:] if cover == "carton" else ()
    part = Part(mesh=mesh, material=4 - 0.1j, roughness=5e-5)

    def work(some: ms.Trajectory) -> np.ndarray:
        return echoes([part], RADAR, some, antenna=ANTENNA, rng=0, occluders=sheets)

    step = Step(lambda: work(trajectory), warm=lambda: work(aperture(40, upper[2] + 0.2)))
    step.frames = lambda made: made
    return step


def generate(scale: float) -> Step:
    """Four captures with images, of a mug and a golf ball in sight and in a carton, by one worker of one thread."""
    from millisight.datasets.generation import Engine, plan_dataset, recipe_from_table, run_plan

    def made(names: list[str], spacing: float) -> np.ndarray:
        """The frames of all captures."""
        world = {
            "scan": {"size": [0.4, 0.4], "corner": [0.0, 0.08], "row_spacing": spacing},
            "arm": {"speed": 0.02},
            "radars": [{"preset": "iwr1443", "frame_period": 0.125}],
        }
        image = {"spacing": [0.0025, 0.0025, 0.01], "margin": 0.03}
        conditions = {"conditions": ["los", "carton"], "empty": []}
        table = {"keep": "captures", "margin": 0.04, "image": image, "world": world, **conditions}
        recipe = recipe_from_table({"name": "bench", "objects": {"names": names}, "rig": table})
        with tempfile.TemporaryDirectory() as folder:
            done = run_plan(plan_dataset(recipe, folder), Engine("threads", 1, 1))
            if done.failures:
                raise SystemExit(str(done.failures))
            files = sorted(Path(folder).rglob("capture.h5"))
            if len(files) != done.made:
                raise SystemExit(f"{len(files)} captures; expected {done.made}")
            return np.concatenate([ms.load(path).frames for path in files])

    step = Step(lambda: made(["mug", "golf_ball"], min(0.0156 / scale, 0.06)), warm=lambda: made(["golf_ball"], 0.04))
    step.frames = lambda frames: frames
    return step


STEPS: dict[str, Callable[[float], Step]] = {
    "rig": lambda scale: rig(scale, "none"),
    "rig-carton": lambda scale: rig(scale, "carton"),
    "rig-whole": lambda scale: rig(5 * scale, "carton"),
    "r": r,
    "r-direct": lambda scale: r(scale, "backprojection"),
    "s-specular": lambda scale: s(scale, "specular"),
    "s-edge": lambda scale: s(scale, "edge"),
    "generate": generate,
}


def errors_against_exact(capture: ms.Capture, image: ms.SarImage, random: int, brightest: int) -> list[float]:
    """Relative L2 errors on random voxels and on the brightest, each set by itself, against float64."""
    values, grid = image.values.ravel(), image.grid
    some = np.random.default_rng(1).choice(grid.size, min(random, grid.size), replace=False)
    picks = some, np.argsort(np.abs(values))[-brightest:]
    exact = [
        ms.image_at(
            capture.frames, capture.tx_positions, capture.rx_positions, capture.radar.waveform.frequencies,
            grid.points[pick], capture.radar.path_offset,
        )
        for pick in picks
    ]  # fmt: skip
    return [float(np.linalg.norm(values[p] - e) / np.linalg.norm(e)) for p, e in zip(picks, exact, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=STEPS)
    parser.add_argument("--scale", type=float, default=1.0, help="of the problem, 1 by default")
    parser.add_argument("--package", type=Path, help="the folder that millisight must come from")
    parser.add_argument("--errors", action="store_true", help="compare with float64, too")
    parser.add_argument("--floor", action="store_true", help="count what must be computed, too, in a run of its own")
    parser.add_argument("--frames", type=Path, help="where to write the frames, as .npy")
    options = parser.parse_args()
    found = Path(ms.__file__).resolve()
    if options.package and options.package.resolve() not in found.parents:
        raise SystemExit(f"millisight comes from {found.parent}; expected {options.package}")
    step = STEPS[options.step](options.scale)
    step.warm()
    began, busy = time.perf_counter(), time.process_time()
    made = step.work()
    seconds, busy = time.perf_counter() - began, time.process_time() - busy
    threads = 1 if options.step == "generate" else numba.get_num_threads()
    told: dict[str, Any] = {"seconds": seconds, "busy": busy, "threads": threads}
    if options.errors and step.errors:
        told["errors"] = step.errors(made)
    if options.frames and step.frames:
        np.save(options.frames, step.frames(made))
    if options.floor:
        from floors import core_seconds, counting

        del made
        with counting() as counted:
            step.work()
        told["counted"] = {name: int(number) for name, number in counted.items()}
        told["floor"] = core_seconds(counted) / threads
    json.dump(told, sys.stdout)
    print()


if __name__ == "__main__":
    main()
