"""Image a real measurement: a metal letter R seen by a 22 GHz scanner.

    python examples/real_capture.py letter_r_22ghz.npy letter_r.png

The file comes from the public repository Ritchizh/Radar-Image-Processing-Class: one monostatic antenna on a scanner,
75 x 75 positions 3.34 mm apart, six frequencies from 22.0 to 22.5 GHz. Its six arrays lie one after the other:
data (frequency, row, column), first frequency [Hz], last, their number, steps [m] and the distance of the letter [m].
"""

import sys
from pathlib import Path

import numpy as np

import millisight as ms


def read_letter(path: Path) -> tuple[ms.Capture, float]:
    """The measurement as a Capture in the plane z = 0, and the distance of the letter [m]."""
    with open(path, "rb") as file:
        # allow_pickle=False: nothing in the file may run code.
        data, first, last, count, steps, distance = (np.load(file, allow_pickle=False) for _ in range(6))
    # The file has the opposite phase sign; the mean of a frequency is the antenna's own echo, the same everywhere.
    field = np.conj(data - data.mean(axis=(1, 2), keepdims=True))
    # Columns run along x, rows against y: so the picture stands upright. A raster's rows run along y.
    field = field[:, ::-1].transpose(2, 1, 0)
    step = (steps[1], steps[0])
    size = ((field.shape[0] - 1) * step[0], (field.shape[1] - 1) * step[1])
    trajectory = ms.Trajectory.raster(size=size, step=step, center=(0, 0, 0))
    radar = ms.Radar(
        name="22 GHz scanner",
        waveform=ms.Waveform.stepped(float(first), float(last - first) / (count - 1), int(count)),
        array=ms.AntennaArray.monostatic(),
    )
    frames = field.reshape(-1, 1, 1, int(count))
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames), float(distance)


def image_letter(path: Path) -> ms.SarImage:
    """The image of the letter's plane, on a grid of 2 mm."""
    capture, distance = read_letter(path)
    half = capture.trajectory.extent[:2] / 2
    # The scene lies below the antennas: z is up.
    grid = ms.VoxelGrid.regular((*-half, -distance), (*half, -distance), 0.002)
    return ms.form_image(capture, grid)


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[2].strip()}", file=sys.stderr)
        sys.exit(2)
    from millisight.viz.plots import plot_projections, save_figure

    source, picture = Path(sys.argv[1]), Path(sys.argv[2])
    image = image_letter(source)
    save_figure(plot_projections(image), picture)
    print(f"wrote {picture}: peak {image.magnitude.max():.3g} at {image.peak} m")


if __name__ == "__main__":
    main()
