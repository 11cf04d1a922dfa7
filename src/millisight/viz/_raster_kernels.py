"""The kernel that draws triangles on a raster; apart, since compiling takes longer to import than figures do."""

import numpy as np

from millisight.core import serial

_EDGE = 1e-9  # of a triangle's side: a centre on an edge belongs to both triangles


@serial()
def raise_to(height, points, faces):
    """Raise `height` (I, J) to the faces (F, 3) at the pixels whose centres lie within them.

    `points` (V, 3) are in pixels to the right and up, pixel i from i to i + 1, and in metres towards the viewer.
    """
    across, up = height.shape
    for n in range(faces.shape[0]):
        ax, ay, az = points[faces[n, 0], 0], points[faces[n, 0], 1], points[faces[n, 0], 2]
        bx, by, bz = points[faces[n, 1], 0], points[faces[n, 1], 1], points[faces[n, 1], 2]
        cx, cy, cz = points[faces[n, 2], 0], points[faces[n, 2], 1], points[faces[n, 2], 2]
        twice_area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(twice_area) <= 1e-12:
            continue  # seen edge-on
        first_i = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0)
        first_j = max(int(np.ceil(min(ay, by, cy) - 0.5)), 0)
        last_i = min(int(np.floor(max(ax, bx, cx) - 0.5)), across - 1)
        last_j = min(int(np.floor(max(ay, by, cy) - 0.5)), up - 1)
        for i in range(first_i, last_i + 1):
            for j in range(first_j, last_j + 1):
                px, py = i + 0.5, j + 0.5
                b = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) / twice_area
                c = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / twice_area
                if b >= -_EDGE and c >= -_EDGE and b + c <= 1 + _EDGE:
                    height[i, j] = max(height[i, j], az + b * (bz - az) + c * (cz - az))
