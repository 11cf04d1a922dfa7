"""What a pickle has made, held against limits before it is handed over."""

from typing import Any

import numpy as np

from millisight.core import Limits

_ATOMS = (str, bytes, bytearray, int, float, complex, type(None), np.generic, np.dtype)


class Refused(Exception):
    """What a pickle asks for and is not given."""


def checked_content(root: Any, limits: Limits) -> Any:
    """`root`, which may hold plain values and arrays alone, not itself, and not be deeper or larger than expected.

    A file of a few bytes can hold a list that twice holds a list that twice holds ...: whoever runs through it later
    would not come to an end. So sizes are summed as if nothing were shared.
    """
    found: dict[int, tuple[int, int] | None] = {}  # bytes and depth of a container; None while it is open
    todo = [(root, False)]
    while todo:
        item, closing = todo.pop()
        if isinstance(item, _ATOMS):
            continue
        if not closing:
            if found.get(id(item), ()) is None:
                raise Refused("a container that holds itself")
            if id(item) not in found:  # seen before it is looked into: it may be long, and shared many times
                found[id(item)] = None
                todo.append((item, True))
                todo.extend((part, False) for part in _content(item))
            continue
        inside = _content(item)
        parts = [found[id(part)] or (0, 0) for part in inside if not isinstance(part, _ATOMS)]
        size = 8 * (1 + len(inside)) + sum(part[0] for part in parts)
        size += item.nbytes if isinstance(item, np.ndarray) else 0
        depth = 1 + max((part[1] for part in parts), default=0)
        if depth > limits.depth:
            raise Refused(f"containers inside containers, {depth} deep; expected at most {limits.depth}")
        if size > limits.content:
            raise Refused(
                f"content of {size} bytes, its shared parts counted each time; expected at most {limits.content}"
            )
        found[id(item)] = size, depth
    return root


def _content(item: Any) -> list[Any]:
    """The items inside a container."""
    if isinstance(item, dict):
        return list(item.values())
    if isinstance(item, np.ndarray):
        return list(item.flat) if item.dtype.hasobject else []
    if isinstance(item, list | tuple | set | frozenset):
        return list(item)
    raise Refused("a global or an unfinished array in the place of a value")
