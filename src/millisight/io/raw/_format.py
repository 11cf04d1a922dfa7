"""The door for raw formats: `RAW_FORMATS`, and what an entry of it is.

A format is one file: a function that reads a radar's files into arrays, and `RAW_FORMATS.add(name, RawFormat(...))`;
or, in another package, an entry point of the group "millisight.raw_formats". A description asks for it by
`[frames] format = "name"`, or by the suffix of its files.
"""

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any

import numpy as np

from millisight.core import Metadata, Registry, checked_array, checked_metadata, checked_record, put, record
from millisight.core.errors import InputError

RECORDED = ("pose", "chirp", "rx", "sample")
"""The axes of what a radar's recorder writes."""


@record
class RawArray:
    """Contents of one raw file, as recorded; the description gives axes, phase sign and positions.

    Attributes
    ----------
    values : array of numbers, real or complex
    lost : (F,) bool, the entries along the axis "pose" that the recorder lost, wholly or in part; None: none
    frequencies : (N,) [Hz] where the file says them; None: it does not
    found : settings that hold for the other files of the recording, too, by key
    metadata : how the file was read; what JSON can hold
    """

    values: np.ndarray
    lost: np.ndarray | None = None
    frequencies: np.ndarray | None = None
    found: Mapping[str, Any] = field(default_factory=dict[str, Any])
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.dtype.kind not in "biufc":
            raise InputError(f"the frames are {values.dtype}; expected an array of numbers")
        metadata = checked_metadata({key: value for key, value in self.metadata.items() if key != "source"})
        put(self, values=values, found=dict(self.found), metadata=metadata)
        if self.lost is not None:
            put(self, lost=checked_array(self.lost, name="lost", shape=("F",), dtype=np.bool_))
        if self.frequencies is not None:
            put(self, frequencies=checked_array(self.frequencies, name="frequencies", shape=("N",), unit="Hz"))


@record
class RawFormat:
    """A format of raw files.

    Attributes
    ----------
    suffixes : of files that are of this format unless a description says otherwise, such as ".bin"
    keys : of [frames] that `read` takes, as keyword arguments: a number, a text, a list, or an array that is referred
        to. samples, receivers and chirps also come from a TI profile, as do order and sample_swap
    read : called with (path, **settings); returns a RawArray; raises FileError or InputError
    axes : of its arrays; None: the description names them
    phase_sign : of its frames; None: the description states it
    remarks : called with (path, **settings) of the first file; returns what is odd about it, in words
    """

    suffixes: tuple[str, ...]
    keys: tuple[str, ...]
    read: Callable[..., RawArray]
    axes: tuple[str, ...] | None = RECORDED
    phase_sign: int | None = None
    remarks: Callable[..., list[str]] | None = None


def _check(name: str, entry: Any) -> None:
    checked_record(entry, RawFormat, name=f"the format {name}")


RAW_FORMATS: Registry[RawFormat] = Registry(
    "format of frames",
    "millisight.raw_formats",
    package="millisight.io.raw",
    check=_check,
)
