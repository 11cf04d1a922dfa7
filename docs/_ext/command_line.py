"""The commands' own help on a page: `.. command-line::` shows `millisight` and every command under it."""

from collections.abc import Iterator
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

_WIDTH = 88
_LOG = logging.getLogger(__name__)


def commands() -> dict[str, Any]:
    """Every command by its whole name, groups before what is in them."""
    import typer

    from millisight.cli.app import app

    def walk(name: str, command: Any) -> Iterator[tuple[str, Any]]:
        yield name, command
        for part, inner in getattr(command, "commands", {}).items():
            yield from walk(f"{name} {part}", inner)

    return dict(walk("millisight", typer.main.get_command(app)))


def help_of(name: str, command: Any) -> str:
    """What `--help` prints."""
    import click

    options = {"help_option_names": ["-h", "--help"]}  # as the application has them
    context = click.Context(command, info_name=name, terminal_width=_WIDTH, max_content_width=_WIDTH, **options)
    return command.get_help(context).rstrip()


class CommandLine(SphinxDirective):
    """`.. command-line::`: a section for each command, with its help."""

    def run(self) -> list[nodes.Node]:
        found = nodes.section()
        found.document = self.state.document
        lines = StringList(list(self._lines()), source=self.get_source_info()[0])
        nested_parse_with_titles(self.state, lines, found)
        return found.children

    def _lines(self) -> Iterator[str]:
        for name, command in commands().items():
            if not (command.help or "").strip():
                _LOG.warning("the command %r has no help", name, location=self.get_location())
            yield from (f".. _{name.replace(' ', '-')}:", "", name, "-" * len(name), "", ".. code-block:: text", "")
            yield from ("   " + line for line in help_of(name, command).splitlines())
            yield ""


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
