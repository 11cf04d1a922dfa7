"""A GRBL controller in software, on a pseudo-terminal."""

import re
import threading
import time
from collections import deque
from contextlib import suppress

import numpy as np

from millisight.rig.emulators._arm import MovingArm
from millisight.rig.emulators._line import PseudoLine
from millisight.rig.virtual import Time

_WORD = re.compile(r"([A-Z])(-?[\d.]+)")
_STEP = 0.002  # [s]
_KNOWN = {"G0", "G1", "G4", "G21", "G90", "G94"}
_REALTIME = b"?!~\x18"


class GrblEmulator:
    """A controller that moves a `MovingArm`.

    Parameters
    ----------
    arm, time : what it moves, and its time
    origin : of the machine in the frame of the arm (3,) [m]
    acceleration : of the machine [m/s²]

    Attributes
    ----------
    port : name of the serial line
    lines : that came, in order
    alarm : it has lost its position, and refuses to move
    silent : it says nothing more
    """

    def __init__(self, arm: MovingArm, time: Time, *, origin: np.ndarray, acceleration: float = 2.0):
        self.arm: MovingArm = arm
        self._time, self._origin, self._acceleration = time, np.asarray(origin), acceleration
        self.lines: list[str] = []
        self.alarm: bool = False
        self.silent: bool = False
        self._came = b""
        self._queue: deque[str] = deque()
        self._held = self._closing = False
        self._line = PseudoLine(self._take)
        self.port: str = self._line.name
        self._thread = threading.Thread(target=self._run, name="millisight gantry", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        self._line.close()

    def _take(self, came: bytes) -> bytes:
        answer = b""
        for byte in came:
            if byte not in _REALTIME:
                self._came += bytes([byte])
            elif byte == ord("?"):
                answer += self._status()
            elif byte == ord("!"):
                self._held = True
                self.arm.stop()
            elif byte == ord("~"):
                self._held = False
            else:
                self._queue.clear()
                self._held, self._came = False, b""
                answer += b"\r\nGrbl 1.1h ['$' for help]\r\n"
        while b"\n" in self._came:
            line, _, self._came = self._came.partition(b"\n")
            answer += self._line_told(line.decode("ascii", "replace").strip())
        return b"" if self.silent else answer

    def _status(self) -> bytes:
        place = 1000 * (self.arm.told(self._time.now) - self._origin)
        state = "Alarm" if self.alarm else "Hold:0" if self._held else "Run" if self.arm.moving else "Idle"
        return f"<{state}|MPos:{place[0]:.3f},{place[1]:.3f},{place[2]:.3f}|FS:0,0>\r\n".encode()

    def _line_told(self, line: str) -> bytes:
        self.lines.append(line)
        codes = {f"{letter}{float(value):g}" for letter, value in _WORD.findall(line) if letter == "G"}
        if line and not codes <= _KNOWN:
            return b"error:20\r\n"
        if self.alarm:
            return b"error:9\r\n"
        self._queue.append(line)
        # A dwell is answered when it is over, all else when it is taken.
        return b"" if "G4" in codes else b"ok\r\n"

    def _run(self) -> None:
        while not self._closing:
            if self.arm.moving or self._held or not self._queue:
                time.sleep(_STEP)
                continue
            line = self._queue.popleft()
            words = {letter: float(value) for letter, value in _WORD.findall(line)}
            if words.get("G") == 4:
                if not self.silent:
                    with suppress(OSError):
                        self._line.send(b"ok\r\n")
                continue
            target = self.arm.place
            for i, axis in enumerate("XYZ"):
                if axis in words:
                    target[i] = self._origin[i] + words[axis] / 1000
            self.arm.move(target, speed=words.get("F", 600.0) / 60_000, acceleration=self._acceleration)
