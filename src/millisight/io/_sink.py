"""Where HDF5 writes to: a file whose errors do not pass through HDF5."""

from collections.abc import Callable
from typing import Any


class Sink:
    """A file for HDF5 to write to, which keeps the first error for us and goes on as if nothing were wrong.

    HDF5 crashes the process when it cannot flush a file that it closes, so it must not meet a full disk itself.
    """

    def __init__(self, raw: Any):
        self._raw = raw
        self.error: BaseException | None = None

    def write(self, data: Any) -> int:
        self._attempt(self._raw.write, data)
        return len(data)

    def truncate(self, length: int | None = None) -> int:
        self._attempt(self._raw.truncate, length)
        return length or 0

    def flush(self) -> None:
        self._attempt(self._raw.flush)

    def seek(self, *place: int) -> int:
        self._attempt(self._raw.seek, *place)  # it may write what was buffered
        return self._raw.tell() if self.error is None else 0

    def tell(self) -> int:
        return self._raw.tell() if self.error is None else 0

    def read(self, size: int = -1) -> bytes:
        return self._raw.read(size) if self.error is None else b""

    def readinto(self, buffer: Any) -> int:
        self._attempt(self._raw.readinto, buffer)
        return len(buffer)

    def _attempt(self, action: Callable, *arguments: Any) -> None:
        if self.error is None:
            try:
                action(*arguments)
            except BaseException as error:  # Ctrl-C as well: it must not pass through HDF5 either
                self.error = error

    def check(self) -> None:
        if self.error is not None:
            raise self.error

    def __enter__(self) -> "Sink":
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.check()
