"""`domain = "time"` in [frames]: pulses and range profiles, transformed to the frequencies of a band."""

import numpy as np

from millisight.core import SPEED_OF_LIGHT
from millisight.io.description._tables import TomlTable

KEYS = ("time_start", "time_step", "range_start", "range_step", "carrier")


def to_frequencies(values: np.ndarray, frames: TomlTable, radar: TomlTable) -> tuple[np.ndarray, np.ndarray]:
    """Samples over time (..., N) as (..., M) complex over the M frequencies of the band, and these [Hz].

    The transform is sum s(t) exp(-i 2 pi f t): an echo that comes after d / c answers exp(-i 2 pi f d / c), the sign
    inside millisight. Of real samples the sum is doubled, as they hold each frequency twice. Its frequencies are 1 over
    the whole time apart; of complex samples they count from the carrier, which was mixed down to 0.

    Raises
    ------
    FormatError
        Times or band are missing, or do not fit.
    """
    count = values.shape[-1]
    start, step = _times(frames)
    real = not np.iscomplexobj(values)
    spacing = 1 / (count * step)
    lowest, highest = (
        radar.number(key, "Hz") if key in radar else None for key in ("start_frequency", "stop_frequency")
    )
    if real and "carrier" in frames:
        raise frames.error("carrier", "this key only for complex samples; those in the file are real")
    carrier = frames.number("carrier", "Hz", 0.0)
    if lowest is None or highest is None:
        if real or not carrier:
            key = "start_frequency" if lowest is None else "stop_frequency"
            raise radar.error(
                key, 'with domain = "time" the band of the pulse, start_frequency and stop_frequency [Hz]'
            )
        lowest, highest = carrier - (count // 2) * spacing, carrier + ((count - 1) // 2) * spacing
    first, last = (round((edge - carrier) / spacing, 6) for edge in (lowest, highest))
    bins = np.arange(np.ceil(first), np.floor(last) + 1)
    limit = 1 / step / (2 if real else 1)
    if not len(bins):
        raise radar.error(
            "stop_frequency",
            f"a band of {spacing:.4g} Hz or more above {lowest:.6g} Hz, 1 over the {count} samples' time",
        )
    if len(bins) > count or (real and highest > limit):
        raise radar.error(
            "stop_frequency",
            f"up to {limit if real else lowest + limit:.6g} Hz, which samples {step:.4g} s apart can hold",
        )
    frequencies = carrier + spacing * bins
    spectrum = np.fft.fft(values, axis=-1)[..., bins.astype(np.int64) % count]
    turns = np.exp(-2j * np.pi * ((spacing * bins * start) % 1))  # the first sample is not at time 0
    return (2 if real else 1) * spectrum * turns, frequencies


def _times(frames: TomlTable) -> tuple[float, float]:
    """The time of the first sample, and from sample to sample [s]."""
    key = frames.only_one("time_step", "range_step")
    other = "range_start" if key == "time_step" else "time_start"
    if other in frames:
        raise frames.error(
            other, f"{other.replace('range', 'time') if key == 'time_step' else 'range_start'} beside {key}"
        )
    start_key, unit, factor = (
        ("time_start", "s", 1.0) if key == "time_step" else ("range_start", "m", 2 / SPEED_OF_LIGHT)
    )
    step = factor * frames.number(key, unit)
    if not step > 0:
        raise frames.error(key, f"more than 0 [{unit}]")
    return factor * frames.number(start_key, unit, 0.0), step
