"""A gantry whose controller runs GRBL: G-code over a serial line.

GRBL 1.1's documents "Interface" and "Commands": a line is answered "ok" when it is taken, "G4" when all motion before
it has ended; "?" asks for the position, "!" holds the feed, and Ctrl-X resets, all at any time.
"""

import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from millisight.core import check_known, checked_integer, checked_number, checked_numbers, checked_record, put, record
from millisight.core.errors import DeviceError, InputError
from millisight.data import Trajectory
from millisight.rig import ArmPose, Limits
from millisight.rig._protocols import NOT_TURNED
from millisight.rig.drivers._driver import DRIVERS, Driver
from millisight.rig.drivers._serial_line import open_serial

_POLL = 0.01  # [s]
_PATIENCE = 3.0  # for the first answer: a board may restart when its line is opened [s]
_PROMPT = 0.05  # an answer that took longer is no pose of the log, unless all do [s]
_UNANSWERED = 0.5  # after which a question is put again [s]
_HOLD, _RESET = b"!", b"\x18"
_AXES = ("x", "-x", "y", "-y", "z", "-z", "")
_STATUS = re.compile(r"<(\w+)[^|>]*\|(?:[^>]*\|)?MPos:([-\d.]+),([-\d.]+),([-\d.]+)")


@record
class GrblSettings:
    """Keys of an arm with `driver = "grbl"`.

    Attributes
    ----------
    limits : workspace and speeds
    serial, baud : the controller's line
    origin : where the radar frame is when the machine is at 0, in the base frame [m]
    axes : of the machine, along the base's x, y and z: "x", "-y" and the like; "": the gantry has none there
    rate : positions a second in the log [Hz]
    silence : how long it may say nothing before it counts as failed [s]
    """

    limits: Limits
    serial: str
    baud: int = 115200
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: tuple[str, str, str] = ("x", "y", "z")
    rate: float = 10.0
    silence: float = 1.5

    def __post_init__(self) -> None:
        checked_record(self.limits, Limits, name="limits")
        for axis in self.axes:
            check_known("axis", axis, _AXES)
        named = [axis[-1] for axis in self.axes if axis]
        if len(set(named)) < len(named) or not named:
            raise InputError(
                f"axes is {list(self.axes)}; expected each axis of the machine once at most, and one at least"
            )
        rate = checked_number(self.rate, name="rate", unit="Hz", above=0)
        silence = checked_number(self.silence, name="silence", unit="s", above=0)
        if rate > 100 or silence > 5:
            raise InputError(f"rate is {rate:g} Hz, silence {silence:g} s; expected up to 100 Hz, and up to 5 s")
        put(
            self,
            baud=checked_integer(self.baud, name="baud"),
            origin=checked_numbers(self.origin, name="origin", count=3, unit="m"),
            rate=rate,
            silence=silence,
        )

    def machine(self, position: np.ndarray) -> dict[str, float]:
        """Where the machine's axes are to go [mm] for a position (3,) in the base frame [m]."""
        return {
            axis[-1].upper(): (-1 if axis[0] == "-" else 1) * 1000 * float(position[i] - self.origin[i])
            for i, axis in enumerate(self.axes)
            if axis
        }

    def position(self, machine: np.ndarray) -> np.ndarray:
        """(3,) in the base frame [m] of the machine's x, y and z (3,) [mm]."""
        place = np.array(self.origin)
        for i, axis in enumerate(self.axes):
            if axis:
                place[i] += (-1 if axis[0] == "-" else 1) * machine["xyz".index(axis[-1])] / 1000
        return place


class GrblGantry:
    """A gantry: an `Arm` and a `Device`. Nothing is sent to it that leaves its limits."""

    def __init__(self, settings: GrblSettings):
        self.settings: GrblSettings = settings
        self.limits: Limits = settings.limits
        self._serial: Any = None
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        if self._serial is not None:
            return
        self._serial = open_serial(self.settings.serial, self.settings.baud, timeout=_POLL)
        self._times: list[float] = []
        self._places: list[np.ndarray] = []
        self._state, self._refusal, self._error = "", "", ""
        self._asked: float | None = None  # when; None: no question is open
        self._least = np.inf  # that an answer took [s]
        self._waiting: deque[str] = deque()  # lines that are not answered yet
        self._heard, self._closing = time.monotonic(), False
        self._thread = threading.Thread(target=self._run, name="millisight GRBL", daemon=True)
        self._thread.start()
        until = time.monotonic() + _PATIENCE
        while not self._times and time.monotonic() < until and not self._error:  # ty: ignore[redundant-condition]: its thread sets it
            time.sleep(_POLL)
        if not self._times:
            self.close()
            raise DeviceError(
                f"the controller at {self.settings.serial} does not tell its position; check that it runs GRBL 1.1, "
                "its baud rate, and that it reports the machine's position ($10=1)"
            )

    def check(self) -> list[str]:
        self.watch()
        place = self._places[-1]
        lines = [
            f"GRBL, {self._state.lower()}",
            "radar frame at " + ", ".join(f"{x:.4f}" for x in place) + " m in the base frame",
        ]
        if self._state == "Alarm":
            lines.append("warning: the gantry does not know where it is; home it ($H)")
        try:
            self.limits.check(ArmPose(position=place), "the gantry")
        except InputError as error:
            lines.append(f"warning: {error}; move it into its workspace by hand, and home it")
        return lines

    def watch(self) -> None:
        if self._serial is None:
            raise DeviceError("the gantry is not open; call open first")
        if self._error:
            raise DeviceError(f"the serial line {self.settings.serial} broke: {self._error}; check the USB cable")
        if self._refusal:
            raise DeviceError(f"the gantry refuses: {self._refusal}; see GRBL's list of these numbers, and home it")
        quiet = time.monotonic() - self._heard
        if quiet > self.settings.silence:
            raise DeviceError(f"the gantry has said nothing for {quiet:.1f} s; check its power and the USB cable")

    def sweep(self, start: ArmPose, end: ArmPose) -> None:
        for pose, name in ((start, "the start of the move"), (end, "the end of the move")):
            self.limits.check(pose, name)
            self._check_reach(pose)
        self.watch()
        if self._state == "Alarm":
            raise DeviceError("the gantry does not know where it is; home it ($H)")
        self.limits.check(ArmPose(position=self._places[-1]), "the gantry")
        feed = 60_000 * self.limits.speed
        for pose in (start, end):
            words = " ".join(f"{axis}{value:.4f}" for axis, value in self.settings.machine(pose.position).items())
            self._send(f"G21 G90 G94 G1 {words} F{feed:.1f}")
        self._send("G4 P0")

    def wait(self, watch: Callable[[], None] | None = None) -> None:
        while self._waiting:
            self.watch()
            if watch is not None:
                watch()
            time.sleep(_POLL)
        self.watch()  # the last answer may have been no
        time.sleep(self.limits.settle)

    def stop(self) -> None:
        if self._serial is None:
            return
        self._write(_HOLD)
        until = time.monotonic() + 1.0
        while self._state not in ("Hold", "Idle", "Alarm") and time.monotonic() < until:
            time.sleep(_POLL)
        # What is in its memory is given up; a machine that stands keeps its position.
        self._write(_RESET)
        self._waiting.clear()

    def log(self, since: float | None = None) -> Trajectory:
        with self._lock:
            times, places = np.array(self._times), np.array(self._places)
        later = slice(None) if since is None else times > since
        if not len(times[later]):
            raise DeviceError("the gantry has logged nothing; check the serial line")
        turned = np.tile(NOT_TURNED, (len(times[later]), 1))
        return Trajectory(times=times[later], positions=places[later], orientations=turned)

    def close(self) -> None:
        line, self._serial = self._serial, None
        if line is not None:
            self._closing = True
            if self._thread is not None:
                self._thread.join()
            line.close()

    def _check_reach(self, pose: ArmPose) -> None:
        """Raise where a pose needs an axis that the gantry has not."""
        for i, axis in enumerate(self.settings.axes):
            if not axis and abs(pose.position[i] - self.settings.origin[i]) > 1e-6:
                raise InputError(
                    f"the gantry has no axis along {'xyz'[i]} and stands at {self.settings.origin[i]:.4f} m there; got "
                    f"{pose.position[i]:.4f} m: change the scan or origin"
                )
        if not np.allclose(np.abs(pose.orientation), NOT_TURNED, atol=1e-6):
            raise InputError(f"a gantry does not turn the radar; got the orientation {pose.orientation}")

    def _send(self, line: str) -> None:
        self._waiting.append(line)
        self._write(line.encode("ascii") + b"\n")

    def _write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except OSError as error:
            raise DeviceError(f"the serial line {self.settings.serial} broke: {error}; check the USB cable") from error

    def _run(self) -> None:
        """Ask for the position, one question at a time, and take what the controller says."""
        line, text, due = self._serial, b"", 0.0
        while not self._closing:
            try:
                now = time.monotonic()
                if now >= due and (self._asked is None or now > self._asked + _UNANSWERED):
                    due, self._asked = now + 1 / self.settings.rate, now
                    line.write(b"?")
                text += line.read(max(1, line.in_waiting))
            except (OSError, TypeError) as error:  # pyserial raises the latter when a line is taken away while it reads
                self._error = str(error)
                return
            *lines, text = text.split(b"\n")
            for told in lines:
                self._take(told.decode("ascii", "replace").strip())

    def _take(self, told: str) -> None:
        now = time.monotonic()
        if told:
            self._heard = now
        if found := _STATUS.match(told):
            self._state = found[1]
            if self._asked is None:
                return
            took, self._asked = now - self._asked, None
            self._least = min(self._least, took)
            # Where it was, between the question and the answer, is not known well if this computer was busy meanwhile.
            if took > max(_PROMPT, 2 * self._least):
                return
            place = self.settings.position(np.array([float(x) for x in found.groups()[1:]]))
            moment = time.time() - took / 2
            with self._lock:
                if not self._times or moment > self._times[-1]:
                    self._times.append(moment)
                    self._places.append(place)
        elif told == "ok" and self._waiting:
            self._waiting.popleft()
        elif told.startswith(("error:", "ALARM:")):
            line = self._waiting.popleft() if self._waiting and told[0] == "e" else ""
            self._refusal = f"{told}{f' to {line!r}' if line else ''}"


DRIVERS.add("grbl", Driver(kind="arm", settings=GrblSettings, make=GrblGantry))
