"""Ctrl-C and SIGTERM raise one exception, from the first moment on. Imports little, so that it starts early."""

import signal
import sys
from types import FrameType
from typing import Any

_NUMBERS = (signal.SIGINT, signal.SIGTERM)
_received = 0


class Interrupted(BaseException):
    """The user or the system asks the program to end.

    Not a KeyboardInterrupt, which Typer would turn into an exit without a word.
    """


def listen() -> None:
    """Raise `Interrupted` on both signals; a signal that the parent process ignores stays ignored."""
    for number in _NUMBERS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = _unraisable


def stop_listening() -> None:
    """Ignore further signals while the program ends."""
    for number in _NUMBERS:
        signal.signal(number, signal.SIG_IGN)


def received() -> int:
    """Number of the last signal received; 0: none."""
    return _received


def check() -> None:
    """Raise `Interrupted` if a signal was received and its exception lost, as in a call-back from C.

    Raises
    ------
    Interrupted
    """
    if _received:
        raise Interrupted


def _interrupt(number: int, _frame: FrameType | None) -> None:
    global _received
    _received = number
    raise Interrupted


def _unraisable(report: Any) -> None:
    """Report an exception that Python cannot raise, unless it is `Interrupted`: `check` raises that one."""
    if not isinstance(report.exc_value, Interrupted):
        sys.__unraisablehook__(report)
