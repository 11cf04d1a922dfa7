"""Records as TOML, both ways: a table a record, a key a field; nothing unknown is passed over."""

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any

from millisight.errors import FormatError, MillisightError, UnknownNameError

HIDDEN = "folder"
"""The field of the outermost record that no file holds: where the file lies."""


def record_of(cls: type, table: Mapping[str, Any], *, folder: str, source: str) -> Any:
    """The record `cls` that a TOML table describes.

    Parameters
    ----------
    table : its fields by name; of fields that are records themselves, their tables
    folder : where relative paths in the table start
    source : name of the table for messages

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    if HIDDEN in table:
        raise FormatError(f"{source}: {HIDDEN}: unknown key; paths of mesh files start at the file's own folder")
    return _made(cls, {**table, HIDDEN: folder}, source, "")


def text_of(record: Any) -> str:
    """The TOML from which `record_of` makes this record."""
    return "\n".join(_lines(record, "")) + "\n"


def _made(cls: type, table: Any, source: str, place: str) -> Any:
    """The record `cls` from a table at `place`, its nested records first."""
    if not isinstance(table, Mapping):
        raise FormatError(f"{source}: {place}: expected a table, got {table!r}")
    kinds = typing.get_type_hints(cls)
    for key in table:
        if key not in kinds:
            unknown = UnknownNameError("key", key, kinds.keys() - {HIDDEN})
            raise FormatError(f"{source}: {_joined(place, key)}: {unknown}")
    values = {}
    for key, value in table.items():
        kind, many = _record_in(kinds[key])
        where = _joined(place, key)
        if kind is None:
            values[key] = _plain(value, source, where)
        elif many:
            if not isinstance(value, list):
                raise FormatError(f"{source}: {where}: expected [[{where}]] tables, got {value!r}")
            values[key] = tuple(_made(kind, item, source, f"{where}[{i}]") for i, item in enumerate(value))
        else:
            values[key] = _made(kind, value, source, where)
    try:
        return cls(**values)
    except (MillisightError, TypeError) as error:
        raise FormatError(f"{source}: {place or 'world'}: {error}") from error


def _plain(value: Any, source: str, place: str) -> Any:
    """A number, a text, a truth, or a list of numbers."""
    if isinstance(value, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value):
        return tuple(value)
    if isinstance(value, bool | int | float | str):
        return value
    raise FormatError(f"{source}: {place}: expected a number, a text or a list of numbers, got {value!r}")


def _record_in(kind: Any) -> tuple[type | None, bool]:
    """The record that a field's type holds, and whether a tuple of them."""
    for option in typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,):
        if dataclasses.is_dataclass(option) and isinstance(option, type):
            return option, False
        inner = typing.get_args(option)
        if typing.get_origin(option) is tuple and inner and dataclasses.is_dataclass(inner[0]):
            return inner[0], True  # type: ignore[return-value]
    return None, False


def _joined(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key


def _lines(record: Any, place: str) -> list[str]:
    """The record's plain fields, then its tables; what is None, or of no objects, is left out."""
    plain, tables = [], []
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        kind, many = _record_in(typing.get_type_hints(type(record))[field.name])
        where = _joined(place, field.name)
        if value is None or (not place and field.name == HIDDEN):
            continue
        if kind is None:
            plain.append(f"{field.name} = {_text(value)}")
        elif many:
            tables += [line for item in value for line in ("", f"[[{where}]]", *_lines(item, where))]
        else:
            tables += ["", f"[{where}]", *_lines(value, where)]
    return plain + tables


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + "".join(_escaped(c) for c in value) + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    return repr(value)


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    return f"\\u{ord(character):04x}" if ord(character) < 32 or ord(character) == 127 else character
