"""The training loop: one seed gives the same weights, whether the run was interrupted or not.

Whatever an epoch draws at random follows from the seed and the epoch's number, so that the state between two epochs is
the weights, the optimiser's moments and the scores so far. They are written as one file after every epoch, atomically
and as safetensors: nothing that such a file holds can run code.
"""

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import numpy as np

from millisight.core import (
    atomic_path,
    check_device,
    checked_integer,
    checked_number,
    make_folder,
    printable,
    put,
    record,
)
from millisight.core.errors import DamagedFileError, DeviceError, InputError

if TYPE_CHECKING:
    from torch import Tensor, nn

T = TypeVar("T")

CHECKPOINT_NAME = "checkpoint.safetensors"

_STATE, _CHECKSUM = "state", "sha256"
_WARM = 0.3  # of the learning rate, in the first epoch


@record
class Schedule:
    """How long and how fast a network learns.

    Attributes
    ----------
    epochs : at most
    patience : epochs without a better score after which it stops
    learning_rate : of AdamW in the second epoch; it falls to 0 along a cosine
    weight_decay : of AdamW
    seed : of the first weights, of dropout, and of the batches as far as they use it
    """

    epochs: int = 40
    patience: int = 12
    learning_rate: float = 2e-3
    weight_decay: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        put(
            self,
            epochs=checked_integer(self.epochs, name="epochs"),
            patience=checked_integer(self.patience, name="patience"),
            learning_rate=checked_number(self.learning_rate, name="learning_rate", above=0),
            weight_decay=checked_number(self.weight_decay, name="weight_decay", minimum=0),
            seed=checked_integer(self.seed, name="seed", minimum=0),
        )

    def rate(self, epoch: int) -> float:
        """The learning rate of an epoch, from 0 on."""
        warmed = _WARM if epoch == 0 and self.epochs > 1 else 1.0
        return self.learning_rate * warmed * (1 + math.cos(math.pi * epoch / self.epochs)) / 2


class Fitted(NamedTuple):
    """What came of training."""

    epochs: int  # how many were done
    best_epoch: int  # the one whose weights the network has now, from 0 on
    history: tuple[Mapping[str, float], ...]  # of each epoch: "loss", "score", "learning_rate"


@contextmanager
def one_thread() -> Iterator[None]:
    """BLAS and torch on one thread: with more, they split sums otherwise, and weights would be each machine's own."""
    import torch
    from threadpoolctl import threadpool_limits

    threads = torch.get_num_threads()
    with threadpool_limits(1):
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def run(network: "nn.Module", channels: np.ndarray) -> "Tensor":
    """The network's output for channels (N, C, ...), on its device."""
    import torch

    return network(torch.from_numpy(channels).to(next(network.parameters()).device))


def check_installed() -> None:
    """Raise ImportError where what training needs is missing; the message says how to install it."""
    missing = [name for name in ("torch", "safetensors", "onnx", "onnxscript", "threadpoolctl") if not find_spec(name)]
    if missing:
        raise ImportError(f'training needs {" and ".join(missing)}: pip install "millisight[train]"')


class Lesson(Protocol):
    """What a network learns: examples in batches, a loss, a score on scenes that are held back; and what it became.

    Everything drawn at random must follow from the recipe's seed and, in `batches`, from the epoch's number, so that a
    run that was interrupted goes on as if it had not been.

    Attributes
    ----------
    input_shape : (C, ...) of one example
    free_axes, free_output_axes : names of the axes of the network's input and output that may be of any length, by
        their number; axis 0, the example, always may
    """

    input_shape: tuple[int, ...]
    free_axes: Mapping[int, str]
    free_output_axes: Mapping[int, str]

    def network(self) -> "nn.Module":
        """A new network, its weights from torch's generator."""
        ...

    def batches(self, epoch: int) -> "Iterable[tuple[Tensor, ...]]":
        """The batches of an epoch, counted from 0: tensors on the CPU, whose first axis is the example."""
        ...

    def loss(self, network: "nn.Module", batch: "tuple[Tensor, ...]") -> "Tensor":
        """The loss () of a batch on the network's device, which is in training mode."""
        ...

    def score(self, network: "nn.Module") -> float:
        """How good the network is, higher for better, without gradients: on held-back simulations, never on a test."""
        ...

    def describe(self, network: "nn.Module") -> dict[str, Any]:
        """What the weights' description says of the trained network, as JSON holds it; without gradients."""
        ...


def fit(
    lesson: Lesson,
    *,
    schedule: Schedule,
    folder: str | os.PathLike[str],
    made_of: Mapping[str, Any],
    device: str = "cpu",
    tensorboard: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> "tuple[nn.Module, Fitted]":
    """The network with the weights of the best epoch, on the CPU, and how it got there; see `train`.

    Parameters
    ----------
    made_of : all that the batches follow from, as JSON holds it: a checkpoint of something else is refused

    Raises
    ------
    InputError
        The folder holds a run of another recipe, or the loss or the score is not finite.
    DamagedFileError, FileError, DeviceError
    ImportError
        torch, or for `tensorboard` its package, is not installed.
    """
    import torch

    check_torch_device(device)
    path, digest = make_folder(folder) / CHECKPOINT_NAME, _digest(made_of, schedule)
    history: list[dict[str, float]] = []
    with _logging(Path(folder) / "tensorboard" if tensorboard else None) as log, repeatable(device):
        torch.manual_seed(schedule.seed)
        network = lesson.network().to(device)
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=schedule.weight_decay)
        best = _copied(network)
        if path.exists():
            history, best = _restore(path, digest, network, optimizer)
        for epoch in range(len(history), schedule.epochs):
            if epoch - _best_epoch(history) > schedule.patience:
                break
            torch.manual_seed(schedule.seed + 1 + epoch)
            rate = schedule.rate(epoch)
            mean_loss = _epoch(network, optimizer, rate, lesson.batches(epoch), lesson.loss, device)
            history.append({"loss": mean_loss, "learning_rate": rate, "score": _scored(network, lesson.score)})
            if _best_epoch(history) == epoch:
                best = _copied(network)
            _save(path, digest, network, best, optimizer, history)
            log(epoch, history[-1])
            if progress is not None:
                progress(epoch + 1, schedule.epochs)
    network.load_state_dict(best)
    network.cpu().eval()
    return network, Fitted(len(history), _best_epoch(history), tuple(history))


def check_torch_device(device: str) -> None:
    """Refuse a device that torch cannot train on; `DeviceError`."""
    import torch

    check_device(device)
    if device == "cuda" and not torch.cuda.is_available():
        raise DeviceError("torch finds no GPU; install a build for CUDA, or train on the CPU")


@contextmanager
def repeatable(device: str) -> Iterator[None]:
    """What torch draws and computes follows from its seed; its state outside is left as it was."""
    import torch

    before = torch.are_deterministic_algorithms_enabled()
    with torch.random.fork_rng():
        torch.use_deterministic_algorithms(device == "cpu")  # on a GPU some steps have no such algorithm
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(before)


@contextmanager
def _logging(folder: Path | None) -> Iterator[Callable[[int, Mapping[str, float]], None]]:
    """What takes the figures of an epoch to TensorBoard, or nowhere."""
    if folder is None:
        yield lambda epoch, figures: None
        return
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ImportError('logging needs TensorBoard: pip install "millisight[tensorboard]"') from error
    writer = SummaryWriter(folder)

    def log(epoch: int, figures: Mapping[str, float]) -> None:
        for name, value in figures.items():
            writer.add_scalar(name, value, epoch)

    try:
        yield log
    finally:
        writer.close()


def _scored(network: "nn.Module", score: "Callable[[nn.Module], float]") -> float:
    import torch

    network.eval()
    with torch.no_grad():
        value = float(score(network))
    if not math.isfinite(value):
        raise InputError(f"the score on validation is {value}; expected a finite number, higher for better")
    return value


def _epoch(network, optimizer, rate: float, batches, loss, device: str) -> float:
    """One pass over the batches at a learning rate; the mean loss."""
    network.train()
    for group in optimizer.param_groups:
        group["lr"] = rate
    losses = []
    for batch in batches:
        value = loss(network, tuple(tensor.to(device) for tensor in batch))
        losses.append(float(value.detach()))
        if not math.isfinite(losses[-1]):
            raise InputError(f"the loss is {losses[-1]} in batch {len(losses)}; lower the learning rate")
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
    if not losses:
        raise InputError("an epoch has no batches; expected at least one")
    return math.fsum(losses) / len(losses)


def _best_epoch(history: list[dict[str, float]]) -> int:
    """The first epoch of the highest score; 0 where there is none yet."""
    return max(range(len(history)), key=lambda i: (history[i]["score"], -i), default=0)


def _copied(network: "nn.Module") -> "dict[str, Tensor]":
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


def _digest(made_of: Mapping[str, Any], schedule: Schedule) -> str:
    """Of all that a run follows from."""
    origin = {"made_of": dict(made_of), "schedule": dataclasses.asdict(schedule)}
    return hashlib.sha256(json.dumps(origin, sort_keys=True).encode()).hexdigest()


def _save(path: Path, digest: str, network, best, optimizer, history) -> None:
    tensors = optimizer_tensors(network, optimizer) | {f"best/{name}": value for name, value in best.items()}
    write_checkpoint(path, tensors, {"made_of": digest, "history": history})


def optimizer_tensors(network, optimizer) -> "dict[str, Tensor]":
    """The weights and the optimiser's moments by name, as a checkpoint holds them."""
    tensors = {f"network/{name}": value for name, value in network.state_dict().items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{name}": value for name, value in moments.items()}
    return tensors


def write_checkpoint(path: Path, tensors: "Mapping[str, Tensor]", state: Mapping[str, Any]) -> None:
    """Tensors by name, and what JSON holds, as safetensors."""
    from safetensors.torch import save_file

    plain = {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}
    # One entry, since safetensors write several in any order.
    told = json.dumps({**state, _CHECKSUM: _checksum(plain, state)})
    with atomic_path(path) as temporary:
        save_file(plain, temporary, metadata={_STATE: told})


def _checksum(tensors: "Mapping[str, Tensor]", state: Mapping[str, Any]) -> str:
    """SHA-256 of all that a checkpoint holds; safetensors have none."""
    from safetensors.torch import save

    return hashlib.sha256(save(dict(tensors)) + json.dumps(state).encode()).hexdigest()


def read_checkpoint(
    path: Path, digest: str, network, optimizer, taken: "Callable[[dict[str, Tensor], dict[str, Any]], T]"
) -> "T":
    """Set the network and the optimiser as they were; what `taken` makes of all tensors and the rest.

    Raises
    ------
    InputError
        It is of another run: its state's "made_of" is not `digest`.
    DamagedFileError
    """
    from safetensors import SafetensorError, safe_open

    name = printable(path)
    try:
        with safe_open(path, framework="pt") as file:
            names = list(file.keys())
            state = json.loads((file.metadata() or {})[_STATE])
            if state["made_of"] != digest:
                raise InputError(
                    f"{name} belongs to another recipe or schedule; choose another folder, or delete it to start again"
                )
            tensors = {key: file.get_tensor(key) for key in names}
        if state.pop(_CHECKSUM) != _checksum(tensors, state):
            raise ValueError("its checksum differs")
        found = taken(tensors, state)
        network.load_state_dict(_part(tensors, "network/"))
        moments: dict[int, dict[str, Any]] = {}
        for key, value in _part(tensors, "optimizer/").items():
            index, _, moment = key.partition("/")
            moments.setdefault(int(index), {})[moment] = value
        groups = optimizer.state_dict()["param_groups"]
        optimizer.load_state_dict({"state": moments, "param_groups": groups})
    except (SafetensorError, RuntimeError, KeyError, TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise DamagedFileError(f"{name} is not a complete checkpoint: {error}; delete it to start again") from error
    return found


def _restore(path: Path, digest: str, network, optimizer) -> "tuple[list[dict[str, float]], dict[str, Tensor]]":
    """The history and the best weights so far; the network and the optimiser are set as they were."""

    def taken(
        tensors: "dict[str, Tensor]", state: dict[str, Any]
    ) -> "tuple[list[dict[str, float]], dict[str, Tensor]]":
        history = [{key: float(entry[key]) for key in ("loss", "learning_rate", "score")} for entry in state["history"]]
        best = _part(tensors, "best/")
        if not history or best.keys() != network.state_dict().keys():
            raise KeyError("best")
        if not all(math.isfinite(entry["score"]) for entry in history):
            raise ValueError("a score is not finite")
        return history, best

    return read_checkpoint(path, digest, network, optimizer, taken)


def _part(tensors: "Mapping[str, Tensor]", prefix: str) -> "dict[str, Tensor]":
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}
