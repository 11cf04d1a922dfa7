"""Images and frames of unusual units: squares of their values would leave float32's range."""

from dataclasses import replace
from typing import Any

import numpy as np

from millisight.core.errors import InputError
from millisight.data import Capture, SarImage

_LOOKED_AT = 16  # poses of a capture on disk
_USUAL = 1e-9, 1e9  # of the maximum


def at_usual_scale(scene: Any) -> tuple[Any, float]:
    """An image, or a capture in memory, times a power of two that brings its maximum about 1; and that factor.

    As it is, times 1, where squares of its values stay within float32's range anyhow.

    Raises
    ------
    InputError
        All values are so small that float32 holds few digits of them, or none.
    """
    if isinstance(scene, Capture) and not scene.in_memory:
        poses = np.unique(np.linspace(0, len(scene.trajectory) - 1, _LOOKED_AT).astype(int))
        peak = max(float(np.abs(scene.frames_of(slice(i, i + 1))).max()) for i in poses)
        if peak == 0 or _USUAL[0] < peak < _USUAL[1]:
            return scene, 1.0
        scene = replace(scene, frames=np.array(scene.frames_of(slice(None))))
    parts = np.asarray(scene.values if isinstance(scene, SarImage) else scene.frames)
    parts = parts.view(parts.real.dtype) if parts.flags.c_contiguous else np.abs(parts)  # without a copy
    peak = float(max(-parts.min(), parts.max()))
    if peak == 0 or _USUAL[0] < peak < _USUAL[1]:
        return scene, 1.0
    if peak < np.finfo(np.float32).tiny:
        raise InputError(
            f"the largest value is {peak:.3g}; expected at least {np.finfo(np.float32).tiny:.2g}, as smaller ones "
            "lose digits: choose another unit"
        )
    scale = 2.0 ** -round(float(np.log2(peak)))
    return scaled(scene, scale), scale


def scaled(scene: Any, scale: float) -> Any:
    """An image or a capture, its values times `scale`."""
    # What goes beyond float32's range is refused by the record, as not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        if isinstance(scene, SarImage):
            return replace(scene, values=scene.values * scale)
        return replace(scene, frames=scene.frames * np.float32(scale))
