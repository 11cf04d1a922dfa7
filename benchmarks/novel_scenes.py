"""AUROC of the classifier's novelty on simulated scenes of drawn shapes: sparse scans, and lids that are not told of.

    python benchmarks/novel_scenes.py [--seed 5] [--count 12]

Each shape is scanned once by `ms.simulate` at 77 GHz, once more 1.8 to 4 times too sparsely, and once under a lid, a
mirror of layers in closed form; every third lid also lies over nothing. Some ten seconds of a core for each shape.
"""

import argparse
import dataclasses

import numpy as np

import millisight as ms
from millisight.core.errors import InputError
from millisight.meshes import random_shape
from millisight.perception import project
from millisight.perception.classification import classifier, classify
from millisight.perception.segmentation import WaveSegmenter, find_mask
from millisight.perception.training import area_under_curve
from millisight.perception.training._sheets import _echo

KINDS = ("can", "handle", "box", "sphere", "cup", "clamp", "other", "box")
RADAR = ms.Radar.preset("iwr1443")
STEPS = np.array((0.0039, 0.0025))  # its four receivers fill the gaps between rows
KNOWN = "known shapes"


class Novelties:
    """By what the scenes show."""

    def __init__(self) -> None:
        self.found: dict[str, list[float]] = {}
        self._segmenter, self._by = WaveSegmenter(), classifier()

    def mask(self, image: ms.SarImage) -> ms.Mask:
        return find_mask(self._segmenter, project(image)).mask

    def add(self, kind: str, image: ms.SarImage, mask: ms.Mask | None = None) -> None:
        try:
            answer = classify(image, mask or self.mask(image), method=self._by)
        except InputError:  # nothing was found
            return
        self.found.setdefault(kind, []).append(answer.novelty)
        print(f"{kind}: {answer!r}, novelty {answer.novelty:.2f} {'; '.join(answer.reasons)}", flush=True)


def add_shape(novelties: Novelties, kind: str, rng: np.random.Generator, *, empty: bool) -> None:
    """One shape: known, under a lid, and too sparsely scanned; and its lid alone."""
    turn = rng.uniform(-10, 10), rng.uniform(-10, 10), rng.uniform(0, 360)
    scene = ms.Scene.from_mesh(random_shape(kind, rng), vertices=1500, rotate_deg=turn)
    scene = scene.moved((0, 0, -rng.uniform(0.2, 0.33) - scene.mesh.extent[2] / 2))
    lower, upper = scene.mesh.bounds
    middle, clearance = (lower + upper) / 2, rng.uniform(0.01, 0.06, 4)
    low, high = lower[:2] - clearance[::2], upper[:2] + clearance[1::2]
    margin = rng.uniform(0.06, 0.12)
    x, y = (np.arange(a - margin, b + margin, 0.0025) for a, b in zip(low, high, strict=True))
    grid = ms.VoxelGrid(x=x, y=y, z=np.arange(lower[2] - 0.05, upper[2] + 0.09, 0.01))

    def scanned(factor: float) -> ms.Capture:
        size, at = high - low + 0.1, (low + high) / 2
        steps = factor * STEPS
        path = ms.Trajectory.raster(size=(size[0], size[1]), step=(steps[0], steps[1]), center=(at[0], at[1], 0.0))
        specular, edge = (ms.simulate(scene, RADAR, path, model=model) for model in ("specular", "edge"))
        return ms.combine(specular, edge, alpha=(1.0, 0.3))

    def formed(capture: ms.Capture, frames: np.ndarray | None = None) -> ms.SarImage:
        held = capture if frames is None else dataclasses.replace(capture, frames=frames)
        return ms.form_image(held, grid, tolerance=0.02)

    capture = scanned(1.0)
    novelties.add(KNOWN, formed(capture))
    height, slope = upper[2] + rng.uniform(0.01, 0.05), np.tan(np.radians(rng.normal(0, 1, 2)))
    faces, gain = (rng.uniform(0.0025, 0.004), rng.uniform(0.3, 1)), 10 ** rng.uniform(-0.5, 0.7)
    path = capture.trajectory
    centred = dataclasses.replace(path, positions=path.positions - [middle[0], middle[1], 0])
    reach = np.column_stack([low - middle[:2], high - middle[:2]]).ravel()
    echo = _echo(RADAR, centred, float(height), slope, np.zeros(2), reach, faces)
    echo = (echo * gain * abs(capture.frames).max() / abs(echo).max()).astype(np.complex64)
    inside = np.outer((x >= low[0]) & (x <= high[0]), (y >= low[1]) & (y <= high[1]))
    lid = ms.Mask(grid_xy=grid.xy, inside=inside)
    for frames in (capture.frames + echo, *((echo,) if empty else ())):
        image = formed(capture, frames)
        novelties.add("a lid", image, lid)
        found = novelties.mask(image)
        if (found.inside & inside).sum() > 0.5 * (found.inside | inside).sum():
            novelties.add("a lid in wave's mask", image, found)
    sparse = formed(scanned(rng.uniform(1.8, 4)))
    novelties.add("a sparse scan, steps told", sparse)
    novelties.add("a sparse scan, by the picture", dataclasses.replace(sparse, metadata={}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--count", type=int, default=12)
    options = parser.parse_args()
    novelties = Novelties()
    for number in range(options.count):
        rng = np.random.default_rng([options.seed, number])
        add_shape(novelties, KINDS[number % len(KINDS)], rng, empty=number % 3 == 0)
    known, limit = np.array(novelties.found[KNOWN]), classifier().description["novelty"]["limit"]
    for kind, found in novelties.found.items():
        area = area_under_curve(known, np.array(found))
        refused = int((np.array(found) > limit).sum())
        print(f"{kind}: {len(found)}, AUROC {area:.2f}, refused {refused}")


if __name__ == "__main__":
    main()
