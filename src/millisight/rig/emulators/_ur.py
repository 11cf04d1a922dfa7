"""A UR robot in software: a controller that runs programs of `movel` and `stopl`, and its RTDE and script servers."""

import re
import socket
import struct
import threading
from contextlib import suppress

import numpy as np

from millisight.rig import _rtde_wire as wire
from millisight.rig.emulators._arm import MovingArm
from millisight.rig.virtual import Time

_POLL = 0.1  # [s]
_STEP = 0.005  # [s]
_VERSION = (5, 11, 0, 0)
_MOVE = re.compile(r"movel\(p\[([^\]]*)\],\s*a=([\d.e+-]+),\s*v=([\d.e+-]+)\)")
_WRITE = re.compile(r"write_output_integer_register\((\d+),\s*(-?\d+)\)")
_TYPES = {
    **wire.OUTPUTS, "target_TCP_pose": "VECTOR6D", "actual_q": "VECTOR6D", "actual_qd": "VECTOR6D",
    "actual_TCP_speed": "VECTOR6D", "actual_TCP_force": "VECTOR6D", "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE", "robot_status_bits": "UINT32", "safety_status_bits": "UINT32",
}  # fmt: skip


class UrController:
    """What runs programs.

    Parameters
    ----------
    arm : what they move, whose positions are those of the tool
    time : the arm's
    level : rotation vector of the tool at first [rad]
    latency : by how much the pose that it tells is older than its time stamp [s]

    Attributes
    ----------
    arm : as given
    registers : integer output registers
    robot_mode, safety_mode : as RTDE tells them
    running : whether a program runs
    remote : whether it takes programs; else they are passed over, as an e-Series in local control does
    programs : how many it has been sent
    """

    def __init__(
        self,
        arm: MovingArm,
        time: Time,
        *,
        level: tuple[float, float, float] = (np.pi, 0.0, 0.0),
        latency: float = 0.0,
    ):
        self.arm: MovingArm = arm
        self._time, self._latency = time, latency
        self._turned = tuple(level)
        self.registers: dict[int, int] = {}
        self.robot_mode: int = wire.ROBOT_RUNNING
        self.safety_mode: int = 1
        self.remote: bool = True
        self.programs: int = 0
        self.running: bool = False
        self._number = 0  # of the program that runs

    def run(self, program: str) -> None:
        """Run a program to its end, or until another one or `halt` ends it; returns when it has ended."""
        self.programs += 1
        self._number += 1
        number = self._number
        if not self.remote or self.safety_mode not in wire.FREE_TO_MOVE:
            return
        self.running = True
        for line in program.splitlines()[1:]:
            if not self._step(line.strip(), number):
                return  # what ended it says whether something runs now
        self.running = False

    def halt(self, safety_mode: int = 3) -> None:
        """Stop at once, as in a protective stop."""
        self.safety_mode = safety_mode
        self._number += 1
        self.running = False
        self.arm.stop()

    @property
    def now(self) -> float:
        """Its clock [s]."""
        return self._time.now

    def state(self, time: float) -> dict[str, object]:
        """The values of RTDE's outputs: modes as they are now, the pose at a `time` [s] that is over."""
        place = self.arm.told(max(0.0, time - self._latency))
        still = (0.0,) * 6
        pose = (*place, *self._turned)
        return {
            "timestamp": time, "actual_TCP_pose": pose, "target_TCP_pose": pose, "robot_mode": self.robot_mode,
            "safety_mode": self.safety_mode, "runtime_state": wire.PLAYING if self.running else wire.STOPPED,
            "actual_q": still, "actual_qd": still, "actual_TCP_speed": still, "actual_TCP_force": still,
            "speed_scaling": 1.0, "target_speed_fraction": 1.0, "robot_status_bits": 1, "safety_status_bits": 1,
        }  # fmt: skip

    def _step(self, line: str, number: int) -> bool:
        """Do one line; False: the program was ended."""
        if self._number != number:
            return False
        if move := _MOVE.fullmatch(line):
            numbers = [float(x) for x in move[1].split(",")]
            self.arm.move(np.array(numbers[:3]), speed=float(move[3]), acceleration=float(move[2]))
            self._turned = tuple(numbers[3:])
            while self.arm.moving:
                self._time.wait_until(self._time.now + _STEP)
                if self._number != number:
                    return False
        elif line.startswith("stopl"):
            self.arm.stop()
        elif write := _WRITE.fullmatch(line):
            self.registers[int(write[1])] = int(write[2])
        return True


class UrEmulator:
    """A robot: its controller behind real sockets.

    Parameters
    ----------
    controller : UrController
    host : where it listens
    rtde_port, script_port : 0: free ones

    Attributes
    ----------
    controller : as given
    rtde_port, script_port : where it listens
    silent : it keeps its connections and says nothing more
    """

    def __init__(self, controller: UrController, *, host: str = "127.0.0.1", rtde_port: int = 0, script_port: int = 0):
        self.controller: UrController = controller
        self.silent: bool = False
        self.rtde_port: int
        self.script_port: int
        self._closing = False
        self._connections: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._rtde, self.rtde_port = self._listen(host, rtde_port, self._talk)
        self._scripts, self.script_port = self._listen(host, script_port, self._take_program)

    def cut(self) -> None:
        """Break all connections, as a cable that is pulled and put back."""
        connections, self._connections = self._connections, []
        for connection in connections:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._closing = True
        self.controller.halt(self.controller.safety_mode)
        self.cut()
        for thread in self._threads:
            thread.join()
        self._rtde.close()
        self._scripts.close()

    def _listen(self, host, port, serve) -> tuple[socket.socket, int]:
        listener = socket.create_server((host, port))
        listener.settimeout(_POLL)
        self._start(self._accept, listener, serve)
        return listener, listener.getsockname()[1]

    def _start(self, run, *arguments) -> None:
        thread = threading.Thread(target=run, args=arguments, name="millisight UR", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket, serve) -> None:
        while not self._closing:
            try:
                connection, _ = listener.accept()
            except OSError:
                continue
            connection.settimeout(_POLL)
            self._connections.append(connection)
            self._start(self._serve, connection, serve)

    def _serve(self, connection: socket.socket, serve) -> None:
        with connection, suppress(OSError):
            serve(connection)

    def _take_program(self, connection: socket.socket) -> None:
        text = b""
        while not self._closing:
            try:
                came = connection.recv(4096)
            except TimeoutError:
                continue
            text += came
            while (end := text.find(b"end\n")) >= 0:
                program, text = text[: end + 4].decode("ascii", "replace"), text[end + 4 :]
                self._start(self.controller.run, program)
            if not came:
                return

    def _talk(self, connection: socket.socket) -> None:
        """RTDE with one client."""
        buffer = bytearray()
        outputs: list[str] = []
        period, due, started = 0.008, 0.0, False
        while not self._closing:
            left = due - self.controller.now
            connection.settimeout(max(0.0005, min(_POLL, left)) if started and not self.silent else _POLL)
            try:
                came = connection.recv(4096)
                if not came:
                    return
                buffer += came
            except TimeoutError:
                pass
            while (package := wire.taken(buffer)) is not None and not self.silent:
                if package.kind == wire.SETUP_OUTPUTS:
                    rate = struct.unpack_from(">d", package.payload)[0]
                    names = package.payload[8:].decode("ascii").split(",")
                    outputs = [name for name in names if name]  # ur_rtde ends the list by a comma
                    period = 1 / min(max(rate, 1.0), 500.0)
                    self._send(connection, wire.SETUP_OUTPUTS, b"\1" + ",".join(map(_type_of, outputs)).encode())
                elif package.kind == wire.REQUEST_VERSION:
                    asked = struct.unpack(">H", package.payload)[0]
                    self._send(connection, package.kind, bytes([asked == wire.VERSION]))
                elif package.kind == wire.GET_CONTROLLER_VERSION:
                    self._send(connection, package.kind, struct.pack(">4I", *_VERSION))
                elif package.kind in (wire.START, wire.PAUSE):
                    started, due = package.kind == wire.START, self.controller.now
                    self._send(connection, package.kind, b"\1")
            # A controller keeps its pace whatever else this computer does: what is late is told as it was when due.
            while started and not self.silent and due <= self.controller.now:
                self._send(connection, wire.DATA, self._values(outputs, due))
                due += period
            if self.silent:
                due = self.controller.now

    def _send(self, connection: socket.socket, kind: int, payload: bytes) -> None:
        connection.sendall(wire.packed(kind, payload))

    def _values(self, outputs: list[str], time: float) -> bytes:
        state, values = self.controller.state(time), []
        for name in outputs:
            value = self.controller.registers.get(_register(name), 0) if _register(name) >= 0 else state[name]
            values += value if isinstance(value, tuple) else [value]
        return wire.data_format([_type_of(name) for name in outputs]).pack(1, *values)


def _register(name: str) -> int:
    """The number of an integer register; -1: it is none."""
    found = re.fullmatch(r"output_int_register_(\d+)", name)
    return int(found[1]) if found else -1


def _type_of(name: str) -> str:
    return "INT32" if _register(name) >= 0 else _TYPES.get(name, "NOT_FOUND")
