"""Raw frames: the numbers that a radar's recorder wrote, before anything is known of poses or phase signs."""

from dataclasses import field

import numpy as np

from millisight.core import (
    Metadata,
    checked_array,
    checked_integer,
    checked_items,
    checked_metadata,
    checked_record,
    put,
    record,
)
from millisight.core.errors import InputError


@record
class Gap:
    """A stretch of a recording that never arrived.

    Attributes
    ----------
    start : its first byte, counted from the start of the recording
    length : in bytes; 0 where something was refused that has no known place
    reason : why, in words
    """

    start: int
    length: int
    reason: str

    def __post_init__(self) -> None:
        checked_record(self.reason, str, name="reason")
        put(
            self,
            start=checked_integer(self.start, name="start", minimum=0),
            length=checked_integer(self.length, name="length", minimum=0),
        )

    @property
    def stop(self) -> int:
        """The first byte after it."""
        return self.start + self.length


@record
class RawFrames:
    """Frames as recorded: nothing conjugated, scaled or taken off.

    Attributes
    ----------
    samples : (F, C, R, N) complex64, frame x chirp x receiver x sample, in counts of the converter
    lost : (F,) bool, the frames that a gap touches; what they hold is not all measured
    gaps : where the recording has holes
    order : the file's sample order, where it has several (DCA1000)
    metadata : what JSON can hold
    """

    samples: np.ndarray
    lost: np.ndarray
    gaps: tuple[Gap, ...] = ()
    order: str | None = None
    metadata: Metadata = field(default_factory=dict)

    def __post_init__(self) -> None:
        samples = checked_array(self.samples, name="samples", shape=("F", "C", "R", "N"), dtype=np.complex64)
        put(
            self,
            samples=samples,
            lost=checked_array(self.lost, name="lost", shape=(len(samples),), dtype=np.bool_),
            gaps=checked_items(self.gaps, Gap, name="a gap"),
            metadata=checked_metadata(self.metadata),
        )
        if self.order is not None and not isinstance(self.order, str):
            raise InputError(f"order is {self.order!r}; expected the name of a sample order, or None")
