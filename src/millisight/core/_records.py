"""What every record shares: fields are checked once, in `__post_init__`, and never change after.

A record is a frozen, keyword-only dataclass with slots and without `==` (comparing arrays has no one meaning).
Its arrays are read-only NumPy; its metadata is a read-only tree of what JSON can hold.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from mmap import mmap
from typing import Any, NoReturn, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from millisight.core.errors import InputError, quoted

Metadata = Mapping[str, Any]
T = TypeVar("T")


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False)
def record(cls: type[T]) -> type[T]:
    """Make `cls` a record: a frozen, keyword-only dataclass with slots and identity equality."""
    made = dataclass(frozen=True, slots=True, kw_only=True, eq=False)(cls)
    made.__reduce__ = _reduced
    return made


def _reduced(self: Any) -> tuple[Any, ...]:
    """For pickle and copy: made anew by its constructor, so checked again and its arrays read-only again."""
    return _made, (type(self), {field.name: getattr(self, field.name) for field in fields(self)})


def _made(cls: type, values: dict[str, Any]) -> Any:
    return cls(**values)


def put(owner: object, **fields: Any) -> None:
    """Set fields of a frozen record: only for its own `__post_init__`."""
    for name, value in fields.items():
        object.__setattr__(owner, name, value)


def checked_array(
    value: ArrayLike, *, name: str, shape: tuple[int | str, ...], dtype: DTypeLike = np.float64, unit: str = ""
) -> np.ndarray:
    """`value` as a read-only array of `dtype` that nobody else can write to: `as_array`, copied where need be.

    Raises
    ------
    InputError
        As `as_array`.
    """
    array = as_array(value, name=name, shape=shape, dtype=dtype, unit=unit)
    # What may be somebody else's is copied, so that nobody can write to it later; a read-only one is taken as it is.
    ours = array is not value and array.base is None and isinstance(value, np.ndarray | list | tuple)
    if not ours and _writeable(array):
        array = array.copy()
    array.flags.writeable = False
    return array


def _writeable(array: Any) -> bool:
    """Whether the array, or one that it is a view of, can be written to; a file that is mapped can by others."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return True
        array = array.base
    return isinstance(array, mmap)


def lengths_of(vectors: np.ndarray) -> np.ndarray:
    """(n,) lengths of vectors (n, k); infinite, and without NumPy's warning, where their squares overflow."""
    with np.errstate(over="ignore"):
        return np.linalg.norm(vectors, axis=1)


def for_kernel(array: np.ndarray) -> np.ndarray:
    """The array in C's order, not to be written to: a kernel is compiled anew for each order, and for what may be."""
    same = np.ascontiguousarray(array).view()
    same.flags.writeable = False
    return same


def as_array(
    value: ArrayLike, *, name: str, shape: tuple[int | str, ...], dtype: DTypeLike = np.float64, unit: str = ""
) -> np.ndarray:
    """`value` as an array of `dtype`, perhaps itself, its shape and finiteness checked.

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
        if given.dtype.kind in "mM":
            raise TypeError("it holds dates or durations")
        if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
            raise TypeError("some of its values are masked, and the mask would be lost; fill them, or leave them out")
        with np.errstate(over="ignore", invalid="ignore"):
            array = np.asarray(given, dtype=dtype)
        _check_fits(given, array)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{name} cannot be read as an array of {dtype}: {error}") from error
    check_shape(array.shape, name=name, shape=shape)
    if array.dtype.kind in "fc" and not _all_finite(array):
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        count = int((~np.isfinite(array)).sum())
        raise InputError(
            f"{name}{unit} has {count} values that are NaN or infinite, the first at {where}; remove or correct them"
        )
    return array


def _all_finite(array: np.ndarray) -> bool:
    """Whether no value of an array of floats or complex numbers is NaN or infinite; piece by piece, within the caches,
    and of real and imaginary parts, for which NumPy has vector code."""
    if not array.flags.c_contiguous:
        return bool(np.isfinite(array).all())
    values = array.reshape(-1)
    values = values.view(values.real.dtype)
    return all(np.isfinite(values[i : i + _PIECE]).all() for i in range(0, len(values), _PIECE))


def _check_fits(given: np.ndarray, array: np.ndarray) -> None:
    """Raise TypeError where integers, or what is true or false, are no longer what was given."""
    kinds = given.dtype.kind, array.dtype.kind
    if kinds[1] in "iu" and kinds[0] in "iuf" and not np.array_equal(given, array):
        what = "values that are not whole numbers" if kinds[0] == "f" else f"{given[given != array].flat[0]}"
        raise TypeError(f"it holds {what}, or numbers beyond those of {array.dtype}")
    counts = kinds[0] in "iuf" and (given >= 0).all() and np.array_equal(given, np.rint(given))
    if kinds[1] == "b" and kinds[0] != "b" and not counts:
        raise TypeError("it holds other values than true and false, or 0 and 1; compare with a threshold first")


def check_shape(actual: tuple[int, ...], *, name: str, shape: tuple[int | str, ...]) -> None:
    """Raise `InputError` unless `actual` has the dimensions of `shape` (a string: any size of at least 1)."""
    fits = len(actual) == len(shape) and all(
        (a >= 1 if isinstance(s, str) else a == s) for a, s in zip(actual, shape, strict=True)
    )
    if not fits:
        expected = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise InputError(f"{name} has shape {actual}; expected ({expected}), and no empty dimension")


_PIECE = 1 << 17  # values that are looked at together
_LONGEST = 1e9  # lengths, of which squares and sums are taken [m]
_LEAST = 1e-300  # of times, speeds and accelerations, which are divided by


def checked_number(
    value: float, *, name: str, unit: str = "", minimum: float | None = None, above: float | None = None
) -> float:
    """`value` as a finite float, at least `minimum` and greater than `above`; a length is below a million kilometres.

    Raises
    ------
    InputError
        It is no number, not finite, or out of range.
    """
    most = _LONGEST if unit == "m" else np.inf
    unit = f" {unit}" if unit else ""
    try:
        if isinstance(value, Sequence) or value is np.ma.masked or np.ndim(value) or _kind(value) in "cmM":
            raise TypeError("not a single number")  # NumPy would drop the imaginary part of a complex one
        number = float(value)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{name} is {_told(value)}; expected a number{f' in{unit}' if unit else ''}") from error
    if not np.isfinite(number):
        raise InputError(f"{name} is {number}; expected a finite number{f' in{unit}' if unit else ''}")
    if above is not None and not number > above:
        raise InputError(f"{name} is {number:g}{unit}; expected more than {above:g}{unit}")
    if above == 0 and unit in (" s", " m/s", " m/s²") and number < _LEAST:
        raise InputError(f"{name} is {number:g}{unit}; expected at least {_LEAST:g}{unit}")
    if minimum is not None and not number >= minimum:
        raise InputError(f"{name} is {number:g}{unit}; expected at least {minimum:g}{unit}")
    if abs(number) > most:
        raise InputError(f"{name} is {number:g}{unit}; expected under {most:g}{unit}")
    return number + 0.0  # -0 would turn ranges about


def _kind(value: Any) -> str:
    """Of a NumPy scalar or array, the letter of its type."""
    return value.dtype.kind if isinstance(value, np.generic | np.ndarray) else "?"


def _told(value: Any) -> str:
    """A value for a message; a whole number too long to be read by its size."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"{'-' if value < 0 else ''}2^{value.bit_length() - 1} or more"
    return quoted(value)


def checked_numbers(
    value: Any,
    *,
    name: str,
    count: int,
    repeat: bool = False,
    unit: str = "",
    minimum: float | None = None,
    above: float | None = None,
) -> tuple[float, ...]:
    """`count` numbers, each as `checked_number` takes it; with `repeat`, a single one stands for all.

    Raises
    ------
    InputError
        They are of another number, or one of them cannot be right.
    """
    if repeat and isinstance(value, int | float | np.number):
        value = [value] * count
    single = isinstance(value, str | bytes) or (isinstance(value, np.ndarray) and not value.ndim)
    if single or not isinstance(value, Sequence | np.ndarray):
        raise InputError(f"{name} is {quoted(value)}; expected {count} numbers{', or one' if repeat else ''}")
    numbers = list(value)
    if len(numbers) != count:
        raise InputError(f"{name} has {len(numbers)} numbers; expected {count}{', or one' if repeat else ''}")
    return tuple(checked_number(n, name=name, unit=unit, minimum=minimum, above=above) for n in numbers)


def checked_integer(value: Any, *, name: str, minimum: int = 1) -> int:
    """`value` as an int of at least `minimum` that 64 bits hold; 4.0 is whole, "4" and True are no numbers.

    Raises
    ------
    InputError
        It is not whole, below `minimum`, or too large.
    """
    if isinstance(value, np.floating):
        value = float(value)  # float16 does not hold what it is compared with
    whole = isinstance(value, int | float | np.integer) and not isinstance(value, bool | np.timedelta64)
    if not whole or not minimum <= value < 1 << 64 or int(value) != value:  # NaN and infinity fit no range
        raise InputError(f"{name} is {_told(value)}; expected a whole number of at least {minimum}")
    return int(value)


def checked_items(values: Any, cls: type[T], *, name: str) -> tuple[T, ...]:
    """`values` as a tuple, each of which must be a `cls`; `name` is that of one.

    Raises
    ------
    InputError
    """
    try:
        if isinstance(values, str | bytes | Mapping):
            raise TypeError("not a sequence of such")
        items = tuple(values)
    except TypeError as error:
        raise InputError(f"{quoted(values)} was given; expected a sequence, each of it {name}") from error
    return tuple(checked_record(item, cls, name=name) for item in items)


def checked_record(value: Any, cls: type[T], *, name: str) -> T:
    """`value`, which must be a `cls`.

    Raises
    ------
    InputError
        It is something else.
    """
    if not isinstance(value, cls):
        named = isinstance(value, os.PathLike) or (isinstance(value, str) and value.endswith(".h5"))
        hint = "; load the file with millisight.load" if named else ""
        raise InputError(f"{name} is of type {type(value).__name__}; expected {cls.__name__}{hint}")
    return value


def seed_or_generator(rng: int | np.random.Generator) -> np.random.Generator:
    """A generator of the seed `rng`, or `rng` itself.

    Raises
    ------
    InputError
        It is neither.
    """
    if isinstance(rng, np.random.Generator):
        return rng
    if isinstance(rng, bool | np.timedelta64) or not isinstance(rng, int | np.integer) or rng < 0:
        raise InputError(f"rng is {rng!r}; expected a seed, a whole number from 0 on, or a numpy Generator")
    return np.random.default_rng(int(rng))


def checked_metadata(value: Metadata) -> Metadata:
    """`value` as a read-only dictionary, its lists and dictionaries too; refused where JSON cannot hold it.

    Raises
    ------
    InputError
        It is no mapping, or holds what JSON cannot, or its `history` is no list of steps.
    """
    try:
        plain = json.loads(json.dumps(dict(value), allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"metadata must be a mapping of plain values that JSON can hold: {error}") from error
    history = plain.get("history", [])
    if not isinstance(history, list) or not all(isinstance(entry, dict) for entry in history):
        raise InputError("metadata's history must be a list of mappings, one for each step, as `with_step` adds them")
    return _frozen(plain)


def _refuse(self: Any, *_: Any, **__: Any) -> NoReturn:
    raise TypeError("metadata is read-only; make a new record with other metadata")


class _Dict(dict):
    """A dictionary that cannot be changed, and otherwise is one: for JSON, for pickle, for `==`."""

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple:
        return _Dict, (dict(self),)


class _List(list):
    """A list that cannot be changed, and otherwise is one."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple:
        return _List, (list(self),)


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return _Dict({key: _frozen(item) for key, item in value.items()})
    return _List(map(_frozen, value)) if isinstance(value, list) else value


def box(lower: np.ndarray, upper: np.ndarray) -> str:
    """The box from (3,) `lower` to (3,) `upper` [m], in words; (2,) along x and y alone."""
    return ", ".join(
        f"{name} {a:.4g} to {b:.4g} m" for name, a, b in zip("xyz"[: len(lower)], lower, upper, strict=True)
    )


def with_step(metadata: Metadata, step: str, **settings: Any) -> dict[str, Any]:
    """`metadata` with one more entry in its `history`: what was done, with which settings."""
    return {**metadata, "history": [*metadata.get("history", ()), {"step": step, **settings}]}
