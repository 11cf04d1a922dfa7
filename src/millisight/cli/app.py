"""The Typer application: every subcommand is a thin module; here they meet."""

from importlib.metadata import version

import typer

from millisight.cli import (
    annotate,
    classify,
    collect,
    dataset,
    demo,
    evaluate,
    generate,
    image,
    info,
    locate,
    objects,
    segment,
    simulate,
    surface,
    train,
    view,
)
from millisight.cli.console import Commands

app: typer.Typer = Commands(
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # with it, whatever stands in square brackets is lost: defaults, units
    context_settings={"help_option_names": ["-h", "--help"]},
    help="See through boxes with millimetre waves: simulate radar captures of meshes, read recorded captures, image "
    "them, and find objects in the images.\n\n"
    "Start with: millisight demo",
)
app.command("demo")(demo.demo)
app.command("simulate")(simulate.simulate)
app.command("image")(image.image)
app.command("info")(info.info)
app.command("objects")(objects.objects)
app.command("segment")(segment.segment)
app.command("classify")(classify.classify)
app.command("surface")(surface.surface)
app.command("locate")(locate.locate)
app.command("view")(view.view)
app.command("annotate")(annotate.annotate)
app.command("collect")(collect.collect)
app.command("generate")(generate.generate)
app.add_typer(dataset.app, name="dataset")
app.add_typer(evaluate.app, name="evaluate")
app.add_typer(train.app, name="train")


@app.callback()
def _main(
    context: typer.Context,
    show_version: bool = typer.Option(False, "--version", help="Print the version and exit.", is_eager=True),
) -> None:
    if show_version:
        typer.echo(version("millisight"))
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
