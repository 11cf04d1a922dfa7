"""A recording as its packets come: each goes to disk at the place that its byte count names, in bounded memory."""

import os
from bisect import bisect_right
from pathlib import Path

from millisight.core import checked_integer, printable
from millisight.core.errors import DeviceError
from millisight.io.raw import HEADER_BYTES, Gap

_BLOCK = 1 << 20  # bytes written together
_MOST_GAPS = 1 << 20
_NUMBERS, _COUNTS = 1 << 32, 1 << 48  # where the card's counters wrap
_LARGEST = 1456


class PacketFile:
    """The raw file of one recording, and what of it is missing.

    Packets may come late, twice or never, and the card's two counters may wrap. A packet that comes late goes to its
    place; a second one of a place is left out; what never comes is a gap, whose bytes are no measurement. A packet
    whose two counters contradict each other, or that lies outside the recording, is refused. Memory holds a block of
    1 MiB and the gaps.

    Parameters
    ----------
    path : the file, made anew; it gets `size` bytes
    size : of the recording [bytes]
    first_number, first_byte : counters of its first packet; the card begins every recording at 1 and 0

    Attributes
    ----------
    end : how far it has come, gaps included [bytes]
    duplicates, late, refused : packets so far that came twice, out of order, or could not be right
    """

    def __init__(self, path: Path, *, size: int, first_number: int = 1, first_byte: int = 0):
        self.path: Path = path
        self.size: int = checked_integer(size, name="size")
        self.end: int = 0
        self.duplicates: int = 0
        self.late: int = 0
        self.refused: int = 0
        self._first = first_number, first_byte
        self._last = 0, 0  # number and place of the packet that reached farthest, counted from 0 and never wrapped
        # Missing stretches below `end`, in order: where they start, and where they stop.
        self._starts: list[int] = []
        self._stops: list[int] = []
        self._missing = 0
        self._block = bytearray()
        self._block_start = 0
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o666)
        os.ftruncate(self._file, self.size)

    @property
    def received(self) -> int:
        """Bytes that are there."""
        return self.end - self._missing

    @property
    def complete(self) -> bool:
        """Whether every byte is there."""
        return self.received == self.size

    def settled(self, window: int) -> int:
        """Up to where nothing changes any more [bytes], if no packet comes later than `window` bytes after its turn."""
        return max(0, self.end - window) if self.end < self.size else self.size

    def add(self, packet: memoryview) -> None:
        """Take one packet, header included.

        Raises
        ------
        DeviceError
            More stretches are missing than can be kept in mind, or the disk is full.
        """
        length = len(packet) - HEADER_BYTES
        if not 0 < length <= _LARGEST:
            self.refused += 1
            return
        number = self._unwrapped(int.from_bytes(packet[:4], "little") - self._first[0], self._last[0], _NUMBERS)
        start = self._unwrapped(
            int.from_bytes(packet[4:HEADER_BYTES], "little") - self._first[1], self._last[1], _COUNTS
        )
        steps, way = number - self._last[0], start - self._last[1]
        # Every packet but the last of a recording is full, so the counters go on together.
        if start < 0 or start + length > self.size or way * steps < 0 or abs(way) > abs(steps) * _LARGEST:
            self.refused += 1
            return
        if start >= self.end:
            self._append(start, packet[HEADER_BYTES:])
            self._last = number, start
        else:
            self._fill(start, packet[HEADER_BYTES:])

    def close(self) -> tuple[Gap, ...]:
        """Write what is left and close the file; the gaps, in order. A closed file stays so."""
        if self._file >= 0:
            self._write()
            os.close(self._file)
            self._file = -1
        gaps = [*zip(self._starts, self._stops, strict=True)]
        if self.end < self.size:
            gaps.append((self.end, self.size))
        joined: list[tuple[int, int]] = []
        for start, stop in gaps:
            if joined and joined[-1][1] == start:
                joined[-1] = joined[-1][0], stop
            else:
                joined.append((start, stop))
        return tuple(Gap(start=start, length=stop - start, reason="lost packets") for start, stop in joined)

    def _unwrapped(self, count: int, near: int, period: int) -> int:
        """The number equal to `count` modulo `period` that is nearest to `near`."""
        return near + (count - near + period // 2) % period - period // 2

    def _append(self, start: int, data: memoryview) -> None:
        if start > self.end:
            if len(self._starts) >= _MOST_GAPS:
                raise DeviceError(f"{_MOST_GAPS} stretches are missing; check the cable and the network card")
            self._starts.append(self.end)
            self._stops.append(start)
            self._missing += start - self.end
        if start != self._block_start + len(self._block) or len(self._block) >= _BLOCK:
            self._write()
            self._block_start = start
        self._block += data
        self.end = start + len(data)

    def _fill(self, start: int, data: memoryview) -> None:
        """Put a late packet where it belongs, if it is still missing there."""
        stop = start + len(data)
        at = bisect_right(self._starts, start) - 1
        if at < 0 or stop > self._stops[at]:
            self.duplicates += 1
            return
        low, high = self._starts[at], self._stops[at]
        rest = [(a, b) for a, b in ((low, start), (stop, high)) if a < b]
        self._starts[at : at + 1] = [a for a, _ in rest]
        self._stops[at : at + 1] = [b for _, b in rest]
        self._missing -= len(data)
        self.late += 1
        self._put(bytes(data), start)

    def _write(self) -> None:
        self._put(self._block, self._block_start)
        self._block = bytearray()

    def _put(self, data: bytes | bytearray, start: int) -> None:
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._file, memoryview(data)[done:], start + done)
        except OSError as error:
            raise DeviceError(
                f"cannot write {printable(self.path)}: {error.strerror}; make room on the disk"
            ) from error
