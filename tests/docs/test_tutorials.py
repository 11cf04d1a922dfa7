"""The tutorials' notebooks as they are kept. That they run is seen to where the site is built."""

import json
import re
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS / "_ext"))

from notebooks import emptied  # noqa: E402

NOTEBOOKS = sorted((DOCS / "tutorials").glob("*.ipynb"))


def cells_of(notebook, kind):
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == kind]


def test_each_has_a_number_of_its_own():
    assert [int(notebook.name[:2]) for notebook in NOTEBOOKS] == [1, 2, 3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
class TestEachNotebook:
    def test_nothing_but_what_was_written_by_hand_is_kept(self, notebook):
        text = notebook.read_text(encoding="utf-8")
        assert text == emptied(text), f"python docs/_ext/notebooks.py docs/tutorials/{notebook.name}"

    def test_it_is_valid(self, notebook):
        nbformat = pytest.importorskip("nbformat", reason="the documentation's tools are not installed: make setup")
        nbformat.validate(nbformat.read(notebook, as_version=nbformat.NO_CONVERT))

    def test_it_begins_with_a_title_and_says_what_to_install(self, notebook):
        title, code = cells_of(notebook, "markdown")[0], cells_of(notebook, "code")[0]
        assert re.match(rf"# {int(notebook.name[:2])}\. \w", title)
        assert re.match(r'# pip install "?millisight', code)

    def test_it_ends_with_exercises(self, notebook):
        headings = re.findall(r"^## (.+)", "\n".join(cells_of(notebook, "markdown")), re.MULTILINE)
        assert len(headings) >= 3
        assert "Exercises" in headings[-2:]

    def test_it_names_no_place_of_a_machine(self, notebook):
        text = notebook.read_text(encoding="utf-8")
        assert not re.search(r"(?<![\w.])/(home|tmp|Users|work|root|usr)\b|[A-Z]:\\", text)


WRITTEN = {"cell_type": "code", "metadata": {"tags": ["hide-input"]}, "source": ["1 +\n", "1\n"]}
RUN = {
    "cells": [
        {"cell_type": "markdown", "id": "a", "metadata": {"editable": True}, "source": "# Title"},
        {
            **WRITTEN,
            "id": "b",
            "metadata": {"tags": ["hide-input"], "execution": {"iopub.execute_input": "2026"}},
            "execution_count": 3,
            "outputs": [{"output_type": "execute_result", "data": {"text/plain": "2"}}],
        },
    ],
    "metadata": {"kernelspec": {"name": "mine", "display_name": "Mine"}, "widgets": {}},
    "nbformat": 4,
    "nbformat_minor": 5,
}


class TestEmptied:
    def test_outputs_counts_and_notes_go_and_the_rest_stays(self):
        notebook = json.loads(emptied(json.dumps(RUN)))
        title, code = notebook["cells"]
        assert title == {"cell_type": "markdown", "id": "cell-01", "metadata": {}, "source": ["# Title"]}
        assert code == {
            "cell_type": "code",
            "id": "cell-02",
            "metadata": {"tags": ["hide-input"]},
            "execution_count": None,
            "outputs": [],
            "source": ["1 +\n", "1"],
        }
        assert notebook["metadata"]["kernelspec"]["name"] == "python3"
        assert set(notebook["metadata"]) == {"kernelspec", "language_info"}

    def test_what_is_empty_stays_as_it_is(self):
        once = emptied(json.dumps(RUN))
        assert emptied(once) == once
