"""The door for devices: `DRIVERS`, and what an entry of it is."""

from collections.abc import Callable
from typing import Any

from millisight.core import Registry, check_known, checked_record, record
from millisight.core.errors import InputError

KINDS = ("arm", "radar", "camera")


@record
class Driver:
    """What a rig file's key `driver` names.

    Attributes
    ----------
    kind : "arm", "radar" or "camera"
    settings : the record of its keys in a rig file; a field `folder` that no file holds is given the rig file's folder
    make : called with the settings; returns the device, an `Arm`, `RadarDevice` or `Camera` that is also a `Device`.
        It must not talk to the device yet
    """

    kind: str
    settings: type[Any]
    make: Callable[[Any], Any]

    def __post_init__(self) -> None:
        check_known("kind of driver", self.kind, KINDS)
        if not isinstance(self.settings, type) or not callable(self.make):
            raise InputError(
                f"settings is {self.settings!r}, make is {self.make!r}; expected a record's class and a function"
            )


def _check(name: str, entry: Any) -> None:
    checked_record(entry, Driver, name=f"the driver {name}")


DRIVERS: Registry[Driver] = Registry("driver", "millisight.drivers", package="millisight.rig.drivers", check=_check)
"""Drivers by name; other packages add theirs by entry points "millisight.drivers"."""
