"""--radar for a file that is named alone: which radar it is of."""

from collections.abc import Iterable
from pathlib import Path

from millisight.core import check_known, printable
from millisight.core.errors import InputError
from millisight.io.mito import RADARS

_CENTRES = {"77_ghz": 77e9, "24_ghz": 24e9}  # [Hz]
_WITHIN = 0.1  # of it is the centre of a file's band: 79 GHz for most radars of the first


def check_named(path: Path, radar: str | None, names: Iterable[str]) -> None:
    """Refuse a radar that is not known, or not the one that a file's place names.

    Parameters
    ----------
    names : of the file and its folder; radars of any name have files of their name

    Raises
    ------
    InputError, UnknownNameError
    """
    names = tuple(names)
    if radar is None or radar in names:
        return
    check_known("radar", radar, RADARS)
    for name in names:
        if name in RADARS:
            raise _of_another(path, name, radar)


def check_band(path: Path, radar: str | None, frequency: float | None) -> None:
    """Refuse a file of another band than that of the radar asked for; a band that is not known passes.

    Parameters
    ----------
    frequency : centre of the file's band [Hz]; None: the file does not tell

    Raises
    ------
    InputError
    """
    centre = _CENTRES.get(radar or "")
    if centre is not None and frequency is not None and abs(frequency / centre - 1) > _WITHIN:
        raise _of_another(path, f"{frequency / 1e9:.3g} GHz", radar)


def _of_another(path: Path, held: str, radar: str | None) -> InputError:
    return InputError(
        f"{printable(path)} is of {held}, and --radar asks for {radar}; leave --radar out, or pass a file of that radar"
    )
