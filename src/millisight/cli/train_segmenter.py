"""`millisight train segmenter`: the weights of `wave` from a recipe."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import progress, say
from millisight.files import printable, read_toml

if TYPE_CHECKING:
    from millisight.perception.training_wave import SegmenterRecipe


def segmenter(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="Scenes, network and schedule.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Where weights go. [default: the recipe's name, here]"),
    ] = None,
    device: Annotated[str, typer.Option(help="Of the training: cpu, or cuda where there is a GPU.")] = "cpu",
    tensorboard: Annotated[bool, typer.Option(help="Log to DIR/tensorboard as well.")] = False,
) -> None:
    """Train the wave segmenter on scenes that the paper's simulator makes, and on nothing else.

    DIR keeps the scenes, a checkpoint after each epoch, and in the end wave.onnx with its description wave.json. Run it
    again to go on after an interruption: the weights are those of a run that was never interrupted.

    Example: millisight train segmenter examples/training/segmenter.toml -o wave
    """
    from millisight.perception.training import check_installed
    from millisight.perception.training_wave import make_scenes, train_segmenter

    described = read_segmenter_recipe(recipe)
    check_installed()  # before scenes are made, which takes long
    folder = output or Path(described.name)
    with progress("make scenes") as report:
        scenes = make_scenes(described, folder, progress=report)
    with progress("train", compiles=False) as report:
        done = train_segmenter(described, scenes, folder, device=device, tensorboard=tensorboard, progress=report)
    told = done.description
    say(f"{told['epochs']} epochs, the best of them {told['best_epoch']}; "
        f"F1 on the validation scenes {max(told['validation']['mean F1 by cut'].values()):.3f}")  # fmt: skip
    say(f"weights: {done.weights}")


def read_segmenter_recipe(path: Path) -> "SegmenterRecipe":
    """The recipe that a TOML file holds.

    Raises
    ------
    FormatError
        It is no TOML, or holds a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    from millisight.datasets.recipefile import record_from_table
    from millisight.perception.training_wave import SegmenterRecipe

    return record_from_table(SegmenterRecipe, read_toml(path, "a recipe"), printable(path))
