"""The one recorder: it runs a scan with any rig's devices, and hands what comes to a writer."""

from collections.abc import Callable, Sequence
from pathlib import Path

from millisight.core.errors import InputError
from millisight.rig._plan import ScanPlan
from millisight.rig._protocols import Arm, Camera, RadarDevice, ScanWriter


def record_scan(
    arm: Arm,
    radars: Sequence[RadarDevice],
    camera: Camera | None,
    plan: ScanPlan,
    writer: ScanWriter,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Take the picture, sweep every row with all radars recording, and write it all down.

    Parameters
    ----------
    arm, radars, camera : the devices; None: no picture
    plan : ScanPlan
    writer : where to and how, such as `PublishedWriter`
    progress : called with (rows done, rows in all)

    Returns
    -------
    The writer's path.

    Raises
    ------
    InputError
        Two radars have one name, or the writer cannot write what they record.
    FileError
        It cannot be written.
    """
    names = [radar.name for radar in radars]
    if not radars or len(set(names)) < len(names):
        raise InputError(f"the radars are called {names}; expected one radar, or several of different names")
    with writer.recording(radars):
        if camera is not None and plan.photo is not None:
            arm.sweep(plan.photo, plan.photo)
            arm.wait()
            writer.add_picture(camera.shoot())
        for count, (start, end) in enumerate(plan.rows, 1):
            arm.sweep(start, start)
            arm.wait()
            for radar in radars:
                radar.start(plan.frames(radar.frame_period))
            arm.sweep(start, end)
            arm.wait()
            for radar in radars:
                writer.add_row(radar, radar.stop())
            if progress is not None:
                progress(count, len(plan.rows))
        writer.finish(arm.log())
    return writer.path
