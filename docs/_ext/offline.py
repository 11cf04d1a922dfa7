"""Nothing on the site comes from another server: whatever a browser would fetch from one is a warning."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def _check(app: Any, exception: Exception | None) -> None:
    for path in _written(Path(app.outdir)) if exception is None else ():
        for what in fetched(path.read_text(encoding="utf-8")):
            _LOG.warning("%s fetches from another server: %s", path.relative_to(app.outdir), what[:120])


def _written(folder: Path) -> Iterator[Path]:
    for pattern in ("*.html", "*.css"):
        yield from folder.rglob(pattern)


def setup(app: Any) -> dict[str, bool]:
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
