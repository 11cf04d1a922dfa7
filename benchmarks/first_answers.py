"""What a newcomer is answered first: objects of the README, the demo and the tutorials, simulated as the README does.

    python benchmarks/first_answers.py

Segments with `wave` and classifies, by 77 GHz alone and by both bands, in two poses each, on the grid that nobody
names: 2 cm around each object. Prints every mask's F1 and every answer, the mean F1, how many are right, and how
many sure ones wrong. Simulated by the paper's physics, as the training was; most of these objects were not in it.
"""

import numpy as np

import millisight as ms
from millisight.evaluation import score_mask
from millisight.imaging import grid_around
from millisight.perception.classification import classifier, classify
from millisight.perception.training._scenes import footprint

OBJECTS = {
    "mug": "cup", "adjustable_wrench": "handle", "cracker_box": "box", "scissors": "handle", "golf_ball": "sphere",
    "apple": "sphere", "tomato_soup_can": "can", "hammer": "handle", "banana": "other", "power_drill": "other",
}  # fmt: skip
TURNS_DEG = (0, 70)


def image_of(name: str, turn_deg: float, preset: str, step: float) -> ms.SarImage:
    """By one radar; the aperture reaches over all of the object and 8 cm beyond."""
    scene = ms.Scene.from_mesh(name, rotate_deg=(0, 0, turn_deg))
    lower, upper = scene.mesh.bounds
    size = upper[:2] - lower[:2] + 0.16
    path = ms.Trajectory.raster(size=(size[0], size[1]), step=step, center=(*((lower + upper)[:2] / 2), upper[2] + 0.2))
    capture = ms.simulate(scene, ms.Radar.preset(preset), path)
    return ms.form_image(capture, grid_around(capture, 0.0025), window="taylor")


def main() -> None:
    by, found_f1, right, sure, wrong = classifier(), [], 0, 0, 0
    for name, truth in OBJECTS.items():
        for turn in TURNS_DEG:
            image = image_of(name, turn, "iwr1443", 0.002)
            low = image_of(name, turn, "position2go", 0.006)
            mesh, xy = ms.Scene.from_mesh(name, rotate_deg=(0, 0, turn)).mesh, image.grid.xy
            under = ms.Mask(grid_xy=xy, inside=footprint(mesh, xy.x, xy.y))
            for bands, other in (("77 GHz", None), ("both", low)):
                mask = ms.segment(image, other_band=other)
                found = classify(image, mask, other_band=other, method=by)
                f1 = score_mask(mask, under).f1
                found_f1.append(f1)
                right += found.label == truth
                sure += found.sure
                wrong += found.sure and found.label != truth
                print(f"{name:18} {turn:3} {bands:7} F1 {f1:.2f} {truth:7} {found!r}", flush=True)
    print(f"mean F1 {np.mean(found_f1):.3f}; right: {right} of {len(found_f1)}; sure: {sure}, of which wrong: {wrong}")


if __name__ == "__main__":
    main()
