"""`millisight train classifier`: the weights of a classifier from a recipe."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from millisight.cli.console import progress, say
from millisight.files import printable, read_toml

if TYPE_CHECKING:
    from millisight.perception.training_classifier import ClassifierRecipe


def classifier(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="Classes, scenes, network and schedule.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Where weights go. [default: the recipe's name, here]"),
    ] = None,
    scenes: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where scenes are kept, for several trainings. [default: DIR/scenes]"),
    ] = None,
    parts: Annotated[
        str | None, typer.Option(help="both, edge or specular: of the simulator's images; in the recipe's place.")
    ] = None,
    network: Annotated[str | None, typer.Option(help="small, or paper: in the recipe's place.")] = None,
    all_objects: Annotated[
        bool,
        typer.Option("--all-objects", help="Train with the recipe's `tests`, too: to test on known objects."),
    ] = False,
    device: Annotated[str, typer.Option(help="Of the training: cpu, or cuda where there is a GPU.")] = "cpu",
    tensorboard: Annotated[bool, typer.Option(help="Log to DIR/tensorboard as well.")] = False,
) -> None:
    """Train a classifier on scenes that the paper's simulator makes, and on nothing else.

    DIR keeps the scenes, a checkpoint after each epoch, and in the end classifier.onnx with its description
    classifier.json. Run it again to go on after an interruption: the weights are those of a run that was never
    interrupted.

    Example: millisight train classifier examples/training/classifier.toml -o classifier
    """
    from millisight.perception.training import check_installed
    from millisight.perception.training_classifier import make_examples, train_classifier

    described = read_classifier_recipe(recipe)
    changes = {"parts": parts, "network": network, "tests": () if all_objects else None}
    described = dataclasses.replace(described, **{key: value for key, value in changes.items() if value is not None})
    check_installed()  # before scenes are made, which takes long
    folder = output or Path(described.name)
    with progress("make scenes") as report:
        examples = make_examples(described, scenes or folder / "scenes", progress=report)
    with progress("train", compiles=False) as report:
        done = train_classifier(described, examples, folder, device=device, tensorboard=tensorboard, progress=report)
    told = done.description
    say(f"{told['epochs']} epochs, the best of them {told['best_epoch']}; "
        f"{100 * told['validation']['accuracy']:.1f} % of the validation scenes right")  # fmt: skip
    say(f"weights: {done.weights}")


def read_classifier_recipe(path: Path) -> "ClassifierRecipe":
    """The recipe that a TOML file holds.

    Raises
    ------
    FormatError
        It is no TOML, or holds a key or a value that cannot be right; the message names the place.
    FileError
        It cannot be read.
    """
    from millisight.datasets.recipefile import record_from_table
    from millisight.perception.training_classifier import ClassifierRecipe

    return record_from_table(ClassifierRecipe, read_toml(path, "a recipe"), printable(path))
