"""What reading a file may take: one measure for every reader, derived from the file's own size."""

from typing import NamedTuple


class Limits(NamedTuple):
    """What a reader refuses to go beyond, before it allocates or parses.

    Attributes
    ----------
    content : bytes of what is made from the file
    unpacked : bytes that a compressed file may unpack to, unless its user allows more
    items : objects, entries, or steps of a program
    depth : of containers inside containers, tables inside tables, nodes below nodes
    seconds : that a process which reads the file is given
    """

    content: int
    unpacked: int
    items: int
    depth: int
    seconds: float


def limits_of(size: int) -> Limits:
    """The limits for a file of `size` bytes."""
    return Limits(
        content=16 * size + (1 << 26),
        unpacked=max(100 * size, 1 << 26),
        items=max(1_000_000, size // 64),
        depth=100,
        seconds=60 + size / 20e6,
    )
