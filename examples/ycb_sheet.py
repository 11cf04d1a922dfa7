"""Simulate and image a folder of meshes at 77 GHz, and draw them on one sheet: is the drill a drill?

    python examples/ycb_sheet.py folder_of_meshes sheet.png

With the YCB Object and Model Set (Calli et al.) as the folder this is a check of the whole main job on real scans.
"""

import sys
from pathlib import Path

import numpy as np

import millisight as ms


def capture_and_image(path: Path, model: str, step: float = 0.0019) -> tuple[ms.Scene, ms.Capture, ms.SarImage]:
    """A scan's frames and image over a reduced aperture, 4 cm wider than the object."""
    scene = ms.Scene.from_mesh(path, unit="m")
    radar = ms.Radar.preset("mito-sim-77ghz")
    trajectory = ms.Trajectory.raster(size=tuple(scene.mesh.extent[:2] + 0.04), step=step)
    capture = ms.simulate(scene, radar, trajectory, model=model)
    lower, upper = scene.mesh.bounds
    grid = ms.VoxelGrid.regular(lower - 0.01, upper + 0.01, (0.003, 0.003, 0.004))
    return scene, capture, ms.form_image(capture, grid)


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    from millisight.viz import plot_sheet, save_figure

    folder, picture = Path(sys.argv[1]), Path(sys.argv[2])
    images, meshes = {}, {}
    for path in sorted(folder.glob("*.ply")):
        scene, capture, specular = capture_and_image(path, "specular")
        _, _, edge = capture_and_image(path, "edge")
        # Each part over its own maximum, so that both are seen.
        balanced = [
            ms.SarImage(grid=i.grid, values=i.values / max(float(np.max(i.magnitude)), 1e-30)) for i in (specular, edge)
        ]
        images[path.stem], meshes[path.stem] = ms.combine(*balanced, alpha=(0.5, 0.5)), scene.mesh
        print(f"{path.stem}: {capture.channels} positions, {100 * capture.metadata['lit_fraction']:.1f} % lit, "
              f"peak at {specular.peak.round(3)} m", flush=True)  # fmt: skip
    save_figure(plot_sheet(images, meshes=meshes, columns=6), picture)
    print(f"wrote {picture}")


if __name__ == "__main__":
    main()
