"""What every record shares: fields are checked once, in `__post_init__`, and never change after.

A record is a frozen, keyword-only dataclass with slots and without `==` (comparing arrays has no one meaning).
Its arrays are read-only NumPy; its metadata is a read-only mapping of what JSON can hold.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from millisight.errors import InputError

Metadata = Mapping[str, Any]


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False)
def record(cls):
    """Make `cls` a record: a frozen, keyword-only dataclass with slots and identity equality."""
    return dataclass(frozen=True, slots=True, kw_only=True, eq=False)(cls)


def put(owner: object, **fields: Any) -> None:
    """Set fields of a frozen record: only for its own `__post_init__`."""
    for name, value in fields.items():
        object.__setattr__(owner, name, value)


def checked_array(
    value: ArrayLike, *, name: str, shape: tuple[int | str, ...], dtype: DTypeLike = np.float64, unit: str = ""
) -> np.ndarray:
    """`value` as a read-only array of `dtype`, its shape and finiteness checked.

    A string in `shape` names a free dimension of at least one entry, an integer fixes it.

    Raises
    ------
    InputError
        The shape does not fit, the values cannot be converted, or some are NaN or infinite.
    """
    unit = f" [{unit}]" if unit else ""
    dtype = np.dtype(dtype)
    try:
        given = np.asarray(value)
        if given.dtype.kind == "c" and dtype.kind != "c":
            raise TypeError("it holds complex values")
        array = np.asarray(given, dtype=dtype)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} cannot be read as an array of {dtype}: {error}") from error
    check_shape(array.shape, name=name, shape=shape)
    if array.dtype.kind in "fc" and not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        count = int((~np.isfinite(array)).sum())
        raise InputError(
            f"{name}{unit} has {count} values that are NaN or infinite, the first at {where}; remove or mend them"
        )
    if array.flags.writeable:
        # A caller's own array is copied, so that nobody can write to it later; a read-only one is taken as it is.
        array = array.copy() if array is value or array.base is not None else array
        array.flags.writeable = False
    return array


def check_shape(actual: tuple[int, ...], *, name: str, shape: tuple[int | str, ...]) -> None:
    """Raise `InputError` unless `actual` has the dimensions of `shape` (a string: any size of at least 1)."""
    fits = len(actual) == len(shape) and all(
        (a >= 1 if isinstance(s, str) else a == s) for a, s in zip(actual, shape, strict=True)
    )
    if not fits:
        expected = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise InputError(f"{name} has shape {actual}; expected ({expected}), no dimension empty")


def checked_number(
    value: float, *, name: str, unit: str = "", minimum: float | None = None, above: float | None = None
) -> float:
    """`value` as a finite float, at least `minimum` and greater than `above`.

    Raises
    ------
    InputError
        It is no number, not finite, or out of range.
    """
    unit = f" {unit}" if unit else ""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is {value!r}; expected a number{f' in{unit}' if unit else ''}") from error
    if not np.isfinite(number):
        raise InputError(f"{name} is {number}; expected a finite number{f' in{unit}' if unit else ''}")
    if above is not None and not number > above:
        raise InputError(f"{name} is {number:g}{unit}; expected more than {above:g}{unit}")
    if minimum is not None and not number >= minimum:
        raise InputError(f"{name} is {number:g}{unit}; expected at least {minimum:g}{unit}")
    return number


def checked_metadata(value: Metadata) -> Metadata:
    """`value` as a read-only mapping, refused where JSON cannot hold it.

    Raises
    ------
    InputError
        It is no mapping, or holds what JSON cannot.
    """
    try:
        plain = json.loads(json.dumps(dict(value), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"metadata must be a mapping of plain values that JSON can hold: {error}") from error
    return MappingProxyType(plain)


def with_step(metadata: Metadata, step: str, **settings: Any) -> dict[str, Any]:
    """`metadata` with one more entry in its `history`: what was done, with which settings."""
    return {**metadata, "history": [*metadata.get("history", ()), {"step": step, **settings}]}
