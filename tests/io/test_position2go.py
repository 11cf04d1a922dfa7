"""Position2Go text: whole frames come back bit for bit, and nothing becomes zeros."""

import random
import time

import numpy as np
import pytest

from millisight.core.errors import DamagedFileError, FormatError, InputError, MillisightError
from millisight.io.raw import read_position2go, write_position2go

SHAPE = (3, 2, 2, 8)
SIZES = {"samples": 8, "chirps": 2}


@pytest.fixture
def small(tmp_path):
    """A file of three frames of two chirps: 24 rows of 8 numbers, and what it holds."""
    frames = np.random.default_rng(0).random((*SHAPE, 2)).astype(np.float32).view(np.complex64)[..., 0]
    write_position2go(tmp_path / "small.txt", frames)
    return tmp_path / "small.txt", frames


def test_round_trip_is_bit_for_bit(small):
    path, frames = small
    raw = read_position2go(path, **SIZES)
    assert raw.samples.dtype == np.complex64
    assert (raw.samples == frames).all()
    assert raw.order is None
    assert raw.lost.tolist() == [False] * 3


def test_rows_stand_as_the_protocol_says(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("1,2\n3,4\n5,6\n7,8\n")  # I-RX1, Q-RX1, I-RX2, Q-RX2
    assert read_position2go(path, samples=2, chirps=1).samples.tolist() == [[[[1 + 3j, 2 + 4j], [5 + 7j, 6 + 8j]]]]
    assert read_position2go(path, samples=2, chirps=2, receivers=1).samples.shape == (1, 2, 1, 2)
    assert read_position2go(path, samples=2, chirps=1, receivers=1).samples.shape == (2, 1, 1, 2)
    write_position2go(path, np.array([[[[4095 + 1j]]]]))
    assert path.read_text() == "4095\n1\n"


def test_ways_to_write_the_same(tmp_path):
    path = tmp_path / "a.txt"
    for text in ("1,2\n-3e0,4\n", "1, 2\r\n -3.0 ,4\r\n\r\n", "\ufeff1,2,\n-3,4,\n\n\n", "1,2\n-3,4"):
        path.write_bytes(text.encode())
        assert read_position2go(path, samples=2, chirps=1, receivers=1).samples.tolist() == [[[[1 - 3j, 2 + 4j]]]]


@pytest.mark.parametrize(("edit", "error", "words"), [
    (lambda rows: [], DamagedFileError, "has 0 rows; expected whole frames of 8 rows"),
    (lambda rows: rows[:-1], DamagedFileError, "has 23 rows; .* 2 are whole, 7 rows are left over"),
    (lambda rows: [*rows, rows[0]], DamagedFileError, "has 25 rows"),
    (lambda rows: [*rows[:9], rows[9].rsplit(",", 1)[0], *rows[10:]], DamagedFileError, "line 10 has 7 cells"),
    (lambda rows: [*rows[:9], rows[9] + ",1", *rows[10:]], DamagedFileError, "line 10 has 9 cells; expected 8"),
    (lambda rows: [*rows[:9], "", *rows[9:]], DamagedFileError, "line 10 is empty"),
    (lambda rows: [*rows[:9], "1,2,nan,4,5,6,7,8", *rows[10:]], FormatError, "line 10, cell 3 is 'nan'"),
    (lambda rows: [*rows[:9], "1,2,3,4,5,6,7,inf", *rows[10:]], FormatError, "line 10, cell 8 is 'inf'"),
    (lambda rows: [*rows[:9], "1,2,3,,5,6,7,8", *rows[10:]], FormatError, "line 10, cell 4 is ''"),
    (lambda rows: [*rows[:9], "1,two,3,4,5,6,7,8", *rows[10:]], FormatError, "line 10, cell 2 is 'two'"),
    (lambda rows: [*rows[:9], "1,2e39,3,4,5,6,7,8", *rows[10:]], FormatError, "line 10, cell 2 is '2e39'"),
    (lambda rows: [*rows[:9], "1,0x2,3,4,5,6,7,8", *rows[10:]], FormatError, "line 10, cell 2 is '0x2'"),
    (lambda rows: ["a,b,c,d,e,f,g,h", *rows], FormatError, "line 1, cell 1 is 'a'"),
    (lambda rows: ["x" * 2000, *rows], DamagedFileError, "line 1 has 1 cells"),
    (lambda rows: ["1,2,3,4,5,6,7," + "8" * 2000, *rows], DamagedFileError, "line 1 has more than 512 characters"),
    (lambda rows: ["\0\1\2", *rows], DamagedFileError, "line 1 has 1 cells"),
])  # fmt: skip
def test_damage_is_named_with_its_line(small, edit, error, words):
    path, _ = small
    path.write_text("".join(row + "\n" for row in edit(path.read_text().splitlines())))
    with pytest.raises(error, match=words) as caught:
        read_position2go(path, **SIZES)
    assert str(caught.value).startswith("small.txt ")


def test_what_cannot_be_written_is_refused(tmp_path):
    for frames in (np.zeros((2, 4)), np.full(SHAPE, np.nan), np.zeros((0, 1, 1, 1)), np.full(SHAPE, "a")):
        with pytest.raises(InputError, match="samples"):
            write_position2go(tmp_path / "a.txt", frames)
    assert not (tmp_path / "a.txt").exists()


@pytest.mark.slow
def test_a_published_file_is_read_in_a_second(tmp_path):
    frame = np.random.default_rng(0).random((1, 16, 2, 256)) * (1 + 1j)
    write_position2go(tmp_path / "a.txt", frame)
    (tmp_path / "a.txt").write_text((tmp_path / "a.txt").read_text() * 110)
    started = time.process_time()
    raw = read_position2go(tmp_path / "a.txt")
    assert time.process_time() - started < 4  # 0.4 s on an idle machine
    assert raw.samples.shape == (110, 16, 2, 256)
    assert (raw.samples == frame.astype(np.complex64)).all()


def test_mutations_end_in_our_errors(small):
    path, _ = small
    good, draw = path.read_bytes(), random.Random(0)
    ends = []
    for _ in range(300):
        data = bytearray(good)
        for _ in range(draw.randrange(1, 4)):
            at = draw.randrange(len(data))
            data[at : at + draw.choice([0, 1, 3, 90])] = draw.choice([b"", b"7", b",", b"\n", b"-", b"\xff", b"9" * 90])
        path.write_bytes(bytes(data))
        try:
            ends.append(bool(np.isfinite(read_position2go(path, **SIZES).samples).all()))
        except MillisightError as error:
            ends.append("small.txt" in str(error))
    assert len(ends) == 300
    assert all(ends)


@pytest.mark.parametrize("scale", [3, 300, 2**15, 1e5, 0.5])
def test_numbers_are_written_as_nine_digits_have_them_whole_or_not(tmp_path, scale):
    """Whole ones come from a table; what is empty is filled up with zeros that have no sign."""
    rng = np.random.default_rng(8)
    parts = np.rint(rng.normal(size=(5, 2, 2, 9, 2))) * scale
    frames = np.conj(parts[..., 0] + 1j * parts[..., 1]).astype(np.complex64)
    frames[3] = np.conj(0j)
    write_position2go(tmp_path / "frames.txt", frames)
    rows = np.stack([frames.real, frames.imag], axis=-2).reshape(-1, 9)
    lines = (tmp_path / "frames.txt").read_text().splitlines()
    assert len(lines) == len(rows)
    for line, row in zip(lines, rows, strict=True):
        assert line == ",".join(["%.9g" % (value if row.any() else 0) for value in row.tolist()])
    assert np.array_equal(read_position2go(tmp_path / "frames.txt", samples=9, chirps=2).samples, frames)
