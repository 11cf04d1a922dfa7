"""What a command is to write, checked before its work."""

import os
from collections.abc import Iterable, Iterator
from itertools import combinations
from pathlib import Path

from millisight.cli.console import claims, files_given, written_before
from millisight.cli.sources import files_read
from millisight.core import (
    FIGURE_SUFFIXES,
    RECORD_SUFFIXES,
    check_record_suffix,
    check_writable,
    claimed,
    make_folder,
    printable,
    same_file,
)
from millisight.core.errors import InputError, UnknownNameError

_OF_FILES = (*RECORD_SUFFIXES, *FIGURE_SUFFIXES, ".json", ".txt", ".csv", ".npy", ".npz", ".ply", ".jpg", ".mat", ".nc")


class _Folder(type(Path())):  # ty: ignore[unsupported-base]
    """A path that was typed with a slash at its end, which Path drops."""


def output_path(text: str) -> Path:
    """The path of an option for outputs.

    Raises
    ------
    InputError
        It is empty.
    """
    if not text:
        raise InputError("an output has no name; expected that of a file or of a folder")
    return _Folder(text) if text.endswith((os.sep, "/")) else Path(text)


def is_folder(output: Path | None) -> bool:
    """Whether an output is a folder that is there, or was typed as one."""
    return output is not None and (isinstance(output, _Folder) or output.is_dir())


def of_folder(output: Path | None) -> Path | None:
    """What is made of a folder: an output without a suffix is a folder, too, whether one file comes of it or many."""
    return output if output is None or output.suffix or output.is_file() else _Folder(output)


def named(output: Path | None, name: str) -> Path | None:
    """The output; where it is a folder, the file of that name in it. The folder is made."""
    return output if output is None or not is_folder(output) else make_folder(output) / name


def folders_of_many(*outputs: Path | None, count: int) -> tuple[Path | None, ...]:
    """The folders for the outputs of many inputs, made where none has a file's name; None where none is named.

    Raises
    ------
    InputError
        It has the name of a file.
    FileError
        It cannot be made.
    """
    for output in outputs:
        if output is not None and output.suffix.lower() in _OF_FILES and not is_folder(output):
            raise InputError(
                f"{printable(output)} is the name of one file, and {count} are to be written; pass a folder, such as "
                f"{printable(output.with_suffix(''))}{os.sep}"
            )
    return tuple(None if output is None else make_folder(output) for output in outputs)


def check_outputs(
    *paths: Path | None,
    records: tuple[Path | None, ...] = (),
    figures: tuple[Path | None, ...] = (),
    source: Path | None = None,
    others: Iterable[str | Path | None] = (),
    data: Path | None = None,
) -> None:
    """Check before the work that its outputs can be written.

    Refused are: files among the command's arguments, and what is read with them; the `source` and `others` that are
    read besides; one file twice, also for a source before; a missing folder, an unknown format of figures or records,
    and what another run is to write. `data` is the folder of the files that a description names, where they do not lie
    beside it.

    Raises
    ------
    FileError, InputError, UnknownNameError
    """
    outputs = [path for path in (*records, *paths, *figures) if path is not None]
    there = {_identity(path): path for path in outputs if path.exists()}
    for what, read in _inputs(source, others, data) if there else ():
        if read.exists() and (path := there.get(_identity(read))) is not None:
            raise InputError(f"{path} is {what} and would be overwritten; choose another name for the output")
    for path in records:
        if path is not None:
            check_record_suffix(path)
    for one, other in combinations(outputs, 2):
        if same_file(one, other):
            raise InputError(f"{one} is given for two outputs; choose two names")
    for path in outputs:
        if written_before(path):
            raise InputError(f"{path} was written by this command already; choose other names or folders")
    claims().close()  # of the source before, where a command has many
    for path in outputs:
        check_writable(path)
        claims().enter_context(claimed(path))
    for figure in figures:
        if figure is not None and figure.suffix.lower() not in FIGURE_SUFFIXES:
            raise UnknownNameError("figure format", figure.suffix or figure.name, FIGURE_SUFFIXES)


def _identity(path: Path) -> tuple[int, int]:
    """What is the same for all names of a file."""
    found = path.stat()
    return found.st_dev, found.st_ino


def _inputs(source: Path | None, others: Iterable[str | Path | None], data: Path | None) -> Iterator[tuple[str, Path]]:
    """What the files are that are read, and where they lie; some may not be there."""
    if source is not None:
        yield "the input", source
        if source.exists():
            yield from ((f"read with {source}", path) for path in files_read(source, data))
    yield from (("an input, too,", Path(path)) for path in others if path is not None)
    yield from files_given(lambda given: files_read(given, data))
