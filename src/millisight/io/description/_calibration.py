"""[calibration] and [medium] of a description, as steps of a calibration, always in the same order.

Background, mean, gains, reference, phase, samples: first what is taken off the frames as recorded, then what scales
them; last what the waves go through.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from millisight.data import CalibrationStep, Capture, Radar, Trajectory
from millisight.io.description._frames import FrameReader
from millisight.io.description._tables import REFERENCE, TomlTable

KEYS = ("background", "subtract_mean", "gains", "reference", "phase", "samples")
MEDIUM_KEYS = ("permittivity", "layers", "towards", "max_angle")
_BACKGROUND_KEYS = ("file", "array", "frame")
_GAINS_KEYS = ("amplitudes", "phases")
_PHASE_KEYS = ("frequencies", "values", "between")
_LAYER_KEYS = ("thickness", "permittivity")


def calibration_steps(
    table: TomlTable, reader: FrameReader, radar: Radar, capture: Capture | None
) -> Iterator[CalibrationStep]:
    """The steps of [calibration] for frames of `radar` that `reader` read; `capture` has their poses, where known.

    Raises
    ------
    FileError, UnknownNameError
        The table, or a file that it names, cannot be right.
    """

    def step(name: str, **settings: object) -> CalibrationStep:
        return CalibrationStep(name=name, settings=settings, source=table.place)

    with table.errors():
        if "background" in table:
            empty, frame = _background(table, reader, radar, capture)
            yield step("subtract_background", empty=empty, frame=frame)
        if table.flag("subtract_mean"):
            yield step("subtract_mean")
        if "gains" in table:
            yield step("divide_gains", gains=_gains(table, radar))
        if "reference" in table:
            about = table.table("reference", (*REFERENCE, "power"))
            spectrum = about.values()
            spectrum = spectrum.reshape(-1) if spectrum.size == max(spectrum.shape, default=1) else spectrum
            if reader.phase_sign == 1:  # it is of the sign of the frames
                spectrum = spectrum.conj()
            yield step("divide_reference", spectrum=spectrum, power=about.number("power", "", 1.0))
        if "phase" in table:
            phase = table.table("phase", _PHASE_KEYS)
            between = phase.text("between", "linear", among=("linear", "nearest"))
            frequencies, values = phase.array("frequencies", "Hz"), phase.array("values", "rad")
            yield step("add_phase", frequencies=frequencies.reshape(-1), phases=values.reshape(-1), between=between)
        if "samples" in table:
            samples = table.wholes("samples")
            if samples.shape != (2,):
                raise table.error("samples", "[first, stop]: the samples from first to stop - 1")
            yield step("crop_samples", first=int(samples[0]), stop=int(samples[1]))


def medium_steps(table: TomlTable, reach: tuple[float, float] | None) -> Iterator[CalibrationStep]:
    """The steps of [medium]; `reach`: how far across rays go at most, and how deep at least, where that is known [m].

    Raises
    ------
    FileError, UnknownNameError
        The table cannot be right.
    """
    permittivity = table.number("permittivity", "", 1.0)
    if "layers" not in table:
        table.number("permittivity", "")  # so there is nothing else
        for key in ("towards", "max_angle"):
            if key in table:
                raise table.error(key, "this key only beside layers")
        yield CalibrationStep(name="set_medium", settings={"permittivity": permittivity}, source=table.place)
        return
    listed = table.get("layers")
    if not isinstance(listed, list) or not listed:
        raise table.error("layers", "a list of { thickness = ..., permittivity = ... }")
    tables = [table.inner(layer, f"{table.name} layers {number}", _LAYER_KEYS) for number, layer in enumerate(listed)]
    layers = [(layer.number("thickness", "m"), layer.number("permittivity", "")) for layer in tables]
    towards = table.text("towards", "-z", among=("x", "-x", "y", "-y", "z", "-z"))
    normal = np.zeros(3)
    normal["xyz".index(towards[-1])] = -1.0 if towards.startswith("-") else 1.0
    settings = {"layers": layers, "towards": normal, "permittivity": permittivity, "reach": reach}
    if "max_angle" in table:
        settings["max_angle"] = table.number("max_angle", "rad")
    yield CalibrationStep(name="see_through", settings=settings, source=table.place)


def _background(table: TomlTable, reader: FrameReader, radar: Radar, capture: Capture | None) -> tuple[Capture, str]:
    """The frames of the empty scene, which lie in a file like that of the frames, and which of them count."""
    if isinstance(table.get("background"), str):
        path, array, frame = table.files.one(table.text("background")), None, "mean"
    else:
        about = table.table("background", _BACKGROUND_KEYS)
        path, array = about.file(), about.text("array") if "array" in about else None
        frame = about.text("frame", "mean", among=("first", "mean", "same"))
    frames = reader.read(path, array)
    values = frames.values[~frames.lost]
    metadata = {"source": path.name}
    if frame == "same" and capture is not None and len(values) == len(capture.trajectory):
        return replace(capture, frames=values, metadata=metadata), frame
    nowhere = Trajectory(times=np.arange(len(values)), positions=np.zeros((len(values), 3)))  # it is not said where
    return Capture(radar=radar, trajectory=nowhere, frames=values, metadata=metadata), frame


def _gains(table: TomlTable, radar: Radar) -> np.ndarray:
    """(T, R) complex gains of the channels."""
    gains = table.table("gains", _GAINS_KEYS)
    shape = len(radar.array.tx_positions), len(radar.array.rx_positions)
    found = np.ones(shape, dtype=complex)
    if "amplitudes" in gains:
        found *= gains.numbers("amplitudes", "", found.size).reshape(shape)
    if "phases" in gains:
        found *= np.exp(1j * gains.numbers("phases", "rad", found.size).reshape(shape))
    return found
