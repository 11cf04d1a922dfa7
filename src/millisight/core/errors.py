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

from collections.abc import Collection, Hashable, Iterable
from difflib import get_close_matches
from typing import Any, Self, TypeVar

_FEW = 20  # Names: a longer list is printed only where none of it is close, since it would drown the one that is.


_LONGEST = 200  # characters of a value in a message
_LONGEST_MESSAGE = 4000  # characters, of which the last quarter says what to do


def quoted(value: object) -> str:
    """The repr of a value as messages hold it; of a long one the beginning, and how long it is."""
    if isinstance(value, str) and len(value) > _LONGEST:  # of a part alone: it may be as long as a request
        return f"{value[:_LONGEST]!r}... ({len(value)} characters)"
    text = repr(value)
    return text if len(text) <= _LONGEST + 2 else f"{text[:_LONGEST]}... ({len(text)} characters)"


class MillisightError(Exception):
    """Base of every error raised on purpose by millisight."""

    def __str__(self) -> str:
        """The message; of one that repeats a file's long texts the beginning and the end."""
        text = super().__str__()
        left_out = len(text) - _LONGEST_MESSAGE
        if left_out <= 100:  # what says so takes some characters, too
            return text
        end = _LONGEST_MESSAGE // 4
        return f"{text[: _LONGEST_MESSAGE - end]} [... {left_out} characters ...] {text[-end:]}"

    def at(self, place: str) -> Self:
        """The same kind of error, which says first what it is about: an entry of a file, say."""
        return _made_again(type(self), f"{place}: {self}")

    def __reduce__(self) -> tuple[Any, ...]:  # for another process; a kind's own arguments are in the text
        return _made_again, (type(self), str(self))


Error = TypeVar("Error", bound=MillisightError)


def _made_again(kind: type[Error], text: str) -> Error:
    """An error of that kind that says that."""
    error = kind.__new__(kind, text)
    Exception.__init__(error, text)
    return error


class InputError(MillisightError, ValueError):
    """An argument, or a field of a record, cannot be right."""


class MeshError(InputError):
    """A mesh is empty, damaged, or its unit is unclear."""


class CoverageError(InputError):
    """The aperture does not cover the object, or the object reaches into it."""


class UnknownNameError(MillisightError, LookupError):
    """No radar, object, material, model, window or format goes by this name."""

    def __init__(self, kind: str, name: object, known: Iterable[str], *, advice: str = ""):
        known = sorted(known)
        few = len(known) <= _FEW
        by_lower = {k.lower(): k for k in known}
        close = get_close_matches(str(name)[:_LONGEST].lower(), by_lower, n=1 if few else 3, cutoff=0.5)
        sentences = [f"unknown {kind} {quoted(name)}."]
        if close:
            sentences.append(f"Did you mean {' or '.join(repr(by_lower[k]) for k in close)}?")
        if few or not close:
            sentences.append(f"Known: {', '.join(known)}.")
        super().__init__(" ".join([*sentences, advice]).rstrip())


def check_known(kind: str, name: object, known: Collection[str]) -> None:
    """Raise `UnknownNameError` unless `name` is one of the `known`; `kind` says what it names, for the message."""
    if not isinstance(name, Hashable) or name not in known:  # an array's comparison is no answer
        raise UnknownNameError(kind, name, known)


class FileError(MillisightError, OSError):
    """A file cannot be read or written."""


class FormatError(FileError):
    """A file is not one of ours, or of a kind that is not known here."""


class DamagedFileError(FileError):
    """A file is one of ours, but truncated or corrupted."""


class DeviceError(MillisightError, RuntimeError):
    """The device asked for is not there."""
