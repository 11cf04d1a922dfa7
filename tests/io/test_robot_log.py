"""Robots' logs: text and arrays, exact round trips, and every fault named with its place."""

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import DamagedFileError, FormatError, UnknownNameError
from millisight.io.raw import read_robot_log, write_robot_log

RNG = np.random.default_rng(0)
TURNS = RNG.normal(size=(9, 4))
LOG = ms.Trajectory(
    times=1.7e9 + np.sort(RNG.uniform(0, 5, 9)),
    positions=RNG.normal(size=(9, 3)),
    orientations=TURNS / np.linalg.norm(TURNS, axis=1, keepdims=True),
)
PLAIN = ms.Trajectory(times=LOG.times, positions=LOG.positions)


def same(one, other):
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.positions, other.positions)
    assert (one.orientations is None) == (other.orientations is None)
    if one.orientations is not None:
        np.testing.assert_array_equal(one.orientations, other.orientations)


@pytest.mark.parametrize("log", [LOG, PLAIN], ids=["turned", "not turned"])
def test_a_log_is_read_back_bit_for_bit(tmp_path, log):
    write_robot_log(tmp_path / "log.csv", log)
    same(read_robot_log(tmp_path / "log.csv"), log)


def test_columns_in_any_order_among_others(tmp_path):
    rows = [f"{z} {i} {t} {y} {x}" for i, (t, (x, y, z)) in enumerate(zip(LOG.times, LOG.positions, strict=True))]
    (tmp_path / "log.txt").write_text("\n".join(["z joint Timestamp y x", *rows]))
    same(read_robot_log(tmp_path / "log.txt"), PLAIN)
    (tmp_path / "mm.txt").write_text("0 1000 2000 3000\n1 2000 2000 3000\n")
    np.testing.assert_array_equal(read_robot_log(tmp_path / "mm.txt", scale=1e-3).positions, [[1, 2, 3], [2, 2, 3]])


def test_arrays(tmp_path):
    both = np.hstack([LOG.positions, LOG.orientations])
    np.savez(tmp_path / "a.npz", times=LOG.times, positions=LOG.positions)
    same(read_robot_log(tmp_path / "a.npz"), PLAIN)
    np.savez(tmp_path / "b.npz", times_77=LOG.times, tx_77_locs=both, times_24=LOG.times[:3])
    same(read_robot_log(tmp_path / "b.npz", times="times_77", positions="tx_77_locs"), LOG)
    np.savez(tmp_path / "c.npz", t=LOG.times, positions=LOG.positions, quaternions=LOG.orientations)
    same(read_robot_log(tmp_path / "c.npz"), LOG)
    np.save(tmp_path / "d.npy", np.hstack([LOG.times[:, None], both]))
    same(read_robot_log(tmp_path / "d.npy"), LOG)
    with pytest.raises(UnknownNameError, match="unknown array of times"):
        read_robot_log(tmp_path / "b.npz", positions="tx_77_locs")
    np.savez(tmp_path / "e.npz", times=LOG.times[:5], positions=LOG.positions)
    with pytest.raises(FormatError, match=r"shapes \(5, 1\), \(9, 3\)"):
        read_robot_log(tmp_path / "e.npz")


def test_repeats_of_a_whole_row_are_passed_over(tmp_path):
    doubled = np.repeat(np.arange(9), [1, 3, 1, 1, 2, 1, 1, 1, 2])
    log = ms.Trajectory(times=LOG.times[doubled], positions=LOG.positions[doubled])
    write_robot_log(tmp_path / "log.csv", log)
    same(read_robot_log(tmp_path / "log.csv"), PLAIN)


HEAD = "time,x,y,z\n"


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        (HEAD + "0,0,0,0\n2,1,0,0\n1,2,0,0\n", DamagedFileError, "row of numbers 3: 1.000000 s follows 2.000000 s"),
        (HEAD + "0,0,0,0\n1,1,0,0\n1,2,0,0\n", DamagedFileError, "the same time with another pose"),
        (HEAD + "0,0,0,0\n1,nan,0,0\n", DamagedFileError, "line 3 has 'nan'"),
        (HEAD + "0,0,0,0\n1,0\n", DamagedFileError, "line 3 has 2 columns"),
        (HEAD + "0,0,0,0\n", DamagedFileError, "a single pose"),
        (HEAD, DamagedFileError, "holds no numbers"),
        ("", DamagedFileError, "holds no numbers"),
        ("time,x,y\n0,0,0\n1,1,1\n", FormatError, "expected time, x, y, z among them"),
        ("0,0,0\n1,1,1\n", FormatError, "has 3 columns without names"),
        ("t,x,y,z,qx\n0,0,0,0,1\n1,1,1,1,1\n", FormatError, "expected all of qx, qy, qz, qw"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 2\n", DamagedFileError, "row of numbers 2: the quaternion has length 2"),
    ],
)
def test_faults_are_named_with_their_place(tmp_path, text, error, said):
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(error, match=said) as caught:
        read_robot_log(tmp_path / "log.csv")
    assert "log.csv" in str(caught.value)
