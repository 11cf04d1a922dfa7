"""The thread that takes a DCA1000's packets from the network, whatever else is going on."""

import math
import socket
import sys
import threading
import time

from millisight.core.errors import DeviceError
from millisight.rig.drivers._packet_file import PacketFile

_BUFFER = 32 << 20  # of the socket [bytes]: half a second at the card's full rate
_LARGEST = 2048
_POLL = 0.2  # [s]


class PacketReceiver:
    """Takes packets from a UDP port; while a recording is open they go into it, else they are thrown away.

    Parameters
    ----------
    host, port : where the packets arrive; port 0: a free one

    Attributes
    ----------
    port : where they arrive
    buffer : bytes that the system keeps until they are taken; a small one loses packets when this computer is busy
    """

    def __init__(self, host: str, port: int):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.settimeout(_POLL)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(
                f"cannot receive at {host}:{port}: {error.strerror}; give this computer's network card the address "
                f"{host}, and close other programs that record from the card"
            ) from error
        # Linux tells twice what it keeps.
        self.buffer: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // (
            2 if sys.platform == "linux" else 1
        )
        self.port: int = self._socket.getsockname()[1]
        self._file: PacketFile | None = None
        self._lock = threading.Lock()
        self._first, self._frame, self._frame_bytes, self._period = math.inf, -1, 1, 0.0
        self._last = 0.0
        self._error: BaseException | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="millisight packets", daemon=True)
        self._thread.start()

    def begin(self, file: PacketFile, *, frame_bytes: int = 1, period: float = 0.0) -> None:
        """Put what comes from now on into `file`: frames of `frame_bytes`, one every `period` [s]."""
        with self._lock:
            self._file, self._last, self._error = file, time.monotonic(), None
            self._first, self._frame, self._frame_bytes, self._period = math.inf, -1, frame_bytes, period

    def end(self) -> PacketFile | None:
        """Throw away what comes from now on; the file that was open, which is now the caller's."""
        with self._lock:
            file, self._file = self._file, None
        return file

    @property
    def first_time(self) -> float:
        """When the first frame was taken, by this computer's clock [s since 1970]; infinite: none has come yet.

        Frames follow each other evenly, and none arrives before it was taken: the earliest of all, less its turn.
        """
        return self._first

    @property
    def quiet(self) -> float:
        """How long no packet has come [s]."""
        return time.monotonic() - self._last

    def check(self) -> None:
        """Raise what the thread met.

        Raises
        ------
        DeviceError
        """
        if self._error is not None:
            raise DeviceError(f"the recording broke: {self._error}") from self._error

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        buffer = bytearray(_LARGEST)
        view = memoryview(buffer)
        while not self._closing:
            try:
                length = self._socket.recv_into(buffer)
            except TimeoutError:
                continue
            except OSError as error:  # the network card was taken away
                self._error = error
                return
            with self._lock:
                if self._file is None:
                    continue
                self._last = time.monotonic()
                try:
                    self._file.add(view[:length])
                except DeviceError as error:
                    self._error, self._file = error, None
                    continue
                frame = (self._file.end - 1) // self._frame_bytes
                if frame > self._frame:
                    self._frame = frame
                    self._first = min(self._first, time.time() - frame * self._period)
