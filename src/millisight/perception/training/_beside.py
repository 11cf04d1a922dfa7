"""Classifiers that are trained already, beside which another one learns: their weights, and what they saw."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from millisight.core import check_readable, checked_path, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError, UnknownNameError
from millisight.perception import read_description
from millisight.perception.classification import CLASSIFIER_CHANNELS

if TYPE_CHECKING:
    from torch import nn

_SUFFIX = ".safetensors"


class Beside(NamedTuple):
    """A trained classifier.

    Attributes
    ----------
    path : the file `.safetensors`, as `train` writes it
    description : of the `.json` beside it
    """

    path: Path
    description: Mapping[str, Any]

    def load_into(self, network: "nn.Module") -> "nn.Module":
        """The network with these weights.

        Raises
        ------
        DamagedFileError
        FormatError
            The network has others.
        """
        from safetensors import SafetensorError
        from safetensors.torch import load_file

        name = printable(self.path)
        try:
            network.load_state_dict(load_file(self.path))
        except SafetensorError as error:
            raise DamagedFileError(f"{name} is no complete safetensors file: {error}; copy it again") from error
        except RuntimeError as error:
            raise FormatError(
                f"{name} holds other weights than the recipe's network has: "
                f"{printable(' '.join(str(error).split())[:200])}; expected those of one network of the same kind, "
                "with as many classes, normalised alike"
            ) from error
        return network


def read_beside(path: str, class_names: Sequence[str], network: str) -> Beside:
    """Read what a trained classifier is, not yet its weights.

    Parameters
    ----------
    path : a file `.safetensors`, with its description `.json` beside it
    class_names, network : that it must have

    Raises
    ------
    FileError, DamagedFileError
    UnknownNameError
        The suffix is another.
    InputError
        It has other classes or channels, or is another network.
    """
    weights = checked_path(path)
    if weights.suffix.lower() != _SUFFIX:
        raise UnknownNameError("kind of weights", weights.name, (_SUFFIX,))
    weights = check_readable(weights)
    expected = {"class_names": list(class_names), "channels": list(CLASSIFIER_CHANNELS), "network": network}
    description = read_description(weights.with_suffix(".json"), *expected, "objects", "poses")
    for kind, one in expected.items():
        if description[kind] != one:
            raise InputError(
                f"beside: {kind} of {printable(path)} is {printable(str(description[kind])[:200])}; expected the "
                f"recipe's, {one}"
            )
    return Beside(weights, description)


def united(own: Mapping[str, Sequence[Any]], others: Sequence[Mapping[str, Sequence[Any]]]) -> dict[str, list[Any]]:
    """Lists by name, joined; what is in several is there once."""
    joined: dict[str, list[Any]] = {name: list(some) for name, some in own.items()}
    for other in others:
        for name, some in other.items():
            held = joined.setdefault(name, [])
            held += [one for one in some if one not in held]
    return joined
