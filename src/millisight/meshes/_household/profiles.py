"""Profiles that several kinds of things share."""

import numpy as np


def round_profile(
    radius: float, half_height: float, *, taper: float = 0.0, top: float = 0.0, bottom: float = 0.0, width: float = 0.3
) -> np.ndarray:
    """(90, 2) radii and heights from the upper pole to the lower; `top` and `bottom` lift the poles' surroundings."""
    share = np.linspace(0, 1, 90)
    angle = np.pi * (share - 0.7 * np.sin(2 * np.pi * share) / (2 * np.pi))  # closer at the poles
    lift = np.where(angle < np.pi / 2, top, bottom) * np.exp(-((np.sin(angle) / width) ** 2))
    across = radius * np.sin(angle) * (1 + taper * np.cos(angle))
    profile = np.column_stack([across, half_height * np.cos(angle) + lift])
    profile[[0, -1], 0] = 0
    return profile
