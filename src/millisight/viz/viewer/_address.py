"""Settings as the text in the page's address, so that a copied address shows the same view.

`threshold_db=-20&slices=1&clip_z=..-0.02`: every setting that differs from `ViewSettings()`. The page itself adds
`of`, which stands for what it shows, and `camera`, where it is seen from.
"""

from dataclasses import fields
from typing import Any
from urllib.parse import parse_qsl, urlencode

from millisight.core.errors import InputError
from millisight.viz.viewer._settings import ViewSettings

_KINDS = {field.name: type(getattr(ViewSettings(), field.name)) for field in fields(ViewSettings)}
_RANGES = ("clip_x", "clip_y", "clip_z")


def to_address(settings: ViewSettings) -> str:
    """The settings as text; those that are as in `ViewSettings()` are left out."""
    usual = ViewSettings()
    told = {name: getattr(settings, name) for name in _KINDS if getattr(settings, name) != getattr(usual, name)}
    return urlencode({name: _text(name, value) for name, value in told.items()}, safe=",.")


def from_address(text: str) -> ViewSettings:
    """The settings that a text of `to_address` holds.

    Raises
    ------
    InputError
        A name is no setting's, comes twice, or a value cannot be right.
    """
    told: dict[str, Any] = {}
    for name, value in parse_qsl(text, keep_blank_values=True):
        if name not in _KINDS or name in told:
            raise InputError(f"the address has {name}={value}; expected each of {', '.join(_KINDS)} once at most")
        try:
            told[name] = _value(name, value)
        except ValueError as error:
            raise InputError(f"the address has {name}={value}, which is no {name} of the viewer") from error
    return ViewSettings(**told)


def _text(name: str, value: Any) -> str:
    if name in _RANGES:
        return "..".join(f"{limit:.6g}" if abs(limit) < float("inf") else "" for limit in value)
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, tuple):
        return ",".join(f"{number:.6g}" for number in value)
    return value if isinstance(value, str) else f"{value:.6g}"


def _value(name: str, text: str) -> Any:
    kind = _KINDS[name]
    if name in _RANGES:
        low, high = text.split("..")
        return float(low or "-inf"), float(high or "inf")
    if kind is bool:
        return bool(("0", "1").index(text))
    if kind is tuple:
        return tuple(float(number) for number in text.split(","))
    return text if kind is str else float(text)
