"""Forty-four household things of all seven classes, and the recipe of their scenes.

    python benchmarks/household_things.py FOLDER
    millisight generate FOLDER/household.toml -o DATASET
    python benchmarks/results.py DATASET --support -0.30 --recipe FOLDER/household.toml -o household.md

Cans, handles, boxes, spheres, cups, clamps and things of no class, drawn by someone who saw neither what the classifier
learns from nor any answer of it. Nothing is trained or chosen on them.
"""

import sys
from collections.abc import Callable
from pathlib import Path

from household_balls import SPHERES
from household_boxes import BOXES
from household_others import OTHERS
from household_tools import CLAMPS, HANDLES
from household_vessels import CANS, CUPS
from manifold3d import Manifold
from odd_shapes import SCENES, mesh_of

import millisight as ms
from millisight.meshes import write_mesh

FINEST = 0.005  # [mm]

THINGS: dict[str, dict[str, Callable[[], Manifold]]] = {
    "can": CANS,
    "handle": HANDLES,
    "box": BOXES,
    "sphere": SPHERES,
    "cup": CUPS,
    "clamp": CLAMPS,
    "other": OTHERS,
}

RECIPE = (
    SCENES
    + """\
[rig.covers]
cartons = 1
clearance = [0.01, 0.06]
thickness = [0.0025, 0.004]
tilt_deg = 2.0
gap = [0.005, 0.03]
empty = 10

[rig.image]
spacing = [0.0025, 0.0025, 0.01]
margin = 0.09
beyond = 0.06

[rig.world.scan]
size = [0.56, 0.56]
corner = [-0.08, 0.02]
row_spacing = 0.0039

[[rig.scans]]
radars = [{{ preset = "iwr1443", frame_period = 0.125 }}]
arm = {{ speed = 0.02 }}

[[rig.scans]]
radars = [{{ preset = "position2go", mount = [0, 0, 0] }}]
arm = {{ speed = 0.06 }}
scan = {{ row_spacing = 0.006 }}
"""
)


def on_table(solid: Manifold) -> ms.TriangleMesh:
    """A solid [mm] as a mesh [m], the middle of its foot at the origin."""
    # Readers of meshes merge corners that are very close; what is thin there would not be watertight any more.
    mesh = mesh_of(solid.simplify(FINEST))
    return ms.TriangleMesh(vertices=mesh.vertices - (0, 0, mesh.vertices[:, 2].min()), faces=mesh.faces)


def main(folder: Path) -> None:
    ms.core.make_folder(folder)
    files = []
    for kind, things in THINGS.items():
        for name, solid in things.items():
            path = folder / f"{name.replace(' ', '_')}.ply"
            write_mesh(path, on_table(solid()))
            files.append(f'[[files]]\npath = "{path.name}"\nunit = "m"\nclass = "{kind}"\n')
    recipe = RECIPE.format(
        name="household", about="Household things drawn by somebody else.", seed=4417,
        objects="\n".join(files), conditions='["los", "carton"]',
    )  # fmt: skip
    (folder / "household.toml").write_text(recipe)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
