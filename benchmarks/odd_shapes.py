"""Five sets of shapes of no class, and recipes of scenes to try answers on that should not be given.

    python benchmarks/odd_shapes.py FOLDER
    millisight generate FOLDER/odd.toml -o FOLDER/odd
    millisight generate FOLDER/newer.toml -o FOLDER/newer
    millisight generate FOLDER/third.toml -o FOLDER/third
    millisight generate FOLDER/fourth.toml -o FOLDER/fourth
    millisight generate FOLDER/fifth.toml -o FOLDER/fifth
    millisight generate FOLDER/sparse.toml -o FOLDER/sparse
    python benchmarks/novelty.py DATASET --odd FOLDER/odd --newer FOLDER/newer --third FOLDER/third \\
        --sparse FOLDER/sparse

Nothing was trained on these shapes, and nobody would call them a can, a handle, a box, a sphere, a cup or a clamp.
`odd`, `newer`, `third`, `fourth` and `fifth` are full scans of 24 and four times 20 by the virtual rig. All sets but
the first were drawn by others, who did not know what classifiers here learn from. `sparse` are scans of known objects,
three times too coarse.
"""

import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold, OpType

import millisight as ms
from millisight.meshes import write_mesh

SIDES = 40
HIGHEST = 120.5  # [mm], tilted by up to 10 degrees


def union(*solids: Manifold) -> Manifold:
    return Manifold.batch_boolean(solids, OpType.Add)


def block(x: float, y: float, z: float, at: Sequence[float] = (0, 0, 0)) -> Manifold:
    return Manifold.cube((x, y, z), True).translate(tuple(at))


def ellipsoid(a: float, b: float, c: float, at: Sequence[float] = (0, 0, 0)) -> Manifold:
    return Manifold.sphere(1.0, 60).scale((a, b, c)).translate(tuple(at))


def rod(points: np.ndarray, radius: float) -> Manifold:
    """A round rod through points (N, 3)."""
    balls = [Manifold.sphere(radius, 20).translate(tuple(point)) for point in points]
    return union(*(Manifold.batch_hull(list(pair)) for pair in pairwise(balls)))


def plate(points: Sequence[Sequence[float]], thickness: float, *holes: CrossSection) -> Manifold:
    """A polygon made thick, with holes."""
    area = CrossSection([np.array(points, dtype=float)], FillRule.NonZero)
    for hole in holes:
        area = area - hole
    return area.extrude(thickness)


def around(count: int, solid: Manifold) -> Manifold:
    return union(*(solid.rotate((0, 0, 360 * i / count)) for i in range(count)))


def rod_through(*points: Sequence[float], radius: float) -> Manifold:
    return rod(np.array(points, dtype=float), radius)


def hull(*solids: Manifold) -> Manifold:
    return Manifold.batch_hull(list(solids))


def footed(solid: Manifold, z: float = 0.0) -> Manifold:
    """Cut flat at z, for a foot to stand on."""
    return solid.trim_by_plane((0, 0, 1), z)


def profile_turned(profile: Sequence[Sequence[float]]) -> Manifold:
    """A profile of radii and heights, turned about z."""
    return CrossSection([np.array(profile, dtype=float)], FillRule.NonZero).revolve(60)


def _letter_r() -> Manifold:
    bow = CrossSection.circle(32, SIDES) - CrossSection.circle(15, SIDES)
    right = CrossSection.square((60, 100)).translate((0, -50))
    bow = (bow ^ right).translate((-20, 28))
    return union(bow.extrude(20), block(20, 120, 20, (-30, 0, 10)), rod(np.array([[-15, -2, 10], [25, -50, 10]]), 10))


def _spring() -> Manifold:
    turn = np.linspace(0, 8 * np.pi, 160)
    return rod(np.column_stack([30 * np.cos(turn), 30 * np.sin(turn), 3.5 * turn]), 4)


def _knot() -> Manifold:
    turn = np.linspace(0, 2 * np.pi, 100)
    x, y = np.sin(turn) + 2 * np.sin(2 * turn), np.cos(turn) - 2 * np.cos(2 * turn)
    return rod(20 * np.column_stack([x, y, -np.sin(3 * turn)]), 6)


def _star() -> Manifold:
    angle, radius = np.arange(10) * np.pi / 5, np.where(np.arange(10) % 2, 26, 65)
    return plate(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), 22)


def _gear() -> Manifold:
    wheel = Manifold.cylinder(18, 45, 45, SIDES) - Manifold.cylinder(18, 15, 15, SIDES)
    return union(wheel, around(10, block(24, 13, 18, (50, 0, 9))))


def _pyramid() -> Manifold:
    return Manifold.hull_points([(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0), (0, 0, 80)])


def _rabbit() -> Manifold:
    ears = [ellipsoid(8, 7, 28, (38, y, 58)) for y in (10, -10)]
    feet = [ellipsoid(22, 9, 10, (20, y, -24)) for y in (22, -22)]
    return union(
        ellipsoid(45, 30, 30), ellipsoid(22, 20, 22, (45, 0, 28)), ellipsoid(10, 10, 10, (-50, 0, 8)), *ears, *feet
    )


def _hand() -> Manifold:
    fingers = [
        rod(np.array([[25, y, 0], [25 + long, y, 0]]), 7) for y, long in ((-26, 50), (-9, 62), (9, 60), (26, 45))
    ]
    return union(block(60, 66, 18), rod(np.array([[-10, 30, 0], [20, 65, 0]]), 8), *fingers)


def _arch() -> Manifold:
    ring = Manifold.cylinder(40, 60, 60, SIDES) - Manifold.cylinder(40, 38, 38, SIDES)
    return union(ring ^ block(140, 140, 40, (0, 70, 20)), *(block(22, 45, 40, (x, -21, 20)) for x in (-49, 49)))


def _grate() -> Manifold:
    bars = [block(140, 8, 8, (0, y, 0)) for y in range(-56, 57, 28)]
    return union(*bars, *(block(8, 130, 8, (x, 0, 0)) for x in range(-60, 61, 30)))


def _stool() -> Manifold:
    return union(block(90, 90, 10, (0, 0, 40)), *(block(12, 12, 80, (x, y, 0)) for x in (-35, 35) for y in (-35, 35)))


def _aeroplane() -> Manifold:
    wing = Manifold.hull_points(
        [(-10, 0, 0), (25, 0, 0), (-20, 80, 0), (0, 80, 0), (-10, 0, 6), (25, 0, 6), (0, 80, 4)]
    )
    tail = block(18, 60, 4, (-60, 0, 4))
    return union(ellipsoid(75, 13, 13), wing, wing.mirror((0, 1, 0)), tail, block(20, 4, 30, (-62, 0, 15)))


def _propeller() -> Manifold:
    blade = ellipsoid(45, 16, 5).rotate((30, 0, 0)).translate((45, 0, 0))
    return union(Manifold.cylinder(25, 16, 16, SIDES, True), around(3, blade))


ODD_SHAPES: dict[str, Callable[[], Manifold]] = {
    "letter R": _letter_r,
    "letter E": lambda: union(block(18, 100, 25, (-26, 0, 0)), *(block(70, 16, 25, (0, y, 0)) for y in (-42, 0, 42))),
    "letter S": lambda: rod(np.array([[35 * np.sin(3 * v), 60 * v, 0] for v in np.linspace(-1, 1, 40)]), 9),
    "spring": _spring,
    "knot": _knot,
    "cross": lambda: union(block(120, 30, 30), block(30, 120, 30)),
    "jack": lambda: union(block(90, 18, 18), block(18, 90, 18), block(18, 18, 90)),
    "star": _star,
    "gear": _gear,
    "staircase": lambda: union(*(block(80, 25, 20 * i, (0, 25 * i, 10 * i)) for i in range(1, 5))),
    "pyramid": _pyramid,
    "cone": lambda: Manifold.cylinder(100, 45, 0.5, 60),
    "angle": lambda: union(block(100, 70, 8), block(100, 8, 70, (0, -31, 31))),
    "pipe tee": lambda: union(
        Manifold.cylinder(130, 22, 22, 60, True).rotate((0, 90, 0)),
        Manifold.cylinder(75, 22, 22, 60).rotate((-90, 0, 0)),
    ),
    "beam": lambda: union(block(130, 60, 9, (0, 0, 30)), block(130, 60, 9, (0, 0, -30)), block(130, 9, 60)),
    "frame": lambda: block(140, 100, 14) - block(104, 64, 20),
    "grate": _grate,
    "stool": _stool,
    "propeller": _propeller,
    "arch": _arch,
    "rabbit": _rabbit,
    "hand": _hand,
    "zigzag": lambda: plate(
        [(-80, -20), (-40, 20), (0, -20), (40, 20), (80, -20), (80, 0), (40, 40), (0, 0), (-40, 40), (-80, 0)], 40
    ),
    "aeroplane": _aeroplane,
}  # fmt: skip


def mesh_of(solid: Manifold) -> ms.TriangleMesh:
    """The middle of its box at the origin [m]."""
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties)[:, :3] / 1000
    return ms.TriangleMesh(
        vertices=vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2, faces=np.array(mesh.tri_verts)
    )


SCENES = """name = "{name}"
about = "{about}"
seed = {seed}

{objects}
[poses]
count = 1
x_deg = [-10, 10]
y_deg = [-10, 10]
z_deg = [0, 359]
shift = 0.02

[rig]
conditions = {conditions}
keep = "images"
margin = 0.06

"""
"""Of a recipe: its objects, how they lie, and what is around them."""

SIGHT = '["los"]'

RECIPE = (
    SCENES
    + """\
[rig.image]
spacing = [0.0025, 0.0025, 0.01]
margin = 0.09

[rig.world.scan]
size = [0.56, 0.56]
corner = [-0.08, 0.02]
row_spacing = {rows}

[[rig.scans]]
radars = [{{ preset = "iwr1443", frame_period = 0.125 }}]
arm = {{ speed = {speed} }}

[[rig.scans]]
radars = [{{ preset = "position2go", mount = [0, 0, 0] }}]
arm = {{ speed = {low_speed} }}
scan = {{ row_spacing = {low_rows} }}
"""
)

KNOWN = (
    "chips_can", "tuna_fish_can", "spoon", "large_marker", "pudding_box", "gelatin_box", "wood_block", "foam_brick",
    "apple", "orange", "softball", "tennis_ball", "golf_ball", "g_cups",
)  # fmt: skip


def _low_enough(solid: Manifold) -> Manifold:
    """A solid [mm] that is no taller than the published image grid lets it be."""
    lower, upper = np.reshape(solid.bounding_box(), (2, 3))
    share = min(1.0, HIGHEST / float(upper[2] - lower[2]))
    return solid if share == 1 else solid.scale((share, share, share))


def main(folder: Path) -> None:
    from fifth_shapes import FIFTH_SHAPES
    from fourth_shapes import FOURTH_SHAPES
    from newer_shapes import NEWER_SHAPES
    from third_shapes import THIRD_SHAPES

    folder.mkdir(parents=True, exist_ok=True)
    for kind, seed, shapes in (
        ("odd", 20, ODD_SHAPES), ("newer", 20, NEWER_SHAPES), ("third", 73, THIRD_SHAPES),
        ("fourth", 74, FOURTH_SHAPES), ("fifth", 75, FIFTH_SHAPES),
    ):  # fmt: skip
        files = []
        for name, solid in shapes.items():
            path = folder / f"{name.replace(' ', '_').lower()}.ply"
            write_mesh(path, mesh_of(_low_enough(solid())))
            files.append(f'[[files]]\npath = "{path.name}"\nunit = "m"\nclass = "other"\n')
        recipe = RECIPE.format(
            name=kind, seed=seed, about="Shapes of no class.", objects="\n".join(files),
            conditions=SIGHT, rows=0.0039, speed=0.02, low_rows=0.006, low_speed=0.06,
        )  # fmt: skip
        (folder / f"{kind}.toml").write_text(recipe)
    sparse = RECIPE.format(
        name="sparse", seed=20, about="Known objects, scanned three times too coarsely.",
        objects=f"[objects]\nnames = {list(KNOWN)}\n".replace("'", '"'),
        conditions=SIGHT, rows=0.0117, speed=0.06, low_rows=0.018, low_speed=0.18,
    )  # fmt: skip
    (folder / "sparse.toml").write_text(sparse)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
