"""`millisight train`: the weights of networks from recipes."""

import dataclasses
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from millisight.cli.console import Commands, progress, say

Recipe = Annotated[Path, typer.Argument(metavar="RECIPE.toml", help="Recipe: scenes, network and schedule.")]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder for the weights. [default: the recipe's name, here]"),
]
SceneFolder = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Folder for the scenes; several trainings may share it. [default: DIR/scenes]"),
]
Device = Annotated[str, typer.Option(help="Device to train on: cpu, or cuda where there is a GPU.")]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Number of processes that make the scenes. [default: one per core, at most eight]"),
]
Tensorboard = Annotated[bool, typer.Option(help="Also log to DIR/tensorboard.")]


class _Recipes(TyperGroup):
    """The commands below, and one for each recipe that a plug-in adds."""

    def list_commands(self, ctx: Any) -> list[str]:
        plugins = {point.name for point in entry_points(group="millisight.recipes")}
        return [*super().list_commands(ctx), *sorted(plugins)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in self.commands or cmd_name not in self.list_commands(ctx):
            return super().get_command(ctx, cmd_name)
        plugin = Commands(add_completion=False)

        @plugin.command(cmd_name, help=f"Train {cmd_name}, a recipe of a plug-in.")
        def command(
            recipe: Recipe,
            output: Output = None,
            scenes: SceneFolder = None,
            workers: Workers = None,
            device: Device = "cpu",
            tensorboard: Tensorboard = False,
        ) -> None:
            _train(cmd_name, recipe, output, scenes, workers, device=device, tensorboard=tensorboard)

        return typer.main.get_command(plugin)


app: typer.Typer = Commands(cls=_Recipes, no_args_is_help=True, help="Train networks on simulated images, by a recipe.")


@app.command("segmenter")
def segmenter(
    recipe: Recipe,
    output: Output = None,
    scenes: SceneFolder = None,
    workers: Workers = None,
    device: Device = "cpu",
    tensorboard: Tensorboard = False,
) -> None:
    """Train the segmenter "wave" on simulated scenes.

    Writes the scenes, a checkpoint after each epoch, and at the end wave.onnx with its description wave.json. Run it
    again to continue after an interruption; the final weights are the same.

    Example: millisight train segmenter examples/training/segmenter.toml -o wave
    """
    _train("segmenter", recipe, output, scenes, workers, device=device, tensorboard=tensorboard)


@app.command("classifier")
def classifier(
    recipe: Recipe,
    output: Output = None,
    scenes: SceneFolder = None,
    parts: Annotated[
        str | None,
        typer.Option(help="Simulated images to train with: both, edge or specular. [default: the recipe's]"),
    ] = None,
    network: Annotated[
        str | None, typer.Option(help="Network to train: small or paper. [default: the recipe's]")
    ] = None,
    beside: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE.safetensors",
            help="A trained classifier, its description .json beside it: the answer is the mean of its logits and "
            "those of the new network. May be given several times. [default: the recipe's]",
        ),
    ] = None,
    all_objects: Annotated[
        bool,
        typer.Option(
            "--all-objects", help="Also train on the objects in the recipe's `tests`, to test on known objects."
        ),
    ] = False,
    workers: Workers = None,
    device: Device = "cpu",
    tensorboard: Tensorboard = False,
) -> None:
    """Train a classifier on simulated scenes.

    Writes the scenes, a checkpoint after each epoch, and at the end classifier.onnx with its description
    classifier.json. Run it again to continue after an interruption; the final weights are the same.

    Example: millisight train classifier examples/training/classifier.toml -o classifier
    """
    changes = {
        "parts": parts, "network": network, "tests": () if all_objects else None,
        "beside": tuple(beside) if beside else None,
    }  # fmt: skip
    _train("classifier", recipe, output, scenes, workers, device=device, tensorboard=tensorboard, **changes)


@app.command("released")
def released(
    root: Annotated[Path, typer.Argument(metavar="DIR", help="Published dataset, with simulated images and masks.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Folder for the weights.")],
    recipe: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Recipe: augmentation and optimiser. [default: the authors']"),
    ] = None,
    epochs: Annotated[int | None, typer.Option(min=1, help="Number of batches. [default: the recipe's, 500]")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="Examples in a batch. [default: the recipe's, 512]")] = None,
    split: Annotated[str, typer.Option(help="Published split. [default: the newest]", show_default=False)] = "",
    device: Device = "cpu",
) -> None:
    """Train the paper's network as its authors did. It is trained on the simulated images of the published dataset.

    Writes final_weights.h5, a torch state dict as theirs, which `evaluate classification --weights` takes. It has 68
    million weights: on a CPU a batch of 512 takes minutes. Every 20 batches a checkpoint of 0.8 GB is written; run it
    again to continue after an interruption, and the final weights are the same.

    Example: millisight train released MITO_Dataset -o released --device cuda
    """
    from millisight import datasets
    from millisight.core import record_from_file
    from millisight.perception.training import ReleasedRecipe, train_released

    held = ReleasedRecipe() if recipe is None else record_from_file(ReleasedRecipe, recipe)
    changes = {name: value for name, value in (("epochs", epochs), ("batch", batch)) if value is not None}
    held = dataclasses.replace(held, **changes)
    examples = datasets.released_examples(datasets.open(root), split=split)
    with progress("train", compiles=False) as report:
        path, losses = train_released(examples, output, held, device=device, progress=report)
    lost = f"loss from {losses[0]:.3f} to {losses[-1]:.3f}"
    say(f"{len(examples)} examples, {held.epochs} batches of {held.batch}; {lost}")
    say(f"weights: {path}")


def _train(
    kind: str,
    path: Path,
    output: Path | None,
    scenes: Path | None,
    workers: int | None,
    *,
    device: str,
    tensorboard: bool,
    **changes: Any,
) -> None:
    """Train what the registry has under this name; `changes` take the place of the recipe's keys, but for None."""
    from millisight.datasets.generation import record_from_file
    from millisight.perception.training import RECIPES, check_installed, make_scenes, train

    recipe = record_from_file(RECIPES[kind], path)
    recipe = dataclasses.replace(recipe, **{key: value for key, value in changes.items() if value is not None})
    check_installed()  # before scenes are made, which takes long
    folder = output or Path(recipe.name)
    with progress("make scenes") as report:
        made = make_scenes(recipe, scenes or folder / "scenes", workers=workers, progress=report)
    with progress("train", compiles=False) as report:
        done = train(recipe, made, folder, device=device, tensorboard=tensorboard, progress=report)
    count, best = done.description["epochs"], done.description["best_epoch"]
    epochs = "1 epoch" if count == 1 else f"{count} epochs, the best of them {best}"
    say(f"{epochs}; {recipe.summary(done.description)}")
    say(f"weights: {done.weights}")
