"""The command `millisight`: every subcommand is a thin module; here they meet, and errors become one line."""

import sys
from importlib.metadata import version

import typer

from millisight.cli import demo, image, info, simulate
from millisight.cli.console import end_on_sigterm
from millisight.errors import MillisightError

app = typer.Typer(
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="See through boxes with millimetre waves: simulate what a radar measures of a mesh, and image it.\n\n"
    "Start with: millisight demo",
)
app.command("demo")(demo.demo)
app.command("simulate")(simulate.simulate)
app.command("image")(image.image)
app.command("info")(info.info)


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


def run() -> None:
    """Run the command line; every error of ours is one line on standard error and exit code 1, Ctrl-C is 130."""
    end_on_sigterm()
    try:
        app()
    except MillisightError as error:
        _fail(str(error), 1)
    except KeyboardInterrupt:
        _fail("interrupted; files that were being written are left as they were before", 130)
    except MemoryError as error:
        _fail(f"not enough memory: {error}; use a coarser grid, fewer positions, or a larger machine", 1)
    except OSError as error:
        _fail(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}", 1)


def _fail(message: str, code: int) -> None:
    print("millisight: " + " ".join(message.split()), file=sys.stderr)  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    run()
