"""One virtual experiment from raw files to images, the true path hidden from the processing, and what that costs.

    python examples/virtual_experiment.py examples/worlds/mug.toml OUT

The arm strays from its plan, its log is noisy, and its clock is not the radar's. From the raw files and the log alone
the clocks are brought together and the image formed; it is compared with the image from the true path, with that from
the planned path, and with that of uncorrected clocks. Prints the figures and draws the four images into OUT.
"""

import sys
import time
from pathlib import Path

import numpy as np

import millisight as ms
from millisight.calibration import retime
from millisight.imaging import estimate_clock
from millisight.io.mito import read_experiment
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import VirtualRig, World, experiment_folder_of, experiment_info

RADAR = "77_ghz"


def at(capture: ms.Capture, path: ms.Trajectory) -> ms.Capture:
    """The same frames at the positions that `path` has for them."""
    index = np.searchsorted(path.times, capture.trajectory.times - 1e-4)
    trajectory = ms.Trajectory(times=capture.trajectory.times, positions=path.positions[index])
    return ms.Capture(radar=capture.radar, trajectory=trajectory, frames=capture.frames)


def compare(image: ms.SarImage, true: ms.SarImage) -> str:
    """Sum of |I|^4 over that of the true image, and the complex normalised correlation with it."""
    sharpness = (image.magnitude**4).sum() / (true.magnitude**4).sum()
    match = abs(np.vdot(true.values, image.values)) / np.linalg.norm(true.values) / np.linalg.norm(image.values)
    return f"sum of |I|^4 {100 * sharpness:6.1f} %, correlation {match:.4f}"


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    from millisight.viz import plot_sheet, save_figure

    world, out = World.from_toml(sys.argv[1]), Path(sys.argv[2])
    rig = VirtualRig(world)
    folder = experiment_folder_of(world, out, 1)
    started = time.perf_counter()
    record_scan(rig.arm, rig.radars, rig.camera, rig.plan, PublishedWriter(folder, info=experiment_info(world)))
    print(f"scanned {len(rig.plan.rows)} rows in {time.perf_counter() - started:.0f} s", flush=True)
    scan = read_experiment(folder, RADAR)
    capture = scan.to_capture()
    estimate = estimate_clock(capture, scan.log)
    print(f"{len(capture.trajectory)} of {len(rig.truth(RADAR))} frames; {estimate}", flush=True)
    strayed = np.linalg.norm(rig.truth(RADAR).positions - rig.planned(RADAR).positions, axis=1)
    print(f"the arm strayed by {1000 * np.sqrt((strayed**2).mean()):.3f} mm rms")
    if estimate.clock is None:
        sys.exit(1)

    corrected = retime(capture, scan.log, estimate.clock)
    lower, upper = (f([thing.bounds[i] for thing in rig.layout.objects], axis=0) for i, f in ((0, np.min), (1, np.max)))
    grid = ms.VoxelGrid.regular(lower - 0.015, upper + 0.015, (0.0025, 0.0025, 0.005))
    captures = {
        "true path": at(corrected, rig.truth(RADAR)),
        "log, clocks corrected": corrected,
        "planned path": at(corrected, rig.planned(RADAR)),
        "log, clocks as they are": capture,
    }
    images = {name: ms.form_image(one, grid) for name, one in captures.items()}
    for name, image in images.items():
        print(f"{name:24} {compare(image, images['true path'])}")
    save_figure(plot_sheet(images, columns=2), out / "images.png")
    print(f"wrote {out / 'images.png'}")


if __name__ == "__main__":
    main()
