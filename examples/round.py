"""How the phases of an image tell a can's radius in a shut carton: the picture of docs/how-to/round.md.

millisight collect --rig virtual examples/worlds/can.toml -o data
millisight image data --clock apply -o images
python examples/round.py images/*.image.h5 docs/images/round.png
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import millisight as ms
from millisight.core import SPEED_OF_LIGHT
from millisight.perception import without_sheets
from millisight.viz import save_figure

WAVENUMBER = 4 * np.pi * 79e9 / SPEED_OF_LIGHT  # there and back
SHOWN = 0.085  # around the can [m]
DB = -35


def propagated(values: np.ndarray, grid: ms.VoxelGrid, depth: float) -> np.ndarray:
    """A slice (X, Y) of an image, so much deeper [m]."""
    x, y = (2 * np.pi * np.fft.fftfreq(len(axis), np.diff(axis).mean()) for axis in (grid.x, grid.y))
    z = np.sqrt(np.maximum(WAVENUMBER**2 - x[:, None] ** 2 - y**2, 0))
    return np.fft.ifft2(np.fft.fft2(values) * np.exp(1j * (z - WAVENUMBER) * depth))


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[4].strip()}", file=sys.stderr)
        sys.exit(2)
    image = ms.load(sys.argv[1])
    mask = ms.segment(image, condition="nlos")
    (can,) = ms.find_round(mask, image, covered=True)
    cleaned, grid = without_sheets(image, covered=True), image.grid
    slice_ = int(np.square(cleaned.magnitude[mask.inside]).sum(axis=0).argmax())
    crest, to_axis = cleaned.values[..., slice_], grid.z[slice_] - can.centre[2]
    depths = np.arange(0, 0.08, 0.002)
    powers = [np.abs(propagated(crest * mask.inside, grid, depth)) ** 2 for depth in depths]
    sharpness = np.array([np.square(one).sum() / one.sum() ** 2 for one in powers])

    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
    extent = np.array([grid.x[0], grid.x[-1], grid.y[0], grid.y[-1]]) * 100
    panels = (
        ("the carton", image.magnitude.mean(axis=2)),
        ("the lid taken off", cleaned.magnitude.mean(axis=2)),
        (f"its crest, {1e3 * to_axis:.0f} mm deeper", np.abs(propagated(crest, grid, to_axis))),
    )
    for ax, (title, level) in zip(axes, panels, strict=False):
        shown = 20 * np.log10(np.maximum(level / level.max(), 1e-6))
        ax.imshow(shown.T, origin="lower", extent=extent, vmin=DB, vmax=0, cmap="inferno")
        ax.set(title=title, xlabel="x [cm]", ylabel="y [cm]")
        for set_limits, middle in zip((ax.set_xlim, ax.set_ylim), can.centre[:2], strict=True):
            set_limits(100 * (middle - SHOWN), 100 * (middle + SHOWN))
    axes[1].contour(100 * grid.x, 100 * grid.y, can.inside.T, [0.5], colors="cyan")
    ends = 100 * (can.centre[:2] + np.outer([-0.5, 0.5], can.length * can.axis[:2]))
    axes[1].plot(*ends.T, "c--", linewidth=1)
    axes[3].plot(1e3 * depths, sharpness / sharpness[0])
    axes[3].axvline(1e3 * to_axis, color="0.6", linestyle="--")
    axes[3].set(title=f"a cylinder of {1e3 * can.radius:.0f} mm radius", xlabel="depth [mm]", ylabel="sharpness")
    save_figure(figure, sys.argv[2])


if __name__ == "__main__":
    main()
