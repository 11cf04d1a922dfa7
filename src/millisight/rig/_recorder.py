"""What a scan is to do, and the one recorder, which does it with any rig's devices and hands what comes to a writer."""

from collections.abc import Callable, Sequence
from pathlib import Path

from millisight.core import checked_number, checked_record, put, record
from millisight.core.errors import DeviceError, InputError
from millisight.rig._protocols import Arm, ArmPose, Camera, Device, RadarDevice, ScanWriter


@record
class ScanPlan:
    """The aperture as the arm is to move over it, in the base frame.

    Attributes
    ----------
    rows : start and end of each, in order
    row_time : how long the radars are to record a row [s]: at least the arm's time for the longest
    photo : where the camera takes its picture from; None: no picture
    """

    rows: tuple[tuple[ArmPose, ArmPose], ...]
    row_time: float
    photo: ArmPose | None = None

    def __post_init__(self) -> None:
        if not self.rows:
            raise InputError("rows is empty; expected at least one row to sweep")
        put(
            self,
            rows=tuple(
                (checked_record(a, ArmPose, name="a row's start"), checked_record(b, ArmPose, name="a row's end"))
                for a, b in self.rows
            ),
            row_time=checked_number(self.row_time, name="row_time", unit="s", above=0),
        )
        if self.photo is not None:
            checked_record(self.photo, ArmPose, name="photo")

    def frames(self, period: float) -> int:
        """How many frames a radar with a frame every `period` [s] takes of a row."""
        return int(self.row_time / period) + 1


def record_scan(
    arm: Arm,
    radars: Sequence[RadarDevice],
    camera: Camera | None,
    plan: ScanPlan,
    writer: ScanWriter,
    *,
    progress: Callable[[int, int], None] | None = None,
    enough: Callable[[], bool] | None = None,
) -> Path:
    """Take the picture, sweep every row with all radars recording, and write it all down.

    Whatever goes wrong, the arm is stopped. Where the writer keeps rows of an earlier scan of the same plan, the scan
    goes on after them.

    Parameters
    ----------
    arm, radars, camera : the devices; None: no picture
    plan : ScanPlan
    writer : where to and how, such as `PublishedWriter`
    progress : called with (rows done, rows in all)
    enough : asked after each row; True ends the scan there, with the rows that were swept

    Returns
    -------
    The writer's path.

    Raises
    ------
    InputError
        Two radars have one name, or the writer cannot write what they record.
    FileError
        It cannot be written.
    DeviceError
        A device cannot be reached, has failed, or has fallen silent. The arm was stopped.
    """
    names = [radar.name for radar in radars]
    if not radars or len(set(names)) < len(names):
        raise InputError(f"the radars are called {names}; expected one radar, or several of different names")
    devices = [device for device in (arm, *radars, camera) if isinstance(device, Device)]

    def watch() -> None:
        for device in devices:
            device.watch()

    with writer.recording(radars):
        try:
            _scan(arm, radars, camera, plan, writer, watch, progress, enough)
        except BaseException as error:
            _stop(arm, error)
            raise
        writer.finish()
    return writer.path


def _scan(
    arm: Arm,
    radars: Sequence[RadarDevice],
    camera: Camera | None,
    plan: ScanPlan,
    writer: ScanWriter,
    watch: Callable[[], None],
    progress: Callable[[int, int], None] | None,
    enough: Callable[[], bool] | None,
) -> None:
    """The rows that are not done yet, and the picture before the first."""
    if camera is not None and plan.photo is not None and not writer.rows_done:
        arm.sweep(plan.photo, plan.photo)
        arm.wait(watch)
        writer.add_picture(camera.shoot())
    logged = None
    for count, (start, end) in enumerate(plan.rows[writer.rows_done :], writer.rows_done + 1):
        arm.sweep(start, start)
        arm.wait(watch)
        for radar in radars:
            radar.start(plan.frames(radar.frame_period))
        arm.sweep(start, end)
        arm.wait(watch)
        for radar in radars:
            writer.add_row(radar, radar.stop())
        log = arm.log(logged)
        logged = float(log.times[-1])
        writer.end_row(log)
        if progress is not None:
            progress(count, len(plan.rows))
        if enough is not None and enough():
            break


def sweep_rows(
    arm: Arm,
    rows: Sequence[tuple[ArmPose, ArmPose]],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Move over rows with no radar on, as a scan would: a dry run. Whatever goes wrong, the arm is stopped.

    Parameters
    ----------
    arm : Arm
    rows : start and end of each
    progress : called with (rows done, rows in all)

    Raises
    ------
    InputError
        A row leaves the arm's workspace.
    DeviceError
        The arm cannot be reached, has failed, or has fallen silent.
    """
    try:
        for count, (start, end) in enumerate(rows, 1):
            for target in (start, end):
                arm.sweep(start, target)
                arm.wait()
            if progress is not None:
                progress(count, len(rows))
    except BaseException as error:
        _stop(arm, error)
        raise


def _stop(arm: Arm, error: BaseException) -> None:
    """Stop the arm after `error`; where that fails, say so besides."""
    try:
        arm.stop()
    except DeviceError as unstopped:
        raise DeviceError(f"{error}; and the arm could not be stopped, press its stop button: {unstopped}") from error
