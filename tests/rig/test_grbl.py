"""A gantry by G-code: the driver against the emulator on a pseudo-terminal."""

import time

import numpy as np
import pytest

from millisight.core.errors import DeviceError, InputError, UnknownNameError
from millisight.rig import Arm, ArmPose, Device, Limits
from millisight.rig.drivers import DRIVERS, GrblGantry, GrblSettings
from millisight.rig.emulators import GrblEmulator, MovingArm, RealTime
from millisight.rig.virtual import ArmSettings

LIMITS = Limits(lower=(0.0, -0.2, 0.1), upper=(0.3, 0.2, 0.1), speed=0.3, acceleration=2.0, settle=0.02)
START = np.array([0.1, 0.0, 0.1])


class Bench:
    """The machine's x runs along the base's y, its y against the base's x, and it has no third axis."""

    def __init__(self, **settings):
        clock = RealTime()
        exact = ArmSettings(path_error=0.0, encoder_noise=0.0)
        self.arm = MovingArm(exact, clock, np.random.default_rng(0), np.array([START[1], -START[0], 0.0]))
        self.machine = GrblEmulator(self.arm, clock, origin=np.zeros(3))
        settings = {"limits": LIMITS, "serial": self.machine.port, "rate": 50.0, "silence": 0.8, **settings}
        self.gantry = GrblGantry(GrblSettings(**{"origin": (0.0, 0.0, 0.1), "axes": ("-y", "x", ""), **settings}))

    def close(self):
        self.gantry.close()
        self.machine.close()


@pytest.fixture
def bench():
    one = Bench()
    yield one
    one.close()


def pose(*position):
    return ArmPose(position=position)


def test_answers_that_took_long_are_no_poses_of_the_log(bench, monkeypatch):
    """Where the gantry was between the question and the answer is not known well."""
    gantry, tell = bench.gantry, bench.machine._status
    gantry.open()
    slow = []

    def late():
        began = time.time()
        time.sleep(0.12)
        slow.append((began, time.time()))
        return tell()

    monkeypatch.setattr(bench.machine, "_status", late)
    time.sleep(1.0)
    monkeypatch.undo()
    time.sleep(0.3)
    assert 4 < len(slow) < 10  # one question at a time, though 50 a second are due
    gantry.watch()
    times = gantry.log().times
    for began, ended in slow:
        assert not ((times > began) & (times < ended)).any()
    assert times[-1] > slow[-1][1]


def test_a_sweep_is_driven_and_logged(bench):
    gantry = bench.gantry
    assert isinstance(gantry, Arm)
    assert isinstance(gantry, Device)
    gantry.open()
    start, end = pose(0.2, -0.05, 0.1), pose(0.2, 0.05, 0.1)
    gantry.sweep(start, start)
    gantry.wait()
    before = gantry.log().times[-1]
    watched = []
    gantry.sweep(start, end)
    gantry.wait(lambda: watched.append(True))  # it still moves
    time.sleep(0.05)
    log = gantry.log(before)
    assert len(watched) > 5
    assert log.times[0] > before
    assert abs(log.times[-1] - time.time()) < 5
    assert log.positions[0] == pytest.approx(start.position, abs=5e-4)
    assert log.positions[-1] == pytest.approx(end.position, abs=1e-5)
    assert bench.arm.place == pytest.approx([0.05, -0.2, 0.0], abs=1e-6)
    truth = bench.arm.true_positions(bench.machine._time.now - (time.time() - log.times))
    expected = np.stack([-truth[:, 1], truth[:, 0], np.full(len(truth), 0.1)], axis=1)
    assert np.abs(log.positions - expected).max() < 0.3 * 0.02
    assert bench.machine.lines[0] == "G21 G90 G94 G1 Y-200.0000 X-50.0000 F18000.0"


def test_what_leaves_its_workspace_is_not_sent(bench):
    bench.gantry.open()
    for wrong, words in (
        (
            pose(0.35, 0.0, 0.1),
            "the end of the move has x = 0.3500 m in the base frame; the workspace runs from 0.0000",
        ),
        (pose(0.1, 0.0, 0.3), "the workspace runs from 0.1000 to 0.1000 m"),
        (ArmPose(position=(0.1, 0.0, 0.1), orientation=(1, 0, 0, 0)), "a gantry does not turn the radar"),
    ):
        with pytest.raises(InputError, match=words):
            bench.gantry.sweep(pose(*START), wrong)
    assert bench.machine.lines == []
    lifted = Bench(limits=Limits(lower=(0, -0.2, 0), upper=(0.3, 0.2, 0.3)))
    try:
        lifted.gantry.open()
        with pytest.raises(InputError, match="the gantry has no axis along z and stands at 0.1000 m there; got 0.2000"):
            lifted.gantry.sweep(pose(*START), pose(0.1, 0.0, 0.2))
    finally:
        lifted.close()


def test_stop_stops_and_it_goes_on(bench):
    bench.gantry.open()
    bench.gantry.sweep(pose(0.2, -0.2, 0.1), pose(0.2, 0.2, 0.1))
    time.sleep(0.4)
    bench.gantry.stop()
    bench.gantry.wait()
    there = bench.arm.place
    time.sleep(0.2)
    assert bench.arm.place == pytest.approx(there)
    assert np.linalg.norm(there - [0.2, -0.2, 0]) > 0.05
    bench.gantry.sweep(pose(0.2, 0.1, 0.1), pose(0.2, 0.1, 0.1))
    bench.gantry.wait()
    assert bench.arm.place == pytest.approx([0.1, -0.2, 0.0], abs=1e-6)


def test_a_machine_that_lost_its_position(bench):
    bench.gantry.open()
    bench.machine.alarm = True
    time.sleep(0.1)
    assert bench.gantry.check()[2] == "warning: the gantry does not know where it is; home it ($H)"
    with pytest.raises(DeviceError, match="home it"):
        bench.gantry.sweep(pose(*START), pose(*START))
    bench.machine.alarm = False
    time.sleep(0.1)
    bench.gantry._send("G77")
    with pytest.raises(DeviceError, match="the gantry refuses: error:20 to 'G77'; see GRBL's list"):
        bench.gantry.wait()


def test_a_machine_that_falls_silent_and_one_that_never_speaks(bench, monkeypatch):
    bench.gantry.open()
    bench.gantry.sweep(pose(0.2, -0.2, 0.1), pose(0.2, 0.2, 0.1))
    bench.machine.silent = True
    began = time.monotonic()
    with pytest.raises(DeviceError, match=r"the gantry has said nothing for 0.\d s; check its power and the USB cable"):
        bench.gantry.wait()
    assert time.monotonic() - began < 10
    bench.gantry.close()
    monkeypatch.setattr("millisight.rig.drivers._grbl._PATIENCE", 0.3)
    with pytest.raises(DeviceError, match="does not tell its position; check that it runs GRBL 1.1"):
        bench.gantry.open()


def test_settings_that_cannot_be_right():
    for wrong, error in (({"axes": ("x", "x", "z")}, InputError), ({"axes": ("x", "y", "w")}, UnknownNameError)):
        with pytest.raises(error):
            GrblSettings(limits=LIMITS, serial="x", **wrong)
    with pytest.raises(InputError, match="expected up to 100 Hz, and up to 5 s"):
        GrblSettings(limits=LIMITS, serial="x", rate=1000)
    assert DRIVERS["grbl"].kind == "arm"
