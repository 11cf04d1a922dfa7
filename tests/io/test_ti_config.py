"""TI .cfg files give the waveform of the samples, or say which line and field cannot be right."""

import random

import numpy as np
import pytest

from millisight.core.errors import FileError, FormatError, InputError, MillisightError
from millisight.io.raw import TiConfig, read_ti_config

GOOD = """\
% The published set-up, all in one profile
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 1 0 1
profileCfg 0 77 7 8.5 63 0 0 58.6116 1 512 10000 0 0 30   % the one that is used
profileCfg 1 78 7 8.5 63 0 0 40 1 256 5000 0 0 30
chirpCfg 0 1 0 0 0 0 0 1
chirpCfg 2 2 1 0 0 0 0 2
frameCfg 0 1 3 4000 125.5 1 0
lvdsStreamCfg -1 0 1 0
guiMonitor -1 1 1 0 0 0 1
sensorStart
"""


def read(tmp_path, text):
    (tmp_path / "a.cfg").write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_ti_config(tmp_path / "a.cfg")


def test_a_configuration_in_numbers(tmp_path):
    config = read(tmp_path, GOOD)
    waveform = config.waveform
    # 77 GHz, and 8.5 us at 58.6116 MHz/us until the first sample
    assert waveform.start_frequency == pytest.approx(77e9 + 498.1986e6, abs=1)
    assert (waveform.slope, waveform.sample_rate) == (58.6116e12, 10e6)
    assert waveform.samples_per_chirp == 512
    assert (config.receivers, config.transmitters, config.chirps_per_frame) == (4, 1, 6)
    assert config.tx_masks == (1, 1)
    assert (config.frames, config.frame_period) == (4000, pytest.approx(0.1255))
    assert (config.sample_swap, config.order, config.complex_samples, config.plain_stream) == (True, None, True, True)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("channelCfg 15", "channelCfg 5", {"receivers": 2}),
    ("adcbufCfg -1 0 1 0 1", "adcbufCfg 0 0 1 1", {"sample_swap": False, "order": "two-lane"}),
    ("adcbufCfg -1 0 1 0 1\n", "adcbufCfg -1 0 1 0 1\nadcbufCfg -1 0 0 0 1\n", {"sample_swap": False}),
    ("adcCfg 2 1\nadcbufCfg -1 0", "adcCfg 2 0\nadcbufCfg -1 1", {"complex_samples": False}),
    ("adcCfg 2 1", "adcCfg 2 2", {"complex_samples": True}),
    ("lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg -1 1 1 0", {"plain_stream": False}),
    ("lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg -1 0 4 0", {"plain_stream": False}),
    ("lvdsStreamCfg -1 0 1 0\n", "", {"plain_stream": True}),
    ("frameCfg 0 1 3 4000", "frameCfg 0 1 255 0", {"frames": 0, "chirps_per_frame": 510}),
    ("chirpCfg 0 1 0 0 0 0 0 1", "chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4", {"transmitters": 2}),
    ("sensorStop\nflushCfg", "channelCfg 1 1 0\nframeCfg 5 5 1 1 1 1 0\nflushCfg", {"receivers": 4}),
    ("\n", "\r\n", {"receivers": 4}),
])  # fmt: skip
def test_what_a_line_sets(tmp_path, old, new, expected):
    assert old in GOOD
    config = read(tmp_path, GOOD.replace(old, new))
    assert {name: getattr(config, name) for name in expected} == expected


def test_the_frame_chooses_the_profile(tmp_path):
    waveform = read(tmp_path, GOOD.replace("frameCfg 0 1", "frameCfg 2 2")).waveform
    assert (waveform.slope, waveform.samples_per_chirp) == (40e12, 256)


def test_chirps_vary_their_profile(tmp_path):
    # start +1 MHz, slope +1000 kHz/us, ADC 0.5 us later
    waveform = read(tmp_path, GOOD.replace("chirpCfg 0 1 0 0 0 0 0 1", "chirpCfg 0 1 0 1e6 1000 0 0.5 1")).waveform
    assert waveform.slope == pytest.approx(59.6116e12)
    assert waveform.start_frequency == pytest.approx(77.001e9 + 9e-6 * 59.6116e12)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("58.6116", "steep", "line 8: slope of profileCfg is 'steep'; expected a number"),
    ("58.6116", "nan", "line 8: slope of profileCfg is 'nan'"),
    ("58.6116", "-2000", "line 8: the chirp falls to"),
    ("58.6116", "0", "line 8: slope is 0 Hz/s with 512 samples"),
    ("512 10000", "512.5 10000", "line 8: samples of profileCfg is '512.5'; expected a whole number from 1 to 65535"),
    ("512 10000", "512 0", "line 8: sampleRate of profileCfg is '0'; expected a number of at least 1"),
    ("0 77 7", "0 -77 7", "line 8: startFrequency of profileCfg is '-77'"),
    ("512 10000 0 0 30 ", "512 10000 0 0 ", "line 8: profileCfg has 13 fields; expected 14: id, startFrequency"),
    ("8.5 63 0 0 58", "8.5 59 0 0 58", "line 8: the ADC samples until 59.70 us, past the ramp's end at 59.00 us"),
    ("channelCfg 15", "channelCfg 0", "line 5: rxMask of channelCfg is '0'; expected a whole number from 1 to 15"),
    ("adcCfg 2 1", "adcCfg 0 1", "line 6: the ADC gives 12 or 14 bits"),
    ("adcCfg 2 1", "adcCfg 2 0", "line 7: format of adcbufCfg .* contradicts that of adcCfg"),
    ("adcbufCfg -1 0 1 0 1", "adcbufCfg -1 0 2 0 1", "line 7: sampleSwap of adcbufCfg is '2'"),
    ("chirpCfg 0 1 0", "chirpCfg 0 1 3", "line 10: the chirp uses profile 3, which no line defines"),
    ("chirpCfg 0 1 0", "chirpCfg 1 0 0", "line 10: last of chirpCfg is '0'; expected a whole number from 1 to 511"),
    ("frameCfg 0 1", "frameCfg 0 3", "line 12: the frame uses chirp 3, which no chirpCfg defines"),
    ("frameCfg 0 1", "frameCfg 0 2", "line 11: the chirp's waveform differs .*line 10"),
    ("frameCfg 0 1 3", "frameCfg 0 1 0", "line 12: loops of frameCfg is '0'"),
    ("125.5", "-1", "line 12: period of frameCfg is '-1'"),
    ("frameCfg 0 1", "advFrameCfg 1 1", "line 12: advFrameCfg .* use frameCfg"),
    ("channelCfg 15 7 0\n", "", "has no channelCfg; expected"),
    ("sensorStart", "flushCfg", "has no channelCfg, adcCfg, adcbufCfg, profileCfg, chirpCfg, frameCfg"),
])  # fmt: skip
def test_mistakes_are_named_with_line_and_field(tmp_path, old, new, words):
    assert old in GOOD
    with pytest.raises(FormatError, match=words) as caught:
        read(tmp_path, GOOD.replace(old, new))
    assert str(caught.value).startswith("a.cfg ")


def test_other_files_are_refused(tmp_path):
    for data in (b"", b"\x7fELF\0\0", bytes(1 << 21), b"% comment\n" * (1 << 17), b"\xff\xfe\x80", b"hello\n"):
        with pytest.raises(FormatError, match=r"a\.cfg"):
            read(tmp_path, data)
    with pytest.raises(FileError, match="folder"):
        read_ti_config(tmp_path)


def test_records_are_checked(tmp_path):
    good = read(tmp_path, GOOD)
    fields = {name: getattr(good, name) for name in TiConfig.__dataclass_fields__}
    for wrong in ({"waveform": 3}, {"receivers": 0}, {"loops": 0}, {"frames": -1}, {"tx_masks": ("a",)}):
        with pytest.raises(InputError):
            TiConfig(**{**fields, **wrong})


def test_mutations_end_in_our_errors(tmp_path):
    draw, read_well = random.Random(0), 0
    values = ["nan", "1e999", "-1", "99999999999999999999", "0", "", "%", "\n", "511", "3.7", "flushCfg", "\xff", "1_0"]
    for _ in range(500):
        words = GOOD.split(" ")
        for _ in range(draw.randrange(1, 4)):
            words[draw.randrange(len(words))] = draw.choice(values)
        try:
            frequencies = read(tmp_path, " ".join(words)).waveform.frequencies
            read_well += bool(np.isfinite(frequencies).all())
        except MillisightError as error:
            read_well += 0 if str(error).startswith("a.cfg") else -1000
    assert 30 < read_well < 470
