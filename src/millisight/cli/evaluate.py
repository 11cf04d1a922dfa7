"""`millisight evaluate`: tables beside the paper's."""

import typer

from millisight.cli import evaluate_classification, evaluate_segmentation, evaluate_simulator

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="How well it works: tables of a dataset's images, the paper's figures beside.",
)
app.command("simulator")(evaluate_simulator.simulator)
app.command("segmentation")(evaluate_segmentation.segmentation)
app.command("classification")(evaluate_classification.classification)
