"""A client of RTDE: what the robot tells of itself, package by package, in a thread of its own.

ur_rtde, the one client library on PyPI, shows the newest state only, so that times and poses of a log would have to be
guessed together; its port is fixed; and it waits without end for a robot that takes the connection and says nothing.
"""

import socket
import struct
import threading
import time
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from millisight.core.errors import DeviceError
from millisight.rig import _rtde_wire as wire

_PATIENCE = 2.0  # for an answer [s]
_PAIRING = 0.3  # how long the two clocks are compared at first [s]


class RobotState(NamedTuple):
    """What one package tells.

    Attributes
    ----------
    time : by the controller's clock, as this computer's shows it [s since 1970]
    pose : (6,) of the tool in the base frame: x, y, z [m], and a rotation vector [rad]
    robot_mode, safety_mode, runtime_state : see `_rtde_wire`
    register : the integer register in which programs tell how far they are
    """

    time: float
    pose: np.ndarray
    robot_mode: int
    safety_mode: int
    runtime_state: int
    register: int


class RtdeClient:
    """A connection to a robot's RTDE.

    Parameters
    ----------
    address, port : of the robot
    rate : packages a second [Hz]
    register : number of the integer register

    Attributes
    ----------
    version : of the controller's software
    """

    def __init__(self, address: str, port: int, rate: float, register: int):
        self._name = f"the robot at {address}:{port}"
        try:
            self._socket = socket.create_connection((address, port), timeout=_PATIENCE)
        except OSError as error:
            raise DeviceError(
                f"cannot reach {self._name}: {error.strerror or error}; check that it is switched on, its address "
                "(Settings, System, Network on the pendant), and the network cable"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer = bytearray()
        self._lock = threading.Lock()
        self._states: list[RobotState] = []
        self._error: str | None = None
        self._heard = time.monotonic()
        self._closing = False
        self._offset = np.inf
        try:
            self._set_up(rate, register)
        except BaseException:
            self._socket.close()
            raise
        self._thread = threading.Thread(target=self._run, name="millisight RTDE", daemon=True)
        self._thread.start()

    def newest(self) -> RobotState | None:
        """The state that came last; None: none has come yet."""
        with self._lock:
            return self._states[-1] if self._states else None

    def states(self, since: float | None) -> list[RobotState]:
        """All that came so far, or those after the time `since` [s]."""
        with self._lock:
            if since is None:
                return list(self._states)
            count = 0
            for state in reversed(self._states):
                if state.time <= since:
                    break
                count += 1
            return self._states[len(self._states) - count :]

    def check(self, silence: float) -> None:
        """Raise if the connection broke, or nothing has come for `silence` [s].

        Raises
        ------
        DeviceError
        """
        if self._error is not None:
            raise DeviceError(f"the connection to {self._name} broke: {self._error}; check the cable and the robot")
        quiet = time.monotonic() - self._heard
        if quiet > silence:
            raise DeviceError(f"{self._name} has said nothing for {quiet:.1f} s; check the cable and the robot")

    def close(self) -> None:
        self._closing = True
        with suppress(OSError):  # the robot may have closed it already
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._socket.close()

    def _set_up(self, rate: float, register: int) -> None:
        if not self._ask(wire.REQUEST_VERSION, struct.pack(">H", wire.VERSION))[:1] == b"\1":
            raise DeviceError(f"{self._name} does not speak RTDE version {wire.VERSION}; update its software")
        version = self._ask(wire.GET_CONTROLLER_VERSION)
        self.version = ".".join(map(str, struct.unpack(">4I", version[:16]))) if len(version) >= 16 else "unknown"
        outputs = {**wire.OUTPUTS, f"output_int_register_{register}": "INT32"}
        answer = self._ask(wire.SETUP_OUTPUTS, struct.pack(">d", rate) + ",".join(outputs).encode())
        types = answer[1:].decode("ascii", "replace").split(",")
        wrong = [f"{name} ({got})" for (name, kind), got in zip(outputs.items(), types, strict=False) if got != kind]
        if wrong or len(types) != len(outputs):
            raise DeviceError(
                f"{self._name} does not tell {', '.join(wrong) or 'what is asked'}; update its software (3.4 or "
                "later), or choose another register"
            )
        self._recipe, self._format = answer[0], wire.data_format(types)
        if not self._ask(wire.START)[:1] == b"\1":
            raise DeviceError(f"{self._name} does not start to send; end other programs that use its RTDE")

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        """The payload of the answer to a package; other packages are passed over."""
        try:
            self._socket.sendall(wire.packed(kind, payload))
            until = time.monotonic() + _PATIENCE
            while time.monotonic() < until:
                package = wire.taken(self._buffer)
                if package is not None:
                    if package.kind == kind:
                        return package.payload
                    continue
                self._fill()
        except TimeoutError:
            pass
        except OSError as error:
            raise DeviceError(f"the connection to {self._name} broke: {error.strerror or error}") from error
        raise DeviceError(
            f"{self._name} takes the connection and does not answer; is it a robot's RTDE port, and the robot booted?"
        )

    def _fill(self) -> None:
        came = self._socket.recv(4096)
        if not came:
            raise ConnectionResetError("it closed the connection")
        self._buffer += came

    def _run(self) -> None:
        began = time.monotonic()
        waiting: list[tuple[float, list[float]]] = []
        while not self._closing:
            try:
                package = wire.taken(self._buffer)
                if package is None:
                    self._fill()
                    continue
            except TimeoutError:
                continue
            except OSError as error:
                self._error = error.strerror or str(error)
                return
            if package.kind != wire.DATA or len(package.payload) != self._format.size:
                continue
            self._heard = time.monotonic()
            recipe, stamp, *values = self._format.unpack(package.payload)
            if recipe != self._recipe:
                continue
            # A package is late by what the network took: the least of the first ones is taken for all.
            if self._offset == np.inf or self._heard - began < _PAIRING:
                self._offset = min(self._offset, time.time() - stamp)
            waiting.append((stamp, values))
            if self._heard - began >= _PAIRING:
                with self._lock:
                    self._states += [_state(stamp + self._offset, values) for stamp, values in waiting]
                waiting = []


def _state(time: float, values: list[float]) -> RobotState:
    return RobotState(time, np.array(values[:6]), *map(int, values[6:]))
