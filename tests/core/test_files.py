"""Text files that hold records: what no reader takes."""

import os

import pytest

from millisight.core import check_writable, checked_integer, checked_number, read_toml
from millisight.core.errors import FileError, FormatError, InputError
from millisight.io.description import read

# The last one Python reads, since it is no decimal; but it prints no number of so many digits.
TOO_LONG = {"65 bits": str(1 << 64), "4 300 digits": "1" * 4300, "5 000 digits": "1" * 5000, "hex": "0x" + "f" * 5000}


@pytest.mark.parametrize("kind", TOO_LONG)
def test_integers_longer_than_any_array_holds_are_refused(tmp_path, kind):
    path = tmp_path / "long.toml"
    for text in ("seed = {}", "[[a.b]]\nc = [1, {{d = -{}}}]"):
        if kind == "hex" and "-" in text:
            continue  # no TOML
        path.write_text(text.format(TOO_LONG[kind]))
        with pytest.raises(
            FormatError, match=r"long\.toml is not valid TOML: .*(64 bits at most|4300 digits)"
        ) as caught:
            read_toml(path, "a recipe")
        assert len(str(caught.value)) < 500
        with pytest.raises(FormatError, match=r"long\.toml is not a description in TOML"):
            read(path)
    path.write_text(f"seed = {(1 << 64) - 1}")
    assert read_toml(path, "a recipe") == {"seed": (1 << 64) - 1}


@pytest.mark.parametrize("value", [1 << 64, -(1 << 64), 10**400, 10**5000], ids=["65", "-65", "400", "5000"])
def test_checks_of_numbers_take_any_integer(value):
    with pytest.raises(InputError, match=r"n is -?2\^\d+ or more; expected a whole number of at least 1"):
        checked_integer(value, name="n")
    if abs(value) > 10**308:
        with pytest.raises(InputError, match=r"n is 2\^\d+ or more; expected a number in m"):
            checked_number(value, name="n", unit="m")


def test_a_file_that_may_not_be_written_is_refused_before_the_work(tmp_path, monkeypatch):
    """As it is for all but root, who may write anything."""
    monkeypatch.setattr(os, "access", lambda path, mode: bool(os.stat(path).st_mode & 0o200))
    path = tmp_path / "old.h5"
    path.touch()
    check_writable(path)
    path.chmod(0o444)
    with pytest.raises(FileError, match=r"old\.h5: it is read-only; choose another name"):
        check_writable(path)
    assert [one.name for one in tmp_path.iterdir()] == ["old.h5"]
