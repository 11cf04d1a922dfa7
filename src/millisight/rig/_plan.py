"""What a scan is to do: the rows to sweep, and where to take the picture from."""

from millisight.core import checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.rig._protocols import ArmPose


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
