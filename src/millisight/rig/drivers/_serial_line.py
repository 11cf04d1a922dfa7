"""A serial line, opened with errors that say what to do."""

from typing import Any

from millisight.core import printable
from millisight.core.errors import DeviceError

_WRITE = 2.0  # how long a write may take [s]


def open_serial(port: str, baud: int, *, timeout: float) -> Any:
    """The serial line `port`, a `serial.Serial` of 8 data bits, no parity, 1 stop bit.

    Parameters
    ----------
    port : its name, such as "/dev/ttyACM0" or "COM5"
    baud : bits a second
    timeout : of one read [s]; a write may take 2 s, since a line that is full for a moment is not broken

    Raises
    ------
    DeviceError
        pyserial is not installed, or the line cannot be opened.
    """
    try:
        import serial
        from serial.tools import list_ports
    except ImportError as error:
        raise DeviceError("serial lines need pyserial: pip install 'millisight[rig]'") from error
    try:
        return serial.Serial(port, baud, timeout=timeout, write_timeout=_WRITE, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        there = ", ".join(sorted(found.device for found in list_ports.comports())) or "none"
        raise DeviceError(
            f"cannot open the serial line {printable(port)}: {error}; lines that are there: {there}. Close other "
            "programs that use it; on Linux, be in the group dialout"
        ) from error
