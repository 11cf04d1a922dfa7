"""The tutorials: notebooks kept without outputs, run while the site is built, and offered for download.

    python docs/_ext/notebooks.py docs/tutorials/*.ipynb

takes outputs, counts and whatever an editor has noted out of notebooks, before they are committed.
"""

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

_METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
_DOWNLOAD = "{{download}}`Download this page as a notebook <{0}>`, and run it by yourself: `jupyter lab {0}`."


def emptied(text: str) -> str:
    """A notebook's text with nothing in it but what was written by hand: the one form in which it is kept."""
    notebook = {"cells": list(_cells(json.loads(text))), "metadata": _METADATA, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def _cells(notebook: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for number, cell in enumerate(notebook["cells"], start=1):
        kept = {"cell_type": cell["cell_type"], "id": f"cell-{number:02}", "metadata": {}}
        if tags := cell["metadata"].get("tags"):
            kept["metadata"] = {"tags": tags}
        if cell["cell_type"] == "code":
            kept |= {"execution_count": None, "outputs": []}
        yield {**kept, "source": "".join(cell["source"]).rstrip().splitlines(keepends=True)}


def _offered(app: Any, page: str, text: list[str]) -> None:
    """Add the link to the notebook under its title."""
    path = Path(app.env.doc2path(page))
    if path.suffix == ".ipynb":
        notebook = json.loads(text[0])
        source = _DOWNLOAD.format(path.name)
        notebook["cells"].insert(1, {"cell_type": "markdown", "id": "download", "metadata": {}, "source": source})
        text[0] = json.dumps(notebook)


def setup(app: Any) -> dict[str, bool]:
    from jupyter_client.manager import KernelManager

    # Or each kernel warns that whoever else is on the machine can listen. MyST-NB has no setting for it.
    with suppress(AttributeError):  # older versions neither encrypt nor warn
        KernelManager.transport_encryption.default_value = "auto"
    logging.getLogger("traitlets").setLevel(logging.WARNING)  # which says on stderr that a notebook begins
    app.connect("source-read", _offered)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(emptied(path.read_text(encoding="utf-8")), encoding="utf-8")
