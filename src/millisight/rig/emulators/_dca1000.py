"""A DCA1000 in software: it obeys commands over UDP and sends packets as the card does, with faults on request."""

import socket
import threading
import time
from contextlib import suppress

import numpy as np

from millisight.core import checked_integer, checked_number, put, record
from millisight.core.errors import InputError
from millisight.io.raw import PACKET_BYTES
from millisight.rig._dca1000_wire import Code, parse_request, reply, version_status

_POLL = 0.1  # [s]
_NO_LVDS_DATA = 1  # status, bit 0
_VERSION = (2, 9)


@record
class PacketFaults:
    """What goes wrong between the card and the computer.

    Attributes
    ----------
    loss, disorder, duplicates : share of the packets that never come, come late, or come twice
    window : by how many packets one comes late at most
    silent_after : packets of a recording after which no more is sent; None: all are
    seed : of what is random
    """

    loss: float = 0.0
    disorder: float = 0.0
    duplicates: float = 0.0
    window: int = 8
    silent_after: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("loss", "disorder", "duplicates"):
            share = checked_number(getattr(self, name), name=name, minimum=0)
            if share > 1:
                raise InputError(f"{name} is {share:g}; expected a share from 0 to 1")
            put(self, **{name: share})
        put(
            self,
            window=checked_integer(self.window, name="window"),
            seed=checked_integer(self.seed, name="seed", minimum=0),
        )


class PacketSender:
    """Cuts a stream of samples into the card's packets and sends them.

    Parameters
    ----------
    target : address and port that they go to
    faults : PacketFaults
    rate : packets a second at most; None: as fast as it can
    first_number, first_byte : the counters that a recording begins with
    rng : of what goes wrong; None: from the seed of `faults`

    Attributes
    ----------
    lost : numbers, from 0, of the packets of this recording that were never sent
    sent : packets of this recording, lost ones included
    """

    def __init__(
        self,
        target: tuple[str, int],
        faults: PacketFaults,
        *,
        rate: float | None = None,
        first_number: int = 1,
        first_byte: int = 0,
        rng: np.random.Generator | None = None,
    ):
        self._target, self._faults, self._rate = target, faults, rate
        self._first = first_number, first_byte
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._rng = rng or np.random.default_rng(faults.seed)
        self.begin()

    def begin(self) -> None:
        """A new recording."""
        self.lost: list[int] = []
        self.sent: int = 0
        self._bytes = 0
        self._rest = b""
        self._held: list[tuple[int, bytes]] = []  # packets that are late, and when they are due
        self._began = time.monotonic()

    def send(self, data: bytes) -> None:
        """Send what fills whole packets, and keep the rest."""
        data = self._rest + data
        whole = len(data) // PACKET_BYTES * PACKET_BYTES
        for at in range(0, whole, PACKET_BYTES):
            self._packet(data[at : at + PACKET_BYTES])
        self._rest = data[whole:]

    def flush(self) -> None:
        """Send the rest as a shorter packet, and what is late."""
        if self._rest:
            self._packet(self._rest)
            self._rest = b""
        for _, packet in self._held:
            self._out(packet)
        self._held = []

    def close(self) -> None:
        self._socket.close()

    def _packet(self, data: bytes) -> None:
        faults, number = self._faults, self.sent
        head = ((self._first[0] + number) % (1 << 32)).to_bytes(4, "little")
        packet = head + ((self._first[1] + self._bytes) % (1 << 48)).to_bytes(6, "little") + data
        self.sent += 1
        self._bytes += len(data)
        if self._rate is not None and number % 16 == 0:
            ahead = number / self._rate - (time.monotonic() - self._began)
            if ahead > 0.001:
                time.sleep(ahead)
        silent = faults.silent_after is not None and number >= faults.silent_after
        chance = self._rng.random(3) if faults.loss or faults.disorder or faults.duplicates else (1, 1, 1)
        if silent or chance[0] < faults.loss:
            self.lost.append(number)
        elif chance[1] < faults.disorder:
            self._held.append((number + 1 + int(self._rng.integers(faults.window)), packet))
        else:
            self._out(packet)
            if chance[2] < faults.duplicates:
                self._out(packet)
        if self._held:
            due = [late for when, late in self._held if when <= number]
            self._held = [(when, late) for when, late in self._held if when > number]
            for late in due:
                self._out(late)

    def _out(self, packet: bytes) -> None:
        with suppress(OSError):  # nobody may listen there
            self._socket.sendto(packet, self._target)


class Dca1000Emulator:
    """A card: commands come in at `port`, samples are given by `samples` and go out while it records.

    Parameters
    ----------
    data_port : of the computer that commands it, where the packets go
    host, port : where it takes commands; port 0: a free one
    faults, rate : see `PacketSender`

    Attributes
    ----------
    port : where it takes commands
    told : names of the commands that came, in order
    silent : it answers no command any more, as a card without power
    """

    def __init__(
        self,
        *,
        data_port: int,
        host: str = "127.0.0.1",
        port: int = 0,
        faults: PacketFaults | None = None,
        rate: float | None = None,
    ):
        self._faults, self._rate, self._data_port = faults or PacketFaults(), rate, data_port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, port))
        self._socket.settimeout(_POLL)
        self.port: int = self._socket.getsockname()[1]
        self.told: list[str] = []
        self.silent: bool = False
        self.refused: set[str] = set()
        self._sender: PacketSender | None = None
        self._commander: tuple[str, int] | None = None
        self._lock = threading.Lock()
        self._recordings = 0
        self._recording = self._closing = False
        self._thread = threading.Thread(target=self._run, name="millisight DCA1000", daemon=True)
        self._thread.start()

    @property
    def faults(self) -> PacketFaults:
        """What goes wrong, from the next recording on."""
        return self._faults

    @faults.setter
    def faults(self, faults: PacketFaults) -> None:
        self._faults = faults

    def samples(self, data: bytes, *, last: bool = False) -> None:
        """What the radar sends over LVDS; `last`: nothing follows."""
        with self._lock:
            if self._recording and self._sender is not None and not self.silent:
                self._sender.send(data)
                if last:
                    self._sender.flush()

    def alarm(self, status: int = _NO_LVDS_DATA) -> None:
        """Tell the commander of an error, unasked."""
        if self._commander is not None:
            self._socket.sendto(reply(Code.SYSTEM_ERROR, status), self._commander)

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        self._socket.close()
        if self._sender is not None:
            self._sender.close()

    def _run(self) -> None:
        while not self._closing:
            try:
                packet, commander = self._socket.recvfrom(1024)
            except OSError:
                continue
            asked = parse_request(packet)
            if asked is None or self.silent:
                continue
            self._commander = commander
            name = Code(asked[0]).name if asked[0] in list(Code) else ""
            self.told.append(name)
            self._socket.sendto(reply(asked[0], self._obey(name)), commander)

    def _obey(self, name: str) -> int:
        """The status of a command's answer."""
        if not name or name in self.refused:
            return 1
        if name == "READ_FPGA_VERSION":
            return version_status(*_VERSION)
        if name == "RECORD_START" and self._commander is not None:
            with self._lock:
                if self._recording:
                    return 1
                if self._sender is not None:
                    self._sender.close()
                self._sender = PacketSender(
                    (self._commander[0], self._data_port), self._faults, rate=self._rate,
                    rng=np.random.default_rng([self._faults.seed, self._recordings]),
                )  # fmt: skip
                self._recordings += 1
                self._recording = True
        if name in ("RECORD_STOP", "RESET_FPGA"):
            with self._lock:
                self._recording = False
        return 0
