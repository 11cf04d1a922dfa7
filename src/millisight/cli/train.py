"""`millisight train`: the weights of networks from recipes."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import progress, say

app = typer.Typer(no_args_is_help=True, help="Train networks on simulated images: weights from a recipe.")

Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Where weights go. [default: the recipe's name, here]"),
]
Device = Annotated[str, typer.Option(help="Of the training: cpu, or cuda where there is a GPU.")]
Tensorboard = Annotated[bool, typer.Option(help="Log to DIR/tensorboard as well.")]


@app.command("segmenter")
def segmenter(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="Scenes, network and schedule.")],
    output: Output = None,
    device: Device = "cpu",
    tensorboard: Tensorboard = False,
) -> None:
    """Train the wave segmenter on scenes that the paper's simulator makes, and on nothing else.

    DIR keeps the scenes, a checkpoint after each epoch, and in the end wave.onnx with its description wave.json. Run it
    again to go on after an interruption: the weights are those of a run that was never interrupted.

    Example: millisight train segmenter examples/training/segmenter.toml -o wave
    """
    from millisight.datasets.recipefile import record_from_file
    from millisight.perception.training import check_installed
    from millisight.perception.training_wave import SegmenterRecipe, make_scenes, train_segmenter

    described = record_from_file(SegmenterRecipe, recipe)
    check_installed()  # before scenes are made, which takes long
    folder = output or Path(described.name)
    with progress("make scenes") as report:
        scenes = make_scenes(described, folder, progress=report)
    with progress("train", compiles=False) as report:
        done = train_segmenter(described, scenes, folder, device=device, tensorboard=tensorboard, progress=report)
    told = done.description
    say(f"{_epochs(told)}; F1 on the validation scenes {max(told['validation']['mean F1 by cut'].values()):.3f}")
    say(f"weights: {done.weights}")


@app.command("classifier")
def classifier(
    recipe: Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="Classes, scenes, network and schedule.")],
    output: Output = None,
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
    device: Device = "cpu",
    tensorboard: Tensorboard = False,
) -> None:
    """Train a classifier on scenes that the paper's simulator makes, and on nothing else.

    DIR keeps the scenes, a checkpoint after each epoch, and in the end classifier.onnx with its description
    classifier.json. Run it again to go on after an interruption: the weights are those of a run that was never
    interrupted.

    Example: millisight train classifier examples/training/classifier.toml -o classifier
    """
    from millisight.datasets.recipefile import record_from_file
    from millisight.perception.classifier_recipe import ClassifierRecipe, make_examples
    from millisight.perception.training import check_installed
    from millisight.perception.training_classifier import train_classifier

    described = record_from_file(ClassifierRecipe, recipe)
    changes = {"parts": parts, "network": network, "tests": () if all_objects else None}
    described = dataclasses.replace(described, **{key: value for key, value in changes.items() if value is not None})
    check_installed()  # before scenes are made, which takes long
    folder = output or Path(described.name)
    with progress("make scenes") as report:
        examples = make_examples(described, scenes or folder / "scenes", progress=report)
    with progress("train", compiles=False) as report:
        done = train_classifier(described, examples, folder, device=device, tensorboard=tensorboard, progress=report)
    told = done.description
    say(f"{_epochs(told)}; {100 * told['validation']['accuracy']:.1f} % of the validation scenes right, "
        f"by chance {100 / len(told['class_names']):.1f} %")  # fmt: skip
    say(f"weights: {done.weights}")


def _epochs(told: Mapping[str, Any]) -> str:
    return "1 epoch" if told["epochs"] == 1 else f"{told['epochs']} epochs, the best of them {told['best_epoch']}"
