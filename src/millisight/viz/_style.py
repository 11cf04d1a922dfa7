"""How figures are styled and written: letters, settings by name, and files.

Figures are made with `matplotlib.figure.Figure` and never through pyplot: no window, no global state.
"""

import functools
import inspect
import os
import warnings
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, get_args

import matplotlib
from matplotlib.figure import Figure
from matplotlib.text import Text

from millisight.core import atomic_path, printable
from millisight.core.errors import UnknownNameError

OUTSIDE = "0.90"
"""Colour of a panel where the image's grid does not reach."""

# Settings of the user, or of a matplotlibrc in the working directory, change no figure.
_DEFAULTS = {name: value for name, value in matplotlib.rcParamsDefault.items() if not name.startswith("backend")}
_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "axes.facecolor": OUTSIDE,
    "figure.facecolor": "white",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
}
# Metadata without dates or versions, so that the same figure gives the same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

P = ParamSpec("P")
T = TypeVar("T")


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Run `function` in the figures' style, whatever the user's own settings, which stay as they are.

    A setting that it does not have is refused by an UnknownNameError that names those it has.
    """
    parameters = inspect.signature(function).parameters

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        for name in kwargs:
            if name not in parameters:
                raise _unknown(getattr(function, "__name__", "the figure"), name, parameters)
        with matplotlib.rc_context({**_DEFAULTS, **_STYLE}):
            return function(*args, **kwargs)

    return wrapper


def _unknown(function: str, name: str, parameters: Mapping[str, inspect.Parameter]) -> UnknownNameError:
    """The error for a setting that a function does not have; one that is a value of another, as "db", says which."""
    known = [one.name for one in parameters.values() if one.kind is one.KEYWORD_ONLY]
    meant = [
        f'Write {other.name}="{name}".'
        for other in parameters.values()
        if any(name in get_args(one) for one in get_args(other.annotation))
    ]
    return UnknownNameError(f"setting of {function}", name, known, advice=" ".join(meant))


class NotebookFigure(Figure):
    """A figure that a notebook shows, with `%matplotlib inline` or without."""

    def _repr_png_(self) -> bytes:
        held = BytesIO()
        self.savefig(held, format="png", dpi=100)
        return held.getvalue()


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: float = 150) -> None:
    """Write a figure as PNG, SVG or PDF, by the suffix; the same figure gives the same bytes.

    Parameters
    ----------
    figure : Figure
    path : an old file there is replaced only when the new one is whole
    dpi : pixels per inch, for PNG

    Raises
    ------
    UnknownNameError
        The suffix is none of these.
    FileError
        The folder is missing, read-only, or full.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _METADATA:
        raise UnknownNameError("figure format", suffix or Path(path).name, _METADATA)
    look: dict[Any, Any] = {**_STYLE, "svg.hashsalt": "millisight"}
    with atomic_path(path) as temporary, matplotlib.rc_context({**_DEFAULTS, **look}), warnings.catch_warnings():
        # Names in scripts that the letters have not: boxes stand for them, and a warning for each helps nobody.
        warnings.filterwarnings("ignore", message="Glyph .* missing from", category=UserWarning)
        for text in figure.findobj(Text):  # a file's name may be none that can be drawn
            text.set_text(printable(text.get_text()))
        figure.savefig(temporary, format=suffix[1:], dpi=dpi, metadata=_METADATA[suffix])
