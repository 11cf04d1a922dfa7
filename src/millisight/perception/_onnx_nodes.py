"""What an ONNX file would run, read from its bytes, before ONNX Runtime sees it.

The file is protocol buffers; the numbers of the fields are those of `onnx.proto3`: a model holds a graph (7) and
functions (25), both hold nodes (1 and 7), a node has an operator (4), a domain (7) and attributes (5), and these hold
graphs (6, 11). Tensors are in graphs (5; sparse ones, of two, 15) and in attributes (5, 10; 22, 23), functions have
attributes (11); a tensor may name a file that its numbers are to be read from (13).
"""

from collections.abc import Iterator

_PARTS = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node", 11: "attribute"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
_OPERATOR, _DOMAIN = 4, 7  # of a node
_ELSEWHERE = 13  # of a tensor
_DEEPEST = 20


def operators(content: bytes) -> set[tuple[str, str]]:
    """(domain, operator) of every node, those of functions and of graphs inside nodes too.

    Raises
    ------
    ValueError
        The bytes are no protocol buffers, nest too deep, or have numbers read from another file.
    """
    found: set[tuple[str, str]] = set()
    pending = [("model", memoryview(content), 0)]
    while pending:
        kind, message, depth = pending.pop()
        if depth > _DEEPEST:
            raise ValueError(f"graphs inside graphs, more than {_DEEPEST} deep")
        operator = domain = ""
        for number, value in _fields(message):
            if number in _PARTS[kind]:
                pending.append((_PARTS[kind][number], value, depth + 1))
            elif kind == "node" and number == _OPERATOR:
                operator = bytes(value).decode("utf-8", "replace")
            elif kind == "node" and number == _DOMAIN:
                domain = bytes(value).decode("utf-8", "replace")
            elif kind == "tensor" and number == _ELSEWHERE:
                raise ValueError("it has numbers read from another file, which no checksum covers")
        if kind == "node":
            found.add((domain, operator))
    return found


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Number and bytes of the fields of a message that have a length; numbers are skipped."""
    place = 0
    while place < len(message):
        key, place = _number(message, place)
        match key & 7:
            case 0:
                _, place = _number(message, place)
            case 1:
                place += 8
            case 5:
                place += 4
            case 2:
                length, place = _number(message, place)
                if place + length > len(message):
                    raise ValueError("a field reaches beyond its message")
                yield key >> 3, message[place : place + length]
                place += length
            case kind:
                raise ValueError(f"a field of the kind {kind}")


def _number(message: memoryview, place: int) -> tuple[int, int]:
    """A number in groups of seven bits, the lowest first; and where it ends."""
    number = 0
    for shift in range(0, 70, 7):
        if place >= len(message):
            raise ValueError("it ends within a number")
        byte = message[place]
        place += 1
        number |= (byte & 0x7F) << shift
        if byte < 0x80:
            return number, place
    raise ValueError("a number of more than 64 bits")
