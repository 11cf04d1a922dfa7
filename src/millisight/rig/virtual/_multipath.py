"""Double bounces: what one patch mirrors onto another, and that one sends back.

Rays are shot from the radar to every lit patch, mirrored there, and followed to what they meet (Ling, Chou & Lee,
"Shooting and bouncing rays", IEEE Trans. Antennas Propag. 37, 194 (1989)). What arrives is geometrical optics: a tube
of rays, weaker by the first reflection and by its growing width; what leaves from there is physical optics over the
tube's footprint. Both orders of a pair of faces are found, each from its own first patch. Which patches make a pair
is settled once for all antennas in a cell of space; lengths and angles are each channel's own.

A pair counts where the path hardly changes over the second face, as it does about a mirror's direction; elsewhere
neighbours cancel but for what the ends of a face leave over, and that is dropped.

The amplitude is that of a wave polarised along or across the fold between the faces. At 45 degrees to it, a conductor's
fold turns the polarisation and a linearly polarised radar sees nothing; that is not followed.
"""

import numpy as np

from millisight.meshes import LIFT, RayCaster
from millisight.rig.virtual._path_kernels import NO_SLOPE

_SLANT = 0.05  # cosine of incidence under which a face mirrors nothing onward
_OVER_A_CELL = 0.2  # by which the slope of a path changes at most


def double_bounces(
    place: np.ndarray, centroids: np.ndarray, normals: np.ndarray, caster: RayCaster
) -> tuple[np.ndarray, np.ndarray]:
    """(M,) patches that mirror a wave from `place` (3,) [m], and (M,) the ones that it meets next and that see `place`.

    `centroids` and `normals` (N, 3) are those of the patches, the triangles of `caster`.
    """
    way = centroids - place
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    along = np.einsum("ni,ni->n", way, normals)
    first = np.flatnonzero(along < -_SLANT)
    start = centroids[first] + LIFT * normals[first]
    mirrored = way[first] - 2 * along[first, None] * normals[first]
    second, reach = caster.first(start, mirrored)
    hit = start + np.where(second < 0, 0.0, reach)[:, None] * mirrored
    # Of the few that meet anything, those that send the wave about to where it came from, and that it reaches.
    kept = np.flatnonzero(second >= 0)
    onto, back = normals[second[kept]], place - hit[kept]
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    down, up = np.einsum("ni,ni->n", mirrored[kept], onto), np.einsum("ni,ni->n", back, onto)
    slope = mirrored[kept] - back - (down - up)[:, None] * onto
    kept = kept[(down < -_SLANT) & (up > 0) & (np.linalg.norm(slope, axis=1) < NO_SLOPE + _OVER_A_CELL)]
    kept = kept[~caster.blocked(start[kept], place)]
    kept = kept[~caster.blocked(hit[kept] + LIFT * normals[second[kept]], place)]
    return first[kept], second[kept]
