"""DCA1000 recordings as formats of frames: .bin files, and .pcap files of the card's packets."""

from functools import partial
from pathlib import Path
from typing import Any

from millisight.core.errors import InputError
from millisight.io.raw._dca1000 import read_dca1000
from millisight.io.raw._dca1000_report import describe_raw
from millisight.io.raw._format import RAW_FORMATS, RawArray, RawFormat


def _read(path: Path, *, samples: int | None = None, truncated: str = "refuse", **settings: Any) -> RawArray:
    if samples is None:
        raise InputError(
            "samples is missing; expected the number of samples of a chirp, or the radar's .cfg as [radar] config"
        )
    raw = read_dca1000(path, samples=samples, truncated=truncated, **settings)
    # One recording has one order: found in its first file, it holds for the others.
    return RawArray(values=raw.samples, lost=raw.lost, found={"order": raw.order}, metadata=raw.metadata)


def _remarks(path: Path, *, truncated: str = "", **settings: Any) -> list[str]:
    """What the file says against its settings, as `millisight info` tells."""
    lines = describe_raw(path, **settings)
    return [line.removeprefix("warning: ") for line in lines if line.startswith("warning:")]


_KEYS = ("samples", "receivers", "chirps", "order", "sample_swap", "truncated")
RAW_FORMATS.add("dca1000", RawFormat(suffixes=(".bin",), keys=_KEYS, read=_read, remarks=_remarks))
# No packet says where a frame begins or the recording ends, so what is over at its end is nothing to refuse.
_read_pcap = partial(_read, truncated="drop")
RAW_FORMATS.add("pcap", RawFormat(suffixes=(".pcap",), keys=_KEYS, read=_read_pcap, remarks=_remarks))
