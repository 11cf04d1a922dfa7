"""The page about arrays of one's own: what it prints runs, and what it says of signs and real samples is so."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import hilbert

import millisight as ms

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "arrays.md").read_text(encoding="utf-8")


@pytest.fixture
def made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    exec(compile(block, "arrays.md", "exec"), names)
    return names


def peak_of(made, frames, **radar):
    device = ms.Radar(name="mine", waveform=radar.get("waveform", made["waveform"]), array=made["array"])
    capture = ms.Capture(radar=device, trajectory=made["path"], frames=frames)
    image = ms.form_image(capture, made["grid"])
    return float(np.linalg.norm(image.peak)), float(abs(image.values).max())


def test_it_runs_and_its_signs_are_right(made, tmp_path):
    image, frames = ms.load(tmp_path / "mine.image.h5"), made["frames"]
    assert np.linalg.norm(image.peak) < 1e-6
    assert abs(image.values).max() == pytest.approx(1, abs=0.01)
    assert image.seen_from == "above"
    assert peak_of(made, frames.conj())[1] < 0.1
    assert peak_of(made, frames.real) == pytest.approx((0, 0.5), abs=0.03)
    assert peak_of(made, hilbert(frames.real).conj()) == pytest.approx((0, 1), abs=0.05)
    rising = made["waveform"]
    falling = ms.Waveform(
        start_frequency=rising.frequencies[-1], slope=-rising.slope, sample_rate=rising.sample_rate,
        samples_per_chirp=rising.samples_per_chirp,
    )  # fmt: skip
    np.testing.assert_allclose(falling.frequencies, rising.frequencies[::-1])
    assert peak_of(made, hilbert(frames.real[..., ::-1]), waveform=falling) == pytest.approx((0, 1), abs=0.05)
