"""[calibration] of a description: steps of `capture.calibrate`, always in the same order.

Background, mean, gains, phase, samples: first what is taken off the frames as recorded, then what scales them.
"""

import numpy as np

from millisight.capture.calibrate import add_phase, crop_samples, divide_gains, subtract_background, subtract_mean
from millisight.capture.capture import Capture
from millisight.capture.trajectory import Trajectory
from millisight.io.description_frames import FrameReader
from millisight.io.description_tables import Table

KEYS = ("background", "subtract_mean", "gains", "phase", "samples")
_BACKGROUND_KEYS = ("file", "array", "frame")
_GAINS_KEYS = ("amplitudes", "phases")
_PHASE_KEYS = ("frequencies", "values", "between")


class Calibration:
    """Calibrates a capture whose frames `reader` read, as the table says.

    Raises
    ------
    FileError, UnknownNameError
        The table, or a file that it names, cannot be right or does not fit the capture.
    """

    def __init__(self, table: Table, reader: FrameReader):
        self._table, self._reader = table, reader

    def __call__(self, capture: Capture) -> Capture:
        table = self._table
        with table.errors():
            if "background" in table:
                capture = self._without_background(capture)
            if table.flag("subtract_mean"):
                capture = subtract_mean(capture)
            if "gains" in table:
                capture = divide_gains(capture, self._gains(capture))
            if "phase" in table:
                phase = table.table("phase", _PHASE_KEYS)
                between = phase.text("between", "linear", among=("linear", "nearest"))
                frequencies, values = phase.array("frequencies", "Hz"), phase.array("values", "rad")
                capture = add_phase(capture, frequencies.reshape(-1), values.reshape(-1), between=between)
            if "samples" in table:
                samples = table.wholes("samples")
                if samples.shape != (2,):
                    raise table.error("samples", "[first, stop]: the samples from first on, before stop")
                capture = crop_samples(capture, *samples)
        return capture

    def _without_background(self, capture: Capture) -> Capture:
        """The capture less the frames of the empty scene, which lie in a file like that of the frames."""
        table = self._table
        if isinstance(table.get("background"), str):
            path, array, frame = table.files.one(table.text("background")), None, "mean"
        else:
            about = table.table("background", _BACKGROUND_KEYS)
            path, array = about.file(), about.text("array") if "array" in about else None
            frame = about.text("frame", "mean", among=("first", "mean", "same"))
        frames = self._reader.read(path, array)
        values = frames.values[~frames.lost]
        poses = capture.trajectory
        if frame != "same" or len(values) != len(poses):  # then it is not said where they were taken
            poses = Trajectory(times=np.arange(len(values)), positions=np.zeros((len(values), 3)))
        metadata = {"source": path.name}
        empty = Capture(radar=capture.radar, trajectory=poses, frames=values, metadata=metadata)
        return subtract_background(capture, empty, frame=frame)

    def _gains(self, capture: Capture) -> np.ndarray:
        """(T, R) complex gains of the channels."""
        gains = self._table.table("gains", _GAINS_KEYS)
        shape = capture.frames.shape[1:3]
        found = np.ones(shape, dtype=complex)
        if "amplitudes" in gains:
            found *= gains.numbers("amplitudes", "", found.size).reshape(shape)
        if "phases" in gains:
            found *= np.exp(1j * gains.numbers("phases", "rad", found.size).reshape(shape))
        return found
