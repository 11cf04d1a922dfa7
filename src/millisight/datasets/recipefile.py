"""RECIPE.toml: a table a record, a key a field; nothing unknown is passed over, and every message names the place."""

import dataclasses
import os
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from millisight.datasets.recipe import Recipe
from millisight.errors import FormatError, MillisightError, UnknownNameError
from millisight.files import printable, read_toml

_KEYS = {"shape_class": "class"}
"""What fields are called in the file where Python keeps the word for itself."""
_NOT_KEYS = {"folder", "source"}

T = TypeVar("T")


def read_recipe(path: str | os.PathLike[str]) -> Recipe:
    """The recipe that a TOML file holds; relative paths in it start at its own folder.

    Raises
    ------
    FormatError
        The file is no TOML, or holds a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    table = read_toml(path, "a recipe")
    return recipe_from_table(table, folder=str(Path(path).parent), source=printable(path))


def recipe_from_table(table: Mapping[str, Any], *, folder: str = ".", source: str = "recipe") -> Recipe:
    """The recipe that a table describes, as RECIPE.toml does.

    Parameters
    ----------
    table : keys as in RECIPE.toml
    folder : where relative paths start
    source : name of the table for messages

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    recipe: Recipe = record_from_table(Recipe, table, source)
    return dataclasses.replace(recipe, folder=folder, source=source)


def record_from_file(cls: type[T], path: str | os.PathLike[str]) -> T:
    """The recipe `cls`, such as that of a training, that a TOML file holds.

    Raises
    ------
    FormatError
        The file is no TOML, holds no key, or a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    table = read_toml(path, "a recipe")
    if not table:  # rather a mistake than the wish for an hour's work by the defaults
        raise FormatError(f'{printable(path)} holds no key; expected a recipe, if only a name: name = "mine"')
    return record_from_table(cls, table, printable(path))


def record_from_table(cls: type, table: Any, source: str, place: str = "") -> Any:
    """The record `cls` from a table of a file, its nested records first.

    Parameters
    ----------
    cls : a record; its fields say which keys there are, and of which kind
    table : the keys and their values
    source : name of the file, for messages
    place : of the table in the file, for messages

    Raises
    ------
    FormatError
        A key or a value cannot be right; the message names the place.
    """
    if not isinstance(table, Mapping):
        raise FormatError(f"{source}: {place}: expected a table, got {table!r}")
    kinds = {_KEYS.get(name, name): (name, kind) for name, kind in typing.get_type_hints(cls).items()}
    kinds = {key: kind for key, kind in kinds.items() if key not in _NOT_KEYS}
    values = {}
    for key, value in table.items():
        where = f"{place}.{key}" if place else key
        if key not in kinds:
            raise FormatError(f"{source}: {where}: {UnknownNameError('key', key, kinds)}")
        name, kind = kinds[key]
        values[name] = _value(kind, value, source, where)
    required = {_KEYS.get(f.name, f.name): f.name for f in dataclasses.fields(cls) if _is_required(f)}
    for key, name in required.items():
        if name not in values:
            raise FormatError(f"{_at(source, place)}: {key} is missing; expected it here")
    try:
        return cls(**values)
    except MillisightError as error:
        raise FormatError(f"{_at(source, place)}: {error}") from error


def _at(source: str, place: str) -> str:
    return f"{source}: {place}" if place else source


def _is_required(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _value(kind: Any, value: Any, source: str, place: str) -> Any:
    """A value of the field type `kind`."""
    if isinstance(kind, types.UnionType):
        (kind,) = (option for option in typing.get_args(kind) if option is not type(None))
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return record_from_table(kind, value, source, place)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is tuple:
        if not isinstance(value, list):
            raise FormatError(f"{source}: {place}: expected a list, got {value!r}")
        kinds = [inner[0]] * len(value) if inner[-1] is Ellipsis else list(inner)
        if len(kinds) != len(value):
            raise FormatError(f"{source}: {place}: expected {len(kinds)} entries, got {value!r}")
        return tuple(_value(k, v, source, f"{place}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if origin is not None:
        if not isinstance(value, Mapping):
            raise FormatError(f"{source}: {place}: expected a table, got {value!r}")
        return dict(value)
    expected = (int, float) if kind in (int, float) else kind
    if not isinstance(value, expected) or (isinstance(value, bool) and kind is not bool):
        raise FormatError(f"{source}: {place}: expected {_WORDS[kind]}, got {value!r}")
    return value


_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
