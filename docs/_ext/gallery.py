"""The gallery: `.. gallery:: folder` runs every script of a folder and shows its figure above its code.

A script makes one Matplotlib figure, `figure`. Its docstring's first line is its title, the rest its caption.
"""

import ast
import runpy
import time
from collections.abc import Iterator
from os.path import relpath
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

from millisight.viz import save_figure

_LOG = logging.getLogger(__name__)


class Gallery(SphinxDirective):
    """`.. gallery:: folder`, beside the page."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        folder = Path(self.env.doc2path(self.env.docname)).parent / self.arguments[0]
        found = nodes.section()
        found.document = self.state.document
        lines = StringList([line for script in sorted(folder.glob("*.py")) for line in self._shown(script)])
        if not lines:
            _LOG.warning("no script in %s", folder, location=self.get_location())
        nested_parse_with_titles(self.state, lines, found)
        return found.children

    def _shown(self, script: Path) -> Iterator[str]:
        text = script.read_text(encoding="utf-8")
        self.env.note_dependency(str(script))
        title, _, caption = (ast.get_docstring(ast.parse(text)) or "").partition("\n")
        picture = Path(self.env.app.outdir).parent / "gallery" / f"{script.stem}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        began = time.perf_counter()
        save_figure(runpy.run_path(str(script))["figure"], picture)
        _LOG.info(" %s: %.1f s", script.stem, time.perf_counter() - began)
        code = text.partition('"""\n\n')[2]
        yield from (title.rstrip("."), "-" * len(title), "", *caption.strip().splitlines(), "")
        here = Path(self.env.doc2path(self.env.docname)).parent
        yield from (f".. image:: {relpath(picture, here)}", f"   :alt: {title}", "", ".. code-block:: python", "")
        yield from ("   " + line for line in code.splitlines())
        yield ""


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("gallery", Gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
