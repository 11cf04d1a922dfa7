"""What a raw DCA1000 file holds, in a few lines, and what of its settings does not fit it."""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_readable, printable
from millisight.core.errors import MillisightError
from millisight.io.raw._dca1000 import frames_touched, identify_order, open_recording
from millisight.io.raw._raw_frames import Gap
from millisight.io.raw._sample_order import (
    UNKNOWN,
    OrderEstimate,
    check_order,
    mean_spectrum,
    repeated_samples,
    values_per_chirp,
)
from millisight.io.raw._ti_config import TiConfig, read_ti_config

# What the settings of a capture go by in JSON files, without num, number of, n, and signs between.
_NAMES = {
    "samples": ("samples", "adcsamples", "samplesperchirp", "adcsamplesperchirp"),
    "receivers": ("rx", "receivers", "rxantennas", "rxchannels"),
    "chirps": ("chirps", "chirpsperframe"),
    "frames": ("frames",),
}
_LARGEST = {"samples": 1 << 16, "receivers": 4, "chirps": 1 << 20, "frames": 1 << 31}
_LIT_DB = 10.0
_MAX_JSON_BYTES = 1 << 20
_MAX_JSON_FILES = 100


def describe_raw(
    path: str | os.PathLike[str],
    *,
    samples: int | None = None,
    receivers: int | None = None,
    chirps: int | None = None,
    frames: int | None = None,
    order: str | None = None,
    sample_swap: bool | None = None,
    config: str | os.PathLike[str] | None = None,
) -> list[str]:
    """Lines that say what a `.bin` or `.pcap` file holds: order, frames, side and lit range bins, gaps, and warnings.

    Settings that are not given come from a TI `.cfg` (`config`, or one beside the file) and a JSON file beside it
    with keys such as num_samples, num_rx, num_chirps and num_frames; what is still missing is worked out from the
    data, and the line says so. Each line that begins with "warning:" names settings that contradict each other, the
    data, or the file's length.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        The file cannot be read, is empty, text, or big-endian; or `config` cannot be read.
    UnknownNameError
        There is no such order.
    """
    path = check_readable(path)
    if order is not None:
        check_order(order)
    warnings: list[str] = []
    config_name, settings = _config(path, config, warnings)
    if settings:
        _check_config(config_name, settings, warnings)
    declared = {"samples": samples, "receivers": receivers, "chirps": chirps, "frames": frames}
    known, origin = _merged({"declared": declared, **_from_config(config_name, settings), **_from_json(path)}, warnings)
    counts, size, gaps = open_recording(path, odd_byte=True)
    estimate = _estimate(counts, known, origin, warnings)
    expected = {"declared": order, config_name: settings.order if settings else None}
    for source, name in expected.items():
        if name and estimate.order not in (name, UNKNOWN):
            lead = estimate.scores[estimate.order] - estimate.scores[name]
            warnings.append(f"order {name} ({source}) does not fit: the data is {estimate.order}, by {lead:.1f} dB")
    used = order if estimate.order == UNKNOWN else estimate.order
    frame_line, frame_bytes, whole = _frames(size, known, origin, used, warnings)
    lines = [_order_line(estimate), frame_line]
    if used and "samples" in known:
        swap = (sample_swap, "declared") if sample_swap is not None else (False, "assumed")
        if sample_swap is None and settings:
            swap = (settings.sample_swap, config_name)
        power = mean_spectrum(counts, used, receivers=known["receivers"], samples=known["samples"], sample_swap=swap[0])
        lines += _spectrum_lines(power, *swap, warnings)
    lines.append(_gap_line(gaps, frame_bytes, whole))
    return lines + [f"warning: {text}" for text in warnings]


def _order_line(estimate: OrderEstimate) -> str:
    if estimate.order == UNKNOWN:
        best = max(estimate.scores, key=lambda order: estimate.scores[order])
        lead = f"{best} is {estimate.margin_db:.1f} dB over the next best ({estimate.next_best})"
        return f"order: unknown, {lead}: {estimate.reason}"
    return f"order: {estimate.order}, {estimate.margin_db:.1f} dB over the next best ({estimate.next_best})"


def _estimate(counts: np.ndarray, known: dict[str, int], origin: dict[str, str], warnings: list[str]) -> OrderEstimate:
    """The order; with it what is missing of samples and receivers, worked out and assumed."""
    if "receivers" not in known:
        known["receivers"], origin["receivers"] = 4, "assumed"
    receivers, samples = known["receivers"], known.get("samples")
    estimate = identify_order(counts, receivers=receivers, samples=samples)
    order = estimate.order if estimate.order != UNKNOWN else "two-lane"
    repeated = repeated_samples(counts, order, receivers=receivers)
    if samples is None and repeated:
        known["samples"], origin["samples"] = repeated, "worked out from the data's repetition"
    # Transmitters that take turns repeat later; two-lane receivers that see the same, earlier.
    if samples and repeated and repeated % samples and repeated * receivers != samples:
        warnings.append(f"the data repeats every {repeated} samples, which {samples} samples a chirp do not fit")
        if estimate.order == UNKNOWN:
            return identify_order(counts, receivers=receivers)
    return estimate


def _frames(
    size: int, known: dict[str, int], origin: dict[str, str], order: str | None, warnings: list[str]
) -> tuple[str, int | None, int]:
    """The line on frames, the bytes of one (of a chirp, where chirps are unknown), and how many are whole."""
    receivers, samples, chirps = known["receivers"], known.get("samples"), known.get("chirps")
    if samples is None or (order is None and receivers != 4):
        return f"frames: unknown, {size} bytes (give samples, receivers and chirps)", None, 0
    told = {source: [n for n in origin if origin[n] == source and n != "frames"] for source in origin.values()}
    said = next(iter(told)) if len(told) == 1 else "; ".join(f"{', '.join(n)} {s}" for s, n in told.items() if n)
    try:
        chirp = 2 * values_per_chirp(order or "two-lane", receivers=receivers, samples=samples)
    except MillisightError as error:
        warnings.append(str(error))
        return f"frames: unknown, {size} bytes", None, 0
    unit = chirp * (chirps or 1)
    whole, over = divmod(size, unit)
    if over:
        kind = "frames" if chirps else "chirps"
        warnings.append(f"the file's {size} bytes are {whole} whole {kind} of {unit} bytes, and {over} bytes over")
    if chirps and known.get("frames", whole) != whole:
        warnings.append(f"{origin['frames']} says {known['frames']} frames; the file holds {whole}")
    count = f"{whole} x {chirps} chirps" if chirps else f"{whole} chirps (chirps per frame unknown)"
    return f"frames: {count} x {receivers} RX x {samples} samples ({said})", unit, whole


def _spectrum_lines(power: np.ndarray, swap: bool, source: str, warnings: list[str]) -> list[str]:
    """On which side the (N,) spectrum is, and which bins are lit."""
    half = len(power) // 2
    if half < 4 or not power.any():
        return []
    side = "positive" if power[2:half].sum() >= power[-half + 1 : -1].sum() else "negative"
    first = "Q first" if swap else "I first"
    if side == "negative" and source != "assumed":
        warnings.append(f"{first} ({source}) makes ranges negative; the other order of I and Q makes them positive")
    strongest = int(np.argmax(power))
    runs = _runs(np.flatnonzero(power > power[strongest] * 10 ** (-_LIT_DB / 10)))
    return [
        f"side: {side} bins, read {first} ({source}); ranges come out {side}",
        f"lit range bins: {runs} of {len(power)} (strongest {strongest}; within {_LIT_DB:g} dB of it)",
    ]


def _runs(bins: np.ndarray) -> str:
    """Bins in words: 3, 17 to 21."""
    runs = np.split(bins, np.flatnonzero(np.diff(bins) > 1) + 1)
    words = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs]
    return ", ".join(words if len(words) <= 12 else [*words[:12], "..."])


def _gap_line(gaps: tuple[Gap, ...], frame_bytes: int | None, whole: int) -> str:
    if not gaps:
        return "gaps: none"
    places = ", ".join(f"{gap.length} at byte {gap.start}" for gap in gaps[:5]) + (", ..." if len(gaps) > 5 else "")
    line = f"gaps: {len(gaps)}, {sum(gap.length for gap in gaps)} bytes of zeros ({places})"
    if frame_bytes is None:
        return line
    lost = np.flatnonzero(frames_touched(gaps, frame_bytes=frame_bytes, frames=whole))
    return f"{line}; {len(lost)} of {whole} frames lost" + (f": {_runs(lost)}" if len(lost) else "")


def _merged(sources: dict[str, dict[str, Any]], warnings: list[str]) -> tuple[dict[str, int], dict[str, str]]:
    """Each setting from the first source that has it, and where from; contradictions become warnings."""
    known: dict[str, int] = {}
    origin: dict[str, str] = {}
    for source, values in sources.items():
        for name, value in values.items():
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _LARGEST[name]:
                warnings.append(f"{source} says {str(value)[:40]} {name}; expected 1 to {_LARGEST[name]}")
            elif name not in known:
                known[name], origin[name] = value, source
            elif known[name] != value:
                warnings.append(f"{source} says {value} {name}; {origin[name]} says {known[name]}, which is used")
    return known, origin


def _config(path: Path, given: str | os.PathLike[str] | None, warnings: list[str]) -> tuple[str, TiConfig | None]:
    """The name and the contents of the `.cfg` that is given, of the file's own name, or alone beside it."""
    if given is not None:
        return printable(os.path.basename(given)), read_ti_config(given)
    beside = [path.with_suffix(".cfg")] if path.with_suffix(".cfg").is_file() else sorted(path.parent.glob("*.cfg"))
    if len(beside) != 1:
        return "", None
    try:
        config = read_ti_config(beside[0])
    except MillisightError as error:
        warnings.append(str(error))
        return "", None
    return printable(beside[0].name), config


def _check_config(name: str, config: TiConfig, warnings: list[str]) -> None:
    if not config.complex_samples:
        warnings.append(f"{name} says real samples; only pairs of I and Q are read")
    if not config.plain_stream:
        warnings.append(f"{name} puts headers or other data between the samples; switch them off to record")


def _from_config(name: str, config: TiConfig | None) -> dict[str, dict[str, int]]:
    if config is None:
        return {}
    settings = {
        "samples": config.waveform.samples_per_chirp,
        "receivers": config.receivers,
        "chirps": config.chirps_per_frame,
        **({"frames": config.frames} if config.frames else {}),
    }
    return {name: settings}


def _from_json(path: Path) -> dict[str, dict[str, Any]]:
    """The settings in the JSON file of the file's own name, else in one that names its digits, else in the only one."""
    found = {}
    for beside in sorted(filter(Path.is_file, path.parent.glob("*.json")))[:_MAX_JSON_FILES]:
        text = _text(beside)
        settings = _named(text)
        if len(settings) > 1:
            found[beside] = text, settings
    stamp = max(re.findall(r"\d+", path.stem), key=len, default="")
    own = [p for p in found if p.stem == path.stem]
    named = [p for p in found if len(stamp) >= 8 and (stamp in p.name or stamp in found[p][0])]
    for choice in (own, named, list(found)):
        if len(choice) == 1:
            return {printable(choice[0].name): found[choice[0]][1]}
    return {}


def _text(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            return file.read(_MAX_JSON_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""


def _named(text: str) -> dict[str, Any]:
    """The values in a JSON object whose keys mean one of our settings."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    names = {alias: name for name, aliases in _NAMES.items() for alias in aliases}
    settings = {}
    for key, value in values.items() if isinstance(values, dict) else ():
        plain = re.sub(r"[^a-z]", "", key.lower())
        name = names.get(plain) or names.get(re.sub("^(num|numberof|n)", "", plain))
        if name:
            settings[name] = value
    return settings
