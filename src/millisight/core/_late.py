"""Functions of upper rooms that a record offers as methods, found when they are called."""

from importlib import import_module
from typing import Any


def late(room: str, name: str) -> Any:
    """The function `name` of a room's public list, imported now.

    Records import nothing from the rooms above them. Where a method of a record is a convenience for a function of an
    upper room (`Scene.from_mesh`, `RawScan.to_capture`), it finds that function by this call, so that loading a
    record loads no algorithm. Only records call it.
    """
    return getattr(import_module(room), name)
