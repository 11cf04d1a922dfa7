"""The limits that every reader shares."""

import os
import time
import tracemalloc

import pytest

from millisight.core import limits_of, parsed_toml, read_json, sealed
from millisight.core.errors import DamagedFileError, UnknownNameError
from millisight.datasets._convert import _read_cache
from millisight.datasets._hub_card import _info
from millisight.datasets._runner import _read_cached
from millisight.datasets.generation._ledger import JOURNAL_NAME, _journal
from millisight.rig._rows import _rows_listed
from millisight.rig.virtual import RadarSettings, World


def test_limits_follow_the_size_of_the_file():
    small, large = limits_of(0), limits_of(10**9)
    assert small.content < 1e8
    assert small.unpacked < 1e8
    assert (large.content, large.unpacked) == pytest.approx((16e9, 1e11), rel=0.01)
    assert large.items > small.items == 1_000_000
    assert small.seconds == 60
    assert large.seconds == 110


@pytest.mark.parametrize(
    "text",
    [
        "a." * 40_000 + "a = 1",
        '"x".' * 20_000 + "a = 1",
        "[" + "a . " * 20_000 + "a]",
        "t = {" + "a." * 40_000 + "a = 1}",
        r'"\"".' * 26_000 + "a = 1",
        r'"\\" . ' * 20_000 + "a = 1",
    ],
    ids=["key", "quoted", "table", "inline", "escaped", "backslash"],
)
def test_a_deep_key_is_refused_before_it_is_parsed(text):
    """80 kB took 6 GB and a minute."""
    tracemalloc.start()
    began = time.process_time()
    with pytest.raises(ValueError, match="a key of more than 100 parts"):
        parsed_toml(text)
    assert time.process_time() - began < 1
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    "text",
    [
        "a" * 1_000_000,
        '"' * 1_000_000,
        "a " * 500_000,
        "a. " * 50,
        "'a'" * 300_000,
        '"' + r"\"" * 500_000,
        '"' + "\\" * 1_000_001,
        "'a'.\"" + r"\"'a'." * 150_000,
    ],
)
def test_the_search_for_deep_keys_takes_no_time_of_its_own(text):
    began = time.process_time()
    try:
        parsed_toml(text)
    except ValueError as error:
        assert "100 parts" not in str(error)  # noqa: PT017
    else:
        pytest.fail("this is no TOML")
    assert time.process_time() - began < 2


def test_keys_of_some_parts_are_read():
    assert parsed_toml("a.b.'c d'.e = 1.5 # 1.2.3") == {"a": {"b": {"c d": {"e": 1.5}}}}
    assert parsed_toml(f"a = [{'0.25, ' * 1000}]")["a"] == [0.25] * 1000


@pytest.fixture
def large(tmp_path):
    """A file of 65 MiB, which takes no place on the disk, under the names of what millisight keeps for itself."""
    path = tmp_path / "rows.json"
    path.touch()
    os.truncate(path, 65 << 20)
    return path


def test_json_that_is_too_large_is_not_parsed(large, monkeypatch):
    monkeypatch.setattr("json.loads", lambda *_: pytest.fail("it was parsed"))
    with pytest.raises(ValueError, match="more than 64 MiB"):
        read_json(large)
    assert _read_cache(large) == ({}, set())
    assert _read_cached(large, "key") is None
    with pytest.raises(DamagedFileError, match=r"rows\.json is damaged: it has more than 64 MiB"):
        _rows_listed(large.parent, ["77_ghz"])
    with pytest.raises(DamagedFileError, match=r"rows\.json of .* cannot be read: it has more than 64 MiB"):
        _info(large)


def test_a_journal_is_read_a_bounded_line_at_a_time(large):
    large.rename(large.parent / JOURNAL_NAME)
    with open(large.parent / JOURNAL_NAME, "ab") as file:
        file.write(f"\n{sealed('[]')}\n".encode())
    tracemalloc.start()
    assert list(_journal(large.parent)) == [[]]
    assert tracemalloc.get_traced_memory()[1] < 60e6
    tracemalloc.stop()


def test_long_values_are_cut_in_messages():
    with pytest.raises(UnknownNameError, match=r"unknown segmenter 'aaa.*'\.\.\. \(1000000 characters\)") as told:
        raise UnknownNameError("segmenter", "a" * 1_000_000, ["wave"])
    assert len(str(told.value)) < 400
    radar = RadarSettings(preset="position2go", frame_period=0.02)
    with pytest.raises(ValueError, match="the radars' files go to") as refused:
        World(radars=(radar,) * 20_000)
    assert len(str(refused.value)) < 400
