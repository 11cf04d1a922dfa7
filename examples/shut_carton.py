"""The scan with which `millisight demo` ends: scissors in a shut carton, by the virtual rig, made small enough to ship.

    python examples/shut_carton.py DATA [OUT]

scans examples/worlds/scissors.toml into DATA, unless that is done, and writes into OUT, the package's own folder if it
is left out, the frames of both radars with descriptions that `millisight image` reads, and what the camera sees with
the carton shut and without it. The scan takes some ten core-minutes.

Of each frame the first receiver is kept, samples are averaged to the few that the scene's ranges need, and numbers are
rounded to 8 bits of the strongest: that is finer than their noise.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

import millisight as ms
from millisight.core import SPEED_OF_LIGHT
from millisight.io.mito import read_experiment
from millisight.rig import PublishedWriter, record_scan
from millisight.rig.virtual import VirtualRig, World, experiment_folder_of, experiment_info, write_truth

ROOT = Path(__file__).parents[1]
NEAR, FAR = 0.4, 1.1  # path lengths of interest [m]
LEAST = 6  # samples
FULL_SCALE = 127
CUT = np.s_[:, 165:475]  # of the camera's pictures: the carton and what is around it

DESCRIPTION = """\
# Scissors in a shut carton at {band}, by the virtual rig: examples/shut_carton.py made this of its frames. Simulated.
#
#     millisight image {name}.toml --clutter lid --plot scissors.png
title = "scissors in a shut carton, {band}"
simulated = true

[radar]
name = "{radar}"
frequencies = {{ array = "frequencies" }}
path_offset = {offset}

[frames]
file = "{name}.npz"
array = "frames"
axes = ["pose", "sample", "part"]
parts = ["I", "Q"]
phase_sign = -1

[positions]
points = {{ array = "positions" }}

[image]
lower = [{lower}]
upper = [{upper}]
spacing = [0.0025, 0.0025, 0.01]
"""


def scan_of(world: World, data: Path) -> Path:
    """The experiment's folder, scanned unless it is there."""
    folder = experiment_folder_of(world, data, 1)
    if not (folder / "unprocessed").exists():
        rig = VirtualRig(world)
        record_scan(rig.arm, rig.radars, rig.camera, rig.plan, PublishedWriter(folder, info=experiment_info(world)))
        write_truth(rig, data / "truth")
    return folder


def averaged(capture: ms.Capture) -> tuple[np.ndarray, np.ndarray]:
    """(P, M) of the first channel, blocks of samples averaged, their phase at (NEAR + FAR) / 2 first taken off; (M,)
    the blocks' frequencies [Hz]."""
    wave = capture.radar.waveform
    size = int(SPEED_OF_LIGHT / (2 * (FAR - NEAR) * abs(wave.frequency_step)))
    size = min(size, wave.samples_per_chirp // LEAST)
    count = wave.samples_per_chirp // size
    middle = (NEAR + FAR) / 2 + capture.radar.path_offset

    def turn(frequencies: np.ndarray) -> np.ndarray:
        return np.exp(2j * np.pi * frequencies * middle / SPEED_OF_LIGHT)

    flat = np.asarray(capture.frames)[:, 0, 0] * turn(wave.frequencies)
    blocks = wave.frequencies[: size * count].reshape(count, size).mean(axis=1)
    means = flat[:, : size * count].reshape(len(flat), count, size).mean(axis=2)
    return means * turn(blocks).conj(), blocks


def ship(folder: Path, name: str, out: Path) -> None:
    """Frames and description of one radar."""
    capture = read_experiment(folder, name).to_capture()
    frames, frequencies = averaged(capture)
    counts = frames * (FULL_SCALE / max(abs(frames.real).max(), abs(frames.imag).max()))
    both = np.round(np.stack([counts.real, counts.imag], axis=-1)).astype(np.int8)
    middle_of_channel = (capture.radar.array.tx_positions[0] + capture.radar.array.rx_positions[0]) / 2
    positions = (capture.trajectory.positions + middle_of_channel).round(6).astype(np.float32)
    np.savez_compressed(out / f"{name}.npz", frames=both, frequencies=frequencies, positions=positions)
    low, high = positions.min(axis=0), positions.max(axis=0)
    told = DESCRIPTION.format(
        name=name, band=f"{name[:2]} GHz", radar=capture.radar.name, offset=capture.radar.path_offset,
        lower=", ".join(f"{v:.3f}" for v in (low[0] - 0.02, low[1] - 0.02, -0.34)),
        upper=", ".join(f"{v:.3f}" for v in (high[0] + 0.02, high[1] + 0.02, -0.2)),
    )  # fmt: skip
    (out / f"{name}.toml").write_text(told, encoding="utf-8")


def main() -> None:
    if len(sys.argv) not in (2, 3):
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    data = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "src/millisight/cli/shut_carton"
    out.mkdir(parents=True, exist_ok=True)
    world = World.from_toml(ROOT / "examples/worlds/scissors.toml")
    folder = scan_of(world, data)
    for radar in world.radars:
        ship(folder, radar.name, out)
    for name, one in (("shut", world), ("open", dataclasses.replace(world, carton=None))):
        rig = VirtualRig(one)
        rig.arm.sweep(rig.plan.photo, rig.plan.photo)
        imsave(out / f"{name}.jpg", rig.camera.shoot().rgb[CUT], pil_kwargs={"quality": 88})


if __name__ == "__main__":
    main()
