"""Every public name and every command says what it is: what the reference shows."""

import inspect
import re
import sys
from pathlib import Path
from types import UnionType
from typing import NamedTuple

import numpy as np
import pytest

import millisight as ms
from helpers.commands import COMMANDS
from millisight import viz
from millisight.core import errors, record

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS / "_ext"))

pytest.importorskip("sphinx", reason="the documentation's tools are not installed: make setup")

from docstrings import attributes, documented, undocumented  # noqa: E402

PAGES = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.rst"))
SHOWN = {
    f"{room.split()[0]}.{name}": thing
    for room in re.findall(r"public-names:: ([\w.* ]+)$", PAGES, re.MULTILINE)
    for name, thing in documented(room).items()
}
FIGURES = {name: getattr(viz, name) for name in viz.__all__ if name.startswith(("plot_", "draw_", "cut_", "save_"))}


def test_there_is_something_to_look_at():
    assert len(SHOWN) > 60
    assert len(FIGURES) > 15
    assert len(COMMANDS) > 8
    things = set(map(id, SHOWN.values()))
    public = [thing for name in ms.__all__ if not inspect.ismodule(thing := getattr(ms, name))]
    raised = [thing for thing in vars(errors).values() if inspect.isclass(thing) and issubclass(thing, Exception)]
    assert things >= {id(thing) for thing in (*public, *raised, *FIGURES.values())}


@pytest.mark.parametrize("name", SHOWN)
def test_every_name_and_all_that_belongs_to_it_is_told(name):
    assert undocumented(name.rpartition(".")[2], SHOWN[name]) == []


@pytest.mark.parametrize("name", [name for name, thing in SHOWN.items() if inspect.isclass(thing)])
def test_every_array_has_its_shape(name):
    told = attributes(inspect.getdoc(SHOWN[name]))
    arrays = [field for field, kind in getattr(SHOWN[name], "__annotations__", {}).items() if _is_array(kind)]
    assert [field for field in arrays if not re.match(r"\(\w+,", told[field])] == []


def _is_array(kind):
    return kind is np.ndarray or (isinstance(kind, UnionType) and np.ndarray in kind.__args__)


def test_what_is_not_told_is_found():
    @record
    class Bare:
        x: float

        def reach(self):
            pass

    @record
    class Half:
        """Two places.

        Attributes
        ----------
        x, y : [m]
        z :
        """

        x: float
        y: float
        z: float
        radius: float

        @property
        def shape(self):
            return ()

        @classmethod
        def unit(cls):
            """One."""

    class Pair(NamedTuple):
        """Two."""

        first: int

    for cls in (Bare, Half, Pair):  # as if they were ours
        cls.__module__ = "millisight.test"
    assert undocumented("Bare", Bare) == ["Bare", "Bare.x", "Bare.reach"]
    assert undocumented("Half", Half) == ["Half.z", "Half.radius", "Half.shape"]
    assert undocumented("Pair", Pair) == ["Pair.first"]
    assert undocumented("_is_array", _is_array) == ["_is_array"]


@pytest.mark.parametrize("name", FIGURES)
def test_every_argument_of_a_figure_is_spoken_of(name):
    text = inspect.getdoc(FIGURES[name])
    assert [argument for argument in inspect.signature(FIGURES[name]).parameters if argument not in text] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_help(name):
    command = COMMANDS[name]
    assert (command.help or "").strip()
    bare = [p.name for p in command.params if not (getattr(p, "help", None) or "").strip()]
    assert bare == []
