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
from millisight.rig.virtual._bounce_kernels import NO_SLOPE
from millisight.rig.virtual._shadow_kernels import mirror_ways, returning_ways

_SLANT = 0.05  # cosine of incidence under which a face mirrors nothing onward
_STEEPEST = NO_SLOPE + 0.2  # slope of a path in the middle of a cell, over which it changes by so much


def double_bounces(
    place: np.ndarray,
    lit: np.ndarray,
    centroids: np.ndarray,
    normals: np.ndarray,
    caster: RayCaster,
    shade: RayCaster,
) -> tuple[np.ndarray, np.ndarray]:
    """(M,) patches that mirror a wave from `place` (3,) [m], and (M,) the ones that it meets next and that see `place`.

    `centroids` and `normals` (N, 3) are those of the patches, the triangles of `caster`; `shade` holds what blocks
    views, which may be of fewer triangles; `lit` (N,) bool is False where a patch is known to be hidden from `place`.
    """
    numbers = np.empty(len(centroids), dtype=np.int64)
    starts, ways = np.empty((2, len(centroids), 3))
    count = mirror_ways(place, lit, centroids, normals, _SLANT, LIFT, numbers, starts, ways)
    first, starts, ways = numbers[:count], starts[:count], ways[:count]
    second, reach = caster.first(starts, ways)
    kept, ends = np.empty(count, dtype=np.int64), np.empty((count, 3))
    count = returning_ways(place, starts, ways, second, reach, normals, _SLANT, _STEEPEST, LIFT, kept, ends)
    kept, ends = kept[:count], ends[:count]
    seen = ~shade.blocked(starts[kept], place)
    kept, ends = kept[seen], ends[seen]
    kept = kept[~shade.blocked(ends, place)]
    return first[kept], second[kept]
