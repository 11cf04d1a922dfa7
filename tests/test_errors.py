"""What the errors say where a name is not known."""

import copy

import pytest

from millisight.core import errors
from millisight.core.errors import MillisightError, UnknownNameError

FEW = ["cpu", "cuda"]
MANY = [f"{letter}_cups" for letter in "abcdefghijklmnopqrstuvwxyz"]


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("CUD", FEW, "unknown device 'CUD'. Did you mean 'cuda'? Known: cpu, cuda."),
        ("x", FEW, "unknown device 'x'. Known: cpu, cuda."),
        ("h_cup", [*MANY, "mug"], "unknown device 'h_cup'. Did you mean 'h_cups' or 'z_cups' or 'y_cups'?"),
        ("mugg", [*MANY, "Mug"], "unknown device 'mugg'. Did you mean 'Mug'?"),
        ("?", MANY, f"unknown device '?'. Known: {', '.join(MANY)}."),
    ],
)
def test_close_names_come_first_and_a_long_list_only_without_one(name, known, expected):
    assert str(UnknownNameError("device", name, reversed(known))) == expected
    assert str(UnknownNameError("device", name, known, advice="Ask.")) == f"{expected} Ask."


def test_a_long_message_keeps_its_beginning_and_its_end():
    error = errors.InputError(f"name is {'x' * 100_000}; expected less").at("a.toml")
    assert len(str(error)) < 5000
    assert str(error).startswith("a.toml: name is xxx")
    assert str(error).endswith("xxx; expected less")
    assert " characters ...] " in str(error)
    assert str(copy.copy(error)) == str(error)


@pytest.mark.parametrize("kind", [kind for kind in vars(errors).values() if isinstance(kind, type)])
def test_every_kind_can_name_a_place_and_go_to_another_process(kind):
    if not issubclass(kind, MillisightError):
        return
    error = kind("device", "CUD", FEW) if kind is UnknownNameError else kind("it is damaged")
    placed = error.at("files[0]")
    for one, text in ((placed, f"files[0]: {error}"), (copy.copy(error), str(error))):
        assert type(one) is kind
        assert str(one) == text
