"""The limits that every reader shares."""

import time
import tracemalloc

import pytest

from millisight.core import limits_of, parsed_toml


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
    began = time.perf_counter()
    with pytest.raises(ValueError, match="a key of more than 100 parts"):
        parsed_toml(text)
    assert time.perf_counter() - began < 1
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
    began = time.perf_counter()
    try:
        parsed_toml(text)
    except ValueError as error:
        assert "100 parts" not in str(error)  # noqa: PT017
    else:
        pytest.fail("this is no TOML")
    assert time.perf_counter() - began < 2


def test_keys_of_some_parts_are_read():
    assert parsed_toml("a.b.'c d'.e = 1.5 # 1.2.3") == {"a": {"b": {"c d": {"e": 1.5}}}}
    assert parsed_toml(f"a = [{'0.25, ' * 1000}]")["a"] == [0.25] * 1000
