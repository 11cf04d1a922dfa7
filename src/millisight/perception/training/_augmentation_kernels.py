"""The compiled loop of augmentation: channels turned, scaled and shifted."""

import numpy as np

from millisight.core import serial


@serial(fastmath={"contract"})
def sampled(channels, turn, offset):
    """(C, A, B) channels at the places `turn` @ (i, j) + `offset` of each pixel, linear between pixels, 0 beyond them.

    Parameters
    ----------
    channels : (C, A, B) float32
    turn, offset : (2, 2), (2,)
    """
    count, a, b = channels.shape
    out = np.zeros(channels.shape, np.float32)
    for i in range(a):
        for j in range(b):
            x, y = turn[0, 0] * i + turn[0, 1] * j + offset[0], turn[1, 0] * i + turn[1, 1] * j + offset[1]
            if not (0 <= x <= a - 1 and 0 <= y <= b - 1):
                continue
            k, m = min(int(x), a - 2), min(int(y), b - 2)
            u, v = x - k, y - m
            near, right = np.float32((1 - u) * (1 - v)), np.float32((1 - u) * v)
            down, far = np.float32(u * (1 - v)), np.float32(u * v)
            for c in range(count):
                out[c, i, j] = (
                    near * channels[c, k, m]
                    + right * channels[c, k, m + 1]
                    + down * channels[c, k + 1, m]
                    + far * channels[c, k + 1, m + 1]
                )
    return out
