"""Ctrl-C and SIGTERM: one exception for both, from the first moment on. It imports next to nothing."""

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
    """From now on the two signals raise `Interrupted`; one that the parent had us ignore stays ignored."""
    for number in _NUMBERS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = _unraisable


def stop_listening() -> None:
    """The end has begun: another signal must not disturb it."""
    for number in _NUMBERS:
        signal.signal(number, signal.SIG_IGN)


def received() -> int:
    """The number of the last signal that came, 0 for none."""
    return _received


def check() -> None:
    """Raise `Interrupted` where a signal came and its exception was lost: in a call-back from C, say.

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
    """Python's own report of an exception that it cannot raise, less ours: `check` will raise it."""
    if not isinstance(report.exc_value, Interrupted):
        sys.__unraisablehook__(report)
