"""DCA1000 files: what is written comes back, what is damaged or foreign is named, what was lost is marked."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from helpers.oracles import shared
from helpers.raw_scenes import scene
from millisight.core.errors import (
    DamagedFileError,
    FileError,
    FormatError,
    InputError,
    MillisightError,
    UnknownNameError,
)
from millisight.io.raw import (
    ORDERS,
    RawFrames,
    find_gaps,
    identify_order,
    open_recording,
    read_dca1000,
    swap_for_positive_ranges,
    write_dca1000,
)
from millisight.io.raw._dca1000 import PACKET_BYTES
from millisight.io.raw._raw_frames import Gap

REAL = "iwr1443_adc_data20251124114141.bin"
SHAPE = {"samples": 128, "receivers": 4, "chirps": 2}
FRAME_BYTES = 2 * 4 * 128 * 4  # chirps x receivers x samples x int16 pairs


@pytest.fixture
def small(tmp_path):
    """A file of 6 frames, and what it holds."""
    frames = scene(np.random.default_rng(5), frames=6, chirps=2, samples=128)
    write_dca1000(tmp_path / "small.bin", frames, order="two-lane interleaved")
    return tmp_path / "small.bin", frames


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("receivers", [1, 2, 3, 4])
def test_round_trip_is_exact(tmp_path, order, receivers, swap):
    rng = np.random.default_rng(0)
    parts = rng.integers(-32768, 32768, (2, 3, 2, receivers, 16))
    frames = parts[0] + 1j * parts[1]
    frames[0, 0, 0, :2] = (-32768 - 32768j, 32767 + 32767j)
    write_dca1000(tmp_path / "a.bin", frames, order=order, sample_swap=swap)
    raw = read_dca1000(
        tmp_path / "a.bin", samples=16, receivers=receivers, chirps=2, frames=3, order=order, sample_swap=swap
    )
    assert raw.samples.dtype == np.complex64
    assert (raw.samples == frames).all()
    assert raw.order == order
    assert raw.gaps == ()
    assert raw.lost.tolist() == [False] * 3
    assert raw.metadata == {"source": "a.bin", "sample_swap": swap, "order_from": "declared"}
    other = read_dca1000(
        tmp_path / "a.bin", samples=16, receivers=receivers, chirps=2, order=order, sample_swap=not swap
    )
    assert (other.samples == frames.imag + 1j * frames.real).all()


def test_the_order_is_found_while_reading(small):
    path, frames = small
    raw = read_dca1000(path, **SHAPE)
    assert raw.order == "two-lane interleaved"
    assert raw.metadata["order_from"] == "data"
    assert raw.metadata["order_margin_db"] > 20
    assert (raw.samples == frames).all()


def test_a_real_capture_is_recognised_and_one_sided():
    path = shared("captures", REAL)
    for samples in (256, None):
        estimate = identify_order(path, samples=samples)
        assert (estimate.order, estimate.samples, estimate.bright_side) == ("two-lane interleaved", 256, "positive")
        assert estimate.margin_db > 30
        assert estimate.scores["four-lane"] < 5
    raw = read_dca1000(path, samples=256, chirps=8, frames=50)
    assert raw.samples.shape == (50, 8, 4, 256)
    power = (np.abs(np.fft.fft(raw.samples * np.hanning(256), axis=-1)) ** 2).mean(axis=(0, 1))
    for profile in power:
        assert int(np.argmax(profile)) == 19
        assert profile[2:127].sum() > 1000 * profile[130:255].sum()
    swapped = read_dca1000(path, samples=256, chirps=8, sample_swap=True)
    assert int(np.argmax(np.abs(np.fft.fft(swapped.samples, axis=-1)).mean(axis=(0, 1, 2)))) == 237
    mean = raw.samples.mean(axis=(1,)).reshape(50, -1)
    likeness = np.abs(mean @ mean[0].conj()) / np.linalg.norm(mean, axis=1) / np.linalg.norm(mean[0])
    assert likeness.min() > 0.999


def test_which_part_stood_first_is_answered_only_when_asked(tmp_path):
    for side in (1, -1):
        frames = scene(np.random.default_rng(0), samples=128, side=side)
        write_dca1000(tmp_path / "a.bin", frames)
        estimate = identify_order(tmp_path / "a.bin", samples=128)
        assert swap_for_positive_ranges(estimate) is (side == -1)
        assert (read_dca1000(tmp_path / "a.bin", samples=128, chirps=4).samples == frames).all()
    noise = np.random.default_rng(0).integers(-9, 9, 4096).astype("<i2")
    with pytest.raises(InputError, match="declare sample_swap"):
        swap_for_positive_ranges(identify_order(noise))


def test_unknown_orders_must_be_declared(tmp_path):
    noise = np.random.default_rng(0).normal(0, 100, (4, 2, 4, 128, 2)).view(complex)[..., 0]
    write_dca1000(tmp_path / "noise.bin", noise)
    with pytest.raises(FormatError, match=r"noise\.bin: its sample order cannot be determined .*declare order"):
        read_dca1000(tmp_path / "noise.bin", **SHAPE)
    assert read_dca1000(tmp_path / "noise.bin", **SHAPE, order="four-lane").samples.shape == (4, 2, 4, 128)


@pytest.mark.parametrize(("edit", "error", "words"), [
    (lambda b: b"", DamagedFileError, "holds 0 bytes"),
    (lambda b: b[:1], DamagedFileError, "holds 1 bytes"),
    (lambda b: b[:-1], DamagedFileError, "odd number"),
    (lambda b: b[:-2], DamagedFileError, "holds 5 whole frames of 4096 bytes, and 4094 bytes left over"),
    (lambda b: b[:4094], DamagedFileError, "less than one frame of 4096"),
    (lambda b: b + b[:4096], DamagedFileError, "holds 7 frames of 4096 bytes; expected 6"),
    (lambda b: b"time, x, y, z\n" * 2000, FormatError, "is text"),
    (lambda b: np.frombuffer(b, "<i2").byteswap().tobytes(), FormatError, "big-endian"),
])  # fmt: skip
def test_damage_is_named_with_its_place(small, edit, error, words):
    path, _ = small
    path.write_bytes(edit(path.read_bytes()))
    for order in (None, "two-lane interleaved"):
        with pytest.raises(error, match=words) as caught:
            read_dca1000(path, **SHAPE, frames=6, order=order)
        assert "small.bin" in str(caught.value)


def test_a_byte_order_that_only_the_spectrum_shows(tmp_path):
    frames = 15 * scene(np.random.default_rng(0), samples=128, snr_db=30)  # both bytes are as restless
    write_dca1000(tmp_path / "loud.bin", frames)
    (tmp_path / "loud.bin").write_bytes(np.fromfile(tmp_path / "loud.bin", "<i2").byteswap().tobytes())
    with pytest.raises(FormatError, match=r"loud\.bin stand in big-endian order"):
        identify_order(tmp_path / "loud.bin", samples=128)


def test_whole_frames_of_a_truncated_file_are_taken_on_request(small):
    path, frames = small
    path.write_bytes(path.read_bytes()[: 4 * FRAME_BYTES + 1001])
    raw = read_dca1000(path, **SHAPE, frames=6, truncated="drop")
    assert (raw.samples == frames[:4]).all()
    assert raw.metadata["dropped_bytes"] == 1001
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(DamagedFileError, match="less than one frame"):
        read_dca1000(path, **SHAPE, order="four-lane", truncated="drop")


def test_lost_packets_are_marked(small):
    path, frames = small
    data = bytearray(path.read_bytes())
    lost = slice(3 * PACKET_BYTES, 5 * PACKET_BYTES)  # bytes 4368 to 7279: frame 1
    data[lost] = bytes(2 * PACKET_BYTES)
    data[-PACKET_BYTES:] = bytes(PACKET_BYTES)
    data[20000 : 20000 + PACKET_BYTES - 2] = bytes(PACKET_BYTES - 2)  # frame 4, a value short of a packet
    path.write_bytes(bytes(data))
    counts = np.frombuffer(bytes(data), "<i2")
    raw = read_dca1000(path, **SHAPE)
    assert [(g.start, g.length) for g in raw.gaps] == [
        (lost.start, 2 * PACKET_BYTES), (len(data) - PACKET_BYTES, PACKET_BYTES),
    ]  # fmt: skip
    assert all(not counts[g.start // 2 : g.stop // 2].any() for g in raw.gaps)
    assert raw.lost.tolist() == [False, True, False, False, False, True]
    assert (raw.samples[[0, 2, 3]] == frames[[0, 2, 3]]).all()


def test_gaps_are_found_wherever_they_begin():
    rng = np.random.default_rng(0)
    for _ in range(200):
        counts = rng.integers(1, 99, 5000).astype("<i2")
        start, length = int(rng.integers(0, 4200)), int(rng.choice([727, 728, 729, 800]))
        counts[start : start + length] = 0
        expected = [(2 * start, 2 * length)] if length >= 728 else []
        assert [(g.start, g.length) for g in find_gaps(counts)] == expected
    assert [(g.start, g.length) for g in find_gaps(np.zeros(5000, "<i2"))] == [(0, 10000)]
    assert find_gaps(np.zeros(10, "<i2")) == ()


def test_arguments_are_checked(small, tmp_path):
    path, frames = small
    for wrong, words in [
        ({"samples": 0}, "samples is 0"), ({"samples": 1.5}, r"samples is 1\.5"), ({"receivers": 5}, "receivers is 5"),
        ({"chirps": "2"}, "chirps is '2'"), ({"frames": -1}, "frames is -1"), ({"sample_swap": 1}, "sample_swap"),
        ({"truncated": "zero"}, "'refuse' or 'drop'"),
    ]:  # fmt: skip
        with pytest.raises(InputError, match=words):
            read_dca1000(path, **{**SHAPE, **wrong})
    with pytest.raises(UnknownNameError, match="Did you mean 'two-lane'"):
        read_dca1000(path, **SHAPE, order="two-lanes")
    with pytest.raises(FileError, match="no such file"):
        read_dca1000(tmp_path / "none.bin", **SHAPE)
    with pytest.raises(InputError, match="int16"):
        identify_order(np.zeros(100))
    for values in (frames[0], frames * 100, np.full((1, 1, 1, 4), np.nan), np.array([[[["a"]]]])):
        with pytest.raises(InputError, match="samples"):
            write_dca1000(tmp_path / "b.bin", values)
    assert not (tmp_path / "b.bin").exists()


def test_raw_frames_check_what_they_hold():
    good = {"samples": np.zeros((2, 1, 1, 4)), "lost": [False, True]}
    assert RawFrames(**good).samples.dtype == np.complex64
    for wrong in ({"lost": [False]}, {"gaps": ("gap",)}, {"order": 3}, {"samples": np.zeros((2, 4))}):
        with pytest.raises(InputError):
            RawFrames(**{**good, **wrong})
    with pytest.raises(InputError, match="start"):
        Gap(start=-1, length=2, reason="")


def test_a_gigabyte_is_identified_in_seconds(tmp_path):
    frames = scene(np.random.default_rng(0), frames=4, chirps=8)
    write_dca1000(tmp_path / "big.bin", frames)
    whole = (tmp_path / "big.bin").read_bytes()
    with open(tmp_path / "big.bin", "r+b") as file:
        for start in range(0, 1 << 30, 1 << 27):  # sparse: the disk holds eight copies of it
            file.seek(start)
            file.write(whole)
    assert (tmp_path / "big.bin").stat().st_size > 0.9e9
    started = time.process_time()
    assert identify_order(tmp_path / "big.bin", samples=256).order == "four-lane"
    assert identify_order(tmp_path / "big.bin").order == "four-lane"
    assert time.process_time() - started < 4


@pytest.mark.slow
def test_mutations_end_in_our_errors(small):
    path, _ = small
    good = path.read_bytes()
    rng = np.random.default_rng(0)
    read, refused = 0, []
    for _ in range(150):
        data = bytearray(good)
        for _ in range(rng.integers(1, 6)):
            at, length = int(rng.integers(len(data))), int(rng.choice([1, 2, 64, 2000]))
            kind = rng.integers(4)
            if kind == 0:
                data[at : at + length] = rng.bytes(length)
            elif kind == 1:
                del data[at : at + length]
            elif kind == 2:
                data[at:at] = bytes(length)
            else:
                data[at : at + length] = b"\xff" * length
        path.write_bytes(bytes(data))
        try:
            read_dca1000(path, **SHAPE, truncated=("refuse", "drop")[int(rng.integers(2))])
            read += 1
        except MillisightError as error:
            refused.append(str(error))
    assert read > 20
    assert len(refused) > 20
    assert all(path.name in message for message in refused)


def test_nothing_is_left_open(small):
    path, _ = small
    raw = read_dca1000(path, **SHAPE)
    Path(path).unlink()
    assert raw.samples.any()
    assert not raw.samples.flags.writeable


CUT = """
import os, sys
from millisight.io.raw import open_recording
counts, _, _ = open_recording(sys.argv[1])
os.truncate(sys.argv[1], 0)
print(counts.any())
"""


def test_a_file_cut_short_after_it_was_opened_kills_no_process(small):
    """Mapped, its values are no more: the process ends by a signal."""
    done = subprocess.run([sys.executable, "-c", CUT, str(small[0])], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


def test_a_file_cut_short_while_it_is_read_is_damaged(small, monkeypatch):
    path, size, read = small[0], small[0].stat().st_size, np.fromfile

    def read_what_is_left(*arguments, **settings):
        os.truncate(path, size // 2)
        return read(*arguments, **settings)

    monkeypatch.setattr(np, "fromfile", read_what_is_left)
    message = rf"small\.bin was cut short while it was read: expected {size} bytes"
    with pytest.raises(DamagedFileError, match=message):
        open_recording(path)
