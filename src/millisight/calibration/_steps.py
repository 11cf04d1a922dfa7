"""Calibrations as data: the steps that a description asks for, and what a description leads to, calibrated."""

import os
from collections.abc import Callable, Iterable, Mapping

from millisight.calibration._calibrate import (
    add_phase,
    crop_samples,
    divide_gains,
    divide_reference,
    subtract_background,
    subtract_mean,
)
from millisight.calibration._medium import see_through, set_medium, set_one_way
from millisight.core import checked_record, printable
from millisight.core.errors import FormatError, InputError, UnknownNameError
from millisight.data import CalibrationStep, Capture, ClockCorrection, RawScan

STEPS: Mapping[str, Callable[..., Capture]] = {
    step.__name__: step
    for step in (
        subtract_background, subtract_mean, divide_gains, divide_reference, add_phase, crop_samples,
        set_one_way, set_medium, see_through,
    )
}  # fmt: skip
"""The steps that a calibration can have, by name."""


def calibrate(capture: Capture, steps: Iterable[CalibrationStep]) -> Capture:
    """Apply the calibration `steps` to a capture, in their order.

    Raises
    ------
    UnknownNameError
        A step is unknown.
    FormatError, InputError
        A step does not fit the capture; FormatError names its place in the description, if any.
    """
    for step in steps:
        checked_record(step, CalibrationStep, name="a step")
        if step.name not in STEPS:
            raise UnknownNameError("calibration step", step.name, STEPS)
        try:
            capture = STEPS[step.name](capture, **step.settings)
        except InputError as error:
            if not step.source:
                raise
            raise FormatError(f"{step.source}: {error}") from error
    return capture


def read_capture(
    path: str | os.PathLike[str],
    *,
    data: str | os.PathLike[str] | None = None,
    clock: ClockCorrection | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Capture:
    """Read a capture from raw files with a description in TOML.

    Parameters
    ----------
    path : the description; or a folder with one; or a file that a shipped description knows by its arrays
    data : the folder of the files named in the description; None: that of the description
    clock : correction from the radar's clock to the robot's, if the positions come from a robot log
    progress : called with (files read, files in all)

    Returns
    -------
    Capture
        With the phase sign of millisight, calibrated as described. `metadata["image_grid"]` and `metadata["imaging"]`
        hold the image settings of the description.

    Raises
    ------
    FileError, UnknownNameError
        A file is missing or damaged, or a description cannot be right: the message names file, table and key.
    InputError
        The description has no positions, without which nothing can be imaged; or has no log for `clock` to correct.
    """
    from millisight.io.description import read

    content = read(path, data=data, progress=progress)
    if isinstance(content, RawScan):
        return content.to_capture(clock=clock, progress=progress)
    if clock is not None:
        raise InputError(f"{printable(path)} names no robot log, so there is no clock to correct; leave clock out")
    return content.to_capture()
