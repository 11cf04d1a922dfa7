"""A serial line in software: a pseudo-terminal, behind which an emulator answers line after line."""

import os
import select
import threading
import tty
from collections.abc import Callable

_POLL = 0.1  # [s]


class PseudoLine:
    """One end of a serial line; the other is opened by its name, as any serial port.

    Parameters
    ----------
    take : called with the bytes that came, in a thread of its own; returns what is sent back

    Attributes
    ----------
    name : of the port
    """

    def __init__(self, take: Callable[[bytes], bytes]):
        # The far end is kept open, else closing it by one program would end the line.
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.name: str = os.ttyname(self._far)
        self._take = take
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="millisight serial line", daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Send what was not asked for just now."""
        while data:
            data = data[os.write(self._near, data) :]

    def close(self) -> None:
        """Take the line away."""
        if self._closing:
            return
        self._closing = True
        self._thread.join()
        os.close(self._near)
        os.close(self._far)

    def _run(self) -> None:
        while not self._closing:
            if not select.select([self._near], [], [], _POLL)[0]:
                continue
            try:
                came = os.read(self._near, 4096)
            except OSError:
                return
            self.send(self._take(came))
