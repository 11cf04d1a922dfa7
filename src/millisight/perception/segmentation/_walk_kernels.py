"""The compiled loop of the random walker: conjugate gradients on a picture's graph."""

import numpy as np

from millisight.core import inline, serial


@inline
def _of_neighbours(down, across, x, i, j):
    """The sum of the four neighbours of pixel (i, j), of `x` (A + 2, B + 2), by their conductances."""
    return (
        down[i, j] * x[i, j + 1]
        + down[i + 1, j] * x[i + 2, j + 1]
        + across[i, j] * x[i + 1, j]
        + across[i, j + 1] * x[i + 1, j + 2]
    )


# Sums may be added up in another order, several at a time.
@serial(fastmath={"reassoc", "contract"})
def walk(down, across, free, fixed, prior, pull, accuracy, most_steps):
    """Probabilities x (A, B) of (L + g) x = g p at `free` pixels, `fixed` at the others.

    By conjugate gradients with the diagonal as preconditioner. The Laplacian is applied along the axes of the picture,
    which needs no matrix.

    Parameters
    ----------
    down, across : (A + 1, B), (A, B + 1) conductances between neighbours along each axis, 0 beyond the rim
    free : (A, B) bool
    fixed, prior : (A, B)
    pull : g
    accuracy : norm of what is left at the end, over that of the right side
    most_steps : after so many it ends in any case
    """
    a, b = prior.shape
    # A rim of zeros, so that no pixel asks whether it has a neighbour.
    seeds, x, direction = np.zeros((a + 2, b + 2)), np.zeros((a + 2, b + 2)), np.zeros((a + 2, b + 2))
    rest, moved = np.zeros((a, b)), np.zeros((a, b))
    diagonal, scale, mask = np.empty((a, b)), np.empty((a, b)), np.empty((a, b))
    for i in range(a):
        for j in range(b):
            diagonal[i, j] = pull + down[i, j] + down[i + 1, j] + across[i, j] + across[i, j + 1]
            scale[i, j] = 1.0 / diagonal[i, j]
            mask[i, j] = 1.0 if free[i, j] else 0.0
            seeds[i + 1, j + 1] = 0.0 if free[i, j] else fixed[i, j]
            x[i + 1, j + 1] = prior[i, j] if free[i, j] else 0.0
    norm = left = 0.0
    for i in range(a):
        for j in range(b):
            if free[i, j]:
                right = pull * prior[i, j] + _of_neighbours(down, across, seeds, i, j)
                rest[i, j] = right - (diagonal[i, j] * x[i + 1, j + 1] - _of_neighbours(down, across, x, i, j))
                norm += right * right
                left += rest[i, j] * rest[i, j]
    goal, before = accuracy * accuracy * norm, 1.0
    for _ in range(most_steps):
        if left <= goal:
            break
        now = along = left = 0.0
        for i in range(a):
            for j in range(b):
                now += rest[i, j] * rest[i, j] * scale[i, j]
        turn = now / before
        for i in range(a):
            for j in range(b):
                direction[i + 1, j + 1] = rest[i, j] * scale[i, j] + turn * direction[i + 1, j + 1]
        for i in range(a):
            for j in range(b):
                here = direction[i + 1, j + 1]
                moved[i, j] = (diagonal[i, j] * here - _of_neighbours(down, across, direction, i, j)) * mask[i, j]
                along += here * moved[i, j]
        step = now / max(along, 1e-300)
        for i in range(a):
            for j in range(b):
                x[i + 1, j + 1] += step * direction[i + 1, j + 1]
                rest[i, j] -= step * moved[i, j]
                left += rest[i, j] * rest[i, j]
        before = max(now, 1e-300)
    return x[1:-1, 1:-1] + seeds[1:-1, 1:-1]
