"""How well plane, axis, sides and bend of flat and slightly bent tops are known, in sight and in shut cartons.

    python benchmarks/flat_things.py make FOLDER --seed 11
    millisight generate FOLDER/flat.toml -o DATASET
    python benchmarks/flat_things.py measure DATASET

`make` writes 30 meshes and a recipe of scenes of the virtual rig: boxes, cubes, discs and frames of random sizes;
bulging plates and domes; and what is not smooth, or neither a rectangle nor an ellipse: bent plates of flat strips of
5 degrees, L shapes, lying cylinders and a ball. The rules of `find_flat` were chosen on other shapes.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold
from odd_shapes import block, mesh_of, union
from round_things import MATERIALS, RECIPE, lying, run, upright

import millisight as ms
from millisight import datasets
from millisight.evaluation import HIGH, score_mask
from millisight.meshes import write_mesh
from millisight.perception import project
from millisight.perception.segmentation import find_flat, find_mask, segmenter
from millisight.rig.virtual import World, build_layout

RECTANGLES, DISCS = ("box", "cube", "frame"), ("disc",)
BULGING = (250.0, 500.0, 1000.0)  # radii [mm]


def shapes(rng: np.random.Generator) -> Iterator[tuple[str, Manifold, str]]:
    """Names, solids [mm] and classes."""

    def size(least: float, most: float) -> float:
        return float(np.exp(rng.uniform(np.log(least), np.log(most))))

    def turned(solid: Manifold) -> Manifold:
        return solid.rotate((0, 0, float(rng.uniform(0, 90))))

    for i in range(8):
        yield f"box{i}", turned(block(size(35, 160), size(25, 110), size(15, 80))), "box"
    for i in range(3):
        side = size(25, 60)
        yield f"cube{i}", turned(block(side, side, side)), "box"
    for i in range(5):
        yield f"disc{i}", upright(size(15, 100), size(18, 50)), "can"
    for i in range(2):
        a, b = size(70, 120), size(60, 100)
        yield f"frame{i}", turned(block(a, b, 20) - block(0.3 * a, 0.3 * b, 30)), "other"
    for i, radius in enumerate((120.0, 200.0, 350.0)):
        barrel = lying(upright(200, radius)).translate((0, 0, 10 - radius))
        yield f"bent{i}", turned(barrel ^ block(80, 100, 60)), "other"
    for i in range(2):
        yield f"ell{i}", turned(union(block(90, 30, 20), block(30, 90, 20, (-30, 30, 0)))), "other"
    yield "lying0", turned(lying(upright(100, size(18, 45)))), "can"
    yield "ball0", Manifold.sphere(size(25, 45), 96), "sphere"
    for i, radius in enumerate(BULGING):
        sides = size(60, 120), size(50, 90)
        barrel = lying(Manifold.cylinder(200, radius, radius, 1440).translate((0, 0, -100)))
        yield f"bulge{i}", turned(barrel.translate((0, 0, 10 - radius)) ^ block(*sides, 60)), "box"
        sides = size(60, 120), size(50, 90)
        rings = [(r, np.sqrt(radius**2 - r**2) - radius + 10) for r in np.linspace(0, 100, 101)]
        dome = Manifold.revolve(CrossSection([[(0, -30), (100, -30), *reversed(rings)]]), 180)
        yield f"dome{i}", turned(dome ^ block(*sides, 60)), "box"


def make(folder: Path, seed: int) -> None:
    files = []
    for i, (name, solid, kind) in enumerate(shapes(np.random.default_rng(seed))):
        write_mesh(folder / f"{name}.ply", mesh_of(solid))
        material = MATERIALS[i % len(MATERIALS)]
        files.append(f'[[files]]\npath = "{name}.ply"\nunit = "m"\nmaterial = "{material}"\nclass = "{kind}"\n')
    recipe = RECIPE.format(
        name="Flat", about="Flat and bent things, in sight and in cartons.", seed=39 + seed,
        objects="\n".join(files), conditions='["los", "carton"]',
    )  # fmt: skip
    (folder / "flat.toml").write_text(recipe)


def top_of(mesh: ms.TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """Normal (3,) and corners (N, 3) of the largest plane that faces up."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals, up = normals / np.maximum(areas, 1e-15)[:, None], normals[:, 2] > 0.8 * areas
    _, planes = np.unique(np.round(100 * normals[up]), axis=0, return_inverse=True)
    largest = planes.ravel() == np.bincount(planes.ravel(), areas[up]).argmax()
    return np.average(normals[up][largest], axis=0, weights=areas[up][largest]), corners[up][largest].reshape(-1, 3)


def rectangle(normal: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre (3,), long axis (3,) and sides (2,) [m] of the smallest rectangle around a plane's corners."""
    first = np.cross(normal, [0, 0, 1.0]) if normal[2] < 1 - 1e-9 else np.array([1.0, 0, 0])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    found = []
    for angle in np.radians(np.arange(0, 90, 0.25)):
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ [first, second]
        places = corners @ axes.T
        found.append((np.ptp(places, axis=0).prod(), angle, axes, places))
    _, _, axes, places = min(found, key=lambda one: one[:2])
    middle, sides = (places.max(axis=0) + places.min(axis=0)) / 2, np.ptp(places, axis=0)
    centre = middle @ axes + (corners[0] @ normal) * normal
    return centre, axes[sides.argmax()], np.sort(sides)[::-1]


def height_at(mesh: ms.TriangleMesh, place: np.ndarray) -> float:
    """The highest point [m] of a mesh over a place (2,)."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    upright = np.abs(np.linalg.det(sides[:, :2])) < 1e-15
    shares = np.linalg.solve(
        np.where(upright[:, None, None], np.eye(2), sides[:, :2]), (place - corners[:, 0, :2])[..., None]
    )[..., 0]
    over = ~upright & (shares >= 0).all(axis=1) & (shares.sum(axis=1) <= 1)
    return float((corners[:, 0, 2] + (sides[:, 2] * shares).sum(axis=1))[over].max(initial=-np.inf))


def measure(root: Path) -> None:
    by = segmenter("wave")
    told: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    kinds: dict[tuple[str, str], list[str]] = defaultdict(list)
    bends: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    marked: dict[tuple[str, str], list[float]] = defaultdict(list)
    for files in datasets.find_scenes(datasets.open(root)):
        scene = files.read(truth="exact", view=False)
        folder, *rest = str(scene.name).split("/")
        name = folder.split("_", 1)[1].rstrip("0123456789")
        key, image, truth = (name, scene.sight), scene.images[HIGH], scene.truth[HIGH]
        mask = find_mask(by, project(image), condition=scene.sight, rng=0).mask
        marked[key].append(100 * score_mask(mask, truth).f1)
        world = World.from_toml(root.joinpath("truth", folder, "robot_collected", *rest, "77_ghz", "world.toml"))
        mesh = build_layout(world).parts[0].mesh
        found = find_flat(mask, image, covered=scene.sight != "los")
        kinds[key] += [one.kind for one in found]
        if name in ("bulge", "dome"):
            true = 1e3 / BULGING[int(folder[-1])]
            for one in found:
                curvatures = np.diag(one.curvatures)
                most = int(curvatures.argmax())
                off = abs(curvatures - (true if name == "dome" else true * (np.arange(2) == most)))
                of_height = 1e3 * abs(one.centre[2] - height_at(mesh, one.centre[:2]))
                bends[key].append([100 * off[most] / true, *np.sort(np.degrees(off * one.sides)), of_height])
            continue
        normal, corners = top_of(mesh)
        centre, axis, sides = rectangle(normal, corners)
        for one in found:
            turned = np.degrees(
                [np.arccos(min(abs(float(a @ b)), 1)) for a, b in ((one.normal, normal), (one.axis, axis))]
            )
            if name == "cube":
                turned[1] = min(turned[1], 90 - turned[1])
            of_sides = np.abs(one.sides - sides).max()
            told[key].append([1e3 * np.linalg.norm(one.centre - centre), turned[0], turned[1], 1e3 * of_sides])
    print("| shapes | sight | scenes | rectangles, ellipses | centre [mm], normal, axis [°], sides [mm] | F1 |")
    print("| --- | --- | --- | --- | --- | --- |")
    for key, scores in marked.items():
        right = "rectangle" if key[0] in RECTANGLES else "ellipse" if key[0] in DISCS else None
        kept = zip(told[key], kinds[key], strict=True) if told[key] else ()
        rows = np.array([row for row, kind in kept if kind == right])
        errors = medians(rows)
        if key[0] in DISCS and errors:
            errors[2] = "-"
        counts = ", ".join(str(kinds[key].count(kind)) for kind in ("rectangle", "ellipse"))
        print(f"| {key[0]} | {key[1]} | {len(scores)} | {counts} | {'; '.join(errors)} | {np.median(scores):.1f} |")
    print(
        "\n| shapes | sight | found | errors of the curvature [%], of bends from edge to edge [°], of the height [mm] |"
    )
    print("| --- | --- | --- | --- |")
    for key, rows in bends.items():
        print(f"| {key[0]} | {key[1]} | {len(rows)} of {len(marked[key])} | {'; '.join(medians(np.array(rows)))} |")


def medians(rows: np.ndarray) -> list[str]:
    """Of each column the median, and the most."""
    return [f"{np.median(one):.2g} ({one.max():.2g})" for one in rows.T] if len(rows) else []


if __name__ == "__main__":
    run(__doc__, 11, make, measure)
