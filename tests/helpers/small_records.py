"""A small capture, and whether records are equal."""

from dataclasses import fields

import numpy as np

import millisight as ms
from millisight.io._hdf5 import RECORDS


def small_capture(receivers="iwr1443"):
    rng = np.random.default_rng(0)
    radar = ms.Radar.preset(receivers)
    trajectory = ms.Trajectory(
        times=[0.0, 0.5], positions=rng.normal(size=(2, 3)), orientations=[[0, 0, 0, 1.0], [1.0, 0, 0, 0]]
    )
    shape = (2, 1, len(radar.array.rx_positions), radar.waveform.samples_per_chirp)
    frames = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    metadata = {"history": [{"step": "made", "numbers": [1, 2.5, None]}], "phase_sign": -1}
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames, metadata=metadata)


def same(a, b):
    if type(a).__name__ in RECORDS:
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple) and a and type(a[0]).__name__ in RECORDS:
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return a == b


class Comparable:
    """A record that is equal to records of the same content, whenever and by whatever command they were made."""

    def __init__(self, record):
        self.record = record

    def __eq__(self, other):
        return isinstance(other, Comparable) and same(self.record, other.record)

    __hash__ = None
