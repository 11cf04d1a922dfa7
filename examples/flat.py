"""How the phases of an image tell a box's top in a shut carton: the picture of docs/how-to/flat.md.

millisight collect --rig virtual examples/worlds/box.toml -o data
millisight image data --clock apply -o images
python examples/flat.py images/*.image.h5 docs/images/flat.png
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import millisight as ms
from millisight.core import SPEED_OF_LIGHT
from millisight.perception import without_sheets
from millisight.viz import save_figure

WAVENUMBER = 4 * np.pi * 79e9 / SPEED_OF_LIGHT  # there and back
SHOWN = 0.09  # around the box [m]
DB = -35


def main() -> None:
    if len(sys.argv) != 3:
        print(f"usage: {__doc__.splitlines()[4].strip()}", file=sys.stderr)
        sys.exit(2)
    image = ms.load(sys.argv[1])
    mask = ms.segment(image, condition="nlos")
    (top,) = ms.find_flat(mask, image, covered=True)
    cleaned, grid = without_sheets(image, covered=True), image.grid
    slice_ = int(abs(grid.z - top.centre[2]).argmin())
    values = cleaned.values[..., slice_]
    wave = np.exp(1j * WAVENUMBER * (top.normal[0] * grid.x[:, None] + top.normal[1] * grid.y))
    real = values * wave
    real = (real * np.exp(-1j * np.angle(real[top.inside].sum()))).real / np.median(np.abs(values[top.inside]))
    corners = top.centre + np.array(
        [u * top.axis * top.sides[0] / 2 + v * np.cross(top.normal, top.axis) * top.sides[1] / 2 for u, v in
         ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))]
    )  # fmt: skip

    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
    extent = np.array([grid.x[0], grid.x[-1], grid.y[0], grid.y[-1]]) * 100
    levels = (image.magnitude.mean(axis=2), cleaned.magnitude.mean(axis=2))
    raw, clean = (20 * np.log10(np.maximum(one / one.max(), 1e-6)) for one in levels)
    panels = (
        ("the carton", raw, {"vmin": DB, "vmax": 0, "cmap": "inferno"}),
        ("phases below the lid", np.angle(values), {"cmap": "twilight"}),
        ("the plane's wave taken off", real, {"vmin": -1.2, "vmax": 1.2, "cmap": "RdBu_r"}),
        (f"{1e3 * top.sides[0]:.0f} x {1e3 * top.sides[1]:.0f} mm", clean, {"vmin": DB, "vmax": 0, "cmap": "inferno"}),
    )
    for ax, (title, shown, look) in zip(axes, panels, strict=True):
        ax.imshow(shown.T, origin="lower", extent=extent, **look)
        ax.set(title=title, xlabel="x [cm]", ylabel="y [cm]")
        for set_limits, middle in zip((ax.set_xlim, ax.set_ylim), top.centre[:2], strict=True):
            set_limits(100 * (middle - SHOWN), 100 * (middle + SHOWN))
    axes[3].plot(*100 * corners[:, :2].T, "c-", linewidth=1)
    save_figure(figure, sys.argv[2])


if __name__ == "__main__":
    main()
