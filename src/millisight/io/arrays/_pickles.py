"""Pickles of NumPy arrays and plain containers: `read_pickle` runs nothing that a file says.

A pickle is a program, and Python's own unpickler calls what the program names. Here another machine runs it: the
standard library's `pickletools` takes it apart into steps, and only those are obeyed that build plain values and
arrays. A global of the file never becomes a Python object: it stays a name, and a few names have a meaning here.
"""

import os
import pickletools
import struct
import sys
import warnings
from collections.abc import Callable
from typing import IO, Any, NoReturn

import numpy as np

from millisight.core import Limits, check_readable, limits_of, printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.io.arrays._entry import array_of_bytes, checked_shape, plain_dtype
from millisight.io.arrays._pickled_content import Refused, checked_content

_LONGEST_INTEGER = 512  # bits
_KEYS = (str, bytes, bool, int, float, type(None))
_LONGEST_KEY = 8  # entries of a tuple that is a key
_KEY_BITS = 16  # of whole numbers in it


def read_pickle(path: str | os.PathLike[str]) -> Any:
    """Read a pickle without running code: NumPy arrays, scalars and types; dict, list, tuple, set; text, bytes,
    numbers, None.

    Nothing is run, whatever the file says. Arrays are read-only; arrays of objects hold such values, never others.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It asks for anything else, which the message names, or is built to exhaust memory or time.
    DamagedFileError
        It is no pickle, truncated, or its parts do not fit.
    """
    path = check_readable(path)
    size = os.path.getsize(path)
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of odd escapes in Python 2's texts
        limits = limits_of(size)
        machine = _Machine(limits)
        try:
            return checked_content(machine.run(_Bounded(file, size)), limits)
        except Refused as error:
            raise FormatError(f"{printable(path)}, byte {machine.position}: {error}") from error
        except (ValueError, LookupError, TypeError, OverflowError, struct.error) as error:
            place = f"{printable(path)} is not a pickle, or is damaged, at byte {machine.position}"
            raise DamagedFileError(f"{place}: {error}; copy or make it again") from error


def _refuse_global(name: str) -> NoReturn:
    raise Refused(
        f"the pickle asks for {name[:200]}, which is refused: a pickle can run any code, so only NumPy arrays and "
        "plain containers are read; convert it with the program that wrote it, to .npz for instance"
    )


class _Bounded:
    """A file that is never asked for more bytes than it has, whatever lengths it claims."""

    def __init__(self, file: IO[bytes], size: int):
        self._file, self.size = file, size
        self.tell, self.readline = file.tell, file.readline

    def read(self, count: int) -> bytes:
        return self._file.read(max(0, min(count, self.size)))


class _Global:
    """A global of the file: a name."""

    __slots__ = ("name",)

    def __init__(self, name: str):
        if name not in _MEANINGS:
            _refuse_global(name)
        self.name = name


class _Unfinished:
    """An array or a type whose state is still to come; then `value` holds it."""

    __slots__ = ("finish", "value")

    def __init__(self, finish: Callable[[Any], Any]):
        self.finish, self.value = finish, None


class _Machine:
    """Runs the steps of a pickle (`pickletools` describes each) that build plain values."""

    def __init__(self, limits: Limits) -> None:
        self.limits, self.made = limits, 0  # bytes of copies that calls have made so far
        self.stack: list[Any] = []
        self.below: list[list[Any]] = []  # the stacks under the marks
        self.memo: dict[int, Any] = {}
        self.position = 0  # of the present step in the file [bytes]

    def run(self, file: _Bounded) -> Any:
        """The value that the pickle leaves at its end."""
        most = self.limits.items  # so a pickle of empty sets, 216 bytes each, ends at a quarter of a gigabyte
        for number, (step, argument, position) in enumerate(pickletools.genops(file)):  # ty: ignore[invalid-argument-type]
            self.position = position or 0
            if number == most:
                raise Refused(f"the pickle has more than {most} steps; save long lists as NumPy arrays")
            if step.name in _CONSTANTS:
                if type(argument) is int and argument.bit_length() > _LONGEST_INTEGER:
                    raise Refused(
                        f"a whole number of {argument.bit_length()} bits; expected at most {_LONGEST_INTEGER}"
                    )
                self.stack.append(argument)
            else:
                self.obey(step.name, argument)
        (value,) = self.stack
        return value

    def obey(self, step: str, argument: Any) -> None:
        """One step that is no constant, its `argument` taken from the file."""
        stack = self.stack
        match step:
            case "PROTO" | "FRAME" | "STOP":
                pass
            case "NONE" | "NEWTRUE" | "NEWFALSE":
                stack.append({"NONE": None, "NEWTRUE": True, "NEWFALSE": False}[step])
            case "EMPTY_LIST" | "EMPTY_DICT" | "EMPTY_SET" | "EMPTY_TUPLE":
                stack.append({"LIST": list, "DICT": dict, "SET": set, "TUPLE": tuple}[step[6:]]())
            case "MARK":
                self.below.append(stack)
                self.stack = []
            case "POP" if stack:
                stack.pop()
            case "POP" | "POP_MARK":
                self.popped()
            case "DUP":
                stack.append(stack[-1])
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                count = int(step[-1])
                if len(stack) < count:
                    raise ValueError(f"a tuple of {count} where there are {len(stack)} items")
                stack[-count:] = [tuple(stack[-count:])]
            case "TUPLE" | "LIST" | "FROZENSET" | "DICT":
                items = self.popped()
                make = {"TUPLE": tuple, "LIST": list, "FROZENSET": _frozenset, "DICT": _pairs}[step]
                self.stack.append(make(items))
            case "APPEND":
                item = stack.pop()
                _expected(stack[-1], list).append(item)
            case "APPENDS":
                items = self.popped()
                _expected(self.stack[-1], list).extend(items)
            case "ADDITEMS":
                items = self.popped()
                _expected(self.stack[-1], set).update(_keys(items))
            case "SETITEM":
                value, key = stack.pop(), stack.pop()
                _expected(stack[-1], dict).update(_pairs([key, value]))
            case "SETITEMS":
                items = self.popped()
                _expected(self.stack[-1], dict).update(_pairs(items))
            case "PUT" | "BINPUT" | "LONG_BINPUT":
                self.memo[argument] = stack[-1]
            case "MEMOIZE":
                self.memo[len(self.memo)] = stack[-1]
            case "GET" | "BINGET" | "LONG_BINGET":
                item = self.memo[argument]
                stack.append(item if not isinstance(item, _Unfinished) or item.value is None else item.value)
            case "GLOBAL":
                stack.append(_Global(argument.replace(" ", ".", 1)))
            case "STACK_GLOBAL":
                name, module = _expected(stack.pop(), str), _expected(stack.pop(), str)
                stack.append(_Global(f"{module}.{name}"))
            case "REDUCE":
                arguments, function = _expected(stack.pop(), tuple), _expected(stack.pop(), _Global)
                try:
                    stack.append(self.counted(_MEANINGS[function.name](*arguments)))
                except TypeError as error:
                    raise ValueError(f"{function.name} with {len(arguments)} arguments of the wrong kind") from error
            case "BUILD":
                state, item = stack.pop(), stack.pop()
                if not isinstance(item, _Unfinished) or item.value is not None:
                    raise Refused(f"the pickle sets the state of a {type(item).__name__}, which is refused")
                item.value = self.counted(item.finish(state))
                stack.append(item.value)
            case "INST":
                _refuse_global(argument.replace(" ", ".", 1))
            case _:  # calls of classes, the extension registry, persistent names, buffers outside the file
                _refuse_global(f"the step {step}")

    def counted(self, value: Any) -> Any:
        """`value`, which a call has made; the same few bytes of a file can ask for it a thousand times."""
        self.made += getattr(value, "nbytes", 0) or sys.getsizeof(value)
        if self.made > self.limits.content:
            raise Refused(
                f"calls make {self.made} bytes; expected at most {self.limits.content} of a file of this size"
            )
        return value

    def popped(self) -> list[Any]:
        """What lies above the last mark."""
        items, self.stack = self.stack, self.below.pop()
        return items


def _expected(value: Any, cls: Any) -> Any:
    if not isinstance(value, cls):
        raise ValueError(f"found {type(value).__name__}; expected {getattr(cls, '__name__', cls)}")
    return value


def _keys(items: list[Any]) -> list[Any]:
    """Keys of a dictionary or a set, of such kinds that no file can make them collide by design."""
    for item in items:
        if type(item) is tuple and _is_plain_key(item):
            continue
        if type(item) not in _KEYS or (type(item) is int and item.bit_length() > 63):
            raise Refused(
                f"a {type(item).__name__} as a key; expected text, bytes, None, a number of 64 bits, or a short tuple "
                f"with a text and whole numbers of {_KEY_BITS} bits"
            )
    return items


def _is_plain_key(items: tuple[Any, ...]) -> bool:
    """A tuple with a text, whose hash no file can foresee; its numbers are too small to be of use for collisions."""
    return (
        len(items) <= _LONGEST_KEY
        and any(type(item) is str for item in items)
        and all(type(item) in (str, bool) or (type(item) is int and item.bit_length() <= _KEY_BITS) for item in items)
    )


def _pairs(items: list[Any]) -> dict[Any, Any]:
    """A dictionary of keys and values in turn."""
    return dict(zip(_keys(items[::2]), items[1::2], strict=True))


def _set(items: Any) -> set[Any]:
    return set(_keys(_expected(items, list)))


def _frozenset(items: Any) -> frozenset[Any]:
    return frozenset(_set(items))


def _dtype(text: Any, *_: Any) -> _Unfinished:
    """`numpy.dtype(text, align, copy)`; the byte order follows as its state."""

    def finish(state: Any) -> np.dtype:
        _, order, base, names, *_ = _expected(state, tuple)
        if base is not None or names is not None or order not in ("<", ">", "|", "="):
            raise Refused("an array of structures, which is refused; save its fields as arrays of their own")
        if text in ("O", "O8"):
            return np.dtype(object)
        try:
            return plain_dtype(f"{order}{text}")
        except ValueError as error:
            raise Refused(f"an array that is not read: {error}") from error

    return _Unfinished(finish)


def _reconstruct(cls: Any, *_: Any) -> _Unfinished:
    """`numpy._core.multiarray._reconstruct(ndarray, (0,), b"b")`; shape, type and bytes follow as its state."""
    if not isinstance(cls, _Global) or cls.name != "numpy.ndarray":
        raise ValueError(f"an array of the class {getattr(cls, 'name', type(cls).__name__)}; expected numpy.ndarray")

    def finish(state: Any) -> np.ndarray:
        _, shape, dtype, fortran, data = _expected(state, tuple)
        if _expected(dtype, np.dtype).hasobject:
            return _objects(_expected(data, list), checked_shape(shape), bool(fortran))
        if isinstance(data, str):  # Python 2's bytes
            data = data.encode("latin-1")
        return array_of_bytes(_expected(data, bytes | bytearray), dtype, checked_shape(shape), fortran=bool(fortran))

    return _Unfinished(finish)


def _objects(data: list[Any], shape: tuple[int, ...], fortran: bool) -> np.ndarray:
    array = np.empty(len(data), object)
    for i, item in enumerate(data):
        array[i] = item
    return array.reshape(shape, order="F" if fortran else "C")


def _scalar(dtype: Any, data: Any) -> Any:
    """`numpy._core.multiarray.scalar(dtype, bytes)`"""
    if isinstance(data, str):
        data = data.encode("latin-1")
    return array_of_bytes(_expected(data, bytes), _expected(dtype, np.dtype), ())[()]


def _from_buffer(data: Any, dtype: Any, shape: Any, order: Any, axes: Any = None) -> np.ndarray:
    """`numpy._core.numeric._frombuffer(buffer, dtype, shape, order, axis_order)` of protocol 5."""
    if order not in ("C", "F") and axes is None:
        raise ValueError(f"an array in the order {order!r}; expected 'C' or 'F'")
    data, dtype = _expected(data, bytes | bytearray), _expected(dtype, np.dtype)
    array = array_of_bytes(data, dtype, checked_shape(shape), fortran=order == "F")
    return array if axes is None else array.transpose(checked_shape(axes))


def _encode(text: Any, encoding: Any) -> bytes:
    """`_codecs.encode`: how protocols 0 to 2 write bytes."""
    if encoding not in ("latin1", "latin-1"):
        raise ValueError(f"bytes in the encoding {encoding!r}; expected 'latin1'")
    return _expected(text, str).encode("latin-1")


def _bytes(data: Any = b"", encoding: Any = None) -> bytes:
    return _expected(data, bytes) if encoding is None else _encode(data, encoding)


def _bytearray(*arguments: Any) -> bytearray:
    return bytearray(_bytes(*arguments))


def _complex(real: Any, imaginary: Any) -> complex:
    return complex(_expected(real, float), _expected(imaginary, float))


def _no_function(*_: Any) -> NoReturn:
    raise ValueError("a class is called that is only named")


_MEANINGS: dict[str, Callable[..., Any]] = {
    "numpy.ndarray": _no_function,
    "numpy.dtype": _dtype,
    "_codecs.encode": _encode,
}
for _core in ("core", "_core"):  # before and since NumPy 2
    _MEANINGS[f"numpy.{_core}.multiarray._reconstruct"] = _reconstruct
    _MEANINGS[f"numpy.{_core}.multiarray.scalar"] = _scalar
    _MEANINGS[f"numpy.{_core}.numeric._frombuffer"] = _from_buffer
for _builtins in ("builtins", "__builtin__"):  # Python 3 and 2
    _MEANINGS[f"{_builtins}.bytes"] = _bytes
    _MEANINGS[f"{_builtins}.bytearray"] = _bytearray
    _MEANINGS[f"{_builtins}.complex"] = _complex
    _MEANINGS[f"{_builtins}.set"] = _set
    _MEANINGS[f"{_builtins}.frozenset"] = _frozenset

_CONSTANTS = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8",
    "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8",
}  # fmt: skip
