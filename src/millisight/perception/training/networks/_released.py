"""The paper's network as released, in torch, and its weights, of which nothing is run."""

import hashlib
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from millisight.core import printable
from millisight.core.errors import DamagedFileError, FormatError
from millisight.io.arrays import check_state_dict

_WIDTHS = (16, 128, 256, 512, 512)
_STRIDES = (2, 2, 2, 2, 1)
_CONNECTED = (1024, 512, 256)
_LEFT = 11  # pixels along each side that the convolutions leave of 224
_LARGEST = 1 << 30  # bytes


class ReleasedNetwork(nn.Module):
    """Five convolutions of 3 x 3 without padding and four connected layers, ReLU between: the paper's, as released.

    With four classes and one channel it has 67 950 884 weights.

    Parameters
    ----------
    classes : number of classes
    channels : 1, the masked image; 2, the mask besides
    """

    sha256: str = ""

    def __init__(self, classes: int, channels: int = 1):
        super().__init__()
        for i, (a, b, stride) in enumerate(zip((channels, *_WIDTHS), _WIDTHS, _STRIDES, strict=False), 1):
            self.add_module(f"conv{i}", nn.Conv2d(a, b, 3, stride))
        sizes = (_WIDTHS[-1] * _LEFT**2, *_CONNECTED, classes)
        for i, (a, b) in enumerate(pairwise(sizes), 1):
            self.add_module(f"fc{i}", nn.Linear(a, b))

    def forward(self, x: Tensor) -> Tensor:
        """(N, classes) logarithms of probabilities of input (N, channels, 224, 224)."""
        for i in range(1, len(_WIDTHS) + 1):
            x = functional.relu(self.get_submodule(f"conv{i}")(x))
        x = x.flatten(1)
        for i in range(1, len(_CONNECTED) + 1):
            x = functional.relu(self.get_submodule(f"fc{i}")(x))
        return functional.log_softmax(self.get_submodule(f"fc{len(_CONNECTED) + 1}")(x), dim=1)

    def probabilities(self, values: np.ndarray) -> np.ndarray:
        """(classes,) float64 of one input (1, 224, 224)."""
        with torch.inference_mode():
            shares = self(torch.from_numpy(values[None])).double().exp()[0].numpy()
        return shares / shares.sum()


def read_released(path: Path, classes: int) -> ReleasedNetwork:
    """The network with the weights of a torch state dict, which is read without running anything.

    Raises
    ------
    FormatError
        It asks for more than tensors, is too large, or its tensors are not this network's.
    DamagedFileError
        It is no file of torch's, or truncated.
    """
    name = printable(path)
    if path.stat().st_size > _LARGEST:
        raise FormatError(f"{name} has {path.stat().st_size} bytes; expected weights, under {_LARGEST} bytes")
    check_state_dict(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch's own, about pickles that it then refuses
            held = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch's reader takes what it finds, and fails in whatever way that does not fit
        reason = (str(error).splitlines() or ["it ends too early"])[0]
        raise DamagedFileError(
            f"{name} is not a state dict that torch saved, or is damaged: {printable(reason[:200])}"
        ) from error
    network = ReleasedNetwork(classes)
    expected = {key: tuple(value.shape) for key, value in network.state_dict().items()}
    tensors = held if isinstance(held, dict) else {}
    found = {str(key): tuple(value.shape) for key, value in tensors.items() if isinstance(value, Tensor)}
    if found != expected:
        wrong = next(
            iter([*(set(expected) - set(found)), *(k for k in found if found[k] != expected.get(k))]), "nothing"
        )
        raise FormatError(
            f"{name} holds other tensors than the released network of {classes} classes and one channel: {wrong} is "
            f"{found.get(wrong, 'missing')}, expected {expected.get(wrong, 'no such tensor')}"
        )
    network.load_state_dict(tensors)
    network.eval()
    with open(path, "rb") as file:
        network.sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return network
