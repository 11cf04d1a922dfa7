"""The exceptions that millisight raises, and nothing else raises.

    MillisightError               every error below; catch this one to catch them all
    ├── InputError (ValueError)   an argument or a record's field cannot be right
    │   ├── MeshError             a mesh is empty, damaged, or of an unclear unit
    │   └── CoverageError         the aperture does not cover the object
    ├── UnknownNameError (LookupError)   no such radar, object, material, model, or format
    ├── FileError (OSError)       a file cannot be read or written
    │   ├── FormatError           the file is not one of ours, or of an unknown kind
    │   └── DamagedFileError      the file is ours, but truncated or corrupted
    └── DeviceError (RuntimeError)       the device asked for is not there

Every message says what came, what was expected, and what to do.
"""

from collections.abc import Iterable
from difflib import get_close_matches


class MillisightError(Exception):
    """Base of every error raised on purpose by millisight."""


class InputError(MillisightError, ValueError):
    """An argument, or a field of a record, cannot be right."""


class MeshError(InputError):
    """A mesh is empty, damaged, or its unit is unclear."""


class CoverageError(InputError):
    """The aperture does not cover the object, or the object reaches into it."""


class UnknownNameError(MillisightError, LookupError):
    """No radar, object, material, model, window or format goes by this name."""

    def __init__(self, kind: str, name: object, known: Iterable[str]):
        known = sorted(known)
        close = get_close_matches(str(name).lower(), [k.lower() for k in known], n=1, cutoff=0.5)
        hint = next((f" Did you mean {k!r}?" for k in known if close and k.lower() == close[0]), "")
        super().__init__(f"unknown {kind} {name!r}.{hint} Known: {', '.join(known)}.")


class FileError(MillisightError, OSError):
    """A file cannot be read or written."""


class FormatError(FileError):
    """A file is not one of ours, or of a kind that is not known here."""


class DamagedFileError(FileError):
    """A file is one of ours, but truncated or corrupted."""


class DeviceError(MillisightError, RuntimeError):
    """The device asked for is not there."""
