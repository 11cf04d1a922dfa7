"""What `millisight info` says of a raw file: the facts in a few lines, and every contradiction."""

import json
import re

import numpy as np
import pytest

from helpers.oracles import shared
from helpers.raw_scenes import scene
from millisight.core.errors import DamagedFileError, FormatError, UnknownNameError
from millisight.io.raw import describe_raw, write_dca1000

CONFIG = """\
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 {swap} {interleave} 1
profileCfg 0 77 7 6 40 0 0 60 1 128 5000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 4 {frames} 100 1 0
"""


@pytest.fixture
def folder(tmp_path):
    """A four-lane file of 8 frames of 4 chirps of 128 samples, alone in its folder."""
    frames = scene(np.random.default_rng(0), frames=8, samples=128, reflectors=1, snr_db=30)
    write_dca1000(tmp_path / "adc_20250102030405.bin", frames)
    return tmp_path


def lines(folder, **settings):
    told = describe_raw(folder / "adc_20250102030405.bin", **settings)
    return {line.split(": ")[0]: line for line in told}, [line for line in told if line.startswith("warning: ")]


def test_a_real_capture_in_lines():
    told = describe_raw(shared("captures", "iwr1443_adc_data20251124114141.bin"))
    margin = re.fullmatch(r"order: two-lane interleaved, (.*) dB over the next best \(four-lane\)", told[0])
    assert margin
    assert float(margin[1]) > 30
    assert told[1:] == [
        "frames: 50 x 8 chirps x 4 RX x 256 samples (iwr1443_metadata.json)",
        "side: positive bins, read I first (assumed); ranges come out positive",
        "lit range bins: 1 to 2, 8 to 10, 15 to 16, 18 to 20, 22 to 31 of 256 (strongest 19; within 10 dB of it)",
        "gaps: none",
    ]


def test_without_any_settings_the_data_speaks(folder):
    told, warnings = lines(folder)
    assert told["order"].startswith("order: four-lane, ")
    assert told["frames"] == (
        "frames: 32 chirps (chirps per frame unknown) x 4 RX x 128 samples "
        "(receivers assumed; samples worked out from the data's repetition)"
    )
    assert not warnings


def test_settings_come_from_the_caller_then_the_cfg_then_json(folder):
    settings = {"numFrames": 8, "num_adc_samples": 128, "n_chirps": 4, "rx_channels": 4, "other": "x"}
    (folder / "other.json").write_text(json.dumps(settings))
    assert lines(folder)[0]["frames"] == "frames: 8 x 4 chirps x 4 RX x 128 samples (other.json)"
    (folder / "radar.cfg").write_text(CONFIG.format(swap=0, interleave=0, frames=8))
    told, warnings = lines(folder)
    assert told["frames"] == "frames: 8 x 4 chirps x 4 RX x 128 samples (radar.cfg)"
    assert told["side"] == "side: positive bins, read I first (radar.cfg); ranges come out positive"
    assert not warnings
    told, warnings = lines(folder, chirps=2)
    assert told["frames"].startswith("frames: 16 x 2 chirps x 4 RX x 128 samples (chirps declared; ")
    assert warnings == [
        "warning: radar.cfg says 4 chirps; declared says 2, which is used",
        "warning: other.json says 4 chirps; declared says 2, which is used",
        "warning: radar.cfg says 8 frames; the file holds 16",
    ]


def test_of_several_json_files_the_one_that_names_the_capture_counts(folder):
    (folder / "a.json").write_text('{"num_samples": 64, "num_chirps": 1}')
    (folder / "b.json").write_text('{"num_samples": 128, "num_chirps": 4, "stamp": "20250102030405"}')
    assert lines(folder)[0]["frames"].endswith("(samples, chirps b.json; receivers assumed)")
    (folder / "adc_20250102030405.json").write_text('{"samples": 128, "chirps": 2}')
    assert lines(folder)[0]["frames"].startswith("frames: 16 x 2 chirps")
    for foreign in ("[1, 2]", '{"num_samples": 1, "num_chirps": ', "[" * 100_000, '{"samples": 128}'):
        (folder / "adc_20250102030405.json").write_text(foreign)
        assert lines(folder)[0]["frames"].endswith("(samples, chirps b.json; receivers assumed)")


def test_contradictions_are_warned_of(folder):
    def warned(words, **settings):
        return any(words in line for line in lines(folder, **settings)[1])

    assert warned("order two-lane (declared) does not fit: the data is four-lane, by ", order="two-lane")
    assert warned("the data repeats every 128 samples, which 96 samples a chirp do not fit", samples=96)
    assert warned("are 4 whole frames of 14336 bytes, and 8192 bytes over", samples=128, chirps=7)
    assert warned("declared says 9 frames; the file holds 8", samples=128, chirps=4, frames=9)
    assert warned("declared says 9 receivers; expected 1 to 4", receivers=9)
    assert warned("Q first (declared) makes ranges negative", sample_swap=True)
    assert not warned("warning", samples=128, chirps=4, frames=8, order="four-lane", sample_swap=False)
    (folder / "a.cfg").write_text(CONFIG.format(swap=1, interleave=1, frames=0))
    assert warned("order two-lane (a.cfg) does not fit")
    assert warned("Q first (a.cfg) makes ranges negative")
    (folder / "a.cfg").write_text(CONFIG.format(swap=1, interleave=1, frames=0) + "lvdsStreamCfg -1 1 1 0\n")
    assert warned("a.cfg puts headers")
    (folder / "a.cfg").write_text("channelCfg 15 7\n")
    assert warned("a.cfg line 1: channelCfg has 2 fields")
    with pytest.raises(FormatError, match="channelCfg has 2 fields"):
        lines(folder, config=folder / "a.cfg")


def test_gaps_and_cut_ends_are_told(folder):
    path = folder / "adc_20250102030405.bin"
    data = bytearray(path.read_bytes())
    data[20000:23000] = bytes(3000)
    path.write_bytes(bytes(data[:-1001]))
    told, warnings = lines(folder, samples=128, chirps=4)
    assert told["gaps"] == "gaps: 1, 3000 bytes of zeros (3000 at byte 20000); 1 of 7 frames lost: 2"
    assert any("7 whole frames of 8192 bytes, and 7191 bytes over" in line for line in warnings)


def test_noise_is_unknown_with_its_reason(tmp_path):
    write_dca1000(tmp_path / "n.bin", np.random.default_rng(0).normal(0, 99, (4, 2, 4, 64, 2)).view(complex)[..., 0])
    told = describe_raw(tmp_path / "n.bin")
    assert told[0].startswith("order: unknown, ")
    assert told[0].endswith("no pairing gives a one-sided spectrum: noise, silence, or another format")
    assert told[1] == "frames: unknown, 8192 bytes (give samples, receivers and chirps)"
    assert describe_raw(tmp_path / "n.bin", samples=64, order="two-lane")[1].startswith("frames: 8 chirps")


def test_what_is_no_raw_file_is_refused(folder, tmp_path):
    for data, error in ((b"", DamagedFileError), (b"I am text\n" * 9, FormatError)):
        (tmp_path / "x.bin").write_bytes(data)
        with pytest.raises(error, match=r"x\.bin"):
            describe_raw(tmp_path / "x.bin")
    with pytest.raises(UnknownNameError, match="sample order"):
        lines(folder, order="one-lane")
