"""TI radars' `.cfg` files, the mmWave SDK's command lines, parsed to the waveform that the samples have."""

import math
import os
from collections.abc import Mapping
from dataclasses import astuple

from millisight.core import check_readable, checked_integer, checked_number, checked_record, printable, put, record
from millisight.core.errors import FormatError, InputError
from millisight.data import Waveform

_MAX_BYTES = 1 << 20
_MAX_CHIRPS = 512  # chirp indices of the devices


@record
class TiConfig:
    """Settings of a `.cfg` file that captures need.

    Attributes
    ----------
    waveform : its start_frequency is that of the first sample
    receivers : R, those switched on
    tx_masks : the transmitters (bit 0: TX1) of each chirp of a loop, in order
    loops : repeats of these chirps in a frame
    frames : 0 where the radar runs until it is stopped
    frame_period : [s]
    sample_swap : whether Q stands before I in memory
    order : "two-lane" where channels are not interleaved; else None, since the lanes' number is not in the file
    complex_samples : False: real samples, which `read_dca1000` does not take
    plain_stream : the LVDS stream holds samples only: no headers, nothing between
    """

    waveform: Waveform
    receivers: int
    tx_masks: tuple[int, ...]
    loops: int
    frames: int
    frame_period: float
    sample_swap: bool
    order: str | None
    complex_samples: bool
    plain_stream: bool

    def __post_init__(self) -> None:
        checked_record(self.waveform, Waveform, name="waveform")
        put(
            self,
            receivers=checked_integer(self.receivers, name="receivers"),
            tx_masks=tuple(checked_integer(mask, name="a tx_mask", minimum=0) for mask in self.tx_masks),
            loops=checked_integer(self.loops, name="loops"),
            frames=checked_integer(self.frames, name="frames", minimum=0),
            frame_period=checked_number(self.frame_period, name="frame_period", unit="s", minimum=0),
        )

    @property
    def chirps_per_frame(self) -> int:
        """C, all transmitters' chirps."""
        return len(self.tx_masks) * self.loops

    @property
    def transmitters(self) -> int:
        """T, the different transmitters, or sets of them, that the chirps use."""
        return len({mask for mask in self.tx_masks if mask})


# The fields of the commands that are read; those of other commands are of no account here.
_FIELDS = {
    "channelCfg": ("rxMask", "txMask", "cascading"),
    "adcCfg": ("bits", "format"),
    "adcbufCfg": ("subframe", "format", "sampleSwap", "chanInterleave", "threshold"),
    "profileCfg": (
        "id", "startFrequency", "idleTime", "adcStartTime", "rampEndTime", "txPower", "txPhase", "slope",
        "txStartTime", "samples", "sampleRate", "hpf1", "hpf2", "rxGain",
    ),
    "chirpCfg": ("first", "last", "profile", "startFrequency", "slope", "idleTime", "adcStartTime", "txMask"),
    "frameCfg": ("firstChirp", "lastChirp", "loops", "frames", "period", "trigger", "delay"),
    "lvdsStreamCfg": ("subframe", "header", "data", "software"),
}  # fmt: skip
_NEEDED = ("channelCfg", "adcCfg", "adcbufCfg", "profileCfg", "chirpCfg", "frameCfg")


@record
class _Command:
    """One line of the file: where it stands, and its fields by name."""

    place: str
    name: str
    values: Mapping[str, str]

    def number(self, field: str, *, minimum: float = -math.inf) -> float:
        text = self.values[field]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < minimum:
            limit = f" of at least {minimum:g}" if minimum > -math.inf else ""
            raise FormatError(f"{self.place}: {field} of {self.name} is {text[:40]!r}; expected a number{limit}")
        return value

    def integer(self, field: str, low: int, high: int) -> int:
        value = self.number(field)
        if value != int(value) or not low <= value <= high:
            raise FormatError(
                f"{self.place}: {field} of {self.name} is {self.values[field][:40]!r}; expected a whole number "
                f"from {low} to {high}"
            )
        return int(value)


def read_ti_config(path: str | os.PathLike[str]) -> TiConfig:
    """Read the waveform and the frame of a `.cfg` file.

    A ramp starts at profileCfg's startFrequency, and the ADC adcStartTime after the knee of the ramp (TI mmWave
    SDK user guide and mmWaveLink's rlProfileCfg_t; chirpCfg adds its own variations to each). So the first sample
    has the frequency

        (startFrequency + chirp's variation) + (adcStartTime + variation) x (slope + variation)

    profileCfg is in GHz, us, MHz/us and ksps; chirpCfg's variations in Hz, kHz/us and us. Of several profiles
    that one counts which the frame's chirps use. `flushCfg` forgets what stands above it, as on the device; other
    commands are passed over.

    Raises
    ------
    FileError
        The file cannot be read.
    FormatError
        A line or a field of it cannot be right, a command is missing, the chirps of the frame have several
        waveforms, or the file asks for what is not supported (12 or 14 bits, advanced frames); with line and field.
    """
    path = check_readable(path)
    name = printable(path.name)
    with open(path, "rb") as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES or b"\0" in data:
        raise FormatError(f"{name} is not a text of up to {_MAX_BYTES >> 20} MiB; expected a .cfg file of TI commands")
    commands = _commands(name, data.decode("utf-8", "replace"))
    missing = [needed for needed in _NEEDED if needed not in commands]
    if missing:
        raise FormatError(f"{name} has no {', '.join(missing)}; expected a .cfg file with all of {', '.join(_NEEDED)}")
    last = {command: lines[-1] for command, lines in commands.items()}
    frame, buffer = last["frameCfg"], last["adcbufCfg"]
    chirps, waveform = _frame_chirps(frame, commands["chirpCfg"], commands["profileCfg"])
    if last["adcCfg"].integer("bits", 0, 2) != 2:
        raise FormatError(f"{last['adcCfg'].place}: the ADC gives 12 or 14 bits; expected 16 (bits 2)")
    is_complex = last["adcCfg"].integer("format", 0, 3) in (1, 2)
    if is_complex == bool(buffer.integer("format", 0, 1)):
        raise FormatError(f"{buffer.place}: format of adcbufCfg (0 complex, 1 real) contradicts that of adcCfg")
    lvds = last.get("lvdsStreamCfg")
    return TiConfig(
        waveform=waveform,
        receivers=last["channelCfg"].integer("rxMask", 1, 15).bit_count(),
        tx_masks=tuple(chirp.integer("txMask", 0, 7) for chirp in chirps),
        loops=frame.integer("loops", 1, 65535),
        frames=frame.integer("frames", 0, 65535),
        frame_period=frame.number("period", minimum=0) * 1e-3,
        sample_swap=bool(buffer.integer("sampleSwap", 0, 1)),
        order="two-lane" if buffer.integer("chanInterleave", 0, 1) else None,
        complex_samples=is_complex,
        plain_stream=lvds is None or (lvds.integer("header", 0, 1) == 0 and lvds.integer("data", 0, 4) <= 1),
    )


def _commands(name: str, text: str) -> dict[str, list[_Command]]:
    """The commands that are read, by name, in the order of the file."""
    commands: dict[str, list[_Command]] = {}
    for i, line in enumerate(text.splitlines(), start=1):
        words = line.split("%")[0].split()
        if not words:
            continue
        command, values, place = words[0], words[1:], f"{name} line {i}"
        if command == "flushCfg":
            commands.clear()
        elif command in ("advFrameCfg", "subFrameCfg"):
            raise FormatError(f"{place}: {command} makes frames of several kinds, which is not supported; use frameCfg")
        elif command in _FIELDS:
            fields = _FIELDS[command]
            if command in ("adcbufCfg", "lvdsStreamCfg") and len(values) == len(fields) - 1:
                values = ["-1", *values]  # before SDK 2 no subframe was named
            if len(values) != len(fields):
                raise FormatError(
                    f"{place}: {command} has {len(values)} fields; expected {len(fields)}: {', '.join(fields)}"
                )
            commands.setdefault(command, []).append(
                _Command(place=place, name=command, values=dict(zip(fields, values, strict=True)))
            )
    return commands


def _frame_chirps(
    frame: _Command, chirp_lines: list[_Command], profile_lines: list[_Command]
) -> tuple[list[_Command], Waveform]:
    """The chirpCfg line of each chirp of a loop, and the one waveform that they all have."""
    last = _MAX_CHIRPS - 1
    profiles = {line.integer("id", 0, 15): line for line in profile_lines}
    lines: list[_Command | None] = [None] * _MAX_CHIRPS
    for line in chirp_lines:
        start = line.integer("first", 0, last)
        stop = line.integer("last", start, last) + 1
        lines[start:stop] = [line] * (stop - start)
    first = frame.integer("firstChirp", 0, last)
    stop = frame.integer("lastChirp", first, last) + 1
    chirps = [line for line in lines[first:stop] if line is not None]
    if len(chirps) < stop - first:
        undefined = first + lines[first:stop].index(None)
        raise FormatError(f"{frame.place}: the frame uses chirp {undefined}, which no chirpCfg defines")
    used = list(dict.fromkeys(chirps))
    waveforms = [_waveform(line, profiles) for line in used]
    for line, waveform in zip(used, waveforms, strict=True):
        if astuple(waveform) != astuple(waveforms[0]):
            raise FormatError(
                f"{line.place}: the chirp's waveform differs from that of the frame's first chirp ({used[0].place}); "
                "expected one waveform a frame"
            )
    return chirps, waveforms[0]


def _waveform(chirp: _Command, profiles: dict[int, _Command]) -> Waveform:
    profile = profiles.get(chirp.integer("profile", 0, 15))
    if profile is None:
        raise FormatError(f"{chirp.place}: the chirp uses profile {chirp.values['profile']}, which no line defines")
    slope = profile.number("slope") * 1e12 + chirp.number("slope") * 1e9
    adc_start = (profile.number("adcStartTime", minimum=0) + chirp.number("adcStartTime", minimum=0)) * 1e-6
    start = profile.number("startFrequency", minimum=0) * 1e9 + chirp.number("startFrequency")
    sample_rate = profile.number("sampleRate", minimum=1) * 1e3
    samples = profile.integer("samples", 1, 65535)
    end, ramp_end = adc_start + samples / sample_rate, profile.number("rampEndTime") * 1e-6
    if end > ramp_end * (1 + 1e-9):
        raise FormatError(
            f"{profile.place}: the ADC samples until {end * 1e6:.2f} us, past the ramp's end at {ramp_end * 1e6:.2f} us"
        )
    try:
        return Waveform(
            start_frequency=start + slope * adc_start, slope=slope, sample_rate=sample_rate, samples_per_chirp=samples
        )
    except InputError as error:
        raise FormatError(f"{profile.place}: {error}") from error
