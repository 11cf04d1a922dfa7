"""Trained networks on disk: ONNX weights, and the JSON that describes them; run by ONNX Runtime, without torch."""

import hashlib
import io
import json
import logging
import os
import re
import warnings
from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.core import atomic_path, check_readable, checked_path, printable, write_text
from millisight.core.errors import DamagedFileError, FileError, FormatError, UnknownNameError
from millisight.perception._onnx_nodes import operators

if TYPE_CHECKING:
    from torch import Tensor, nn

INPUT, OUTPUT = "channels", "logits"
"""Names in the ONNX files."""

_HDF5 = b"\x89HDF\r\n\x1a\n"  # how such a file begins
_MOST_WEIGHTS = 1 << 26  # bytes
_MOST_DESCRIPTION = 1 << 24
_MOST_DIGITS = 18  # of a whole number
_SECONDS = 10  # that a network may take, and one more for each that it is run on
_NUMBERS = re.compile(r"\[\s+-?[\d.]+(,\s+-?[\d.]+)*\s+\]")  # lists in a description
_LARGE = 1024  # weights of an array that is worth a step of its own
_MOST_MEMORY = 1 << 32  # bytes that the networks of a process take; the largest canvas takes a quarter


def read_description(path: str | os.PathLike[str], *keys: str) -> dict[str, Any]:
    """The description of weights, from the JSON beside them: an object with the text `sha256`, and all of `keys`.

    Parameters
    ----------
    path : the JSON file
    keys : further entries that must be there; the caller checks their values

    Raises
    ------
    FileError
        It is not there, or cannot be read.
    FormatError
        It is too large for a description.
    DamagedFileError
        It is no JSON object, an entry is missing, or `sha256` is no text.
    """
    path = checked_path(path)
    if not path.exists():
        weights = printable(path.with_suffix(".onnx").name)
        raise FileError(f"{printable(path)}: no such file; it describes {weights}, and must lie beside it")
    path = _of_size(check_readable(path), _MOST_DESCRIPTION, "a description of weights")
    try:
        held = json.loads(path.read_text(encoding="utf-8"), parse_int=_whole)
        for key in ("sha256", *keys):
            held[key]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DamagedFileError(
            f"{printable(path)} does not describe weights: {error!r}; train again, or reinstall"
        ) from error
    if not isinstance(held["sha256"], str):
        raise DamagedFileError(f"{printable(path)}: sha256 is {held['sha256']!r}; expected the weights' as text")
    return held


def check_weights(path: str | os.PathLike[str], torch_suffixes: Collection[str]) -> None:
    """Refuse a file that cannot hold weights, by its suffix or its first bytes, before a package is asked for.

    Parameters
    ----------
    torch_suffixes : of weights that torch saved; others are ONNX

    Raises
    ------
    UnknownNameError
        The suffix is not that of weights.
    FormatError
        It is an HDF5 file, as our images and masks are: torch's own never are, whatever their suffix.
    """
    path = checked_path(path)
    suffix = path.suffix.lower()
    if suffix not in (".onnx", *torch_suffixes):
        raise UnknownNameError("kind of weights", path.name, (".onnx", *torch_suffixes))
    if not path.is_file():
        return  # who reads it says so
    with open(check_readable(path), "rb") as file:
        start = file.read(len(_HDF5))
    if start == _HDF5:
        raise FormatError(
            f"{printable(path)} is an HDF5 file, such as an image or a mask, and holds no weights; expected .onnx, or "
            f"what torch saved ({', '.join(torch_suffixes)})"
        )


def weights_version(path: str | os.PathLike[str] | None) -> tuple[int, ...]:
    """What changes when weights, or their description, are written anew; nothing for the shipped ones, None."""
    if path is None:
        return ()
    files = (Path(path), Path(path).with_suffix(".json"))
    return tuple(n for one in files if one.exists() for n in _written(one))


def _written(path: Path) -> tuple[int, int, int]:
    found = os.stat(path)
    return found.st_ino, found.st_mtime_ns, found.st_size


def _whole(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def open_network(path: str | os.PathLike[str], sha256: str, *, needed_by: str, channels: int | None = None) -> Any:
    """The network of an ONNX file as an `onnxruntime.InferenceSession`, ready to run on the CPU.

    It is made from the bytes that were checked, so that a file which would have others read is refused. All networks
    of a process share 4 GiB: one that asks for more as it runs fails.

    Parameters
    ----------
    path : the ONNX file
    sha256 : of its bytes, as its description has it
    needed_by : name of what runs it, for messages
    channels : it must take one float32 array (n, channels, ...) and return one; None: not checked

    Raises
    ------
    ImportError
        ONNX Runtime is not installed.
    FileError
        It cannot be read.
    FormatError
        It is too large, no network that ONNX Runtime can run, has loops or branches, or takes something else.
    DamagedFileError
        It is another file than the one described.
    """
    try:
        onnxruntime = _onnx_runtime()
    except ImportError as error:
        raise ImportError(f'{needed_by} runs by ONNX Runtime: pip install "millisight[perception]"') from error
    path = _of_size(check_readable(path), _MOST_WEIGHTS, "weights")
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != sha256:
        raise DamagedFileError(
            f"{printable(path)} is not the file that {printable(path.stem)}.json describes: its SHA-256 differs; copy "
            "both again"
        )
    try:
        refused = sorted(f"{domain}.{name}".strip(".") for domain, name in operators(content) if _may_not(domain, name))
    except ValueError as error:
        raise FormatError(f"{printable(path)} is not a network that ONNX Runtime can run: {error}") from error
    if refused:
        raise FormatError(
            f"{printable(path)} has the operators {printable(', '.join(refused))[:200]}; expected those of ONNX "
            "without loops and branches: a network that may never end is not run"
        )
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    # Threads that wait by spinning take the cores from the next network's.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    _bound_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    try:
        # Without folding of constants, which may take any time and ends for nobody.
        session = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"], disabled_optimizers=["ConstantFolding"]
        )
        # Names that are not UTF-8 are found here, of outputs too.
        inputs, _ = (_listed(some) for some in (session.get_inputs(), session.get_outputs()))
    except Exception as error:
        if not _of_onnx_runtime(error):
            raise  # by a handler of signals, for one
        raise FormatError(f"{printable(path)} is not a network that ONNX Runtime can run: {error}") from error
    if channels is not None and not _takes(session, channels):
        raise FormatError(
            f"{printable(path)} takes {printable(inputs)[:200]}; expected one float32 array with {channels} channels, "
            f"which becomes one other; it is not a network for {needed_by}"
        )
    return session


def run_network(session: Any, channels: np.ndarray) -> np.ndarray:
    """What a network of `open_network` makes of (n, channels, ...): an array of at least two axes, the first of n.

    Raises
    ------
    FormatError
        It fails at that, takes too long, or makes something else.
    """
    options = _onnx_runtime().RunOptions()
    seconds = _SECONDS + len(channels)
    # In a thread of its own it ends, between two operators, when time is over or the user does not wait.
    with ThreadPoolExecutor(1) as pool:
        used = process_time()
        running = pool.submit(session.run, None, {session.get_inputs()[0].name: channels}, options)
        try:
            wait([running], seconds)
            # On a busy or a sleeping machine the clock goes on without the network.
            while not running.done() and process_time() - used < seconds:
                wait([running], 1)
        finally:
            options.terminate = late = not running.done()
    if late:
        raise FormatError(f"the network takes over {seconds} s for {channels.shape}; train a smaller one")
    if (error := running.exception()) is not None:  # of ONNX Runtime's own kinds
        raise FormatError(f"the network fails on {channels.shape}: {_one_line(error)}; train it again") from error
    (made,) = running.result()
    if not isinstance(made, np.ndarray) or made.ndim < 2 or len(made) != len(channels):
        shape = np.shape(made)
        raise FormatError(f"the network makes {shape} of {channels.shape}; expected as many; train it again")
    return made


def _onnx_runtime() -> Any:
    """The module, its telemetry off unless ORT_DISABLE_TELEMETRY is set otherwise.

    Version 1.32 writes a number of this machine and what runs here into the user's folder, and sends both to its maker.
    """
    off = os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1") == "1"
    import onnxruntime

    if off:
        onnxruntime.disable_telemetry_events()  # where another package has imported it before
    return onnxruntime


@cache
def _bound_memory() -> None:
    """Bound what networks may take: 170 bytes can ask for 6 GB, and a few operators more for any amount."""
    ort = _onnx_runtime()
    memory = ort.OrtMemoryInfo("Cpu", ort.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, ort.OrtMemType.DEFAULT)
    with suppress(Exception):  # the process has such a bound already, and only one can be set
        ort.create_and_register_allocator(memory, ort.OrtArenaCfg(_MOST_MEMORY, -1, -1, -1))


def _of_onnx_runtime(error: Exception) -> bool:
    """Whether it is of ONNX Runtime's own kinds, which have no common public base, or one that it passes on."""
    return type(error).__module__.startswith("onnxruntime") or isinstance(error, RuntimeError | ValueError | TypeError)


def _listed(some: Any) -> str:
    """Inputs or outputs of a session, as text."""
    return ", ".join(f"{one.name} {one.type} {one.shape}" for one in some)


def _one_line(error: BaseException) -> str:
    return printable(" ".join(str(error).split())[:200])


def _may_not(domain: str, operator: str) -> bool:
    """Whether an operator is none of ONNX's own, or decides at run time how long it takes."""
    return domain not in ("", "ai.onnx") or operator in ("If", "Loop", "Scan", "SequenceMap")


def _takes(session: Any, channels: int) -> bool:
    """Whether it makes one array of one float32 array (n, channels, ...)."""
    taken, given = session.get_inputs(), session.get_outputs()
    if len(taken) != 1 or len(given) != 1 or taken[0].type != "tensor(float)" or len(taken[0].shape) < 2:
        return False
    return not isinstance(taken[0].shape[1], int) or taken[0].shape[1] == channels


def _of_size(path: Path, most: int, what: str) -> Path:
    if path.stat().st_size > most:
        raise FormatError(f"{printable(path)} has {path.stat().st_size} bytes; expected {what}, under {most} bytes")
    return path


def write_network(
    folder: Path,
    stem: str,
    network: "nn.Module",
    example: "Tensor",
    description: Mapping[str, Any],
    *,
    free: Mapping[int, str] | None = None,
    free_out: Mapping[int, str] | None = None,
) -> Path:
    """Write a network as ONNX and as safetensors, and beside them the description with the ONNX file's SHA-256.

    Parameters
    ----------
    folder : that is there
    stem : of the files' names
    network : of one input and one output
    example : of an input
    free, free_out : names of the axes of input and output that may be of any length; the first always may

    Returns
    -------
    Path of the ONNX file
    """  # fmt: skip
    from safetensors.torch import save_file

    path = folder / f"{stem}.onnx"
    content = _onnx_bytes(network, example, {INPUT: {0: "n", **(free or {})}, OUTPUT: {0: "n", **(free_out or {})}})
    with atomic_path(path.with_suffix(".safetensors")) as temporary:
        save_file({name: value.contiguous() for name, value in network.state_dict().items()}, temporary)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)
    full = {"sha256": hashlib.sha256(content).hexdigest(), **description}
    write_text(path.with_suffix(".json"), _NUMBERS.sub(_on_one_line, json.dumps(full, indent=1)) + "\n")
    return path


def _on_one_line(numbers: re.Match[str]) -> str:
    return re.sub(r"\s+", " ", numbers[0]).replace("[ ", "[").replace(" ]", "]")


def _onnx_bytes(network: "nn.Module", example: "Tensor", axes: Mapping[str, Mapping[int, str]]) -> bytes:
    import torch

    target: Any = io.BytesIO()
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    network.eval()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch's own, about its own ways of exporting
            torch.onnx.export(
                network, (example,), target, input_names=[INPUT], output_names=[OUTPUT], opset_version=18,
                dynamo=False, dynamic_axes=axes,
            )  # fmt: skip
    finally:
        logger.setLevel(level)
    return _with_half_weights(target.getvalue())


def round_weights(network: "nn.Module") -> None:
    """Round large arrays of weights to float16, which halves the network's ONNX file; they stay float32.

    Arrays with a weight beyond float16's range are left alone.
    """
    import torch

    with torch.no_grad():
        for weights in network.parameters():
            half = weights.half()
            if weights.numel() >= _LARGE and half.isfinite().all():
                weights.copy_(half)


def _with_half_weights(content: bytes) -> bytes:
    """The network with the arrays that float16 holds exactly as such, of which it makes float32 as it runs."""
    import onnx

    model = onnx.load_model_from_string(content)
    casts = []
    for tensor in [one for one in model.graph.initializer if one.data_type == onnx.TensorProto.FLOAT]:
        weights = onnx.numpy_helper.to_array(tensor)
        with np.errstate(over="ignore"):
            half = weights.astype(np.float16)
        if weights.size < _LARGE or not np.array_equal(half, weights):
            continue
        name = f"{tensor.name}.half"
        model.graph.initializer.remove(tensor)
        model.graph.initializer.append(onnx.numpy_helper.from_array(half, name))
        casts.append(onnx.helper.make_node("Cast", [name], [tensor.name], to=onnx.TensorProto.FLOAT))
    for cast in reversed(casts):
        model.graph.node.insert(0, cast)
    return model.SerializeToString()
