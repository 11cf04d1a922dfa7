"""Partial results of a run, a file each, so that the next run takes from there what is still true."""

import hashlib
import json
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from millisight.core import write_text


def cache_key(paths: Iterable[Path], **settings: Any) -> str:
    """Of what a result follows from: files, known by size and time; settings; and the version of this package."""
    stats = [path.stat() if path.exists() else None for path in paths]
    content = {
        "version": version("millisight"),
        "files": [(one.st_size, one.st_mtime_ns) if one else None for one in stats],
        **settings,
    }
    return _checksum(content)


def write_cached(path: Path, key: str, result: Any) -> None:
    """Write a result, and the key by which it is known to be still true."""
    write_text(path, json.dumps({"key": key, "checksum": _checksum(result), "result": result}, indent=1))


def read_cached(path: Path, key: str) -> Any:
    """The result of a file; None where there is none of this key, or the file is damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        result = content["result"]
        return result if (content["key"], content["checksum"]) == (key, _checksum(result)) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _checksum(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
