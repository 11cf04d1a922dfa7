"""What torch's files of weights ask for, looked into before torch reads them: `check_state_dict`.

torch's own reader runs nothing either, but damaged files end in errors of every kind there, names of 40 kB in 16 s, and
a storage is taken to be as large as the pickle says.
"""

import os
import struct
import warnings
import zipfile
from typing import IO, Any

from millisight.core import check_readable, limits_of, printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.io.arrays._pickled_content import Refused, checked_content
from millisight.io.arrays._pickles import _Bounded, _expected, _Machine

_BYTES = {"Double": 8, "Float": 4, "Half": 2, "BFloat16": 2, "Long": 8, "Int": 4, "Short": 2, "Char": 1, "Byte": 1,
          "Bool": 1}  # fmt: skip
_STORAGES = {f"torch.{name}Storage": size for name, size in _BYTES.items()}
_TABLE = "collections.OrderedDict"
_NAMES = {_TABLE, "torch._utils._rebuild_tensor_v2", "torch._utils._rebuild_parameter", *_STORAGES}
_STEPS = {
    "PROTO", "STOP", "NONE", "NEWTRUE", "NEWFALSE", "EMPTY_LIST", "EMPTY_DICT", "EMPTY_TUPLE", "MARK", "TUPLE",
    "TUPLE1", "TUPLE2", "TUPLE3", "APPEND", "APPENDS", "SETITEM", "SETITEMS", "BINPUT", "LONG_BINPUT", "BINGET",
    "LONG_BINGET",
}  # fmt: skip
_OLD = 5  # pickles at the head of files from before the zip: three numbers, the tensors, the keys of their storages
# A pickle names tensors and holds none, whatever the file's size: some 35 steps for each.
_LIMITS = limits_of(0)._replace(items=100_000)


def check_state_dict(path: str | os.PathLike[str]) -> None:
    """Raise where a file that torch saved holds more than tensors by name, or other bytes than its tensors have.

    Raises
    ------
    FileError
        There is no such file.
    FormatError
        It asks for anything else, which the message names, or is built to exhaust memory or time.
    DamagedFileError
        It is no file of torch's, truncated, or its parts do not fit.
    """
    path = check_readable(path)
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of odd escapes in Python 2's texts
        try:
            if file.read(4) == b"PK\x03\x04":
                _check_zip(file)
            else:
                file.seek(0)
                _check_old(file, os.path.getsize(path))
        except Refused as error:
            raise FormatError(
                f"{printable(path)} is not read: a state dict of tensors is expected, and nothing else: {error}"
            ) from error
        except (
            ValueError, LookupError, TypeError, OverflowError, struct.error, OSError, EOFError, zipfile.BadZipFile,
            NotImplementedError, RuntimeError,
        ) as error:  # fmt: skip
            raise DamagedFileError(
                f"{printable(path)} is not a state dict that torch saved, or is damaged: {error}; copy it again"
            ) from error


def _check_zip(file: IO[bytes]) -> None:
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        if any(one.compress_type != zipfile.ZIP_STORED for one in members):
            raise Refused("members of the archive are compressed, which torch's are not")
        sizes = {one.filename.partition("/")[2]: one.file_size for one in members}
        if len(sizes) < len(members):
            raise ValueError("members of the archive share a name")
        (program,) = (one for one in members if one.filename.partition("/")[2] == "data.pkl")
        with archive.open(program) as content:
            storages = _storages(_Bounded(content, program.file_size))
    for key, size in storages.items():
        if sizes.get(f"data/{key}") != size:
            raise ValueError(f"data/{key[:100]} has {sizes.get(f'data/{key}', 'no')} bytes; expected {size}")


def _check_old(file: IO[bytes], size: int) -> None:
    asked = 0
    for _ in range(_OLD):
        asked += sum(_storages(_Bounded(file, size)).values())
    if asked > size:
        raise ValueError(f"tensors of {asked} bytes in a file of {size}")


def _storages(file: _Bounded) -> dict[str, int]:
    """Bytes of the storages that a pickle names, by their keys; it is checked besides."""
    machine = _Torch()
    try:
        checked_content(machine.run(file), _LIMITS)
    except Refused as error:
        raise Refused(f"byte {machine.position}: {error}") from error
    return machine.storages


class _Name:
    """A global of the file: a name."""

    def __init__(self, name: str):
        if name not in _NAMES:
            raise Refused(f"it asks for {printable(name[:200])}")
        self.name = name


class _Torch(_Machine):
    """Runs the steps of a pickle of torch's; a tensor in it is None."""

    def __init__(self) -> None:
        super().__init__(_LIMITS)
        self.storages: dict[str, int] = {}

    def obey(self, step: str, argument: Any) -> None:
        """One step that is no constant, its `argument` taken from the file."""
        match step:
            case "GLOBAL":
                self.stack.append(_Name(argument.replace(" ", ".", 1)))
            case "REDUCE":
                arguments, function = _expected(self.stack.pop(), tuple), _expected(self.stack.pop(), _Name)
                if function.name in _STORAGES or (function.name == _TABLE and arguments):
                    raise Refused(f"it calls {function.name} with {len(arguments)} arguments")
                self.stack.append({} if function.name == _TABLE else None)
            case "BUILD":  # what torch says of the layers, beside the tensors
                _expected(self.stack.pop(), dict)
                _expected(self.stack[-1], dict)
            case "BINPERSID":
                kind, storage, key, _, count, *_ = _expected(self.stack.pop(), tuple)
                if kind != "storage" or _expected(storage, _Name).name not in _STORAGES:
                    raise Refused("it asks for something in another file")
                size = _STORAGES[storage.name] * _expected(count, int)
                if self.storages.setdefault(_expected(key, str), size) != size:
                    raise ValueError(f"storage {key[:100]} is told to have {size} bytes, and before another number")
                self.stack.append(None)
            case _ if step in _STEPS:
                super().obey(step, argument)
            case _:
                raise Refused(f"it has the step {step}")
