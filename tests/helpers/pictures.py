"""What a saved figure shows, read from its pixels alone."""

import numpy as np
from PIL import Image
from scipy import ndimage


def panels(path):
    """(rows, columns, 3) of each panel of a figure on white, colour bars left out, from left to right.

    A panel is what hangs together and is not white, without its ticks; text is too small to count.
    """
    pixels = np.asarray(Image.open(path).convert("RGB"))
    filled = ndimage.binary_fill_holes((pixels < 245).any(axis=-1))
    labels, _ = ndimage.label(ndimage.binary_opening(filled, np.ones((15, 15))))
    found = [place for place in ndimage.find_objects(labels) if _is_panel([edge.stop - edge.start for edge in place])]
    return [pixels[place] for place in sorted(found, key=lambda place: (place[1].start, place[0].start))]


def _is_panel(size):
    return min(size) > 60 and max(size) < 6 * min(size)


def brightness(pixels):
    """(rows, columns) between 0 and 255."""
    return pixels[..., :3].mean(axis=-1)


def on_grid(panel, grid_xy):
    """(X, Y) the brightness of a panel that is seen along z, at the pixels of its image.

    `grid_xy` gives the panel's limits: it begins and ends half a pixel outside of the first and last one.
    """
    shown = brightness(panel)[::-1].T
    at = [((np.arange(n) + 0.5) * size / n).astype(int) for n, size in zip(grid_xy.shape, shown.shape, strict=True)]
    return shown[np.ix_(*at)]
