"""JSON with a checksum beside it, for what a later run believes: a changed digit is noticed."""

import hashlib
import json
import os
from typing import Any

from millisight.core._files import read_json, write_text


def sha256_of(text: str) -> str:
    """SHA-256 of a text, lone surrogates of file names included."""
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def sealed(text: str) -> str:
    """The file that `read_sealed` reads, for the JSON `text`."""
    return json.dumps({"sha256": sha256_of(text), "content": text})


def write_sealed(path: str | os.PathLike[str], content: Any) -> None:
    """Write what JSON can hold, and its checksum; the same content gives the same bytes.

    Raises
    ------
    FileError
    """
    write_text(path, sealed(json.dumps(content, sort_keys=True)))


def read_sealed(path: str | os.PathLike[str]) -> Any:
    """What `write_sealed` wrote.

    Raises
    ------
    ValueError, RecursionError
        It is no JSON, or was changed.
    TypeError
        It holds something else.
    OSError
        It cannot be read.
    """
    return unsealed(read_json(path))


def unsealed(held: Any) -> Any:
    """What `sealed` was given, of the JSON that it made.

    Raises
    ------
    ValueError, TypeError, RecursionError
        As `read_sealed`.
    """
    if not isinstance(held, dict) or not isinstance(text := held.get("content"), str):
        raise TypeError("it holds no content with a checksum")
    if held.get("sha256") != sha256_of(text):
        raise ValueError("its checksum is of another text")
    return json.loads(text)
