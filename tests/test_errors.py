"""What the errors say where a name is not known."""

import pytest

from millisight.core.errors import UnknownNameError

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
