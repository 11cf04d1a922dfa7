"""Calibration: from a capture as recorded to one that the signal model fits (primer 3), step by step.

Every step is `Capture -> Capture` and enters the capture's history; frames on disk are read into memory by those that
change them. What a step needs to know is given, or estimated from a reference target: a small reflector whose place is
known, alone or by far the brightest there.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from millisight.core import (
    SPEED_OF_LIGHT,
    as_array,
    checked_array,
    checked_integer,
    checked_number,
    checked_numbers,
    checked_record,
    with_step,
)
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import AntennaArray, Capture, Radar

_SECOND = 0.5  # of the brightest offset's brightness, that of another at most
_PARTS = 8  # of the poses, each of which gives an estimate of its own
_DIVISORS = 1e-15, 1e15  # amplitudes by which frames may be divided: far from where float32 ends
_SAME_PLACE = 1 / 32  # of a wavelength: by so much may two poses differ that count as one


class PathOffset(NamedTuple):
    """A path offset, and the standard error of it: of estimates from disjoint parts of the poses [m]."""

    value: float
    uncertainty: float


def set_antennas(capture: Capture, array: AntennaArray) -> Capture:
    """Replace the antenna positions in the radar frame; their number stays the same.

    Raises
    ------
    InputError
        There are more or fewer transmitters or receivers than the frames have; or the capture's antennas have places
        of their own at each pose.
    """
    checked_record(capture, Capture, name="capture")
    checked_record(array, AntennaArray, name="array")
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError("the capture states the antenna positions of each pose; they cannot be moved with an array")
    radar = capture.radar
    return remade(
        capture,
        "set_antennas",
        {"tx_positions": array.tx_positions.tolist(), "rx_positions": array.rx_positions.tolist()},
        radar=replace(radar, array=array),
    )


def set_path_offset(capture: Capture, path_offset: float) -> Capture:
    """Set the path offset, the length in cables and front end that is added to every path [m] (primer 2)."""
    checked_record(capture, Capture, name="capture")
    radar = capture.radar
    changed = replace(radar, path_offset=path_offset)
    return remade(capture, "set_path_offset", {"path_offset": changed.path_offset}, radar=changed)


def estimate_path_offset(
    capture: Capture, target: np.ndarray, *, search: tuple[float, float] = (-0.5, 1.0)
) -> PathOffset:
    """Estimate the path offset that makes a reference target brightest at its known position (primer 2, 4).

    Only magnitudes are compared, so the phase of the target's reflection does not matter.

    Parameters
    ----------
    capture : its own path offset is left out of account
    target : (3,) where the reference target is, in the world frame [m]
    search : between which offsets to look [m]

    Raises
    ------
    InputError
        The band is a single frequency, or repeats within the search: offsets c / frequency step apart look alike; or
        no offset within the search stands out, as where the true one lies beyond it.
    """
    from scipy.optimize import minimize_scalar

    checked_record(capture, Capture, name="capture")
    low, high = checked_numbers(search, name="search", count=2, unit="m")
    waveform = capture.radar.waveform
    if waveform.samples_per_chirp < 2:
        raise InputError("the path offset cannot be found from a single frequency; expected a frequency sweep")
    span = SPEED_OF_LIGHT / abs(waveform.frequency_step)
    if not 0 < high - low < span:
        raise InputError(
            f"search is {low:g} to {high:g} m; expected from low to high, and less than {span:.3g} m apart"
        )

    focused = _focused(capture, target).mean(axis=(1, 2))
    offsets = np.linspace(low, high, 2 + int(8 * (high - low) * waveform.bandwidth / SPEED_OF_LIGHT))
    phases = 2j * np.pi / SPEED_OF_LIGHT * (waveform.frequencies - waveform.center_frequency)

    def dimness(offset: float, sums: np.ndarray) -> float:
        return -float(np.abs((sums * np.exp(phases * offset)).sum()))

    def best(sums: np.ndarray) -> float:
        i = int(np.argmin([dimness(offset, sums) for offset in offsets]))
        around = offsets[max(i - 1, 0)], offsets[min(i + 1, len(offsets) - 1)]
        found: Any = minimize_scalar(dimness, bounds=around, args=(sums,), method="bounded", options={"xatol": 1e-7})
        return float(found.x)

    _check_one_stands_out(
        offsets, -np.array([dimness(one, focused.sum(axis=0)) for one in offsets]), waveform.bandwidth
    )
    parts = [best(focused[i::_PARTS].sum(axis=0)) for i in range(min(_PARTS, len(focused)))]
    error = float(np.std(parts, ddof=1) / np.sqrt(len(parts))) if len(parts) > 1 else float("inf")
    return PathOffset(best(focused.sum(axis=0)), error)


def _check_one_stands_out(offsets: np.ndarray, brightness: np.ndarray, bandwidth: float) -> None:
    """Refuse offsets [m] of which none is twice as bright as all beside its lobe, as sidelobes are not."""
    best = int(brightness.argmax())
    beside = abs(offsets - offsets[best]) > 1.5 * SPEED_OF_LIGHT / bandwidth
    if beside.any() and brightness[beside].max() > _SECOND * brightness[best]:
        other = float(offsets[beside][brightness[beside].argmax()])
        raise InputError(
            f"no offset from {offsets[0]:g} to {offsets[-1]:g} m stands out: at {offsets[best]:.3f} m the target is "
            f"less than twice as bright as at {other:.3f} m; check where the target is, or search farther: "
            "search=(-2, 4), for example"
        )


def divide_gains(capture: Capture, gains: np.ndarray) -> Capture:
    """Divide the frames of each channel by its complex gain (T, R).

    Raises
    ------
    InputError
        A gain is zero, or there are more or fewer than channels.
    """
    checked_record(capture, Capture, name="capture")
    array = capture.radar.array
    shape = (len(array.tx_positions), len(array.rx_positions))
    gains = checked_array(gains, name="gains", shape=shape, dtype=np.complex128)
    if not np.abs(gains).min() > 0:
        raise InputError("gains holds a zero; expected the complex gain of each channel")
    _check_divisor(gains, "gains")
    settings = {"amplitudes": np.abs(gains).tolist(), "phases": np.angle(gains).tolist()}
    frames = capture.frames_of(slice(None)) / gains[:, :, None].astype(np.complex64)
    return remade(capture, "divide_gains", settings, frames=frames)


def _check_divisor(values: np.ndarray, name: str) -> None:
    """Refuse what would make frames 0 or infinite in float32."""
    sizes = np.abs(values)
    if not (sizes.min() > _DIVISORS[0] and sizes.max() < _DIVISORS[1]):
        odd = sizes.min() if sizes.min() <= _DIVISORS[0] else sizes.max()
        raise InputError(f"{name} has an amplitude of {odd:g}; expected {_DIVISORS[0]:g} to {_DIVISORS[1]:g}")


def estimate_gains(capture: Capture, target: np.ndarray) -> np.ndarray:
    """Estimate the (T, R) complex gains, relative to their mean, from a reference target at (3,) [m] (primer 3)."""
    checked_record(capture, Capture, name="capture")
    offset = 2j * np.pi / SPEED_OF_LIGHT * capture.radar.waveform.frequencies * capture.radar.path_offset
    answers = (_focused(capture, target) * np.exp(offset)).mean(axis=(0, 3))
    if not np.abs(answers).min() > 0:
        raise InputError("a channel has no signal from the target; check the target's position and the frames")
    return answers / answers.mean()


def divide_reference(capture: Capture, spectrum: np.ndarray, *, power: float = 1.0) -> Capture:
    """Divide the frames by a reference spectrum: the measured signal of a target whose true signal is 1.

    Parameters
    ----------
    spectrum : (N,) of every channel, or (T, R, N) of each; complex, of the phase sign inside millisight
    power : that the spectrum is raised to first: 2 where it is of one antenna alone, which the wave passes twice. For
        a power that is not whole the phase is unwrapped along the frequencies

    Raises
    ------
    InputError
        The spectrum has another shape, or is zero somewhere.
    """
    checked_record(capture, Capture, name="capture")
    _, *channels = capture.frames.shape
    given = np.asarray(spectrum)
    shape = (channels[-1],) if given.ndim == 1 else tuple(channels)
    known = checked_array(given, name="reference", shape=shape, dtype=np.complex128)
    power = checked_number(power, name="power")
    if not np.abs(known).min() > 0:
        first = tuple(int(i) for i in np.argwhere(known == 0)[0])
        raise InputError(f"reference is 0 at {first}; frames cannot be divided by it: leave these frequencies out")
    raised = known ** int(power) if power == int(power) else None
    if raised is None:
        raised = np.abs(known) ** power * np.exp(1j * power * np.unwrap(np.angle(known), axis=-1))
    _check_divisor(raised, "reference, raised to its power,")
    frames = (capture.frames_of(slice(None)) / raised).astype(np.complex64)
    return remade(capture, "divide_reference", {"power": power}, frames=frames)


def add_phase(capture: Capture, frequencies: np.ndarray, phases: np.ndarray, *, between: str = "linear") -> Capture:
    """Multiply the frames by exp(+i phase), with the phase over frequency, for example of a front end.

    Parameters
    ----------
    frequencies, phases : (M,) [Hz], increasing, and [rad], continuous
    between : "linear" between the given frequencies, or the "nearest" one's

    Raises
    ------
    InputError, UnknownNameError
        The given frequencies do not increase, or the capture's lie more than a step of its own outside of them.
    """
    checked_record(capture, Capture, name="capture")
    known = checked_array(frequencies, name="frequencies", shape=("M",), unit="Hz")
    phases = checked_array(phases, name="phases", shape=(len(known),), unit="rad")
    if between not in ("linear", "nearest"):
        raise UnknownNameError("interpolation between frequencies", between, ("linear", "nearest"))
    if not (np.diff(known) > 0).all():
        raise InputError("frequencies must increase strictly; sort them together with their phases")
    waveform = capture.radar.waveform
    wanted, margin = waveform.frequencies, abs(waveform.frequency_step)
    if wanted.min() < known[0] - margin or wanted.max() > known[-1] + margin:
        raise InputError(
            f"phases are given from {known[0] / 1e9:.4f} to {known[-1] / 1e9:.4f} GHz; expected them for the "
            f"capture's band, {wanted.min() / 1e9:.4f} to {wanted.max() / 1e9:.4f} GHz"
        )
    if between == "nearest":
        found = phases[np.abs(known[None] - wanted[:, None]).argmin(axis=1)]
    else:
        found = np.interp(wanted, known, phases)
    frames = capture.frames_of(slice(None)) * np.exp(1j * found).astype(np.complex64)
    return remade(capture, "add_phase", {"phases": found.tolist(), "between": between}, frames=frames)


def subtract_mean(capture: Capture) -> Capture:
    """Subtract the mean over all poses from each channel and sample.

    What is the same everywhere, the antennas' own echo and leakage, goes; so does a little of the scene.

    Raises
    ------
    InputError
        There is one pose.
    """
    checked_record(capture, Capture, name="capture")
    if len(capture.trajectory) < 2:
        raise InputError("the capture has one pose, and nothing would be left; expected at least two")
    frames = capture.frames_of(slice(None))
    mean = frames.mean(axis=0, dtype=np.complex128).astype(np.complex64)
    return remade(capture, "subtract_mean", {}, frames=frames - mean)


def subtract_background(capture: Capture, empty: Capture, *, frame: str = "mean") -> Capture:
    """Subtract the frames of the empty scene, captured by the same radar.

    Parameters
    ----------
    frame : "first" or "mean" of the empty scene's, subtracted from every frame; or "same": pose by pose

    Raises
    ------
    UnknownNameError
        `frame` is none of these.
    InputError
        The radars differ in what their frames mean; or, for "same", the poses do.
    """
    checked_record(capture, Capture, name="capture")
    checked_record(empty, Capture, name="empty")
    if frame not in ("first", "mean", "same"):
        raise UnknownNameError("frame of the background", frame, ("first", "mean", "same"))
    ours, theirs = capture.radar, empty.radar
    if not np.array_equal(ours.waveform.frequencies, theirs.waveform.frequencies) or any(
        getattr(ours.array, name).shape != getattr(theirs.array, name).shape
        for name in ("tx_positions", "rx_positions")
    ):
        raise InputError(
            f"the empty scene was captured by another radar ({theirs.name}) than the scene ({ours.name}); expected "
            "the same frequencies and number of antennas"
        )
    if frame == "same":
        _check_same_poses(capture, empty)
        background = empty.frames_of(slice(None))
    elif frame == "first":
        background = empty.frames_of(slice(0, 1))
    else:
        background = empty.frames_of(slice(None)).mean(axis=0, dtype=np.complex128).astype(np.complex64)
    settings = {"frame": frame, "empty": dict(empty.metadata)}
    return remade(capture, "subtract_background", settings, frames=capture.frames_of(slice(None)) - background)


def crop_samples(capture: Capture, first: int, stop: int) -> Capture:
    """Keep only the samples `first` to `stop` - 1 of each chirp: a narrower band from a later frequency.

    Raises
    ------
    InputError
        There are no such samples.
    """
    checked_record(capture, Capture, name="capture")
    radar, waveform = capture.radar, capture.radar.waveform
    first = checked_integer(first, name="first", minimum=0)
    stop = checked_integer(stop, name="stop", minimum=first + 1)
    if stop > waveform.samples_per_chirp:
        raise InputError(f"stop is {stop}; expected at most {waveform.samples_per_chirp}, the samples of a chirp")
    cropped = replace(waveform, start_frequency=float(waveform.frequencies[first]), samples_per_chirp=stop - first)
    return remade(
        capture,
        "crop_samples",
        {"first": first, "stop": stop},
        radar=replace(radar, waveform=cropped),
        frames=capture.frames_of(slice(None))[..., first:stop],
    )


def remade(
    capture: Capture, step: str, settings: dict, *, radar: Radar | None = None, frames: np.ndarray | None = None
) -> Capture:
    """The capture with another radar or other frames, and the step in its history."""
    if frames is not None:
        frames.flags.writeable = False
    return replace(
        capture,
        radar=radar or capture.radar,
        frames=capture.frames if frames is None else frames,
        metadata=with_step(capture.metadata, step, **settings),
    )


def _focused(capture: Capture, target: np.ndarray) -> np.ndarray:
    """(P, T, R, N) complex128 frames times exp(+i 2 pi f d / c), d the way by `target` without the path offset."""
    point = as_array(target, name="target", shape=(3,), unit="m")
    to = np.linalg.norm(capture.tx_positions - point, axis=-1)
    back = np.linalg.norm(capture.rx_positions - point, axis=-1)
    paths = to[:, :, None] + back[:, None]
    turns = paths[..., None] * (capture.radar.waveform.frequencies / SPEED_OF_LIGHT)
    return capture.frames_of(slice(None)) * np.exp(2j * np.pi * (turns % 1))


def _check_same_poses(capture: Capture, empty: Capture) -> None:
    if len(capture.trajectory) != len(empty.trajectory):
        raise InputError(
            f"the scene has {len(capture.trajectory)} poses, the empty one {len(empty.trajectory)}; expected the same "
            "poses, or frame='mean'"
        )
    apart = max(
        float(np.abs(getattr(capture, name) - getattr(empty, name)).max()) for name in ("tx_positions", "rx_positions")
    )
    tolerance = _SAME_PLACE * capture.radar.waveform.wavelength
    if apart > tolerance:
        raise InputError(
            f"poses of the scene and the empty one differ by {apart * 1e3:.3g} mm; expected at most "
            f"{tolerance * 1e3:.2g} mm, or frame='mean'"
        )
