"""Tables in three languages, and intervals of known coverage."""

import csv
from xml.etree import ElementTree

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.evaluation import Table, bootstrap_interval

TABLE = Table(title="A < B", columns=("name|x", "F [%]"), rows=(("a|b", 93.25), ("<c>", None)), notes=("Mind & read.",))


def test_markdown_keeps_its_columns():
    lines = [line for line in TABLE.markdown().splitlines() if line.startswith("|")]
    assert len(lines) == 4
    assert {line.replace("\\|", "").count("|") for line in lines} == {3}
    assert lines[1].rstrip(" |").endswith(":")
    assert TABLE.markdown().endswith("Mind & read.")


def test_csv_gives_the_cells_back():
    assert list(csv.reader(TABLE.csv().splitlines())) == [["name|x", "F [%]"], ["a|b", "93.25"], ["<c>", ""]]


def test_html_is_escaped_and_whole():
    tree = ElementTree.fromstring(f"<div>{TABLE.html()}</div>")
    assert [cell.text for cell in tree.iter("td")][::2] == ["a|b", "<c>"]
    assert "A < B" in "".join(tree.itertext())


def test_a_row_of_another_length_is_refused():
    with pytest.raises(InputError, match="1 cells; expected 2"):
        Table(title="t", columns=("a", "b"), rows=((1,),))


def test_the_interval_of_a_mean_is_that_of_the_normal_distribution():
    values = np.random.default_rng(0).normal(size=400)
    low, high = bootstrap_interval(values, np.mean, draws=4000)
    half = 1.96 * values.std() / 20
    assert (values.mean() - low, high - values.mean()) == pytest.approx((half, half), rel=0.08)


def test_rows_are_drawn_whole_and_the_seed_decides():
    values = np.array([[0.0, 0.0], [1.0, -1.0], [2.0, -2.0]])
    assert bootstrap_interval(values, lambda drawn: drawn.sum()) == (0.0, 0.0)
    one = np.random.default_rng(1).random(20)
    assert bootstrap_interval(one, np.mean, rng=3) == bootstrap_interval(one, np.mean, rng=3)
    assert bootstrap_interval(one, np.mean, rng=3) != bootstrap_interval(one, np.mean, rng=4)


def test_no_values_have_no_interval():
    with pytest.raises(InputError, match="values"):
        bootstrap_interval([])
    with pytest.raises(InputError, match="level"):
        bootstrap_interval([1.0], level=95)
