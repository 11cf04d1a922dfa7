"""The site's own small extensions, and what its contents lists promise."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_ext"))

pytest.importorskip("sphinx", reason="the documentation's tools are not installed: make setup")

import docstrings  # noqa: E402
import mathml  # noqa: E402
import offline  # noqa: E402
from command_line import commands, help_of  # noqa: E402


class TestDocstrings:
    def test_what_means_something_in_restructured_text_means_itself(self):
        lines = docstrings.to_rst(["|I| is 2 * a*b of `record_` and a_ [m]; `max|I|` is not."])
        assert lines == [r"\|I\| is 2 \* a\*b of `record_` and a\_ [m]; ``max|I|`` is not."]

    def test_sections_become_fields(self):
        parameters = "Parameters\n----------\nx, y : where [m];\n    to the right\nz : up"
        text = f"About.\n\n{parameters}\n\nRaises\n------\nInputError\n    Never."
        rst = "\n".join(docstrings.to_rst(text.split("\n")))
        assert ":Parameters:" in rst
        assert "    * **x**, **y** – where [m];\n      to the right" in rst
        assert "    * :py:exc:`~millisight.core.errors.InputError`\n\n      Never." in rst
        assert rst.index(":Parameters:") < rst.index("**z**") < rst.index(":Raises:")

    def test_the_primer_is_linked(self):
        (line,) = docstrings.to_rst(["The image (paper Eq. 1, primer 4) by primer (7)."])
        link = "`primer {} <../explanation/primer.html#equation-{}>`__"
        assert line == f"The image (paper Eq. 1, {link.format('4', 4)}) by {link.format('(7)', 7)}."

    def test_doctests_and_drawings_keep_their_shape(self):
        lines = ["A tree:", "", "    a|b", "    c*d", "", "Examples", "--------", ">>> f(*x)", "2"]
        rst = docstrings.to_rst(lines)
        assert rst[rst.index("::") :][:4] == ["::", "", "    a|b", "    c*d"]
        assert ">>> f(*x)" in rst

    def test_every_room_with_a_public_name_has_its_page(self):
        rooms = {docstrings.room_of(thing) for thing in docstrings.public_names().values()}
        pages = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.rst"))
        shown = set(re.findall(r"public-names:: (\w+)$", pages, re.MULTILINE))
        assert len(rooms) >= 5
        assert rooms == shown


class TestEquations:
    EQUATIONS = re.findall(r"\$\$(.*?)\$\$", (DOCS / "explanation/primer.md").read_text(encoding="utf-8"), re.DOTALL)

    def test_the_primer_numbers_its_equations_from_one(self):
        numbers = [tag for equation in self.EQUATIONS for tag in re.findall(r"\\tag\{(\d+)\}", equation)]
        assert len(numbers) >= 15
        assert numbers == [str(n) for n in range(1, len(numbers) + 1)]

    def test_every_equation_that_the_code_cites_is_there(self):
        code = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
        cited = {int(number) for number in re.findall(r"\bprimer \(?(\d+)", code)}
        assert len(cited) >= 10
        assert cited <= set(range(1, len(self.EQUATIONS) + 1))

    def test_nothing_of_tex_is_left(self):
        assert len(self.EQUATIONS) >= 15
        for equation in self.EQUATIONS:
            drawn = mathml.as_mathml(re.sub(r"\\tag\{\d+\}", "", equation).strip(), display="block")
            assert drawn.startswith("<math")
            assert "\\" not in drawn, equation


class TestCommandLine:
    def test_groups_come_before_what_is_in_them(self):
        names = list(commands())
        assert names[0] == "millisight"
        assert names.index("millisight dataset") < names.index("millisight dataset list")

    def test_help_is_what_the_command_prints_and_not_too_wide_for_the_page(self):
        for name, command in commands().items():
            text = help_of(name, command)
            assert text.startswith(f"Usage: {name}")
            assert max(map(len, text.splitlines())) <= 88


class TestOffline:
    def test_what_a_browser_would_fetch_is_found(self):
        found = [
            '<script async src="https://cdn.example/x.js">',
            '<link href="//fonts.example/a.css" rel="stylesheet">',
            "<img alt='' src='http://example/pixel.gif'>",
            "url(https://fonts.example/a.woff",
        ]
        assert offline.fetched("".join(f"<p>{what})</p>" for what in found)) == found

    def test_links_that_a_reader_follows_are_none(self):
        page = '<a href="https://example/">there</a><link rel="canonical" href="https://x/"><script src="_static/a.js">'
        assert offline.fetched(page) == []

    def test_our_own_style_fetches_nothing(self):
        sheets = list((DOCS / "_static").rglob("*.css"))
        assert sheets
        assert all(offline.fetched(sheet.read_text(encoding="utf-8")) == [] for sheet in sheets)

    def test_links_that_lead_nowhere_are_found(self, tmp_path):
        (tmp_path / "deep").mkdir()
        other, page = tmp_path / "deep" / "other.html", tmp_path / "page.html"
        other.write_text('<h1 id="a-b">A</h1><a href="../page.html#here">up</a><a href="../page.html#nowhere">up</a>')
        page.write_text(
            '<p id="here"><a href="#here">a</a><a href="#">top</a><a href="deep/other.html#a-b">b</a>'
            '<a href="https://example/#x">out</a><a href="mailto:a@b">m</a><a href="page%2ehtml?q=1">q</a>'
            '<a href="#gone">c</a><a href="deep/other.html#c">d</a><a href="gone.html">e</a><img src="gone.png">'
        )
        assert list(offline.broken([page, other])) == [
            *((page, link) for link in ("#gone", "deep/other.html#c", "gone.html", "gone.png")),
            (other, "../page.html#nowhere"),
        ]


def test_the_first_page_shows_what_the_readme_shows_and_what_is_run_there():
    first, readme = (
        re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
        for path in (DOCS / "index.md", ROOT / "README.md")
    )
    assert first
    assert set(first) <= set(readme)
