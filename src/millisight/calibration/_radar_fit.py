"""A radar's mount, path offset and channel gains, as fitted to a scan of one reference target; and their use."""

from typing import Any

import numpy as np

from millisight.calibration._calibrate import divide_gains, set_antennas, set_path_offset
from millisight.calibration._target_fit import BANDS, BLOCKS, TargetFit
from millisight.calibration._targets import ReferenceTarget
from millisight.core import (
    SPEED_OF_LIGHT,
    checked_number,
    checked_numbers,
    checked_record,
    put,
    record,
    rotation_from_vector,
    rotation_vector,
)
from millisight.core.errors import InputError
from millisight.data import Capture

_NOISE = 1.0  # phase error from which there is no target [rad]


@record
class RadarCalibration:
    """How a radar is mounted and how its channels answer, as fitted to a reference target; with standard deviations.

    Attributes
    ----------
    radar : name of the radar
    offset, offset_uncertainty : (3,) what is added to the places of its antennas in the radar frame [m]
    turn_deg, turn_uncertainty_deg : (3,) rotation vector by which they are turned about the radar frame's origin before
        that [degrees]
    path_offset, path_offset_uncertainty : the path offset, in place of the radar's own [m]
    amplitudes, phases : (T, R) of the channels' gains: amplitudes relative to their mean, phases to that of the first
        channel [rad]
    phase_error : what the fit leaves of a phase, root mean square [rad]
    undetermined : what the scan does not tell, and was left as it was: names such as "turn about x"
    """

    radar: str
    path_offset: float
    path_offset_uncertainty: float
    amplitudes: tuple[tuple[float, ...], ...]
    phases: tuple[tuple[float, ...], ...]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset_uncertainty: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_uncertainty_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    phase_error: float = 0.0
    undetermined: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked_record(self.radar, str, name="radar")
        for name in ("offset", "offset_uncertainty"):
            put(self, **{name: checked_numbers(getattr(self, name), name=name, count=3, unit="m")})
        for name in ("turn_deg", "turn_uncertainty_deg"):
            put(self, **{name: checked_numbers(getattr(self, name), name=name, count=3, unit="deg")})
        for name in ("path_offset", "path_offset_uncertainty", "phase_error"):
            put(self, **{name: checked_number(getattr(self, name), name=name)})
        channels = len(self.amplitudes[0]) if self.amplitudes else 0
        for name in ("amplitudes", "phases"):
            rows = getattr(self, name)
            if len(rows) != len(self.amplitudes) or not channels or any(len(row) != channels for row in rows):
                raise InputError(f"{name} is {rows}; expected a row for each transmitter, with a number a receiver")
            put(self, **{name: tuple(checked_numbers(row, name=name, count=channels) for row in rows)})

    def __repr__(self) -> str:
        offset, turn = (", ".join(f"{value:.3g}" for value in v) for v in (1e3 * np.array(self.offset), self.turn_deg))
        return (
            f"RadarCalibration({self.radar}, offset {offset} mm, turn {turn} degrees, path offset "
            f"{1e3 * self.path_offset:.5g} mm, phase error {np.degrees(self.phase_error):.1f} degrees"
            f"{f', {len(self.undetermined)} undetermined' if self.undetermined else ''})"
        )

    @property
    def gains(self) -> np.ndarray:
        """(T, R) complex."""
        return np.array(self.amplitudes) * np.exp(1j * np.array(self.phases))

    def apply(self, capture: Capture) -> Capture:
        """The capture with the antennas' true places, the path offset, and its frames divided by the gains.

        Raises
        ------
        InputError
            The capture is of another radar, or states the places of its antennas at each pose.
        """
        checked_record(capture, Capture, name="capture")
        if capture.radar.name != self.radar:
            raise InputError(f"the calibration is of the radar {self.radar}; the capture's is {capture.radar.name}")
        moved = capture.radar.array.moved(rotation=self._turn, translation=np.array(self.offset))
        return divide_gains(set_path_offset(set_antennas(capture, moved), self.path_offset), self.gains)

    @property
    def _turn(self) -> np.ndarray:
        return rotation_from_vector(np.radians(self.turn_deg))


def calibrate_radar(capture: Capture, target: ReferenceTarget, *, search: float = 0.3) -> RadarCalibration:
    """Fit mount, path offset and channel gains of a radar to a scan of one reference target (primer 2, 3).

    The target must be alone, or by far the brightest within some range cells. What all frames share, such as leakage
    from transmitter to receiver, is taken off; other echoes are not. What the scan cannot tell stays as it is and is
    named: a level radar, for example, does not tell its offset from an error of the target's position, so that the
    offset is known to the target's uncertainty at best. Standard deviations take neighbouring poses to err alike: the
    scan is cut into 24 parts, and how they differ says how sure the whole is. The target's uncertainty is part of them.

    Parameters
    ----------
    capture : with the antennas where they are thought to be
    target : ReferenceTarget, its position in the world frame
    search : how far either way of the radar's own path offset to look [m]

    Returns
    -------
    RadarCalibration

    Raises
    ------
    InputError
        There are too few frequencies or poses; nothing bright is where the target should be, or its phases fit none
        there; the path offset is beyond the search, or the band repeats within it; or the capture states the places of
        its antennas at each pose.

    Examples
    --------
    >>> import millisight as ms
    >>> target = ms.calibration.ReferenceTarget(position=(0.05, 0.04, -0.36), kind="sphere", radius=0.02)
    >>> found = ms.calibration.calibrate_radar(capture, target)  # doctest: +SKIP
    >>> image = ms.form_image(found.apply(mug), grid)  # doctest: +SKIP
    """
    checked_record(capture, Capture, name="capture")
    checked_record(target, ReferenceTarget, name="target")
    search = checked_number(search, name="search", unit="m", above=0)
    waveform = capture.radar.waveform
    if capture.tx_points is not None or capture.rx_points is not None:
        raise InputError("the capture states the antenna positions of each pose; there is no mount to be fitted")
    if waveform.samples_per_chirp < BANDS or len(capture.trajectory) < 2 * BLOCKS:
        raise InputError(
            f"the capture has {len(capture.trajectory)} poses and {waveform.samples_per_chirp} frequencies; expected "
            f"at least {2 * BLOCKS} and {BANDS}"
        )
    span = SPEED_OF_LIGHT / abs(waveform.frequency_step)
    if not 2 * search < span:
        raise InputError(f"search is {search:g} m either way; expected less than {span / 2:.3g} m: the band repeats")
    fit = TargetFit(capture, target)
    fit.find_path_offset(search)
    fit.fit_delays()
    fit.fit_phases()
    fit.find_still()
    fit.fit_phases()
    fit.keep_determined()
    fit.find_still()
    fit.fit_phases()
    found = _result(fit)
    if found.phase_error > _NOISE:
        raise InputError(
            f"the phases fit no target there: {np.degrees(found.phase_error):.0f} degrees are left, root mean square, "
            "and 104 would be by chance; check the target's position, which is in the frame of the images, and that it "
            "was in view"
        )
    if abs(found.path_offset - capture.radar.path_offset) > search:
        raise InputError(
            f"the best path offset is {found.path_offset:.4g} m, more than search = {search:g} m from the radar's "
            f"{capture.radar.path_offset:.4g} m; check the target's position, or search farther"
        )
    return found


def _result(fit: TargetFit) -> RadarCalibration:
    gains, left = fit.gains()
    state, spread = fit.state, np.where(fit.free, fit.spread, 0)
    turn = np.degrees(rotation_vector(state.turn))
    names = [f"{what} {axis}" for what in ("target along", "offset along", "turn about") for axis in "xyz"]
    told: Any = {
        "offset": np.where(fit.free[3:6], state.offset, 0),
        "offset_uncertainty": spread[3:6],
        "turn_deg": np.where(fit.free[6:9], turn, 0),
        "turn_uncertainty_deg": np.degrees(spread[6:9]),
    }
    return RadarCalibration(
        radar=fit.capture.radar.name,
        path_offset=state.path_offset,
        path_offset_uncertainty=float(spread[9]),
        amplitudes=tuple(map(tuple, np.abs(gains).tolist())),
        phases=tuple(map(tuple, np.angle(gains).tolist())),
        phase_error=left,
        undetermined=tuple(name for name, free in zip([*names, "path offset"], fit.free, strict=True) if not free),
        **{name: tuple(values.tolist()) for name, values in told.items()},
    )
