"""The virtual arm: how it moves, strays, and logs; and its clock."""

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.rig import Arm, ArmPose
from millisight.rig.virtual import ArmSettings
from millisight.rig.virtual._arm import VirtualArm
from millisight.rig.virtual._settings import EPOCH, DeviceClock, WorldTime

HERE, THERE = ArmPose(position=(0.4, -0.2, 0.2)), ArmPose(position=(0.4, 0.3, 0.2))


def arm_of(time=None, seed=0, **settings):
    return VirtualArm(ArmSettings(**settings), time or WorldTime(), np.random.default_rng(seed))


def swept(rows=20, seed=0, **settings):
    """An arm that went to and fro between HERE and THERE, and the time of the world at the end."""
    time = WorldTime()
    arm = arm_of(time, seed, **settings)
    for i in range(rows):
        arm.sweep(*((HERE, THERE) if i % 2 == 0 else (THERE, HERE)))
        arm.wait()
    return arm, time.now


def test_it_is_an_arm():
    assert isinstance(arm_of(), Arm)


@pytest.mark.parametrize("length", [0.5, 0.12, 0.004])
def test_a_sweep_keeps_to_speed_and_acceleration_and_covers_its_way(length):
    settings = ArmSettings(speed=0.2, acceleration=0.8, settle=0.1, path_error=0)
    time = WorldTime()
    arm = VirtualArm(settings, time, np.random.default_rng(0))
    arm.sweep(HERE, ArmPose(position=(0.4, -0.2 + length, 0.2)))
    arm.wait()
    assert time.now == pytest.approx(settings.duration(length) + 2 * settings.settle)
    times = np.linspace(0, time.now, 40_001)
    along = arm.planned_positions(times)[:, 1] - HERE.position[1]
    assert along[0] == 0
    assert along[-1] == pytest.approx(length, abs=1e-12)
    speed = np.diff(along) / np.diff(times)
    acceleration = np.diff(speed) / np.diff(times)[0]
    assert speed.min() > -1e-9
    # A way too short for full speed is as fast as the acceleration allows, which is used in full.
    assert speed.max() == pytest.approx(min(0.2, np.sqrt(2 * 0.8 * length / np.pi)), rel=1e-3)
    assert np.abs(acceleration).max() == pytest.approx(0.8, rel=1e-2)
    assert np.abs(np.diff(acceleration)).max() < 0.02  # no jump


@pytest.mark.slow
def test_the_path_error_has_its_rms_and_its_correlation_length():
    arm, end = swept(rows=60, path_error=0.3e-3, correlation_length=0.04)
    times = np.linspace(0, end, 200_001)
    error = arm.true_positions(times) - arm.planned_positions(times)
    moving = np.r_[False, np.abs(np.diff(arm.planned_positions(times)[:, 1])) > 0]
    rms = np.sqrt((error[moving] ** 2).sum(axis=1).mean())
    assert moving.sum() > 100_000
    assert rms == pytest.approx(0.3e-3, rel=0.05)
    assert np.sqrt((error[moving] ** 2).mean(axis=0)) == pytest.approx(np.full(3, rms / np.sqrt(3)), rel=0.15)
    # The covariance falls to exp(-1/2) over the correlation length.
    travelled = np.concatenate([[0], np.cumsum(np.abs(np.diff(arm.planned_positions(times)[:, 1])))])
    places = np.arange(0, travelled[-1], 0.001)
    along = np.stack([np.interp(places, travelled, error[:, i]) for i in range(3)], axis=1)
    covariance = (along[40:] * along[:-40]).sum(axis=1).mean() / (along**2).sum(axis=1).mean()
    assert covariance == pytest.approx(np.exp(-0.5), abs=0.08)


@pytest.mark.slow
def test_the_true_path_is_smooth_also_where_sweeps_meet():
    arm, end = swept(rows=4, acceleration=1.0)
    times = np.linspace(0, end, 100_001)
    speed = np.diff(arm.true_positions(times), axis=0) / (times[1] - times[0])
    assert np.abs(np.diff(speed, axis=0)).max() < 2 * 1.0 * (times[1] - times[0])  # 2 m/s² of 1 asked for


@pytest.mark.slow
def test_the_log_tells_the_true_path_with_noise_by_its_own_clock():
    arm, end = swept(encoder_noise=0.03e-3, clock_offset=0.02, clock_drift=50e-6, log_rate=125)
    log = arm.log()
    clock = DeviceClock(offset=0.02, drift=50e-6)
    assert len(log) == pytest.approx(125 * end, abs=2)
    assert np.diff(log.times) == pytest.approx(1 / 125, abs=1e-6)
    assert log.times[0] == pytest.approx(EPOCH + 0.02, abs=1e-6)
    noise = log.positions - arm.true_positions(clock.true_times(log.times))
    assert np.sqrt((noise**2).sum(axis=1).mean()) == pytest.approx(0.03e-3, rel=0.03)
    # By the true time in place of the clock's, it is off by what the arm moves in 20 ms.
    wrong = log.positions - arm.true_positions(np.clip(log.times - EPOCH, 0, end))
    assert np.abs(wrong).max() == pytest.approx((0.02 + 50e-6 * end) * 0.1, rel=0.05)


def test_what_was_logged_stays_logged():
    time = WorldTime()
    arm = arm_of(time)
    arm.sweep(HERE, THERE)
    arm.wait()
    early = arm.log()
    arm.sweep(THERE, HERE)
    arm.wait()
    assert np.array_equal(arm.log().positions[: len(early) - 1], early.positions[:-1])
    whole, later = arm.log(), arm.log(since=float(early.times[-1]))
    assert np.array_equal(later.times, whole.times[len(early) :])
    assert np.array_equal(later.positions, whole.positions[len(early) :])


def test_one_seed_gives_one_path_and_another_another():
    logs = [swept(rows=2, seed=seed)[0].log().positions for seed in (1, 1, 2)]
    assert np.array_equal(logs[0], logs[1])
    assert np.abs(logs[0] - logs[2]).max() > 1e-5


def test_an_arm_elsewhere_goes_to_the_start_first():
    time = WorldTime()
    arm = arm_of(time, path_error=0)
    arm.sweep(HERE, HERE)
    arm.wait()
    stood = time.now
    arm.sweep(THERE, HERE)
    # Not before it stands at the start does it return: the sweep begins where it should.
    assert arm.planned_positions(np.array([time.now]))[0] == pytest.approx(THERE.position)
    assert time.now > stood + 5
    arm.wait()
    assert arm.planned_positions(np.array([time.now]))[0] == pytest.approx(HERE.position)


def test_clocks_turn_readings_back_into_true_times():
    clock = DeviceClock(offset=-0.3, drift=-80e-6)
    times = np.array([0.0, 12.5, 4000.0])
    assert clock.reading(times) - EPOCH == pytest.approx(times - 0.3 - 80e-6 * times, abs=1e-6)
    assert clock.true_times(clock.reading(times)) == pytest.approx(times, abs=1e-6)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"speed": 0}, "speed is 0 m/s; expected more than 0"),
        ({"path_error": -1e-3}, "path_error is -0.001 m"),
        ({"log_rate": float("nan")}, "log_rate is nan"),
        ({"clock_drift": -2}, "clock_drift is -2"),
    ],
)
def test_what_no_arm_can_be_is_refused(settings, words):
    with pytest.raises(InputError, match=words):
        ArmSettings(**settings)


def test_an_arm_that_was_sent_nowhere_has_no_place():
    with pytest.raises(InputError, match="call sweep first"):
        arm_of().log()


def test_an_arm_that_is_stopped_stands_there_and_goes_on_from_there():
    time = WorldTime()
    arm = arm_of(time, speed=0.2, acceleration=0.8, settle=0.1, path_error=0)
    arm.stop()  # before it has moved at all
    arm.sweep(HERE, THERE)
    time.wait_until(1.0)
    arm.stop()
    (there,) = arm.planned_positions(np.array([1.0]))
    assert HERE.position[1] + 0.05 < there[1] < THERE.position[1] - 0.05
    time.wait_until(3.0)
    arm.stop()
    times = np.linspace(1.0, 3.0, 50)
    assert np.abs(arm.planned_positions(times) - there).max() < 1e-12
    arm.sweep(HERE, THERE)
    arm.wait()
    times = np.linspace(0, time.now, 20_001)
    along = arm.planned_positions(times)[:, 1]
    assert np.abs(np.diff(along)).max() < 0.2 * np.diff(times)[0] * 1.001  # nothing jumps
    assert along[-1] == pytest.approx(THERE.position[1])


def test_the_log_since_a_time_is_the_rest_of_the_log():
    arm, _ = swept(rows=3, encoder_noise=1e-4)
    log = arm.log()
    since = log.times[len(log) // 3]
    rest = arm.log(since)
    assert rest.times[0] > since
    assert np.array_equal(rest.times, log.times[len(log) // 3 + 1 :])
    assert np.array_equal(rest.positions, log.positions[len(log) // 3 + 1 :])
