"""Objects in three dimensions: how well `ms.segment(image, volume=True)` finds their voxels.

    python examples/volume.py OUT [SCENE ...]

The scenes of `sheets.py` at 77 GHz, in sight and hidden; echoes are kept in OUT, as that example keeps them. Prints
a table in Markdown: IoU, precision and recall of the voxels against three truths: the object's visible surface, at most
half a voxel above or below it; the same within half a range resolution, over which the echo of a perfectly imaged
surface spreads; and the solid object down to its lowest point in each column. Beside them the IoU of two baselines that
do not look at depth: the same mask of pixels over all depths, and over the middle third. Draws the voxels into OUT.
"""

import sys
from pathlib import Path

import numpy as np
from sheets import SCENES, kept_scan, layout_of, radar, trajectory

import millisight as ms
from millisight.evaluation import score_volume, volume_truth
from millisight.viz import plot_volume, save_figure

BAND = "77"
# On which the settings were chosen.
CALIBRATION = ("mug3", "golf3t", "padlock25", "tuna35", "banana3b", "strawhalf", "rubik2", "clamp5", "lockbox",
               "meatbox")  # fmt: skip


def truths(name: str, grid: ms.VoxelGrid) -> dict[str, ms.VolumeMask]:
    """By what counts as the object."""
    meshes = [part.mesh for part in layout_of(name, BAND).objects[0].parts]
    cell = radar(BAND).waveform.range_resolution / 2
    return {
        "surface": volume_truth(meshes, grid),
        "range cell": volume_truth(meshes, grid, within=cell),
        "solid": volume_truth(meshes, grid, of="solid"),
    }


def extruded(mask: ms.Mask, grid: ms.VoxelGrid, *, third: bool) -> ms.VolumeMask:
    """A mask of pixels over all depths, or over the middle third."""
    depths = np.ones(len(grid.z), bool)
    if third:
        depths[: len(grid.z) // 3] = depths[-(len(grid.z) // 3) :] = False
    return ms.VolumeMask(grid=grid, inside=mask.inside[..., None] & depths)


def measure(name: str, folder: Path) -> dict[str, dict[str, list[float]]]:
    """By condition and truth: IoU, precision and recall, IoU of the baselines, and IoU with the true mask of pixels."""
    held = kept_scan(name, BAND, folder)
    grid = ms.VoxelGrid(x=held["x"], y=held["y"], z=held["z"])
    outline, measured = ms.Mask(grid_xy=grid.xy, inside=held["mask"]), {}
    for condition in ("open", "hidden"):
        capture = ms.Capture(radar=radar(BAND), trajectory=trajectory(held["places"]), frames=held[condition])
        image = ms.form_image(capture, grid, tolerance=0.02)
        mask = ms.segment(image)
        found, at_best = ms.extend_mask(mask, image), ms.extend_mask(outline, image)
        blind = [extruded(mask, grid, third=third) for third in (False, True)]
        measured[condition] = {
            kind: [
                *score_volume(found, truth),
                *(score_volume(one, truth).iou for one in blind),
                score_volume(at_best, truth).iou,
            ]
            for kind, truth in truths(name, grid).items()
        }
        save_figure(plot_volume(found, image=image, title=f"{name}, {condition}"), folder / f"{name}-{condition}.png")
    return measured


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1].startswith("-") or set(sys.argv[2:]) - set(SCENES):
        print(f"usage: {__doc__.splitlines()[2].strip()}\nscenes: {', '.join(SCENES)}", file=sys.stderr)
        sys.exit(2)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    print("| scene | | truth | IoU | precision | recall | all depths | middle third | true mask |")
    print("|---|---|---|---|---|---|---|---|---|")
    totals: dict[tuple[str, str, str], list[list[float]]] = {}
    for name in sys.argv[2:] or SCENES:
        side = "calibration" if name in CALIBRATION else "test"
        for condition, rows in measure(name, folder).items():
            carton = condition == "hidden" and isinstance(SCENES[name][3], float)
            for kind, row in rows.items():
                print(f"| {name} | {condition} | {kind} |" + "".join(f" {value:.2f} |" for value in row), flush=True)
                totals.setdefault((side, "carton" if carton else condition, kind), []).append(row)
    print("\n| means | | images | truth | IoU | precision | recall | all depths | middle third | true mask |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for (side, condition, kind), rows in sorted(totals.items()):
        values = "".join(f" {value:.2f} |" for value in np.mean(rows, axis=0))
        print(f"| {side} | {condition} | {len(rows)} | {kind} |{values}")


if __name__ == "__main__":
    main()
