"""The DCA1000's commands on the wire.

Codes, fields and their order are those of TI's "DCA1000EVM Data Capture Card User's Guide" (SPRUIJ4A), sections 5 and
6, and of the constants of TI's command-line tool for it. All numbers are little-endian.

    request    header 0xA55A, code, number of data bytes, data, footer 0xEEAA
    reply      header 0xA55A, code, status, footer 0xEEAA
"""

import struct
from enum import IntEnum

HEADER, FOOTER = 0xA55A, 0xEEAA
COMMAND_PORT = 4096
_MOST = 504  # data bytes
_PACKET_BYTES = 1470
_CLOCK_NS = 8  # of the FPGA, in which the delay between packets is counted


class Code(IntEnum):
    """Commands of the card."""

    RESET_FPGA = 0x01
    RESET_AR_DEV = 0x02
    CONFIG_FPGA_GEN = 0x03
    CONFIG_EEPROM = 0x04
    RECORD_START = 0x05
    RECORD_STOP = 0x06
    PLAYBACK_START = 0x07
    PLAYBACK_STOP = 0x08
    SYSTEM_CONNECT = 0x09
    SYSTEM_ERROR = 0x0A  # never asked for: the card tells it
    CONFIG_PACKET_DATA = 0x0B
    CONFIG_DATA_MODE_AR_DEV = 0x0C
    INIT_FPGA_PLAYBACK = 0x0D
    READ_FPGA_VERSION = 0x0E


ALARMS = (
    "no LVDS data: the radar does not run, its LVDS output is off, or the cable between the boards is loose",
    "no header in the data: the card expects a header, the radar sends none",
    "its EEPROM failed",
    "an SD card was detected",
    "the SD card was removed",
    "the SD card is full",
    "the mode of the card's switches contradicts the command: set SW2.5 to CONFIG_VIA_SW",
    "its memory is full: the network is too slow, make packet_delay_us smaller",
    "the recording is complete",
    "its LVDS buffer is full: the radar sends faster than the network takes, make the frame period longer",
    "the playback is complete",
    "the playback is out of sequence",
)
"""What a status of SYSTEM_ERROR means, by its bit."""

HARMLESS = frozenset({3, 4, 8, 10})
"""Bits of `ALARMS` that are no errors."""


def request(code: Code, data: bytes = b"") -> bytes:
    """A command as it is sent."""
    return struct.pack("<HHH", HEADER, code, len(data)) + data + struct.pack("<H", FOOTER)


def parse_request(packet: bytes) -> tuple[int, bytes] | None:
    """Code and data of a command; None: it is none."""
    if len(packet) < 8:
        return None
    header, code, size = struct.unpack_from("<HHH", packet)
    if header != HEADER or size > _MOST or len(packet) != 8 + size or packet[-2:] != struct.pack("<H", FOOTER):
        return None
    return code, packet[6 : 6 + size]


def reply(code: int, status: int = 0) -> bytes:
    """What the card answers."""
    return struct.pack("<HHHH", HEADER, code, status, FOOTER)


def parse_reply(packet: bytes) -> tuple[int, int] | None:
    """Code and status of an answer; None: it is none."""
    if len(packet) != 8:
        return None
    header, code, status, footer = struct.unpack("<HHHH", packet)
    return (code, status) if (header, footer) == (HEADER, FOOTER) else None


def fpga_settings(*, lanes: int) -> bytes:
    """Data of CONFIG_FPGA_GEN: raw mode, `lanes` LVDS lanes, capture to Ethernet, 16 bits, 30 s to "no LVDS data"."""
    return struct.pack("<6B", 1, 1 if lanes == 4 else 2, 1, 2, 3, 30)


def packet_settings(*, delay_us: float) -> bytes:
    """Data of CONFIG_PACKET_DATA: the time between two packets [us]."""
    return struct.pack("<HHH", _PACKET_BYTES, round(delay_us * 1000 / _CLOCK_NS), 0)


def version(status: int) -> str:
    """The FPGA's version from the status of READ_FPGA_VERSION."""
    return f"{status & 0x7F}.{status >> 7 & 0x7F}{', in playback mode' if status & 0x4000 else ''}"


def version_status(major: int, minor: int) -> int:
    """The inverse of `version`."""
    return major | minor << 7
