"""RTDE's packages on the wire: Universal Robots' "Real-Time Data Exchange (RTDE) Guide", protocol version 2.

A package is its size with this header (u16), its type (u8), and a payload; all numbers are big-endian.
"""

import struct
from typing import NamedTuple

RTDE_PORT, SCRIPT_PORT = 30004, 30002

REQUEST_VERSION, GET_CONTROLLER_VERSION, TEXT_MESSAGE = ord("V"), ord("v"), ord("M")
DATA, SETUP_OUTPUTS, SETUP_INPUTS = ord("U"), ord("O"), ord("I")
START, PAUSE = ord("S"), ord("P")

VERSION = 2
_HEAD = struct.Struct(">HB")
_FORMATS = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d",
    "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip

OUTPUTS = {
    "timestamp": "DOUBLE",
    "actual_TCP_pose": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "runtime_state": "UINT32",
}
"""What is asked for, and of which type it is; an integer register comes besides."""

SAFETY = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop", 6: "system emergency stop",
    7: "robot emergency stop", 8: "violation", 9: "fault",
}  # fmt: skip
FREE_TO_MOVE = (1, 2)
ROBOT_RUNNING = 7
STOPPED, PLAYING = 1, 2


class Package(NamedTuple):
    """A package, without its header."""

    kind: int
    payload: bytes


def packed(kind: int, payload: bytes = b"") -> bytes:
    """A package as it is sent."""
    return _HEAD.pack(_HEAD.size + len(payload), kind) + payload


def taken(buffer: bytearray) -> Package | None:
    """The first whole package of `buffer`, from which it is removed; None: there is none yet."""
    if len(buffer) < _HEAD.size:
        return None
    size, kind = _HEAD.unpack_from(buffer)
    size = max(size, _HEAD.size)
    if len(buffer) < size:
        return None
    package = Package(kind, bytes(buffer[_HEAD.size : size]))
    del buffer[:size]
    return package


def data_format(types: list[str]) -> struct.Struct:
    """Of the payload of data packages: the recipe's number, and the values of these types."""
    return struct.Struct(">B" + "".join(_FORMATS[kind] for kind in types))
