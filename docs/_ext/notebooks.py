"""The tutorials: notebooks kept without outputs, run before the site is built, and offered for download.

    python docs/_ext/notebooks.py docs/tutorials/*.ipynb

takes outputs, counts and whatever an editor has noted out of notebooks, before they are committed.
"""

import json
import logging
import shutil
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
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


def _run_ahead(app: Any, _env: Any, pages: list[str]) -> None:
    """Run the notebooks side by side, as many as `--jobs`, into the cache where MyST-NB looks for what they give.

    By itself it runs one after another. What earlier builds left in the cache is thrown away, for the package may have
    changed. One that fails is not kept: MyST-NB runs it again, and tells of it.
    """
    from jupyter_cache import get_cache
    from jupyter_cache.base import CacheBundleIn
    from nbformat import from_dict

    folder = app.env.mystnb_config.execution_cache_path
    shutil.rmtree(folder, ignore_errors=True)
    paths = [path for page in pages if (path := Path(app.env.doc2path(page))).suffix == ".ipynb"]
    paths = [path for path in paths if not any(map(path.match, app.config.nb_execution_excludepatterns))]
    # The longest first, so that none of them is left alone at the end.
    paths.sort(key=lambda path: not path.name.startswith(("01", "04", "07")))
    cache = get_cache(folder)
    with ProcessPoolExecutor(max_workers=app.parallel) as pool:
        running = {pool.submit(_executed, path, app.config.nb_execution_timeout): path for path in paths}
        for done in as_completed(running):
            notebook, seconds = done.result()
            if notebook is not None:
                bundle = CacheBundleIn(from_dict(notebook), str(running[done]), data={"execution_seconds": seconds})
                cache.cache_notebook_bundle(bundle, check_validity=False)


def _executed(path: Path, timeout: int) -> tuple[dict[str, Any] | None, float]:
    """A notebook with its outputs, run as MyST-NB would, and the seconds that it took; None if a cell failed."""
    import nbformat
    from jupyter_cache.executors.utils import single_nb_execution

    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as place:
        result = single_nb_execution(notebook, cwd=place, timeout=timeout, allow_errors=False)
    return (None if result.err else dict(notebook)), result.time


def setup(app: Any) -> dict[str, bool]:
    from jupyter_client.manager import KernelManager

    # Or each kernel warns that whoever else is on the machine can listen. MyST-NB has no setting for it.
    with suppress(AttributeError):  # older versions neither encrypt nor warn
        KernelManager.transport_encryption.default_value = "auto"
    logging.getLogger("traitlets").setLevel(logging.WARNING)  # which says on stderr that a notebook begins
    app.connect("env-before-read-docs", _run_ahead)
    app.connect("source-read", _offered)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(emptied(path.read_text(encoding="utf-8")), encoding="utf-8")
