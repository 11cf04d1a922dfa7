"""How often each class has which form: the table that the classifier counts with, from simulated images alone.

    python benchmarks/form_classes.py [--workers 2]

40 shapes of each class and as many odd ones, which are of none, are drawn at random, and the training objects of
examples/objects.toml are simulated twice each, tilted by up to 10 degrees. Prints how many have which form by `form_of`
in the masks of `wave`, and their shares with one of each answer added. No object that is tested with takes part.
"""

import argparse
import tempfile
import tomllib
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.imaging import grid_around
from millisight.meshes import NO_SHAPE_CLASS, ODD, RANDOM_SHAPES, random_shape, write_mesh
from millisight.perception.classification import FORM_SHARES, form_of

ROOT = Path(__file__).parents[1]
DRAWN, TURNS = 40, 2


def form(job: tuple[str, str | None, int]) -> tuple[str, str | None]:
    """The class and the form of one object; no form where no mask is found."""
    shape_class, name, seed = job
    rng = np.random.default_rng(seed)
    turns = float(rng.uniform(-10, 10)), float(rng.uniform(-10, 10)), float(rng.uniform(0, 360))
    if name is None:
        with tempfile.TemporaryDirectory() as folder:
            write_mesh(Path(folder) / "shape.ply", random_shape(shape_class, rng))
            scene = ms.Scene.from_mesh(Path(folder) / "shape.ply", rotate_deg=turns)
    else:
        scene = ms.Scene.from_mesh(name, rotate_deg=turns)
    lower, upper = scene.mesh.bounds
    size = upper[:2] - lower[:2] + 0.16
    middle = (lower + upper)[:2] / 2
    path = ms.Trajectory.raster(size=(size[0], size[1]), step=0.002, center=(*middle, upper[2] + 0.25))
    capture = ms.simulate(scene, ms.Radar.preset("iwr1443"), path)
    image = ms.form_image(capture, grid_around(capture, 0.0025), window="taylor")
    mask = ms.segment(image)
    kind = form_of(mask.inside, [*ms.find_round(mask, image), *ms.find_flat(mask, image)])
    # All drawn cups stand open or lie, and rims do not echo in these images.
    return shape_class, "vessel" if shape_class == "cup" and kind == "ellipse" else kind


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    training = tomllib.loads((ROOT / "examples/objects.toml").read_text())["training"]
    classes = tomllib.loads((ROOT / "examples/training/classifier.toml").read_text())["classes"]
    of_object = {name: shape_class for shape_class, names in classes.items() for name in names}
    jobs: list[tuple[str, str | None, int]] = []
    for i, shape_class in enumerate(RANDOM_SHAPES):
        jobs += [(shape_class, None, 1000 * i + j) for j in range(DRAWN)]
    for i, name in enumerate(training):
        jobs += [(of_object.get(name, NO_SHAPE_CLASS), name, 7000 + 10 * i + j) for j in range(TURNS)]
    counts: dict[str, Counter[str | None]] = defaultdict(Counter)
    with ProcessPoolExecutor(options.workers) as pool:
        for number, (shape_class, kind) in enumerate(pool.map(form, jobs), 1):
            counts[NO_SHAPE_CLASS if shape_class == ODD else shape_class][kind] += 1
            print(f"\r{number} of {len(jobs)}", end="", flush=True)
    print()
    for shape_class, found in counts.items():
        total = found.total() + len(FORM_SHARES) + 1
        told = ", ".join(f"{kind}: {found[kind]}, {(found[kind] + 1) / total:.3f}" for kind in FORM_SHARES)
        print(f"{shape_class:8} {found.total():3} {told}")


if __name__ == "__main__":
    main()
