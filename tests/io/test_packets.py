"""Packets come late, twice, wild or never; the recording and its gaps say so."""

import random
import struct
import time

import pytest

from helpers.raw_scenes import packet, pcap, udp
from millisight.core.errors import DamagedFileError, FormatError, InputError, MillisightError
from millisight.io.raw import assemble_packets, read_packets

SIZE = 1456


@pytest.fixture
def stream():
    """20 packets, the last one short, and the recording that they make."""
    recording = random.Random(0).randbytes(19 * SIZE + 500)
    return [packet(i + 1, i * SIZE, recording[i * SIZE : (i + 1) * SIZE]) for i in range(20)], recording


def test_packets_in_any_order_and_twice_make_the_recording(stream):
    packets, recording = stream
    assert assemble_packets(packets) == (recording, ())
    mixed = packets * 2
    random.Random(1).shuffle(mixed)
    assert assemble_packets(mixed) == (recording, ())
    assert assemble_packets(map(bytearray, packets)) == (recording, ())


def test_lost_packets_are_gaps_of_zeros(stream):
    packets, recording = stream
    result, gaps = assemble_packets(p for i, p in enumerate(packets) if i not in (0, 7, 8, 12))
    assert [(gap.start, gap.length) for gap in gaps] == [(0, SIZE), (7 * SIZE, 2 * SIZE), (12 * SIZE, SIZE)]
    expected = bytearray(recording)
    for gap in gaps:
        expected[gap.start : gap.stop] = bytes(gap.length)
    assert result == bytes(expected)


def test_wild_packets_are_refused_and_told(stream):
    packets, recording = stream
    wild = [packet(9, 1 << 47, b"wild"), packet(3, 0, b""), b"abc"]
    started = time.process_time()
    result, gaps = assemble_packets([*wild, *packets, wild[0]])
    assert time.process_time() - started < 1
    assert result == recording
    assert [(gap.start, gap.length) for gap in gaps] == [(0, 0)] * 3 + [(len(recording), 0)]
    assert "packet 9 refused: byte count 140737488355328" in gaps[0].reason
    assert "no data" in gaps[1].reason
    result, gaps = assemble_packets([packets[0], packets[5]], max_lost=4 * SIZE)
    assert (len(result), len(gaps)) == (6 * SIZE, 1)
    result, gaps = assemble_packets([packets[0], packets[5]], max_lost=4 * SIZE - 1)
    assert (len(result), gaps[0].length) == (SIZE, 0)


def test_no_recording_at_all_is_an_error():
    with pytest.raises(DamagedFileError, match="no packet with data in 0 packets"):
        assemble_packets([])
    with pytest.raises(DamagedFileError, match="in 2 packets, the first: packet 1 refused"):
        assemble_packets([packet(1, 1 << 40, b"x"), b"short"])
    with pytest.raises(InputError, match="type str"):
        assemble_packets(["text"])


@pytest.mark.parametrize("byte_order", ["<", ">"])
@pytest.mark.parametrize("magic", [0xA1B2C3D4, 0xA1B23C4D])
@pytest.mark.parametrize(("link", "before"), [
    (1, bytes(12) + b"\x08\x00"), (1, bytes(12) + b"\x81\x00\x40\x01\x08\x00"), (101, b""), (113, bytes(16)),
])  # fmt: skip
def test_pcap_files_give_their_payloads(tmp_path, stream, link, before, magic, byte_order):
    packets, recording = stream
    others = [before + udp(b"other port", port=53), before + b"\x60" + bytes(60), before, b""]
    frames = [before + udp(p, options=bytes(4 * (i % 2))) for i, p in enumerate(packets)]
    (tmp_path / "a.pcap").write_bytes(pcap(others + frames, link=link, byte_order=byte_order, magic=magic))
    assert list(read_packets(tmp_path / "a.pcap")) == packets
    assert assemble_packets(read_packets(tmp_path / "a.pcap")) == (recording, ())
    assert list(read_packets(tmp_path / "a.pcap", port=53)) == [b"other port"]


def test_other_and_damaged_captures_are_named(tmp_path, stream):
    path, good = tmp_path / "a.pcap", pcap([bytes(14) + udp(p) for p in stream[0]])
    for data, error, words in [
        (b"", FormatError, "not a pcap file"), (good[:20], FormatError, "not a pcap file"),
        (b"\x0a\x0d\x0d\x0a" + bytes(40), FormatError, "editcap"),
        (pcap([], link=105), FormatError, "link type 105"),
        (good[:-5], DamagedFileError, "of 1008 bytes|cut off"), (good + b"abc", DamagedFileError, "at byte"),
        (good[:24] + struct.pack("<IIII", 0, 0, 1 << 31, 0) + good[40:], DamagedFileError, "at byte 24"),
        (good[:24] + bytes(1 << 20), DamagedFileError, "at byte 16024: over 1000 packets of no bytes in a"),
    ]:  # fmt: skip
        path.write_bytes(data)
        with pytest.raises(error, match=words):
            list(read_packets(path))


def test_mutations_end_in_our_errors(tmp_path, stream):
    good, draw = pcap([bytes(14) + udp(p[:100]) for p in stream[0]]), random.Random(0)
    ends = []
    for _ in range(300):
        data = bytearray(good)
        for _ in range(draw.randrange(1, 5)):
            at, length = draw.randrange(len(data)), draw.choice([1, 4, 40])
            data[at : at + draw.choice([length, length, length, 0])] = draw.randbytes(length)
        (tmp_path / "a.pcap").write_bytes(bytes(data))
        try:
            ends.append(len(assemble_packets(read_packets(tmp_path / "a.pcap"))[0]))
        except MillisightError:
            ends.append(-1)
    assert 30 < ends.count(-1) < 270
