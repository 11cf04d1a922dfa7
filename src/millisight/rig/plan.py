"""What a scan is to do: the rows to sweep, and where to take the picture from."""

from millisight.errors import InputError
from millisight.records import checked_number, checked_record, put, record
from millisight.rig.protocols import Pose


@record
class ScanPlan:
    """The aperture as the arm is to move over it, in the base frame.

    Attributes
    ----------
    rows : start and end of each, in order
    row_time : how long the radars are to record a row [s]: at least the arm's time for the longest
    photo : where the camera takes its picture from; None: no picture
    """

    rows: tuple[tuple[Pose, Pose], ...]
    row_time: float
    photo: Pose | None = None

    def __post_init__(self) -> None:
        if not self.rows:
            raise InputError("rows is empty; expected at least one row to sweep")
        put(
            self,
            rows=tuple(
                (checked_record(a, Pose, name="a row's start"), checked_record(b, Pose, name="a row's end"))
                for a, b in self.rows
            ),
            row_time=checked_number(self.row_time, name="row_time", unit="s", above=0),
        )
        if self.photo is not None:
            checked_record(self.photo, Pose, name="photo")

    def frames(self, period: float) -> int:
        """How many frames a radar with a frame every `period` [s] takes of a row."""
        return int(self.row_time / period) + 1
