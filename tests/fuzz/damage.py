"""Damage to files, drawn by a plain generator of random numbers; cheap, so that most of the time goes to the readers.

Bytes are changed, cut out, doubled, inserted, the end cut off; numbers in text become extreme ones, and numbers in
binary a little larger or smaller, or the edge of what they hold; brackets are opened 20 000 times; parts are exchanged,
overwritten by others, filled or joined anew; lines and words change places.
"""

import random
import re
from collections.abc import Callable

EXTREME = (
    b"0",
    b"-1",
    b"1e308",
    b"-1e400",
    b"nan",
    b"inf",
    b"99999999999999999999",
    b"1e-320",
    b"3.4e38",
    b"-1e38",
    b"1e-45",
    b"-0.0",
    b"9" * 4301,
    b'"',
    b"",
    b"[",
    b"{",
    b"true",
    b"x",
)
LARGE = (b"\xff" * 4, b"\xff" * 8, b"\x7f\xff\xff\xff", bytes(8))
NUMBER, WORD = re.compile(rb"[-+]?\d[\d.e+]*"), re.compile(rb"[\w.+-]+")


def damaged(valid: bytes, header: int, *, text: bool, rng: random.Random) -> bytes:
    """The valid file after one to five pieces of damage, three in four of them behind the header."""
    data, kinds = bytearray(valid), OF_TEXT if text else OF_ALL
    for _ in range((1, 1, 2, 5)[_below(4, rng)]):
        first = min(header, len(data) - 1) if rng.random() < 0.75 else 0
        if len(data) - first > 1:
            kinds[_below(len(kinds), rng)](data, first, rng)
    return bytes(data)


def _below(count: int, rng: random.Random) -> int:
    """Like `randrange`, several times as fast."""
    return int(rng.random() * count)


def _place(data: bytearray, first: int, size: int, rng: random.Random) -> int:
    """Where `size` bytes are, or one."""
    return first + _below(max(len(data) - first - size, 0) + 1, rng)


def _set(data: bytearray, first: int, rng: random.Random) -> None:
    size = 1 + _below(8, rng)
    at = _place(data, first, 1, rng)
    data[at : at + size] = rng.randbytes(size)


def _flipped(data: bytearray, first: int, rng: random.Random) -> None:
    data[_place(data, first, 1, rng)] ^= 1 << _below(8, rng)


def _cut(data: bytearray, first: int, rng: random.Random) -> None:
    at = _place(data, first, 1, rng)
    del data[at : at + 1 + _below(64, rng)]


def _inserted(data: bytearray, first: int, rng: random.Random) -> None:
    at = _place(data, first, 0, rng)
    data[at:at] = rng.randbytes(1 + _below(32, rng))


def _doubled(data: bytearray, first: int, rng: random.Random) -> None:
    at = _place(data, first, 1, rng)
    data[at:at] = data[at : at + 1 + _below(200, rng)]


def _ended(data: bytearray, first: int, rng: random.Random) -> None:
    del data[_place(data, first, 1, rng) :]


def _large(data: bytearray, first: int, rng: random.Random) -> None:
    what = LARGE[_below(len(LARGE), rng)]
    at = _place(data, first, 1, rng)
    data[at : at + len(what)] = what


def _nested(data: bytearray, first: int, rng: random.Random) -> None:
    """Brackets opened; seldom so many that they make the file large, which takes long to read."""
    at = _place(data, first, 0, rng)
    data[at:at] = (b"[", b'{"a":', b"a.", b"(")[_below(4, rng)] * (20_000 if rng.random() < 0.05 else 90)


def _counted(data: bytearray, first: int, rng: random.Random) -> None:
    """A number in binary, a little larger or smaller, or at the edge of what it holds."""
    size = min((1, 2, 4, 8)[_below(4, rng)], len(data) - first)
    at, order, most = _place(data, first, size, rng), "little" if rng.random() < 0.5 else "big", 1 << 8 * size
    held = int.from_bytes(data[at : at + size], order) + _below(71, rng) - 35
    held = (held, held, held, most // 2, most // 2 - 1, most - 1)[_below(6, rng)]
    data[at : at + size] = (held % most).to_bytes(size, order)


def _exchanged(data: bytearray, first: int, rng: random.Random) -> None:
    size = 1 + _below(min(64, (len(data) - first) // 2), rng)
    one, other = _place(data, first, size, rng), _place(data, first, size, rng)
    data[one : one + size], data[other : other + size] = data[other : other + size], data[one : one + size]


def _overwritten(data: bytearray, first: int, rng: random.Random) -> None:
    """A part by another part of the file, which stays where it is as well."""
    size = 1 + _below(min(256, len(data) - first), rng)
    to, taken = _place(data, first, size, rng), _place(data, 0, size, rng)
    data[to : to + size] = data[taken : taken + size]


def _filled(data: bytearray, first: int, rng: random.Random) -> None:
    size = 1 + _below(min(8 if rng.random() < 0.5 else 512, len(data) - first), rng)
    at = _place(data, first, size, rng)
    data[at : at + size] = bytes([(0, 1, 0x20, 0x7F, 0x80, 0xFF)[_below(6, rng)]]) * size


def _joined(data: bytearray, first: int, rng: random.Random) -> None:
    """The file up to a place, and from another place on."""
    end, start = _place(data, first, 0, rng), _below(len(data), rng)
    data[end:] = data[start:]


def _lines(data: bytearray, first: int, rng: random.Random) -> None:
    """A line gone, doubled, or in another's place."""
    lines = data.split(b"\n")
    at, other = lines[i := _below(len(lines), rng)], lines[_below(len(lines), rng)]
    lines[i : i + 1] = ([], [at, at], [other], [at + other])[_below(4, rng)]
    data[:] = b"\n".join(lines) or b"\n"


_LONG = 20_000  # bytes of a word


def _words(data: bytearray, first: int, rng: random.Random) -> None:
    """A word or a number in another's place, or an extreme number."""
    one = WORD.search(data, _place(data, first, 1, rng))
    other = WORD.search(data, _place(data, 0, 1, rng))
    if one and other:
        word, which = other.group(), _below(5, rng)
        long = word * 40 if len(word) < _LONG else word  # or a few of these in turn would take all memory
        data[slice(*one.span())] = word if which < 3 else long if which < 4 else _extreme(rng)


def _numbers(data: bytearray, first: int, rng: random.Random) -> None:
    if found := NUMBER.search(data, _place(data, first, 1, rng)):
        data[slice(*found.span())] = _extreme(rng)


def _extreme(rng: random.Random) -> bytes:
    return EXTREME[_below(len(EXTREME), rng)]


OF_ALL: tuple[Callable[[bytearray, int, random.Random], None], ...] = (
    _set,
    _flipped,
    _cut,
    _inserted,
    _doubled,
    _ended,
    _large,
    _nested,
    *(_counted, _exchanged, _overwritten, _filled, _joined) * 2,
)
OF_TEXT = OF_ALL + (_words, _words, _numbers, _numbers, _lines) * 3
