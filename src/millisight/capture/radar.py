"""Radars: waveform, antennas, and the presets of the published set-up."""

import tomllib
from importlib.resources import files
from typing import Any

import numpy as np

from millisight.constants import SPEED_OF_LIGHT
from millisight.errors import InputError, UnknownNameError
from millisight.records import checked_array, checked_integer, checked_number, checked_record, put, record


@record
class Waveform:
    """A linear chirp, sampled: frequencies f_0 + j slope / sample_rate (primer 1).

    Attributes
    ----------
    start_frequency : f_0 [Hz], of the first sample
    slope : [Hz/s]
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
            slope=checked_number(self.slope, name="slope", unit="Hz/s", minimum=0),
            sample_rate=checked_number(self.sample_rate, name="sample_rate", unit="Hz", above=0),
            samples_per_chirp=samples,
        )
        if samples > 1 and not self.slope > 0:
            raise InputError(f"slope is 0 Hz/s with {samples} samples; expected a rising chirp, or a single sample")

    @classmethod
    def stepped(cls, start_frequency: float, step: float, count: int) -> "Waveform":
        """A stepped-frequency sweep: `count` frequencies, `step` [Hz] apart. Its sample rate is nominal, 1 Hz."""
        return cls(start_frequency=start_frequency, slope=step, sample_rate=1.0, samples_per_chirp=count)

    @property
    def frequency_step(self) -> float:
        """slope / sample_rate [Hz]."""
        return self.slope / self.sample_rate

    @property
    def frequencies(self) -> np.ndarray:
        """(N,) frequency of each sample [Hz]."""
        return self.start_frequency + self.frequency_step * np.arange(self.samples_per_chirp)

    @property
    def bandwidth(self) -> float:
        """B = N slope / sample_rate [Hz]."""
        return self.samples_per_chirp * self.frequency_step

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
    """Where a radar's antennas are; every pair of a transmitter and a receiver is one channel.

    Attributes
    ----------
    tx_positions : (T, 3) transmitters in the radar's own frame [m]
    rx_positions : (R, 3) receivers in the radar's own frame [m]
    """

    tx_positions: np.ndarray
    rx_positions: np.ndarray

    def __post_init__(self) -> None:
        put(
            self,
            tx_positions=checked_array(self.tx_positions, name="tx_positions", shape=("T", 3), unit="m"),
            rx_positions=checked_array(self.rx_positions, name="rx_positions", shape=("R", 3), unit="m"),
        )

    @classmethod
    def monostatic(cls) -> "AntennaArray":
        """One transmitter and one receiver, both at the radar's origin."""
        return cls(tx_positions=np.zeros((1, 3)), rx_positions=np.zeros((1, 3)))


@record
class Radar:
    """A radar: what it sends, from where, and the electrical path it adds.

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

    @classmethod
    def preset(cls, name: str, *, rx_axis: str | None = None) -> "Radar":
        """One of the published set-up's radars, by name: see `radar_names()`.

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
        if name not in radar_names():
            raise UnknownNameError("radar", name, radar_names())
        table: dict[str, Any] = tomllib.loads((_PRESETS / f"{name}.toml").read_text(encoding="utf-8"))
        axis = rx_axis or table["rx_axis"]
        if axis not in ("x", "y"):
            raise InputError(f"rx_axis is {axis!r}; expected 'x' or 'y'")
        receivers = np.zeros((len(table["rx_offsets"]), 3))
        receivers[:, "xy".index(axis)] = table["rx_offsets"]
        return cls(
            name=name,
            waveform=Waveform(**table["waveform"]),
            array=AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=receivers),
            path_offset=table["path_offset"],
        )


_PRESETS = files("millisight.capture") / "presets"


def radar_names() -> tuple[str, ...]:
    """The names that `Radar.preset` knows."""
    return tuple(sorted(entry.name[:-5] for entry in _PRESETS.iterdir() if entry.name.endswith(".toml")))
