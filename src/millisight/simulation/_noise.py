"""Receiver noise (primer 15)."""

from dataclasses import replace
from typing import Any

import numpy as np

from millisight.core import checked_number, checked_record, seed_or_generator, with_step
from millisight.core.errors import InputError
from millisight.data import Capture


def add_noise(capture: Capture, *, snr_db: float, rng: int | np.random.Generator | None) -> Capture:
    """Add complex white Gaussian noise; the SNR is the mean |S|² of all frames over the noise variance (primer 15).

    Parameters
    ----------
    capture : frames in memory; not empty
    snr_db : [dB]
    rng : a seed, or a generator to draw one from; the seed goes into the metadata

    Raises
    ------
    InputError
        The ratio or the seed cannot be right, or the capture is empty.
    """
    checked_record(capture, Capture, name="capture")
    snr_db = check_noise(snr_db, rng)
    # Pose by pose: no second array of the frames' size.
    poses = [slice(p, p + 1) for p in range(len(capture.frames))]
    power = sum(float(np.sum(np.abs(capture.frames_of(one).astype(np.complex128)) ** 2)) for one in poses)
    power /= capture.frames.size
    if not power > 0:
        raise InputError("snr_db sets noise relative to the signal, but there is none: no vertex is lit")
    seed = int(rng.integers(2**63) if isinstance(rng, np.random.Generator) else rng)  # ty: ignore[invalid-argument-type]: None was refused
    generator = np.random.default_rng(seed)
    scale = np.float32(np.sqrt(power / 10 ** (snr_db / 10) / 2))
    frames = np.empty(capture.frames.shape, dtype=np.complex64)
    for one in poses:
        noise = generator.standard_normal((*frames.shape[1:], 2), dtype=np.float32)
        frames[one] = capture.frames_of(one) + scale * noise.view(np.complex64)[..., 0]
    frames.flags.writeable = False
    metadata = with_step(capture.metadata, "add_noise", snr_db=snr_db, seed=seed)
    return replace(capture, frames=frames, metadata=metadata)


def check_noise(snr_db: float, rng: Any) -> float:
    """`snr_db` [dB] as a number; `InputError` before any work where noise could not be added with it and `rng`."""
    number = checked_number(snr_db, name="snr_db", unit="dB")
    if abs(number) > 300:
        raise InputError(f"snr_db is {number:g} dB; expected between -300 and 300 dB")
    if rng is None:
        raise InputError("snr_db adds noise, which needs a seed: pass rng=0, for example")
    seed_or_generator(rng)
    return number
