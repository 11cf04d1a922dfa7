"""Where sampled curves are highest."""

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
