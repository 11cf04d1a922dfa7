"""Where in a scene a known lid lies: the largest part that echoes like one mirror, apart from its grating lobes."""

import numpy as np
from scipy.ndimage import label

from millisight.imaging._sheet_edges import LidPlace, rectangle_around
from millisight.imaging._sheet_fit import SUPPORT, Cells, coherence, fresnel_zone, local_means, plane_wave

_LEVEL, _EDGE = 0.95, 0.5  # quantile that is a lid's amplitude or more; share of its median at its edges
_ROUNDS = 5  # in which a lid's profile is found
_APART = 0.3  # of grating lobes' amplitude, at most, is of their profile between them


def lid_place(cells: Cells, wave_number: float, *, lobes: bool) -> LidPlace | None:
    """The rectangle around the largest part that echoes like one mirror, level or tilted; None if there is none.

    Parameters
    ----------
    cells : Cells
    wave_number : k at the band's centre [rad/m]
    lobes : whether the cells may show grating lobes of the lid, the last channel highest, as those of an image do
    """
    zone, seen = fresnel_zone(wave_number), plane_wave(cells, wave_number)
    if seen is None:
        return None
    (basis, phase), looked_at = seen, cells.counts > 0
    flat = cells.values(phase) * looked_at[..., None] @ basis.conj()
    local = local_means(flat, looked_at.astype(np.float32), cells, zone)
    weights = coherence(flat, cells, zone) * looked_at
    profile, share = _profile_of(local, weights)
    part = _largest_part(local, profile)
    if lobes and part is not None and np.abs(basis @ profile).argmax() == len(basis) - 1:
        # What is highest may be lobes: then the lid lies between them, where little has their profile.
        other = _largest_part(local, _profile_of(local, weights * (1 - share))[0])
        highest = np.abs(local @ profile.conj())
        if other is not None and np.median(highest[other]) < _APART * np.median(highest[part]):
            part = other
    return None if part is None else rectangle_around(part, cells.x, cells.y)


def _profile_of(local: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The profile (C,) that most of the local means (X, Y, C) share, and its share of the power of each (X, Y).

    A lid's echo comes from one distance, but its grating lobes, which may be as bright and as wide, lie higher: their
    profiles differ from its own. The profile is the strongest principal component of the means, all alike strong; from
    round to round those that differ from it count less.
    """
    strength = np.linalg.norm(local, axis=2)
    usual = max(float(SUPPORT * np.quantile(strength, _LEVEL)), 1e-30)
    alike = local / np.maximum(strength, usual)[..., None]
    profile, share = np.zeros(local.shape[2], local.dtype), np.ones_like(strength)
    for _ in range(_ROUNDS):
        weighted = (alike * (weights * share)[..., None]).reshape(-1, alike.shape[2])
        profile = np.linalg.eigh(weighted.T @ weighted.conj())[1][:, -1]
        share = np.abs(alike @ profile.conj()) ** 2
    return profile, share


def _largest_part(local: np.ndarray, profile: np.ndarray) -> np.ndarray | None:
    """(X, Y) bool, the largest part where the local means have about as much of a profile as a lid has of its own."""
    strength = np.abs(local @ profile.conj())
    # An object that shines through a lid is smaller, and does not move the median.
    seen = strength[strength > SUPPORT * np.quantile(strength, _LEVEL)]
    if not len(seen):
        return None
    parts, count = label(strength > _EDGE * np.median(seen))
    return parts == int(np.bincount(parts.ravel())[1:].argmax()) + 1 if count else None
