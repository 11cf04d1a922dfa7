"""`millisight train`: networks from recipes."""

import typer

from millisight.cli import train_classifier, train_segmenter

app = typer.Typer(no_args_is_help=True, help="Train networks on simulated images: weights from a recipe.")
app.command("segmenter")(train_segmenter.segmenter)
app.command("classifier")(train_classifier.classifier)
