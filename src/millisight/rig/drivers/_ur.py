"""A Universal Robots arm: it is moved by URScript, and logged by RTDE.

URScript programs go to the secondary interface (port 30002) as text: "The URScript Programming Language", `movel` and
`stopl`. A program ends by writing its number into a register that RTDE tells, which is how its end is known.
"""

import socket
import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from millisight.core import checked_integer, checked_number, checked_numbers, checked_record, put, record
from millisight.core.errors import DeviceError, InputError
from millisight.data import Trajectory
from millisight.rig import ArmPose, Limits
from millisight.rig._rtde_wire import (
    FREE_TO_MOVE,
    PLAYING,
    ROBOT_RUNNING,
    RTDE_PORT,
    SAFETY,
    SCRIPT_PORT,
)
from millisight.rig.drivers._driver import DRIVERS, Driver
from millisight.rig.drivers._rtde import RobotState, RtdeClient

_POLL = 0.01  # [s]
_PATIENCE = 2.0  # for a program to begin [s]
_NEAR = 2e-4  # how far from a place the arm may be and count as there [m]
_LEVEL_DEG = 0.5  # and how far turned [degrees]
_REGISTERS = range(24, 48)  # those that the guide leaves to clients like this


@record
class UrSettings:
    """Keys of an arm with `driver = "ur"`.

    Attributes
    ----------
    limits : workspace and speeds
    address : of the robot
    level : rotation vector of the tool, as the pendant shows it, when the radar frame is parallel to the base [rad];
        (pi, 0, 0): the tool points down
    offset : the radar frame's origin from the tool's, in the radar frame [m]
    rate : poses a second in the log [Hz]: 125, or up to 500 for e-Series
    register : integer output register that nothing else uses, 24 to 47
    rtde_port, script_port : of the robot
    silence : how long it may say nothing before it counts as failed [s]
    """

    limits: Limits
    address: str
    level: tuple[float, float, float] = (np.pi, 0.0, 0.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate: float = 125.0
    register: int = 24
    rtde_port: int = RTDE_PORT
    script_port: int = SCRIPT_PORT
    silence: float = 1.0

    def __post_init__(self) -> None:
        checked_record(self.limits, Limits, name="limits")
        register = checked_integer(self.register, name="register")
        rate = checked_number(self.rate, name="rate", unit="Hz", above=0)
        silence = checked_number(self.silence, name="silence", unit="s", above=0)
        if register not in _REGISTERS or rate > 500 or silence > 5:
            raise InputError(
                f"register is {register}, rate {rate:g} Hz, silence {silence:g} s; expected 24 to 47, up to 500 Hz, "
                "and up to 5 s"
            )
        put(
            self,
            level=checked_numbers(self.level, name="level", count=3, unit="rad"),
            offset=checked_numbers(self.offset, name="offset", count=3, unit="m"),
            rate=rate,
            register=register,
            silence=silence,
            rtde_port=checked_integer(self.rtde_port, name="rtde_port"),
            script_port=checked_integer(self.script_port, name="script_port"),
        )


class UrArm:
    """A UR arm: an `Arm` and a `Device`. Nothing is sent to it that leaves its limits."""

    def __init__(self, settings: UrSettings):
        from scipy.spatial.transform import Rotation

        self.settings: UrSettings = settings
        self.limits: Limits = settings.limits
        self._level = Rotation.from_rotvec(settings.level)
        self._client: RtdeClient | None = None
        self._program = 0  # number of the program that was sent last
        self._running = False
        self._due = 0.0

    def open(self) -> None:
        if self._client is not None:
            return
        settings = self.settings
        self._client = RtdeClient(settings.address, settings.rtde_port, settings.rate, settings.register)
        try:
            until = time.monotonic() + _PATIENCE
            while self._client.newest() is None and time.monotonic() < until:
                self._client.check(settings.silence)
                time.sleep(_POLL)
            # Not that of a program of an earlier run, which the register may still show.
            self._program = self._state().register
        except BaseException:
            self.close()
            raise

    def check(self) -> list[str]:
        state = self._state()
        position, turned = self._radar_frame(state.pose[None])
        lines = [
            f"controller {self._opened().version}, {SAFETY.get(state.safety_mode, 'unknown safety mode')}",
            "radar frame at " + ", ".join(f"{x:.4f}" for x in position[0]) + " m in the base frame",
        ]
        if state.robot_mode != ROBOT_RUNNING:
            lines.append("warning: the arm is not ready to move; switch it on and release the brakes on the pendant")
        if state.safety_mode not in FREE_TO_MOVE:
            lines.append(f"warning: {SAFETY.get(state.safety_mode, 'unknown safety mode')}; clear it on the pendant")
        try:
            self.limits.check(ArmPose(position=position[0]), "the arm")
        except InputError as error:
            lines.append(f"warning: {error}; move the arm into its workspace by the pendant")
        tilt = np.degrees(turned[0].magnitude())
        if tilt > _LEVEL_DEG:
            lines.append(f"warning: the radar is turned by {tilt:.1f} degrees; check level, or level it by the pendant")
        return lines

    def watch(self) -> None:
        self._opened().check(self.settings.silence)
        state = self._state()
        if state.safety_mode not in FREE_TO_MOVE:
            self._running = False
            raise DeviceError(
                f"the arm has stopped: {SAFETY.get(state.safety_mode, 'unknown safety mode')}; find out why, clear it "
                "on the pendant, and start the scan again"
            )

    def sweep(self, start: ArmPose, end: ArmPose) -> None:
        for pose, name in ((start, "the start of the move"), (end, "the end of the move")):
            self.limits.check(pose, name)
        if self._running:
            self.wait()
        self.watch()
        state = self._state()
        if state.robot_mode != ROBOT_RUNNING:
            raise DeviceError("the arm is not ready to move; switch it on and release the brakes on the pendant")
        here = ArmPose(position=self._radar_frame(state.pose[None])[0][0])
        self.limits.check(here, "the arm")
        places = [here.position, start.position, end.position]
        self._program += 1
        # A move to where the arm is would be one of no length.
        moves = [b for a, b in zip([here, start], [start, end], strict=True) if _apart(a, b)]
        length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
        lines = [self._movel(pose) for pose in moves]
        lines.append(f"write_output_integer_register({self.settings.register}, {self._program})")
        self._send(f"millisight_{self._program}", lines)
        self._running = True
        self._sent = time.monotonic()
        self._due = self._sent + _PATIENCE + 2 * self.limits.duration(length) + self.limits.settle

    def wait(self, watch: Callable[[], None] | None = None) -> None:
        while self._running:
            self.watch()
            state, now = self._state(), time.monotonic()
            if state.register == self._program:
                self._running = False
            elif now > self._due or (now > self._sent + _PATIENCE and state.runtime_state != PLAYING):
                self._running = False
                raise DeviceError(
                    "the arm does not do what it was told; switch the pendant to remote control, and stop the program "
                    "that runs on it"
                )
            if watch is not None:
                watch()
            time.sleep(_POLL)
        time.sleep(self.limits.settle)

    def stop(self) -> None:
        self._running = False
        if self._client is not None:
            self._send("millisight_stop", [f"stopl({10 * self.limits.acceleration:.6g})"])

    def log(self, since: float | None = None) -> Trajectory:
        states = self._opened().states(since)
        if not states:
            raise DeviceError("the arm has logged nothing; check the network to the robot")
        positions, turned = self._radar_frame(np.stack([state.pose for state in states]))
        times = np.array([state.time for state in states])
        return Trajectory(times=times, positions=positions, orientations=turned.as_quat())

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _opened(self) -> RtdeClient:
        if self._client is None:
            raise DeviceError("the arm is not open; call open first")
        return self._client

    def _state(self) -> RobotState:
        state = self._opened().newest()
        if state is None:
            raise DeviceError(f"the robot at {self.settings.address} tells nothing; check that it has booted")
        return state

    def _radar_frame(self, poses: np.ndarray):
        """(n, 3) positions of the radar frame [m], and its rotations to the base, from the tool's poses (n, 6)."""
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_rotvec(poses[:, 3:]) * self._level.inv()
        return poses[:, :3] + turned.apply(self.settings.offset), turned

    def _movel(self, pose: ArmPose) -> str:
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_quat(pose.orientation)
        place = pose.position - turned.apply(self.settings.offset)
        numbers = ", ".join(f"{x:.7f}" for x in (*place, *(turned * self._level).as_rotvec()))
        return f"movel(p[{numbers}], a={self.limits.acceleration:.6g}, v={self.limits.speed:.6g})"

    def _send(self, name: str, lines: list[str]) -> None:
        """Send a program, which ends the one that runs."""
        program = f"def {name}():\n" + "".join(f"  {line}\n" for line in lines) + "end\n"
        address = self.settings.address, self.settings.script_port
        try:
            with socket.create_connection(address, timeout=_PATIENCE) as connection:
                connection.sendall(program.encode("ascii"))
        except OSError as error:
            raise DeviceError(
                f"cannot send programs to the robot at {address[0]}:{address[1]}: {error.strerror or error}; check the "
                "network, and that the pendant allows remote control"
            ) from error


def _apart(a: ArmPose, b: ArmPose) -> bool:
    return float(np.linalg.norm(a.position - b.position)) > _NEAR


DRIVERS.add("ur", Driver(kind="arm", settings=UrSettings, make=UrArm))
