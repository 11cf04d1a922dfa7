"""Training of the released network as the authors trained it: their images, augmentation and optimiser.

Each example is a pair of simulated images of one object, projected along z and masked, weighed anew each time. The
optimiser is Adam with torch's own settings; an epoch is one batch, its classes drawn evenly.
"""

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import (
    atomic_path,
    checked_array,
    checked_integer,
    checked_number,
    checked_numbers,
    make_folder,
    put,
    record,
)
from millisight.core.errors import InputError
from millisight.perception.classification import RELEASED_CLASSES, blurred_levels, clipped, middle
from millisight.perception.training._loop import (
    CHECKPOINT_NAME,
    check_torch_device,
    optimizer_tensors,
    read_checkpoint,
    repeatable,
    write_checkpoint,
)

RELEASED_WEIGHTS = "final_weights.h5"
_STEPS = 255
_TRIES = 50  # of an augmentation that erases too much


@record
class ReleasedRecipe:
    """How the released network is trained; the defaults are the authors'.

    Attributes
    ----------
    epochs : one batch each
    batch : examples in a batch
    weights : largest weight of each part; "specular" and "edges" are drawn from 0 to it
    blur : smallest and largest sigma [pixels]
    noisy : share of examples with noise
    erased : share of examples that lose a rectangle
    shift : largest along rows and along columns, as shares of the picture
    scale : smallest and largest
    learning_rate : of Adam
    seed : of everything drawn
    """

    epochs: int = 500
    batch: int = 512
    weights: tuple[float, float] = (1.0, 0.5)
    blur: tuple[float, float] = (0.1, 4.0)
    noisy: float = 0.25
    erased: float = 0.5
    shift: tuple[float, float] = (0.1, 0.3)
    scale: tuple[float, float] = (0.85, 1.15)
    learning_rate: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("epochs", "batch"):
            put(self, **{name: checked_integer(getattr(self, name), name=name)})
        for name in ("weights", "shift", "scale", "blur"):
            put(self, **{name: checked_numbers(getattr(self, name), name=name, count=2, minimum=0)})
        for name in ("noisy", "erased"):
            put(self, **{name: checked_number(getattr(self, name), name=name, minimum=0)})
        put(
            self,
            learning_rate=checked_number(self.learning_rate, name="learning_rate", above=0),
            seed=checked_integer(self.seed, name="seed", minimum=0),
        )
        if not sum(self.weights) > 0:
            raise InputError("weights are (0, 0); expected one above 0 at least")


class ReleasedExample(NamedTuple):
    """Simulated images of one object: means of |I| along z in the published scale, masked, and the class.

    Attributes
    ----------
    specular, edges : (A, B)
    label : index in RELEASED_CLASSES
    """

    specular: np.ndarray
    edges: np.ndarray
    label: int


def released_example(example: ReleasedExample, recipe: ReleasedRecipe, rng: np.random.Generator) -> np.ndarray:
    """(224, 224) float32, from -0.5 to 0.5: one drawing of an example.

    Raises
    ------
    InputError
        Nothing of it is left however it is drawn.
    """
    for _ in range(_TRIES):
        weights = rng.uniform(0, recipe.weights)
        seen = (weights[0] * example.specular + weights[1] * example.edges) / max(weights.sum(), 1e-12)
        before = np.count_nonzero(seen)
        if rng.random() < recipe.noisy:
            peak = seen.max()
            seen = np.maximum(seen + rng.normal(peak * rng.uniform(0, 0.1), 0.01 * peak, seen.shape), 0)
        levels = middle(np.minimum(np.floor(_STEPS * seen), _STEPS))
        levels = blurred_levels(levels, float(rng.uniform(*recipe.blur)))
        levels = levels[:: rng.choice((1, -1)), :: rng.choice((1, -1))]
        levels = _moved(levels, rng.uniform(-360, 360), (0.0, 0.0), 1.0)
        if rng.random() < recipe.erased:
            levels = _erased(levels, rng)
        shift = rng.uniform(-1, 1, 2) * recipe.shift * levels.shape
        levels = _moved(levels, rng.uniform(0, 360), (shift[0], shift[1]), float(rng.uniform(*recipe.scale)))
        values = clipped(levels / _STEPS)
        if values is not None and np.count_nonzero(values > -0.5) > before / 2:
            return values.astype(np.float32)
    name = RELEASED_CLASSES[example.label]
    raise InputError(f"an example of {name} is 0 however it is drawn; check its mask and its scale")


def _moved(levels: np.ndarray, angle_deg: float, shift: tuple[float, float], scale: float) -> np.ndarray:
    """A picture turned, scaled and shifted about its middle, nearest pixels, zeros from outside."""
    from scipy.ndimage import affine_transform

    angle = np.deg2rad(angle_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / scale
    centre = (np.array(levels.shape) - 1) / 2
    offset: Any = centre - turn @ (centre + shift)
    return affine_transform(levels, turn, offset, order=0)


def _erased(levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Without a rectangle of 2 to 33 % of the picture, its sides in a ratio of 0.3 to 3.3."""
    area = levels.size * rng.uniform(0.02, 0.33)
    ratio = np.exp(rng.uniform(np.log(0.3), np.log(3.3)))
    height, width = (round(side) for side in ((area * ratio) ** 0.5, (area / ratio) ** 0.5))
    if height >= levels.shape[0] or width >= levels.shape[1]:
        return levels
    row, column = rng.integers(levels.shape[0] - height + 1), rng.integers(levels.shape[1] - width + 1)
    levels = levels.copy()
    levels[row : row + height, column : column + width] = 0
    return levels


def train_released(
    examples: Sequence[ReleasedExample],
    folder: Path,
    recipe: ReleasedRecipe | None = None,
    *,
    device: str = "cpu",
    every: int = 20,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, list[float]]:
    """Train the released network, or continue an interrupted run; its weights are a torch state dict, as the authors'.

    Whatever an epoch draws follows from the seed and its number, so that a run that was interrupted ends with the same
    bytes.

    Parameters
    ----------
    examples : of every class at least one
    folder : for `final_weights.h5` and the checkpoint (0.8 GB); created if missing
    recipe : None: the authors'
    device : "cpu" or "cuda"
    every : epochs between checkpoints
    progress : called with (epochs done, epochs in all)

    Returns
    -------
    The weights' file, and the loss of each epoch.

    Raises
    ------
    InputError
        A class has no example, one is no pair of pictures of one size, or the folder holds a run of another recipe or
        of other examples.
    ImportError, DeviceError, FileError, DamagedFileError
    """
    try:
        import torch

        from millisight.perception.training.networks import ReleasedNetwork
    except ImportError as error:
        raise ImportError('training needs torch: pip install "millisight[train]"') from error
    recipe = recipe or ReleasedRecipe()
    check_torch_device(device)
    by_class = [[one for one in examples if one.label == label] for label in range(len(RELEASED_CLASSES))]
    for name, some in zip(RELEASED_CLASSES, by_class, strict=True):
        if not some:
            raise InputError(f"the class {name!r} has no example; expected simulated images of one of its objects")
        for one in some:
            checked_array(one.edges, name=f"edges of a {name}", shape=np.shape(one.specular))
    folder, every = make_folder(folder), checked_integer(every, name="every")
    checkpoint, digest = folder / CHECKPOINT_NAME, _digest(recipe, examples)
    losses: list[float] = []
    with repeatable(device):
        torch.manual_seed(recipe.seed)
        network = ReleasedNetwork(len(RELEASED_CLASSES)).to(device)
        optimiser = torch.optim.Adam(network.parameters(), lr=recipe.learning_rate)
        if checkpoint.exists():
            losses = read_checkpoint(checkpoint, digest, network, optimiser, lambda _, state: list(state["losses"]))
        for epoch in range(len(losses), recipe.epochs):
            rng = np.random.default_rng([recipe.seed, epoch])
            labels = rng.integers(len(by_class), size=recipe.batch)
            drawn = [by_class[label][rng.integers(len(by_class[label]))] for label in labels]
            batch = np.stack([released_example(one, recipe, rng) for one in drawn])[:, None]
            said = network(torch.from_numpy(batch).to(device))
            loss = torch.nn.functional.nll_loss(said, torch.from_numpy(labels).to(device))
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(float(loss.detach()))
            if (epoch + 1) % every == 0 and epoch + 1 < recipe.epochs:
                write_checkpoint(
                    checkpoint, optimizer_tensors(network, optimiser), {"made_of": digest, "losses": losses}
                )
            if progress is not None:
                progress(epoch + 1, recipe.epochs)
    path = folder / RELEASED_WEIGHTS
    with atomic_path(path) as temporary, open(temporary, "wb") as file:  # given a path, torch writes its name, too
        torch.save({name: value.cpu() for name, value in network.state_dict().items()}, file)
    return path, losses


def _digest(recipe: ReleasedRecipe, examples: Sequence[ReleasedExample]) -> str:
    """Of all that a run follows from."""
    found = hashlib.sha256(repr(dataclasses.astuple(recipe)).encode())
    for one in examples:
        found.update(f"{one.label} {one.specular.shape}".encode())
        for values in (one.specular, one.edges):
            found.update(np.asarray(values, np.float64).tobytes())
    return found.hexdigest()
