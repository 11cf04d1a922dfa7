"""The site stands alone: what a browser would fetch from another server is a warning, and so is a broken link within.

Sphinx looks at links in the sources; here the built pages are read, so that anchors that are made while building
(equations, names in the reference) are looked at as well.
"""

import re
from collections.abc import Iterable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from sphinx.util import logging

_FETCHED = re.compile(
    r"<(?:script|img|iframe|source|video|audio|embed)\b[^>]*\bsrc=[\"']?(?:https?:)?//[^>]*>"
    r"|<link\b(?=[^>]*\brel=[\"']?(?:stylesheet|preload|icon|preconnect))[^>]*\bhref=[\"']?(?:https?:)?//[^>]*>"
    r"|(?:url\(\s*|@import\s+)[\"']?(?:https?:)?//[^)\s]*"
)
_LOG = logging.getLogger(__name__)


def fetched(text: str) -> list[str]:
    """What a page or style sheet fetches from elsewhere."""
    return [found[0] for found in _FETCHED.finditer(text)]


def broken(pages: Iterable[Path]) -> Iterator[tuple[Path, str]]:
    """Each page with each of its links that leads to no file beside it, or to no anchor of a page."""
    known: dict[Path, _Page] = {}

    def read(path: Path) -> _Page:
        if path not in known:
            known[path] = _Page(path.read_text(encoding="utf-8"))
        return known[path]

    for page in pages:
        for link in read(page).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = page.parent / unquote(parts.path) if parts.path else page
            anchor = unquote(parts.fragment) if target.suffix == ".html" else ""
            if not target.exists() or (anchor and anchor not in read(target.resolve()).anchors):
                yield page, link


class _Page(HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value:
                self.links.append(value)


def _check(app: Any, exception: Exception | None) -> None:
    if exception is not None or app.builder.format != "html":
        return
    out = Path(app.outdir).resolve()
    for path in _written(out):
        for what in fetched(path.read_text(encoding="utf-8")):
            _LOG.warning("%s fetches from another server: %s", path.relative_to(out), what[:120])
    # The pages of code are left as they are where the code is, and then lead to where names were documented before.
    for path, link in broken(Path(app.builder.get_outfilename(name)).resolve() for name in sorted(app.env.found_docs)):
        _LOG.warning("%s has a link that leads nowhere: %s", path.relative_to(out), link)


def _written(folder: Path) -> Iterator[Path]:
    for pattern in ("*.html", "*.css"):
        yield from folder.rglob(pattern)


def setup(app: Any) -> dict[str, bool]:
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
