"""Records as TOML, both ways: a table a record, a key a field; nothing unknown is passed over.

A field's metadata may name its `key` in the file where Python keeps the word for itself, or None for a field that no
file holds. Ranges and units are the records' own checks; every message names the file and the place in it.
"""

import dataclasses
import functools
import os
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from millisight.core._files import printable, read_toml
from millisight.core.errors import FormatError, MillisightError, UnknownNameError, quoted

T = TypeVar("T")

_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def record_from_file(cls: type[T], path: str | os.PathLike[str], what: str = "a recipe") -> T:
    """The record `cls` that a TOML file holds.

    Parameters
    ----------
    cls : a record
    path : the file
    what : what it is expected to be, for messages

    Raises
    ------
    FormatError
        The file is no TOML, holds no key, or a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    table = read_toml(path, what)
    if not table:  # rather a mistake than the wish for an hour's work by the defaults
        raise FormatError(f'{printable(path)} holds no key; expected {what}, at least a name: name = "mine"')
    return record_from_table(cls, table, printable(path))


def record_from_table(cls: type[T], table: Any, source: str, place: str = "", /, **hidden: Any) -> T:
    """The record `cls` from a table of a file, its nested records first.

    Parameters
    ----------
    cls : a record; its fields say which keys there are, and of which kind
    table : the keys and their values
    source : name of the file, for messages
    place : of the table in the file, for messages
    **hidden : fields that the file does not hold

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    if not isinstance(table, Mapping):
        raise FormatError(f"{source}: {place}: expected a table, got {quoted(table)}")
    kinds, fields = _kinds(cls), _fields(cls)
    values = dict(hidden)
    for key, value in table.items():
        where = f"{place}.{key}" if place else key
        if key not in fields:
            raise FormatError(f"{source}: {where}: {UnknownNameError('key', key, fields)}")
        values[fields[key].name] = _value(kinds[fields[key].name], value, source, where)
    at = f"{source}: {place}" if place else source
    for key, field in fields.items():
        if field.name not in values and field.default is field.default_factory is dataclasses.MISSING:
            raise FormatError(f"{at}: {key} is missing; add it")
    try:
        return cls(**values)
    except MillisightError as error:
        raise FormatError(f"{at}: {error}") from error


def toml_of(record: Any) -> str:
    """The TOML from which `record_from_table` makes this record; fields that are None, or empty, are left out."""
    return "\n".join(_lines(record, "")) + "\n"


@functools.cache
def _kinds(cls: Any) -> dict[str, Any]:
    """The types of the fields, which take long to resolve."""
    return typing.get_type_hints(cls)


@functools.cache
def _fields(cls: Any) -> dict[str, dataclasses.Field]:
    """The fields that a file holds, by their keys."""
    named = {field.metadata.get("key", field.name): field for field in dataclasses.fields(cls)}
    return {key: field for key, field in named.items() if key is not None}


def _value(kind: Any, value: Any, source: str, place: str) -> Any:
    """A value of the field type `kind`."""
    if isinstance(kind, types.UnionType):
        (kind,) = (option for option in typing.get_args(kind) if option is not type(None))
    if _is_record(kind):
        return record_from_table(kind, value, source, place)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        if not isinstance(value, list):
            some = "a list" if inner[-1] is Ellipsis else f"a list of {len(inner)}"
            expected = f"[[{place}]] tables" if _is_record(inner[0]) else some
            raise FormatError(f"{source}: {place}: expected {expected}, got {quoted(value)}")
        kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else list(inner)
        if len(kinds) != len(value):
            raise FormatError(f"{source}: {place}: expected {len(kinds)} entries, got {quoted(value)}")
        return tuple(_value(k, v, source, f"{place}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if origin is not None:
        if not isinstance(value, Mapping):
            raise FormatError(f"{source}: {place}: expected a table, got {quoted(value)}")
        return dict(value)
    expected = (int, float) if kind in (int, float) else kind
    if not isinstance(value, expected) or (isinstance(value, bool) and kind is not bool):
        raise FormatError(f"{source}: {place}: expected {_WORDS[kind]}, got {quoted(value)}")
    return value


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def _lines(record: Any, place: str) -> list[str]:
    """The record's plain fields, then its tables."""
    plain, tables = [], []
    for key, field in _fields(type(record)).items():
        value = getattr(record, field.name)
        where = f"{place}.{key}" if place else key
        if _is_record(type(value)):
            tables += ["", f"[{where}]", *_lines(value, where)]
        elif isinstance(value, tuple) and value and _is_record(type(value[0])):
            tables += [line for item in value for line in ("", f"[[{where}]]", *_lines(item, where))]
        elif value is not None and value != ():
            plain.append(f"{key} = {_text(value)}")
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
