"""The whole Typer application, as documentation and tests read it; `millisight` itself loads what it is asked for."""

import typer

from millisight.cli.commands import application

app: typer.Typer = application()
