"""How well `remove_sheets` finds the place of a known lid: intersection over union with that of the world.

    python benchmarks/lid_places.py DATASET [DATASET ...]

The datasets are of `millisight generate`, which keeps each scene's world; images at 77 GHz. Of several sheets that are
taken, the one that overlaps most counts. Where a cloth lies over the lid, it may be the cloth that is found.
"""

import argparse
from pathlib import Path

import numpy as np

from millisight.data import PixelGrid
from millisight.imaging import DetectedSheet, remove_sheets
from millisight.io.mito import read_published
from millisight.perception import HIGH_BAND
from millisight.rig.virtual import World, build_layout


def lid_in(world: World) -> DetectedSheet | None:
    """The lid of a world's carton; None: there is none."""
    if world.carton is None or not world.carton.lid:
        return None
    lid = [panel for panel in build_layout(world).panels if panel.stack == world.carton.stack][-1]
    corners = np.array([lid.corner, lid.corner + lid.u, lid.corner + lid.u + lid.v, lid.corner + lid.v])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    return DetectedSheet(
        height=float(corners[:, 2].mean()), tilt_deg=(0.0, 0.0), lower=tuple(lower[:2]), upper=tuple(upper[:2]),
        area=float(np.linalg.norm(np.cross(lid.u, lid.v))), border=0.0, explained=1.0, power=0.0,
        corners=tuple(map(tuple, corners[:, :2])),
    )  # fmt: skip


def overlap(one: DetectedSheet, other: DetectedSheet, pixels: PixelGrid) -> float:
    here, there = one.box_on(pixels), other.box_on(pixels)
    return float((here & there).sum() / max((here | there).sum(), 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", type=Path, nargs="+")
    for root in parser.parse_args().datasets:
        found = []
        for file in sorted(root.glob("truth/**/nlos/77_ghz/world.toml")):
            scene = file.parents[1].relative_to(root / "truth")
            image = root / scene / "processed" / "radars" / "77_ghz" / "processed_image.pkl"
            lid = lid_in(World.from_toml(file))
            if lid is None or not image.exists():
                continue
            image = read_published(image).record
            sheets = remove_sheets(image, frequency=image.frequency or HIGH_BAND, clutter="lid").sheets
            found.append(max((overlap(sheet, lid, image.grid.xy) for sheet in sheets), default=0.0))
            print(f"  {scene}: {found[-1]:.2f}")
        if not found:
            print(f"{root.name}: no lids")
            continue
        right = sum(one > 0.9 for one in found)
        print(f"{root.name}: {right} of {len(found)} lids overlap by more than 0.9, {np.mean(found):.2f} on average")


if __name__ == "__main__":
    main()
