"""Compiled loops over what is seen from where. See `_shadows` and `_multipath`."""

import numpy as np

from millisight.core import inline, kernel, phase, prange, serial

_distance = inline(phase.distance)

_BLOCK = 8192  # scatterers whose views stay in the caches


@kernel()
def blend_views(views, corners, shares, light):
    """light (A, V) uint8: of each antenna, the views (K, V) from its `corners` (A, S), by their `shares` (A, S) of 255.

    A view is 0 or, all bits set, 255.
    """
    for a in prange(len(light)):
        for start in range(0, light.shape[1], _BLOCK):
            stop = min(start + _BLOCK, light.shape[1])
            for v in range(np.uint64(start), np.uint64(stop)):
                light[a, v] = 0
            for s in range(corners.shape[1]):
                share, view = shares[a, s], np.uint64(corners[a, s])
                for v in range(np.uint64(start), np.uint64(stop)):
                    light[a, v] += share & views[view, v]


@serial(error_model="numpy")
def mirror_ways(place, lit, centroids, normals, slant, lift, first, starts, ways):
    """How many patches (N) mirror a wave from `place`, their numbers, and the `starts` and unit `ways` of what leaves.

    Only those that are `lit` (N,) are asked. `slant` is the cosine of incidence under which they mirror nothing, `lift`
    how far over a patch a way starts [m].
    """
    count = 0
    for n in range(len(centroids)):
        if not lit[n]:
            continue
        x, y, z = centroids[n, 0] - place[0], centroids[n, 1] - place[1], centroids[n, 2] - place[2]
        over = 1 / _distance(x, y, z)
        x, y, z = x * over, y * over, z * over
        along = x * normals[n, 0] + y * normals[n, 1] + z * normals[n, 2]
        if along < -slant:
            first[count] = n
            for i in range(3):
                starts[count, i] = centroids[n, i] + lift * normals[n, i]
            ways[count, 0] = x - 2 * along * normals[n, 0]
            ways[count, 1] = y - 2 * along * normals[n, 1]
            ways[count, 2] = z - 2 * along * normals[n, 2]
            count += 1
    return count


@serial(error_model="numpy")
def returning_ways(place, starts, ways, second, reach, normals, slant, slope, lift, kept, ends):
    """How many of the ways meet a patch that sends the wave about to where it came from; their numbers, and where they
    meet it, `lift` over it.

    `second` and `reach` are what they meet, below 0 for nothing, and how far away [m]; `slope` how fast the path may
    change over the patch.
    """
    count = 0
    for n in range(len(starts)):
        if second[n] < 0:
            continue
        wx, wy, wz = ways[n, 0], ways[n, 1], ways[n, 2]
        mx, my, mz = normals[second[n], 0], normals[second[n], 1], normals[second[n], 2]
        hx, hy, hz = starts[n, 0] + reach[n] * wx, starts[n, 1] + reach[n] * wy, starts[n, 2] + reach[n] * wz
        bx, by, bz = place[0] - hx, place[1] - hy, place[2] - hz
        over = 1 / _distance(bx, by, bz)
        bx, by, bz = bx * over, by * over, bz * over
        down, up = wx * mx + wy * my + wz * mz, bx * mx + by * my + bz * mz
        onto = down - up
        steep = _distance(wx - bx - onto * mx, wy - by - onto * my, wz - bz - onto * mz)
        if down < -slant and up > 0 and steep < slope:
            kept[count] = n
            ends[count, 0], ends[count, 1], ends[count, 2] = hx + lift * mx, hy + lift * my, hz + lift * mz
            count += 1
    return count


@kernel(error_model="numpy")
def doubtful_places(place, places, normals, lower, upper, doubtful):
    """doubtful (V,) bool: whether something may lie between `place` (3,) and one of `places` (V, 3), and it matters.

    It does where one of the faces, with normals (S, V, 3), on which it lies faces the place; something may where the
    way there meets the box from `lower` to `upper` (3,), that holds all that blocks it.
    """
    for v in prange(len(places)):
        x, y, z = place[0] - places[v, 0], place[1] - places[v, 1], place[2] - places[v, 2]
        found = False
        for s in range(len(normals)):
            found |= x * normals[s, v, 0] + y * normals[s, v, 1] + z * normals[s, v, 2] >= 0
        into, out_of = 0.0, 1.0
        for i in range(3):
            way = place[i] - places[v, i]
            near, far = lower[i] - places[v, i], upper[i] - places[v, i]
            if way < 0:
                near, far = far, near
            if way != 0:
                into, out_of = max(into, near / way), min(out_of, far / way)
            elif near > 0 or far < 0:
                out_of = -1.0
        doubtful[v] = found and into <= out_of
