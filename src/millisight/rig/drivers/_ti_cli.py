"""The command line of TI's mmWave SDK demos, on a board's serial line: it takes a profile, and starts frames.

mmWave SDK user guide, "mmWave Demos", and the demos' cli.c: a command is a line; the board repeats it, answers "Done",
or "Error" or "... is not recognized as a CLI command", and then prompts.
"""

import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from millisight.core import check_readable, printable
from millisight.core.errors import DeviceError
from millisight.rig.drivers._serial_line import open_serial

_PATIENCE = 2.0  # for one answer [s]
_READ = 0.05  # [s]
_ANSWERED = re.compile(rb"(Done|Error[^\r\n]*|[^\r\n]*not recognized as a CLI command)[ \t]*[\r\n]")
_STARTS = ("sensorStart", "sensorStop")


class TiCommandLine:
    """A board that runs a demo of the mmWave SDK.

    Parameters
    ----------
    port, baud : the serial line of the board's command line
    profile : its .cfg file
    """

    def __init__(self, port: str, baud: int, profile: Path):
        self._port, self._profile = port, profile
        self._lines = profile_lines(profile)
        self._serial: Any = open_serial(port, baud, timeout=_READ)
        self._frames: int | None = None

    def start(self, frames: int) -> None:
        """Take `frames` frames from now on. The profile is sent when their number changes, and first of all.

        Raises
        ------
        DeviceError
        """
        self.command("sensorStop")
        if frames == self._frames:
            self.command("sensorStart 0")
            return
        self._frames = None
        if not any(line.split()[0] == "flushCfg" for line in self._lines):
            self.command("flushCfg")
        for line in self._lines:
            self.command(with_frames(line, frames))
        self.command("sensorStart")
        self._frames = frames

    def stop(self) -> None:
        """Take no more frames."""
        self.command("sensorStop")

    def version(self) -> str:
        """What the demo says of itself, in one line."""
        lines = [" ".join(line.split()) for line in self.command("version").splitlines()]
        return "; ".join(line for line in lines if ":" in line and not line.endswith("/>") and "/>version" not in line)

    def command(self, line: str) -> str:
        """Send a line; what the board answers.

        Raises
        ------
        DeviceError
            It does not answer, or refuses.
        """
        answer = b""
        try:
            self._serial.reset_input_buffer()
            self._serial.write(line.encode("ascii", "replace") + b"\n")
            until = time.monotonic() + _PATIENCE
            while (found := _ANSWERED.search(answer)) is None and time.monotonic() < until:
                answer += self._serial.read(max(1, self._serial.in_waiting))
        except OSError as error:  # pyserial's errors are such
            raise DeviceError(f"the serial line {self._port} broke: {error}; check the USB cable") from error
        text = answer.decode("ascii", "replace").strip()
        if found is None:
            raise DeviceError(
                f"the board at {self._port} does not answer {line!r} (got {printable(text)[-80:]!r}); check that it "
                "runs a demo of the mmWave SDK (SOP jumpers for functional mode), that this is its command line's "
                "port, and press its reset button"
            )
        if not found[1].startswith(b"Done"):
            raise DeviceError(
                f"the board at {self._port} refuses {line!r}: {printable(found[1].decode('ascii', 'replace'))}; "
                f"correct {printable(self._profile.name)} for this demo's version"
            )
        return text

    def close(self) -> None:
        """Ask for no more frames, whatever the board answers, and close the line."""
        with suppress(OSError):
            self._serial.write(b"sensorStop\n")
            self._serial.flush()
        self._serial.close()


def profile_lines(path: Path) -> list[str]:
    """The commands of a .cfg file, without comments and without those that start or stop frames."""
    text = check_readable(path).read_text(encoding="utf-8", errors="replace")
    lines = [" ".join(line.split("%")[0].split()) for line in text.splitlines()]
    return [line for line in lines if line and line.split()[0] not in _STARTS]


def with_frames(line: str, frames: int) -> str:
    """`line`, or where it is frameCfg, the same with another number of frames."""
    words = line.split()
    if words[0] == "frameCfg":
        words[4] = str(frames)
    return " ".join(words)
