"""A UR arm: the driver against the emulator over real sockets, its limits, and the emulator by another client."""

import dataclasses
import os
import re
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from millisight.core.errors import DeviceError, InputError
from millisight.rig import Arm, ArmPose, Device, Limits
from millisight.rig.drivers import DRIVERS, UrArm, UrSettings
from millisight.rig.emulators import MovingArm, RealTime, UrController, UrEmulator
from millisight.rig.virtual import ArmSettings, WorldTime

LOW, HIGH = (0.2, -0.4, 0.1), (0.6, 0.4, 0.5)
LIMITS = Limits(lower=LOW, upper=HIGH, speed=0.5, acceleration=4.0, settle=0.02)
MIDDLE = np.array([0.4, 0.0, 0.3])
EXACT = ArmSettings(path_error=0.0, encoder_noise=0.0)


def robot_of(clock, **settings):
    return UrController(MovingArm(EXACT, clock, np.random.default_rng(0), MIDDLE), clock, **settings)


class Bench:
    def __init__(self, **settings):
        self.controller = robot_of(RealTime())
        self.robot = UrEmulator(self.controller)
        self.arm = UrArm(
            UrSettings(
                **{
                    "limits": LIMITS, "address": "127.0.0.1", "rtde_port": self.robot.rtde_port,
                    "script_port": self.robot.script_port, "silence": 0.5, **settings,
                }
            )
        )  # fmt: skip

    def close(self):
        self.arm.close()
        self.robot.close()


@pytest.fixture
def bench():
    one = Bench()
    yield one
    one.close()


def pose(*position):
    return ArmPose(position=position)


def test_a_sweep_is_driven_and_logged(bench):
    arm = bench.arm
    assert isinstance(arm, Arm)
    assert isinstance(arm, Device)
    arm.open()
    arm.open()  # which is nothing new
    start, end = pose(0.3, -0.05, 0.3), pose(0.3, 0.05, 0.3)
    arm.sweep(start, start)
    arm.wait()
    before = arm.log().times[-1]
    watched = []
    arm.sweep(start, end)
    arm.wait(lambda: watched.append(True))  # it still moves
    time.sleep(0.02)
    log = arm.log(before)
    assert len(watched) > 5
    assert log.times[0] > before
    assert abs(log.times[-1] - time.time()) < 5  # on this computer's clock
    assert np.median(np.diff(log.times)) == pytest.approx(1 / 125, rel=0.2)
    assert log.positions[0] == pytest.approx(start.position, abs=1e-4)
    assert log.positions[-1] == pytest.approx(end.position, abs=1e-6)
    assert np.abs(log.orientations - [0, 0, 0, 1]).max() < 1e-6
    speeds = np.diff(log.positions[:, 1]) / np.diff(log.times)
    assert speeds.min() > -1e-9
    assert 0.3 < speeds.max() < 0.5 * 1.02
    truth = bench.controller.arm.true_positions(bench.controller._time.now - (time.time() - log.times))
    assert np.abs(log.positions - truth).max() < 0.5 * 0.005  # what 5 ms of network make at full speed


def test_a_tool_that_holds_the_radar_off_its_point_and_turned(bench):
    arm = Bench(level=(2.0, -1.0, 0.5), offset=(0.02, -0.01, 0.05))
    try:
        arm.arm.open()
        arm.arm.sweep(pose(0.3, 0.1, 0.3), pose(0.32, 0.1, 0.3))
        arm.arm.wait()
        assert arm.controller.arm.place == pytest.approx([0.30, 0.11, 0.25])
        log = arm.arm.log()
        assert log.positions[-1] == pytest.approx([0.32, 0.1, 0.3], abs=1e-6)
        assert np.abs(np.abs(log.orientations[-1]) - [0, 0, 0, 1]).max() < 1e-6
    finally:
        arm.close()


@pytest.mark.slow
def test_a_thousand_random_plans_never_leave_the_workspace(monkeypatch):
    """What is sent is run by the controller in a time that jumps, and its whole path is looked at."""
    rng = np.random.default_rng(7)
    clock = WorldTime()
    controller = robot_of(clock)
    arm = UrArm(UrSettings(limits=LIMITS, address="nowhere"))
    monkeypatch.setattr(arm, "_send", lambda name, lines: controller.run("\n".join([f"def {name}():", *lines, "end"])))
    monkeypatch.setattr(arm, "watch", lambda: None)
    monkeypatch.setattr(arm, "_state", lambda: state_of(controller, arm))
    monkeypatch.setattr("millisight.rig.drivers._ur.time.sleep", lambda seconds: None)
    span = np.subtract(HIGH, LOW)
    done = refused = 0
    for _ in range(1000):
        places = LOW - 0.1 * span + rng.random((2, 3)) ** 0.5 * 1.2 * span
        if rng.random() < 0.4:
            places = np.clip(places, LOW, HIGH)
        inside = ((places >= LOW) & (places <= HIGH)).all()
        programs = controller.programs
        if inside:
            arm.sweep(pose(*places[0]), pose(*places[1]))
            arm.wait()
            assert controller.arm.place == pytest.approx(places[1], abs=3e-4)
            done += 1
        else:
            with pytest.raises(InputError, match="the workspace runs from"):
                arm.sweep(pose(*places[0]), pose(*places[1]))
            assert controller.programs == programs  # nothing was sent
            refused += 1
    assert done > 300
    assert refused > 300
    times = np.linspace(0, clock.now, 200_000)
    path = controller.arm.true_positions(times)
    assert np.ptp(path, axis=0) == pytest.approx(span, rel=0.01)  # it went nearly everywhere
    assert (path >= np.array(LOW) - 1e-9).all()
    assert (path <= np.array(HIGH) + 1e-9).all()
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / np.diff(times)
    assert speed.max() < LIMITS.speed * 1.001


def state_of(controller, arm):
    state = controller.state(controller.now)
    return SimpleNamespace(
        **state, pose=np.array(state["actual_TCP_pose"]), register=controller.registers.get(arm.settings.register, 0)
    )


def test_a_protective_stop_is_obeyed(bench):
    bench.arm.open()
    bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    threading.Timer(0.3, bench.controller.halt).start()
    began = time.monotonic()
    with pytest.raises(
        DeviceError, match="the arm has stopped: protective stop; find out why, clear it on the pendant"
    ):
        bench.arm.wait()
    assert time.monotonic() - began < 10
    there = bench.controller.arm.place
    programs = bench.controller.programs
    with pytest.raises(DeviceError, match="protective stop"):
        bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    assert bench.controller.programs == programs
    assert bench.controller.arm.place == pytest.approx(there)
    assert bench.arm.check()[2].startswith("warning: protective stop; clear it")


def test_stop_stops(bench):
    bench.arm.open()
    bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    time.sleep(0.6)
    bench.arm.stop()
    time.sleep(0.1)
    there = bench.controller.arm.place
    assert -0.3 < there[1] < 0.25
    time.sleep(0.2)
    assert bench.controller.arm.place == pytest.approx(there)
    bench.arm.sweep(pose(*there), pose(0.3, 0.3, 0.3))
    bench.arm.wait()
    assert bench.controller.arm.place == pytest.approx([0.3, 0.3, 0.3], abs=3e-4)


def test_a_robot_that_falls_silent_or_hangs_up(bench):
    bench.arm.open()
    bench.robot.silent = True
    bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"127.0.0.1:\d+ has said nothing for 0.\d s; check the cable and the robot"):
        bench.arm.wait()
    assert time.monotonic() - began < 10
    bench.robot.silent = False
    bench.arm.close()
    bench.arm.open()
    bench.robot.cut()
    time.sleep(0.1)
    with pytest.raises(DeviceError, match=r"the connection to .* broke: it closed the connection"):
        bench.arm.watch()


def test_a_robot_in_local_control_does_nothing(bench):
    bench.arm.open()
    bench.controller.remote = False
    bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    with pytest.raises(DeviceError, match="switch the pendant to remote control"):
        bench.arm.wait()


def test_a_robot_that_is_not_ready(bench):
    bench.controller.robot_mode = 5
    bench.arm.open()
    with pytest.raises(DeviceError, match="switch it on and release the brakes"):
        bench.arm.sweep(pose(0.3, -0.3, 0.3), pose(0.3, 0.3, 0.3))
    assert bench.controller.programs == 0


def test_an_arm_outside_its_workspace_is_not_moved(bench):
    narrow = Limits(lower=(0.2, 0.1, 0.1), upper=HIGH)
    bench.arm.settings = dataclasses.replace(bench.arm.settings, limits=narrow)
    bench.arm.limits = narrow
    bench.arm.open()
    with pytest.raises(InputError, match=r"the arm has y = 0.0000 m in the base frame; the workspace runs from 0.1000"):
        bench.arm.sweep(pose(0.3, 0.2, 0.3), pose(0.3, 0.3, 0.3))
    assert bench.controller.programs == 0
    assert any(line.startswith("warning: the arm has y") for line in bench.arm.check())


def test_what_the_robot_says_when_asked(bench):
    bench.arm.open()
    assert bench.arm.check() == [
        "controller 5.11.0.0, normal",
        "radar frame at 0.4000, 0.0000, 0.3000 m in the base frame",
    ]


def test_nobody_a_stranger_and_an_old_robot(bench):
    with socket.create_server(("127.0.0.1", 0)) as there:
        port = there.getsockname()[1]
        stranger = UrArm(dataclasses.replace(bench.arm.settings, rtde_port=port))
        began = time.monotonic()
        with pytest.raises(DeviceError, match="takes the connection and does not answer; is it a robot's RTDE port"):
            stranger.open()
        assert time.monotonic() - began < 5
    with pytest.raises(
        DeviceError, match=r"cannot reach the robot at 127.0.0.1:\d+: Connection refused; check that it"
    ):
        stranger.open()
    bench.arm.settings = dataclasses.replace(bench.arm.settings, script_port=port)
    bench.arm.open()
    with pytest.raises(DeviceError, match="cannot send programs to the robot at .*remote control"):
        bench.arm.sweep(pose(0.3, 0.2, 0.3), pose(0.3, 0.3, 0.3))


def test_settings_that_cannot_be_right():
    for wrong in ({"register": 3}, {"rate": 600}, {"silence": 9}):
        with pytest.raises(InputError, match="expected 24 to 47, up to 500 Hz, and up to 5 s"):
            UrSettings(limits=LIMITS, address="x", **wrong)
    with pytest.raises(InputError, match="expected upper >= lower"):
        Limits(lower=HIGH, upper=LOW)
    with pytest.raises(InputError, match="speed is 2 m/s; expected 1 m/s at most"):
        Limits(lower=LOW, upper=HIGH, speed=2)
    assert DRIVERS["ur"].kind == "arm"


@pytest.mark.parametrize("length", [0.01, 0.06, 0.5])
def test_a_move_takes_no_longer_than_said(length):
    clock = WorldTime()
    controller = robot_of(clock)
    controller.arm.move(MIDDLE + np.array([length, 0, 0]), speed=LIMITS.speed, acceleration=LIMITS.acceleration)
    controller.arm.wait()
    assert clock.now == pytest.approx(LIMITS.duration(length), rel=0.15)


CLIENT = """
import sys, time, rtde_receive
variables = ["timestamp", "actual_TCP_pose", "robot_mode", "safety_mode", "runtime_state"]
client = rtde_receive.RTDEReceiveInterface(sys.argv[1], 125.0, variables)
print(*client.getActualTCPPose(), client.getTimestamp(), client.getSafetyMode(), client.getRobotMode(), flush=True)
input()
time.sleep(0.1)
print(*client.getActualTCPPose(), client.getTimestamp())
client.disconnect()
"""


def test_another_client_understands_the_emulator():
    """ur_rtde, which knows the one port and shows the newest state; it answers to nothing else while it connects."""
    pytest.importorskip("rtde_receive", reason="needs ur-rtde, which has wheels for Linux and Python 3.11 and 3.12")
    controller = robot_of(RealTime())
    host = f"127.{1 + os.getpid() % 250}.{1 + os.getpid() // 250 % 250}.9"
    robot = UrEmulator(controller, host=host, rtde_port=30004)
    try:
        with subprocess.Popen(
            [sys.executable, "-c", CLIENT, host], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as client:
            first = [float(word) for word in client.stdout.readline().split()]
            assert first[:6] == pytest.approx([*MIDDLE, np.pi, 0, 0])
            assert first[7:] == [1, 7]
            controller.run("def go():\nmovel(p[0.3, 0.1, 0.3, 3.1415927, 0, 0], a=4, v=0.5)\nend")
            then = [float(word) for word in client.communicate("\n", timeout=20)[0].split()[-7:]]
        assert then[:3] == pytest.approx([0.3, 0.1, 0.3])
        assert 0.2 < then[6] - first[6] < 5
    finally:
        robot.close()


def test_programs_are_what_the_guide_says():
    arm = UrArm(UrSettings(limits=LIMITS, address="nowhere"))
    line = arm._movel(pose(0.3, 0.1, 0.3))
    assert re.fullmatch(
        r"movel\(p\[0.3000000, 0.1000000, 0.3000000, 3.1415927, 0.0000000, 0.0000000\], a=4, v=0.5\)", line
    )
