"""Two images or captures of one scene as one: the paper's sum of specular and edge returns."""

from dataclasses import replace
from typing import overload

import numpy as np

from millisight.core import checked_numbers, with_step
from millisight.core.errors import InputError
from millisight.data import Capture, SarImage, grid_difference


@overload
def combine(specular: SarImage, edge: SarImage, alpha: tuple[float, float]) -> SarImage: ...


@overload
def combine(specular: Capture, edge: Capture, alpha: tuple[float, float]) -> Capture: ...


def combine(specular: SarImage | Capture, edge: SarImage | Capture, alpha: tuple[float, float]) -> SarImage | Capture:
    """(a1 specular + a2 edge) / (a1 + a2) (paper Eq. 8, primer 14), for two images or for two captures.

    Imaging is linear, so combining the frames and imaging once gives the same as combining two images.

    Parameters
    ----------
    specular, edge : two SarImage on the same grid, or two Capture of the same radar and trajectory
    alpha : (a1, a2), not negative, not both zero

    Raises
    ------
    InputError
        The two do not match, or the weights are invalid.
    """
    a1, a2 = checked_alpha(alpha)
    weights = np.float32(a1 / (a1 + a2)), np.float32(a2 / (a1 + a2))
    if isinstance(specular, SarImage) and isinstance(edge, SarImage):
        metadata = with_step(specular.metadata, "combine", alpha=[a1, a2], edge=dict(edge.metadata))
        if differs := grid_difference(specular.grid, edge.grid):
            raise InputError(f"the two images' grids differ along {differs}; image both on one grid")
        values = weights[0] * specular.values + weights[1] * edge.values
        return SarImage(grid=specular.grid, values=values, metadata=metadata)
    if isinstance(specular, Capture) and isinstance(edge, Capture):
        metadata = with_step(specular.metadata, "combine", alpha=[a1, a2], edge=dict(edge.metadata))
        if not _same_setup(specular, edge):
            raise InputError("the two captures' radars or positions differ; simulate both with the same ones")
        frames = weights[0] * specular.frames_of(slice(None)) + weights[1] * edge.frames_of(slice(None))
        metadata["lit_fraction"] = max(c.metadata.get("lit_fraction", 0.0) for c in (specular, edge))
        return replace(specular, frames=frames, metadata=metadata)
    raise InputError(
        f"combine got {type(specular).__name__} and {type(edge).__name__}; expected two images or two captures"
    )


def checked_alpha(alpha: tuple[float, float]) -> tuple[float, float]:
    """The weights of specular and edge echoes; `InputError` before any work where nothing can be combined by them."""
    a1, a2 = checked_numbers(alpha, name="alpha", count=2, minimum=0)
    if not a1 + a2 > 0:
        raise InputError("alpha is (0, 0); expected at least one weight above zero")
    return a1, a2


def _same_setup(a: Capture, b: Capture) -> bool:
    return (
        np.array_equal(a.radar.waveform.frequencies, b.radar.waveform.frequencies)
        and a.radar.path_offset == b.radar.path_offset
        and np.array_equal(a.tx_positions, b.tx_positions)
        and np.array_equal(a.rx_positions, b.rx_positions)
    )
