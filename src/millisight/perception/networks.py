"""Trained networks on disk: ONNX weights, and the JSON that describes them; run by ONNX Runtime, without torch."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from millisight.errors import DamagedFileError, FormatError
from millisight.files import check_readable, printable

_MOST_WEIGHTS = 1 << 26  # bytes
_MOST_DESCRIPTION = 1 << 24


def read_description(path: str | os.PathLike[str], *keys: str) -> dict[str, Any]:
    """What the JSON beside the weights tells of them: an object with the text `sha256`, and all of `keys`.

    Parameters
    ----------
    path : the JSON file
    keys : further entries that must be there; what they hold is the caller's to check

    Raises
    ------
    FileError
        It cannot be read.
    FormatError
        It is too large for a description.
    DamagedFileError
        It is no JSON object, an entry is missing, or `sha256` is no text.
    """
    path = _of_size(check_readable(path), _MOST_DESCRIPTION, "a description of weights")
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        for key in ("sha256", *keys):
            told[key]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DamagedFileError(
            f"{printable(path)} describes no weights: {error!r}; train anew, or reinstall"
        ) from error
    if not isinstance(told["sha256"], str):
        raise DamagedFileError(f"{printable(path)}: sha256 is {told['sha256']!r}; expected the weights' as text")
    return told


def open_network(path: str | os.PathLike[str], sha256: str, *, needed_by: str) -> Any:
    """The network of an ONNX file as an `onnxruntime.InferenceSession`, ready to run on the CPU.

    It is made from the bytes that were checked, so that a file which would have others read is refused.

    Parameters
    ----------
    path : the ONNX file
    sha256 : of its bytes, as its description has it
    needed_by : what wants to run it, for the message where ONNX Runtime is missing

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    FileError
        It cannot be read.
    FormatError
        It is too large, or no network that ONNX Runtime can run.
    DamagedFileError
        It is another file than the one described.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise ImportError(f'{needed_by} runs by ONNX Runtime: pip install "millisight[perception]"') from error
    path = _of_size(check_readable(path), _MOST_WEIGHTS, "weights")
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != sha256:
        raise DamagedFileError(
            f"{printable(path)} is not the file that {printable(path.stem)}.json describes: its SHA-256 differs; "
            "copy both anew"
        )
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of ONNX Runtime's own kinds, which have no common public base
        raise FormatError(f"{printable(path)} is no network that ONNX Runtime can run: {error}") from error


def _of_size(path: Path, most: int, what: str) -> Path:
    if path.stat().st_size > most:
        raise FormatError(f"{printable(path)} has {path.stat().st_size} bytes; expected {what}, under {most} bytes")
    return path
