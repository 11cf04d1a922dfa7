"""Packets as they come, in a file: order, loss, duplicates, counters that wrap, and what cannot be right."""

import os
from itertools import pairwise

import numpy as np
import pytest

from millisight.core.errors import DeviceError
from millisight.io.raw import assemble_packets
from millisight.rig.drivers import PacketFile

SIZE = 1456


def packets_of(data, *, first_number=1, first_byte=0):
    """The card's packets of a recording."""
    return [
        ((first_number + i) % 2**32).to_bytes(4, "little")
        + ((first_byte + at) % 2**48).to_bytes(6, "little")
        + data[at : at + SIZE]
        for i, at in enumerate(range(0, len(data), SIZE))
    ]


def written(path, data, packets, **counters):
    file = PacketFile(path, size=len(data), **counters)
    for packet in packets:
        file.add(memoryview(packet))
    return file, file.close(), path.read_bytes()


@pytest.fixture
def data():
    return np.random.default_rng(0).integers(1, 256, 100 * SIZE + 300, dtype=np.uint8).tobytes()


@pytest.mark.parametrize("first_number", [1, 2**32 - 50])
@pytest.mark.parametrize("first_byte", [0, 2**48 - 40 * SIZE - 7])
def test_any_order_any_loss_and_wrapping_counters(tmp_path, data, first_number, first_byte):
    rng = np.random.default_rng(1)
    packets = packets_of(data, first_number=first_number, first_byte=first_byte)
    assert len(packets) == 101
    kept = [i for i in range(101) if rng.random() > 0.2]
    # Each comes up to ten places late, and every third twice.
    order = sorted(kept + kept[::3], key=lambda i: i + 10 * rng.random())
    file, gaps, content = written(
        tmp_path / "raw.bin", data, [packets[i] for i in order], first_number=first_number, first_byte=first_byte
    )
    expected = bytearray(data)
    for i in set(range(101)) - set(kept):
        expected[i * SIZE : (i + 1) * SIZE] = bytes(len(data[i * SIZE : (i + 1) * SIZE]))
    assert content == bytes(expected)
    missing = np.zeros(len(data), bool)
    for gap in gaps:
        assert not missing[gap.start : gap.stop].any()
        missing[gap.start : gap.stop] = True
    assert np.array_equal(missing, np.frombuffer(bytes(expected), np.uint8) == 0)
    assert all(a.stop < b.start for a, b in pairwise(gaps))
    assert file.duplicates == len(kept[::3])
    assert file.late > 10
    assert file.refused == 0
    assert not file.complete


def test_it_agrees_with_the_reader_of_pcap_files(tmp_path, data):
    packets = packets_of(data)
    some = [packet for i, packet in enumerate(packets) if i % 7 != 3]
    _, gaps, content = written(tmp_path / "raw.bin", data, some)
    assembled, known = assemble_packets(some)
    assert content == assembled
    assert [(gap.start, gap.stop) for gap in gaps] == [(gap.start, gap.stop) for gap in known]
    assert len(gaps) == 14


def test_a_whole_recording_is_told(tmp_path, data):
    file = PacketFile(tmp_path / "raw.bin", size=len(data))
    *most, last = packets_of(data)
    for packet in most:
        file.add(memoryview(packet))
    assert (file.received, file.complete) == (100 * SIZE, False)
    assert file.settled(10 * SIZE) == 90 * SIZE
    file.add(memoryview(last))
    assert file.complete
    assert file.settled(10 * SIZE) == len(data)
    assert file.close() == file.close() == ()
    assert (tmp_path / "raw.bin").read_bytes() == data


def test_what_cannot_be_right_is_refused(tmp_path, data):
    packets = packets_of(data)
    short = packets[5][:10]
    wild = packets[5][:4] + (10**9).to_bytes(6, "little") + packets[5][10:]
    contradicting = packets[5][:4] + (90 * SIZE).to_bytes(6, "little") + packets[5][10:]
    backwards = (4).to_bytes(4, "little") + packets[8][4:]
    beyond = packets[100][:4] + (len(data) - 10).to_bytes(6, "little") + packets[100][10:]
    file, gaps, content = written(
        tmp_path / "raw.bin", data, [*packets[:5], short, wild, contradicting, packets[6], backwards, beyond]
    )
    assert file.refused == 5
    assert [(gap.start, gap.stop) for gap in gaps] == [(5 * SIZE, 6 * SIZE), (7 * SIZE, len(data))]
    assert content[: 5 * SIZE] == data[: 5 * SIZE]


def test_a_full_disk_is_told(tmp_path, data):
    file = PacketFile(tmp_path / "raw.bin", size=len(data))
    file.add(memoryview(packets_of(data)[0]))
    os.close(file._file)
    file._file = os.open(tmp_path / "raw.bin", os.O_RDONLY)
    with pytest.raises(DeviceError, match=r"cannot write .*raw.bin: Bad file descriptor; make room on the disk"):
        file.close()
