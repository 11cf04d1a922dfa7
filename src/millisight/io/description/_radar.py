"""[radar] of a description: a preset, a TI profile, or numbers, each completing what goes before it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.data import AntennaArray, Radar, Waveform, radar_names
from millisight.io.description._tables import TomlTable

if TYPE_CHECKING:
    from millisight.io.raw import TiConfig

KEYS = (
    "preset", "config", "name", "path_offset", "rx_axis", "tx_positions", "rx_positions",
    "frequencies", "start_frequency", "stop_frequency", "step", "slope", "sample_rate", "samples", "adc_start",
)  # fmt: skip
_LOWEST, _NARROWEST = 1e6, 1e3  # frequency and bandwidth of a radar [Hz]
_UNEVEN = 0.01  # by so much of a step may a list of frequencies stray from even ones


def read_config(table: TomlTable) -> "TiConfig | None":
    """The TI profile (.cfg) that [radar] names, if it does."""
    if "config" not in table:
        return None
    from millisight.io.raw import read_ti_config

    config = read_ti_config(table.files.one(table.text("config")))
    if not config.complex_samples:
        raise table.error("config", "one with complex samples (adcCfg)")
    if not config.plain_stream:
        raise table.error("config", "one whose LVDS stream holds samples only (lvdsStreamCfg)")
    return config


def read_radar(
    table: TomlTable,
    config: "TiConfig | None",
    shape: tuple[int, ...],
    name: str,
    *,
    receivers: list[int] | None = None,
    recorded: int = 0,
    frequencies: np.ndarray | None = None,
    placed: Mapping[str, np.ndarray] | None = None,
) -> Radar:
    """The radar of frames (F, T, R, N) of `shape`, called `name` unless the table says otherwise.

    Parameters
    ----------
    receivers : the numbers of those that the frames are of, where not of all that were `recorded`
    frequencies : (N,) of the frames, where their files say them [Hz]
    placed : tx_positions or rx_positions (A, 3) of the first pose [m], where [positions] says where antennas are

    Raises
    ------
    FormatError, UnknownNameError
        The table cannot be right, or does not fit the frames.
    """
    with table.errors():
        rx_axis = table.text("rx_axis", among=("x", "y")) if "rx_axis" in table else None
        preset = Radar.preset(table.text("preset", among=radar_names()), rx_axis=rx_axis) if "preset" in table else None
        if preset is None and rx_axis is not None:
            raise table.error("rx_axis", "this key only beside preset; otherwise give rx_positions")
        antennas = {"tx_positions": np.zeros((1, 3)), "rx_positions": np.zeros((1, 3))}
        for key in antennas:
            if placed is not None and key in placed:
                if key in table:
                    raise table.error(key, "antenna positions only in [positions], which has them already")
                antennas[key] = placed[key]
            elif key in table:
                antennas[key] = table.array(key, "m", ("antenna", 3))
            elif preset is not None:
                antennas[key] = getattr(preset.array, key)
        if receivers is not None and len(antennas["rx_positions"]) == recorded:
            antennas["rx_positions"] = antennas["rx_positions"][receivers]
        radar = Radar(
            name=table.text("name", preset.name if preset is not None else name),
            waveform=_waveform(table, config, preset, shape[3], frequencies),
            array=AntennaArray(**antennas),
            path_offset=table.number("path_offset", "m", preset.path_offset if preset is not None else 0.0),
        )
    _check_band(table, radar.waveform)
    found = {
        "tx_positions": (len(radar.array.tx_positions), shape[1], "transmitters"),
        "rx_positions": (len(radar.array.rx_positions), shape[2], "receivers"),
        "samples": (radar.waveform.samples_per_chirp, shape[3], "samples"),
    }
    for key, (stated, there, what) in found.items():
        if stated != there:
            given = "frequencies" if key == "samples" and "frequencies" in table else key
            raise table.error(given, f"{there} {what} as in the frames, and not {stated}")
    return radar


def _waveform(
    table: TomlTable, config: "TiConfig | None", preset: Radar | None, samples: int, found: np.ndarray | None
) -> Waveform:
    """The chirp, of the frames' number of samples unless something says otherwise."""
    if found is not None:
        for key in ("frequencies", "step", "slope", "sample_rate", "adc_start"):
            if key in table:
                raise table.error(key, "no such key here: the frequencies come from the files or times of the frames")
        return _listed(table, found)
    if "frequencies" in table:
        for key in ("start_frequency", "stop_frequency", "step", "slope"):
            if key in table:
                table.only_one("frequencies", key)
        return _listed(table, table.array("frequencies", "Hz"))
    stated: dict[str, Any] = {}
    base = config.waveform if config is not None else preset.waveform if preset is not None else None
    if base is not None:
        stated = {name: getattr(base, name) for name in ("start_frequency", "slope", "sample_rate")}
        samples = base.samples_per_chirp
    samples = table.integer("samples", samples)
    start = table.number("start_frequency", "Hz", stated.get("start_frequency"))
    if "adc_start" in table:
        if config is not None:
            raise table.error("adc_start", "no such key beside config, whose profile sets it")
        delay = table.number("adc_start", "s")
        if delay < 0:
            raise table.error("adc_start", "0 or more [s], from the start of the ramp to the first sample")
        start += delay * table.number("slope", "Hz/s", stated.get("slope"))
    ways = [key for key in ("stop_frequency", "step", "slope") if key in table]
    if not ways and stated:
        stated.update(start_frequency=start, samples_per_chirp=samples)
        return Waveform(**stated)
    if not ways and samples == 1:
        return Waveform.stepped(start, 0.0, 1)
    way = table.only_one("stop_frequency", "step", "slope")
    if way == "slope":
        rate = table.number("sample_rate", "Hz", stated.get("sample_rate"))
        slope = table.number("slope", "Hz/s")
        return Waveform(start_frequency=start, slope=slope, sample_rate=rate, samples_per_chirp=samples)
    if way == "step":
        return Waveform.stepped(start, table.number("step", "Hz"), samples)
    return Waveform.stepped(start, (table.number("stop_frequency", "Hz") - start) / max(1, samples - 1), samples)


def _check_band(table: TomlTable, waveform: Waveform) -> None:
    """Refuse what no radar sends, and what forgotten units make."""
    key = "frequencies" if "frequencies" in table else "start_frequency"
    highest = waveform.frequencies.max()
    if highest < _LOWEST:
        raise table.error(key, f'frequencies in Hz, or a unit such as "GHz": they go to {highest:.4g} Hz')
    if waveform.samples_per_chirp > 1 and waveform.bandwidth < _NARROWEST:
        key = next((key for key in ("slope", "step") if key in table), key)
        raise table.error(key, f"a sweep in Hz, with slopes in Hz/s: it is {waveform.bandwidth:.4g} Hz wide")


def _listed(table: TomlTable, frequencies: np.ndarray) -> Waveform:
    """The waveform of frequencies that are listed one by one."""
    frequencies = frequencies.reshape(frequencies.size)  # MATLAB's lists are rows or columns
    count = len(frequencies)
    step = (frequencies[-1] - frequencies[0]) / max(1, count - 1)
    even = frequencies[0] + step * np.arange(count)
    if count > 1 and not abs(frequencies - even).max() <= _UNEVEN * abs(step):
        raise table.error("frequencies", "evenly spaced ones, in the order of the samples: rising or falling")
    return Waveform.stepped(float(frequencies[0]), float(step), count)
