"""Results that a run keeps, a file each, so that the next one takes from there what is still true."""

import hashlib
import json
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from millisight.files import write_text

T = TypeVar("T")


def key_of(paths: Iterable[Path], **settings: Any) -> str:
    """What a result follows from: files, known by size and time; settings; and the version of this package."""
    stats = [path.stat() if path.exists() else None for path in paths]
    content = {
        "version": version("millisight"),
        "files": [(one.st_size, one.st_mtime_ns) if one else None for one in stats],
        **settings,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def keep(place: Path, key: str, **result: Any) -> None:
    """Write a result, and the key by which it is known to be still true.

    Raises
    ------
    FileError
    """
    write_text(place, json.dumps({"key": key, **result}, indent=1))


def kept(place: Path, key: str, read: Callable[[dict[str, Any]], T]) -> T | None:
    """What `read` makes of a result that was kept; None where there is none of this key, or the file is damaged."""
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
        return read(content) if content["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def checksum_of(network: Any) -> str:
    """Of the weights of a classifier or a segmenter; "" where it has none."""
    return str(getattr(network, "description", {}).get("sha256", ""))
