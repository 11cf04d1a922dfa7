"""The DCA1000's UDP packets, put back in order: nothing that is lost, late or wild goes unsaid.

A packet's payload is a sequence number (u32, from 1), the number of bytes sent before it (u48), both little-endian,
and up to 1456 bytes of data (protocol of the TI DCA1000EVM, raw mode). No packet marks where a frame begins.
"""

import os
from collections.abc import Iterable, Iterator
from typing import BinaryIO, Literal

from millisight.core import check_readable, checked_integer, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError
from millisight.io.raw._raw_frames import Gap

DATA_PORT = 4098
HEADER_BYTES = 10

_REASON = "lost packets"


def assemble_packets(packets: Iterable[bytes], *, max_lost: int = 1 << 26) -> tuple[bytes, tuple[Gap, ...]]:
    """The recording that UDP payloads make up, each at the place that its byte count names, and its gaps.

    Packets may come late, twice or never; missing stretches hold zeros and are gaps. A payload that cannot be right,
    or whose place would leave more than `max_lost` bytes unaccounted for, is refused and is a gap of length 0. Memory
    is bounded by what came and `max_lost`.

    Parameters
    ----------
    packets : payloads with their headers, in the order in which they came
    max_lost : the most bytes that may be missing in all, 64 MiB (about a second at the card's full rate)

    Raises
    ------
    InputError
        A packet is not bytes.
    DamagedFileError
        There was none, or all were refused.
    """
    max_lost = checked_integer(max_lost, name="max_lost", minimum=0)
    recording = bytearray()
    came: dict[int, int] = {}  # where packets begin -> where they end
    received = 0
    refused: list[Gap] = []
    for packet in packets:
        if not isinstance(packet, bytes | bytearray | memoryview):
            raise InputError(f"a packet is of type {type(packet).__name__}; expected bytes")
        number, start = int.from_bytes(packet[:4], "little"), int.from_bytes(packet[4:HEADER_BYTES], "little")
        data = packet[HEADER_BYTES:]
        stop = start + len(data)
        if came.get(start, -1) >= stop:
            continue
        if not data or stop - received - len(data) > max_lost:
            reason = f"packet {number} refused: " + (
                f"{len(packet)} bytes, no data behind the header"
                if not data
                else f"byte count {start} is far too large"
            )
            refused.append(Gap(start=len(recording), length=0, reason=reason))
            continue
        recording.extend(bytes(max(0, stop - len(recording))))
        recording[start:stop] = data
        received += stop - max(start, came.get(start, start))
        came[start] = stop
    if not came:
        told = f", the first: {refused[0].reason}" if refused else ""
        raise DamagedFileError(f"no packet with data in {len(refused)} packets{told}")
    gaps, end = [], 0
    for start, stop in sorted(came.items()):
        if start > end:
            gaps.append(Gap(start=end, length=start - end, reason=_REASON))
        end = max(end, stop)
    return bytes(recording), tuple(sorted([*gaps, *refused], key=lambda gap: gap.start))


# Bytes before the IP header, by a capture's link type: Ethernet, raw IP, Linux "any" (two versions).
_LINKS = {1: 14, 101: 0, 113: 16, 276: 20}
_MAGIC: dict[bytes, Literal["little", "big"]] = {
    b"\xd4\xc3\xb2\xa1": "little",  # microseconds
    b"\x4d\x3c\xb2\xa1": "little",  # nanoseconds
    b"\xa1\xb2\xc3\xd4": "big",
    b"\xa1\xb2\x3c\x4d": "big",
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_MOST_EMPTY = 1000  # packets in a row, as zeros are
_MAX_PACKET = 1 << 18


def is_pcap(path: str | os.PathLike[str]) -> bool:
    """Whether a file begins as captures of packets do: pcap or pcapng."""
    with open(path, "rb") as file:
        return file.read(4) in (*_MAGIC, _PCAPNG)


def read_packets(path: str | os.PathLike[str], *, port: int = DATA_PORT) -> Iterator[bytes]:
    """The UDP payloads sent to `port` in a classic pcap file (tcpdump -w), one after the other.

    Raises
    ------
    FileError
        The file cannot be read.
    FormatError
        It is no classic pcap, or of a link type that is not known here.
    DamagedFileError
        It ends within a packet, or a length in it cannot be right.
    """
    path = check_readable(path)
    name = printable(path.name)
    with open(path, "rb") as file:
        head = file.read(24)
        if head[:4] == _PCAPNG:
            raise FormatError(f"{name} is pcapng; convert it first: editcap -F pcap {name} capture.pcap")
        byte_order = _MAGIC.get(head[:4])
        if byte_order is None or len(head) < 24:
            raise FormatError(
                f"{name} is not a pcap file (it starts with {head[:4]!r}); expected one as tcpdump -w writes"
            )
        link = int.from_bytes(head[20:24], byte_order) & 0xFFFFFFF
        if link not in _LINKS:
            raise FormatError(f"{name} has link type {link}; expected one of {', '.join(map(str, _LINKS))}")
        for packet in _pcap_records(file, name, byte_order):
            tagged = link == 1 and packet[12:14] == b"\x81\x00"  # a VLAN's tag: four bytes more
            payload = _udp_payload(packet[_LINKS[link] + 4 * tagged :], port)
            if payload is not None:
                yield payload


def _pcap_records(file: BinaryIO, name: str, byte_order: Literal["little", "big"]) -> Iterator[bytes]:
    empty = 0
    while head := file.read(16):
        place = f"{name} at byte {file.tell() - len(head)}"
        length = int.from_bytes(head[8:12], byte_order)
        if len(head) < 16 or length > _MAX_PACKET:
            raise DamagedFileError(f"{place}: not a packet header ({len(head)} bytes, length {length}); copy it again")
        packet = file.read(length)
        if len(packet) < length:
            raise DamagedFileError(f"{place}: {len(packet)} of {length} bytes of a packet; the file is cut off")
        empty = 0 if packet else empty + 1
        if empty > _MOST_EMPTY:
            raise DamagedFileError(f"{place}: over {_MOST_EMPTY} packets of no bytes in a row; copy it again")
        yield packet


def _udp_payload(packet: bytes, port: int) -> bytes | None:
    """The payload of an IPv4 packet, if it is UDP to `port`."""
    header = (packet[0] & 15) * 4 if packet else 0
    udp = packet[header:]
    if len(udp) < 8 or header < 20 or packet[0] >> 4 != 4 or packet[9] != 17 or int.from_bytes(udp[2:4], "big") != port:
        return None
    return udp[8 : int.from_bytes(udp[4:6], "big")]
