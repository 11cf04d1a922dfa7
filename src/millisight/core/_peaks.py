"""Sampled curves: where they are highest, and how wide filters over them are."""

import numpy as np


def peak_place(values: np.ndarray, places: np.ndarray) -> float:
    """Where values (N,) at even places (N,) are highest: between them by a parabola through three, at an end there."""
    top = int(values.argmax())
    if not 0 < top < len(places) - 1:
        return float(places[top])
    before, here, after = values[top - 1 : top + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(places[top] + shift * (places[top + 1] - places[top - 1]) / 2)


def widths_in_samples(width: float, *axes: np.ndarray) -> list[float]:
    """A filter's width [m] in samples of axes (n,) [m]: no wider than an axis, and 0 along one of a single sample."""
    return [min(width / float(np.diff(axis).mean()), len(axis)) if len(axis) > 1 else 0.0 for axis in axes]
