"""Connected parts of a mask."""

from typing import cast

import numpy as np


def parts_of(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Numbers of the parts of a mask (A, B), from 1 on and 0 outside, and how many; pixels touch at corners as well."""
    from scipy.ndimage import label

    return cast("tuple[np.ndarray, int]", label(mask, structure=np.ones((3, 3))))
