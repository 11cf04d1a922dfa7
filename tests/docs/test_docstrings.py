"""Every public name and every command says what it is: what the reference shows."""

import inspect

import pytest
import typer

import millisight as ms
from millisight import errors
from millisight.cli.app import app
from millisight.viz import plots

NAMES = {name: getattr(ms, name) for name in ms.__all__ if name != "__version__"}
FIGURES = {name: getattr(plots, name) for name in plots.__all__}
ERRORS = {
    name: thing for name, thing in vars(errors).items() if inspect.isclass(thing) and issubclass(thing, Exception)
}


def commands(name="millisight", command=None):
    command = command or typer.main.get_command(app)
    yield name, command
    for part, inner in getattr(command, "commands", {}).items():
        yield from commands(f"{name} {part}", inner)


COMMANDS = dict(commands())


def members_of(thing):
    """Public methods and properties that a class defines itself."""
    for name, member in vars(thing).items():
        if not name.startswith("_") and (callable(member) or isinstance(member, property | classmethod | staticmethod)):
            yield name, getattr(member, "fget", None) or getattr(member, "__func__", member)


def test_there_is_something_to_look_at():
    assert len(NAMES) > 25
    assert len(FIGURES) > 15
    assert len(COMMANDS) > 8


@pytest.mark.parametrize("name", [*NAMES, *FIGURES, *ERRORS])
def test_every_public_name_has_a_docstring_of_its_own(name):
    thing = {**NAMES, **FIGURES, **ERRORS}[name]
    text = inspect.getdoc(thing) or ""
    # A dataclass without one gets its signature instead.
    assert text.strip()
    assert not text.startswith(f"{name}(")


@pytest.mark.parametrize("name", [name for name, thing in NAMES.items() if inspect.isclass(thing)])
def test_every_public_method_and_property_has_a_docstring(name):
    bare = [member for member, of in members_of(NAMES[name]) if not (of.__doc__ or "").strip()]
    assert set(bare) <= {"shape"}  # which says itself


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
