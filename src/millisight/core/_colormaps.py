"""The colour map of all pictures: one setting, Matplotlib's maps, and those of plug-ins.

Everything that colours magnitudes asks `checked_colormap`: figures, reports, the viewer, notebooks. Another colour map
for all of them is another `_current` here, a call of `set_colormap`, or the environment variable
`MILLISIGHT_COLORMAP`.
"""

import os
from typing import TYPE_CHECKING, Any

from millisight.core._registry import Registry
from millisight.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

PUBLISHED_COLORMAP = "jet"
"""The paper's rainbow. Segmenters look at it, whatever colours people look at."""

_OFFERED = ("inferno", "viridis", "cividis", "turbo", PUBLISHED_COLORMAP, "gray")
"""Where a user chooses; the first four tell the value by their brightness, more or less."""

_current: str | None = None  # None: of the environment, or "inferno", whose brightness tells the value to everybody


def _check(name: str, entry: Any) -> None:
    from matplotlib.colors import Colormap

    if not isinstance(entry, Colormap):
        raise InputError(f"colour map {name!r} is a {type(entry).__name__}; expected a matplotlib.colors.Colormap")


PLUGIN_COLORMAPS: "Registry[Colormap]" = Registry("colour map", "millisight.colormaps", check=_check)
"""Colour maps beside Matplotlib's: `matplotlib.colors.Colormap`, each by the name of its entry point."""


def checked_colormap(name: "str | Colormap | None" = None) -> "Colormap":
    """The colour map of that name: Matplotlib's, or a plug-in's.

    Parameters
    ----------
    name : None is the colour map of all pictures, see `set_colormap`; a Matplotlib Colormap is returned as it is

    Raises
    ------
    InputError
        There is none, or a plug-in's cannot be loaded.
    """
    import matplotlib

    name = colormap_in_use() if name is None else name
    if isinstance(name, str) and name not in matplotlib.colormaps and name in PLUGIN_COLORMAPS:
        return PLUGIN_COLORMAPS[name]
    try:
        return matplotlib.colormaps.get_cmap(name)
    except (ValueError, TypeError) as error:
        raise InputError(f"unknown colour map {str(name)[:80]!r}; try one of {', '.join(colormap_names())}") from error


def colormap_in_use() -> str:
    """Name of the colour map that pictures have where none is asked for."""
    return _current or os.environ.get("MILLISIGHT_COLORMAP") or _OFFERED[0]


def set_colormap(name: str | None) -> None:
    """Show magnitudes in this colour map from now on, in every figure, report, viewer and notebook of this process.

    Parameters
    ----------
    name : Matplotlib's name, or a plug-in's; None: what the environment variable MILLISIGHT_COLORMAP says, or "inferno"

    Raises
    ------
    InputError
        There is none of that name.
    """
    global _current
    if name is not None:
        checked_colormap(name)
    _current = name


def colormap_names() -> tuple[str, ...]:
    """Names to choose from: the one in use, well-known ones, those of plug-ins."""
    from matplotlib import colormaps

    known = (*_OFFERED, *PLUGIN_COLORMAPS.names())
    used = (colormap_in_use(),) if colormap_in_use() in (*colormaps, *known) else ()
    return tuple(dict.fromkeys((*used, *known)))
