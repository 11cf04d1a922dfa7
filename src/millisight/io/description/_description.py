"""Captures of any radar from a description in TOML: which files, and what their axes, units, sign and positions are.

`read` takes the description, a folder with one, or a file of arrays that one of the shipped descriptions
knows. The keys are explained, with examples, in docs/how-to/your-own-scanner.md.
"""

import os
import tomllib
from collections.abc import Callable, Iterator
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from millisight.core import check_readable, checked_path, printable
from millisight.core.errors import FileError, FormatError, InputError
from millisight.data import Radar, RawCapture, RawScan
from millisight.io.arrays import array_shapes, small_files_kept
from millisight.io.description._content import Description
from millisight.io.description._tables import Files, parse

_SHIPPED = files("millisight.io.description") / "examples"


def read_scan(path: str | os.PathLike[str], *, data: str | os.PathLike[str] | None = None) -> RawScan:
    """The frames by the radar's clock and the robot's log by its own, where a description names such a log.

    Raises
    ------
    FileError, UnknownNameError
        As `read`.
    InputError
        The description names no log.
    """
    content = read(path, data=data)
    if not isinstance(content, RawScan):
        raise InputError(f"{printable(path)} names no robot log under [positions]; use read_capture")
    return content


def read_frames(
    path: str | os.PathLike[str], *, data: str | os.PathLike[str] | None = None
) -> tuple[Radar, np.ndarray]:
    """The radar and its frames (F, T, R, N) as recorded, but for the phase sign, which is ours; no positions needed.

    Raises
    ------
    FileError, UnknownNameError
        As `read`.
    """
    with small_files_kept():
        description = _opened(path, data)
        frames = description.frames()
        return description.radar(frames.shape), frames


def read(
    path: str | os.PathLike[str],
    *,
    data: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RawCapture | RawScan:
    """What a description leads to: a scan where it names a robot's log, a capture otherwise, both to be calibrated.

    Parameters and errors as of `millisight.read_capture`, which calibrates it.
    """
    with small_files_kept():
        description = _opened(path, data)
        log = description.log
        return description.capture(progress) if log is None else description.scan(log, progress)


def description_in(folder: str | os.PathLike[str]) -> Path | None:
    """The description in a folder, a .toml file with a table [frames]; None: there is none.

    Raises
    ------
    FileError
        There are several, or the folder cannot be read.
    """
    folder = checked_path(folder)
    try:
        found = [path for path in sorted(folder.iterdir()) if path.suffix == ".toml" and _may_describe(path)]
    except OSError as error:
        raise FileError(f"cannot read the folder {printable(folder)}: {error.strerror}") from error
    if len(found) > 1:
        names = ", ".join(printable(path.name) for path in found)
        raise FileError(f"{printable(folder)} holds several descriptions, {names}; pass one of them")
    return found[0] if found else None


def files_named(path: str | os.PathLike[str], data: str | os.PathLike[str] | None = None) -> list[Path]:
    """Files that any text of a TOML file may mean, by name or by pattern, in the folder `data` or beside the file.

    Nothing of them is read. A file that is no TOML names none.
    """
    path = checked_path(path)
    try:
        texts = set(_texts(parse(path)))
    except FileError:
        return []
    folders = [path.parent] if data is None else [path.parent, checked_path(data)]
    named: set[Path] = set()
    for folder, text in product(folders, texts):
        try:
            named.update([folder / text] if (folder / text).is_file() else Files(folder / path.name, None).many(text))
        except (FileError, OSError, ValueError):
            continue  # a text that means no file
    return sorted(named)


def _texts(value: Any) -> Iterator[str]:
    """All texts within the tables and lists of a TOML file."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def _may_describe(path: Path) -> bool:
    try:
        return "frames" in parse(path)
    except FileError:
        return True  # so that its error is told


def _opened(path: str | os.PathLike[str], data: str | os.PathLike[str] | None) -> Description:
    """The description that a path leads to."""
    path = checked_path(path)
    folder = None if data is None else checked_path(data)
    if folder is not None and not folder.is_dir():
        raise FileError(
            f"{printable(folder)} is not a folder; expected the folder of the files named in the description"
        )
    if path.is_dir():
        found = description_in(path)
        if found is None:
            raise FileError(f"{printable(path)} holds no description, a .toml file with a table [frames]")
        path = found
    path = check_readable(path)
    if path.suffix.lower() == ".toml":
        return Description(parse(path), Files(path, folder), path)
    return _shipped(path)


def _shipped(path: Path) -> Description:
    """The shipped description whose [match] fits the arrays of a file."""
    shapes = array_shapes(path)
    for entry in sorted(_SHIPPED.iterdir(), key=lambda entry: entry.name):
        content = tomllib.loads(entry.read_text(encoding="utf-8"))
        if _fits(shapes, content.pop("match")["arrays"]):
            return Description(content, Files(path, None, path), Path(entry.name))
    there = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
    raise FormatError(
        f"{printable(path)} holds the arrays {there}, which no shipped description covers; write a description in "
        "TOML: see docs/how-to/your-own-scanner.md"
    )


def _fits(shapes: dict[str, tuple[int, ...]], pattern: dict[str, list[int | str]]) -> bool:
    """Whether the arrays of a pattern are there in its shapes; equal texts in it stand for equal lengths."""
    lengths: dict[str, int] = {}
    for name, wanted in pattern.items():
        shape = shapes.get(name, ())
        if len(shape) != len(wanted):
            return False
        if any(
            n != (w if isinstance(w, int) else lengths.setdefault(w, n)) for n, w in zip(shape, wanted, strict=True)
        ):
            return False
    return True
