"""Where the subcommands meet: the application with all of them, or with the one that is asked for."""

from importlib import import_module
from importlib.metadata import version

import typer

from millisight.cli.console import Commands

_ALONE = (
    "demo", "simulate", "image", "info", "objects", "segment", "classify", "surface", "locate", "view", "annotate",
    "collect", "generate",
)  # fmt: skip
_GROUPS = ("dataset", "rig", "calibrate", "evaluate", "train")


def application(*words: str) -> typer.Typer:
    """The application with all commands, or with the one alone that the first of `words` names.

    The modules of all of them take half a second to import.
    """
    app = Commands(
        invoke_without_command=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # with it, whatever stands in square brackets is lost: defaults, units
        context_settings={"help_option_names": ["-h", "--help"]},
        help="See through boxes with millimetre waves: simulate radar captures of meshes, read recorded captures, "
        "image them, and find objects in the images.\n\nStart with: millisight demo",
    )
    app.callback()(_main)
    every = _ALONE + _GROUPS
    wanted = () if words[:1] == ("--version",) else [name for name in every if name in words[:1]] or every
    for name in wanted:
        module = import_module(f"millisight.cli.{name}")
        if name in _GROUPS:
            app.add_typer(module.app, name=name)
        else:
            app.command(name)(getattr(module, name))
    return app


def _main(
    context: typer.Context,
    show_version: bool = typer.Option(False, "--version", help="Print the version and exit.", is_eager=True),
) -> None:
    if show_version:
        typer.echo(version("millisight"))
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
