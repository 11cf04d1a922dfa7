"""Radars: waveform, antennas, and the presets of the published set-up."""

from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import (
    SPEED_OF_LIGHT,
    Registry,
    box,
    checked_array,
    checked_integer,
    checked_number,
    checked_record,
    put,
    record,
    record_from_file,
)
from millisight.core.errors import InputError
from millisight.data._reach import check_reach

_LOWEST = 1.0  # frequency [Hz], of waves as long as any scene may be
_HIGHEST = 1e15  # frequency [Hz], of light; beyond it a wavelength of the band may be zero


@record
class Waveform:
    """A linear chirp, sampled: frequencies f_0 + j slope / sample_rate (primer 1).

    Attributes
    ----------
    start_frequency : f_0 [Hz], of the first sample
    slope : [Hz/s]; negative for a falling chirp
    sample_rate : [Hz]
    samples_per_chirp : N
    """

    start_frequency: float
    slope: float
    sample_rate: float
    samples_per_chirp: int

    def __post_init__(self) -> None:
        samples = checked_integer(self.samples_per_chirp, name="samples_per_chirp")
        put(
            self,
            start_frequency=checked_number(self.start_frequency, name="start_frequency", unit="Hz", above=0),
            slope=checked_number(self.slope, name="slope", unit="Hz/s"),
            sample_rate=checked_number(self.sample_rate, name="sample_rate", unit="Hz", above=0),
            samples_per_chirp=samples,
        )
        if samples > 1 and self.slope == 0:
            raise InputError(f"slope is 0 Hz/s with {samples} samples; expected a sweep, or a single sample")
        last = self.start_frequency + self.frequency_step * (samples - 1)
        if last <= 0:
            raise InputError(f"the chirp falls to {last:g} Hz; expected more than 0 Hz at its last sample")
        # Not a number where an infinite step meets one sample.
        if not (min(self.start_frequency, last) >= _LOWEST and max(self.start_frequency, last) <= _HIGHEST):
            raise InputError(
                f"the chirp runs from {self.start_frequency:.3g} to {last:.3g} Hz; expected {_LOWEST:g} Hz at least, "
                f"and {_HIGHEST:g} Hz at most: check start_frequency, slope and sample_rate, in Hz, Hz/s and Hz"
            )

    @classmethod
    def stepped(cls, start_frequency: float, step: float, count: int) -> "Waveform":
        """A stepped-frequency sweep: `count` frequencies, `step` [Hz] apart; a negative step falls.

        Its sample rate is nominal, 1 Hz.
        """
        return cls(start_frequency=start_frequency, slope=step, sample_rate=1.0, samples_per_chirp=count)

    @property
    def frequency_step(self) -> float:
        """slope / sample_rate [Hz]; negative for a falling chirp."""
        return self.slope / self.sample_rate

    @property
    def frequencies(self) -> np.ndarray:
        """(N,) frequency of each sample [Hz]."""
        return self.start_frequency + self.frequency_step * np.arange(self.samples_per_chirp)

    @property
    def bandwidth(self) -> float:
        """B = N |slope| / sample_rate [Hz]."""
        return self.samples_per_chirp * abs(self.frequency_step)

    @property
    def center_frequency(self) -> float:
        """Mean of the samples' frequencies [Hz]."""
        return self.start_frequency + self.frequency_step * (self.samples_per_chirp - 1) / 2

    @property
    def wavelength(self) -> float:
        """At the centre frequency [m]."""
        return SPEED_OF_LIGHT / self.center_frequency

    @property
    def range_resolution(self) -> float:
        """c / (2B) [m] (primer 5); infinite for a single frequency."""
        return SPEED_OF_LIGHT / (2 * self.bandwidth) if self.bandwidth else float("inf")


@record
class AntennaArray:
    """Antenna positions of a radar; every pair of a transmitter and a receiver is one channel.

    Attributes
    ----------
    tx_positions : (T, 3) transmitters in the radar's own frame [m]
    rx_positions : (R, 3) receivers in the radar's own frame [m]
    """

    tx_positions: np.ndarray
    rx_positions: np.ndarray

    def __post_init__(self) -> None:
        for name, count in (("tx_positions", "T"), ("rx_positions", "R")):
            positions = checked_array(getattr(self, name), name=name, shape=(count, 3), unit="m")
            check_reach(positions, name)
            put(self, **{name: positions})

    def __repr__(self) -> str:
        both = np.concatenate([self.tx_positions, self.rx_positions])
        size = f"{len(self.tx_positions)} TX x {len(self.rx_positions)} RX"
        return f"AntennaArray({size}, {box(both.min(axis=0), both.max(axis=0))})"

    def moved(self, *, rotation: np.ndarray | None = None, translation: np.ndarray | None = None) -> "AntennaArray":
        """The antennas rotated by a (3, 3) matrix about the radar's origin, then shifted by a (3,) vector [m]."""
        turn = np.eye(3) if rotation is None else checked_array(rotation, name="rotation", shape=(3, 3))
        shift = 0.0 if translation is None else checked_array(translation, name="translation", shape=(3,), unit="m")
        return AntennaArray(
            tx_positions=self.tx_positions @ turn.T + shift, rx_positions=self.rx_positions @ turn.T + shift
        )

    @classmethod
    def monostatic(cls) -> "AntennaArray":
        """One transmitter and one receiver, both at the radar's origin."""
        return cls(tx_positions=np.zeros((1, 3)), rx_positions=np.zeros((1, 3)))


@record
class Radar:
    """A radar: waveform, antennas, and path offset of its electronics.

    Attributes
    ----------
    name : str
    waveform : Waveform
    array : AntennaArray
    path_offset : constant path in cables and front end, added to every path length [m] (primer 2)
    """

    name: str
    waveform: Waveform
    array: AntennaArray
    path_offset: float = 0.0

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        checked_record(self.waveform, Waveform, name="waveform")
        checked_record(self.array, AntennaArray, name="array")
        put(self, path_offset=checked_number(self.path_offset, name="path_offset", unit="m"))

    def __repr__(self) -> str:
        first, last = self.waveform.frequencies[[0, -1]] / 1e9
        size = f"{len(self.array.tx_positions)} TX x {len(self.array.rx_positions)} RX"
        return (
            f"Radar({self.name}, {first:.4f} to {last:.4f} GHz in {self.waveform.samples_per_chirp} samples, {size}, "
            f"path offset {self.path_offset:g} m)"
        )

    @classmethod
    def preset(cls, name: str, *, rx_axis: str | None = None) -> "Radar":
        """A radar by name, of the published set-up or of an installed plug-in; see `radar_names()`.

        Parameters
        ----------
        name : "iwr1443" | "position2go" | "mito-sim-77ghz" | "mito-sim-24ghz"
        rx_axis : "x" or "y", the axis of the row of receivers; default as in the preset's file

        Raises
        ------
        UnknownNameError, InputError

        Examples
        --------
        >>> radar = Radar.preset("iwr1443", rx_axis="y")
        >>> f"{radar.waveform.bandwidth / 1e9:.3f} GHz, {len(radar.array.rx_positions)} RX"
        '3.001 GHz, 4 RX'
        """
        if repr(rx_axis) not in ("None", "'x'", "'y'"):  # of an array, too
            raise InputError(f"rx_axis is {rx_axis!r}; expected 'x' or 'y'")
        entry = RADAR_PRESETS[name]
        if isinstance(entry, str | Path):
            return record_from_file(_Preset, entry, "a radar").radar(name, rx_axis)
        if isinstance(entry, Radar):
            if rx_axis is not None:
                raise InputError(f"the receivers of the radar {name!r} are fixed; leave rx_axis={rx_axis!r} out")
            return entry
        return checked_record(entry(**({"rx_axis": rx_axis} if rx_axis else {})), Radar, name=f"radar {name!r}")


@record
class _Preset:
    """A radar's file: its receivers in a row beside the transmitter."""

    waveform: Waveform
    rx_axis: str  # "x" or "y", along which the receivers lie where nothing is said
    rx_offsets: tuple[float, ...]  # from the transmitter [m]
    path_offset: float = 0.0  # see Radar [m]

    def __post_init__(self) -> None:
        if self.rx_axis not in ("x", "y") or not self.rx_offsets:
            raise InputError(
                f"rx_axis is {self.rx_axis!r} with {len(self.rx_offsets)} rx_offsets; expected 'x' or 'y', and some"
            )

    def radar(self, name: str, rx_axis: str | None) -> Radar:
        """The radar, its receivers along `rx_axis`."""
        receivers = np.zeros((len(self.rx_offsets), 3))
        receivers[:, "xy".index(rx_axis or self.rx_axis)] = self.rx_offsets
        array = AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=receivers)
        return Radar(name=name, waveform=self.waveform, array=array, path_offset=self.path_offset)


def _check_preset(name: str, entry: Any) -> None:
    if not (isinstance(entry, str | Path | Radar) or callable(entry)):
        raise InputError(f"radar {name!r} is {entry!r}; expected a Radar, a TOML file's path, or a function")


RADAR_PRESETS: Registry[Any] = Registry("radar", "millisight.radars", check=_check_preset)
"""Radars by name: the path of a TOML file, a `Radar`, or a function that returns one and may take `rx_axis`.

A file of the folder `presets` is one; other packages add theirs by entry points "millisight.radars".
"""
for _file in sorted(Path(__file__).with_name("presets").glob("*.toml")):
    RADAR_PRESETS.add(_file.stem, _file)


def radar_names() -> tuple[str, ...]:
    """Names that `Radar.preset` accepts."""
    return RADAR_PRESETS.names()
