"""The laws of windows, for every window."""

import numpy as np
import pytest

from millisight.core.errors import UnknownNameError
from millisight.imaging import WINDOWS
from millisight.imaging._windows import aperture_weights, range_weights, window_pair

PLACES = np.linspace(-1, 1, 401)


def sidelobe_db(weights):
    """The highest sidelobe of the window's spectrum over its main lobe [dB]."""
    spectrum = np.abs(np.fft.fft(weights, 64 * len(weights)))[: 32 * len(weights)]
    falls = np.flatnonzero(np.diff(spectrum) > 0)[0]  # the first null
    return 20 * np.log10(spectrum[falls:].max() / spectrum[0])


def test_there_are_windows():
    assert set(WINDOWS) >= {"hann", "taylor"}


@pytest.mark.parametrize("name", WINDOWS)
class TestEachWindow:
    def test_it_is_even_and_highest_in_the_middle(self, name):
        weights = WINDOWS[name](PLACES)
        assert weights.shape == PLACES.shape
        assert weights == pytest.approx(weights[::-1], abs=1e-12)
        assert weights.argmax() == 200
        assert weights.min() > -1e-9

    def test_its_sidelobes_are_lower_than_without_a_window(self, name):
        assert sidelobe_db(WINDOWS[name](PLACES)) < sidelobe_db(np.ones(401)) - 10

    def test_weights_have_the_mean_one(self, name):
        assert range_weights(name, 64).mean() == pytest.approx(1)
        positions = np.random.default_rng(0).uniform(-0.2, 0.2, (300, 3)) * [1, 1, 0]
        assert aperture_weights(name, positions).mean() == pytest.approx(1)


def test_published_sidelobes():
    """Hann: -31.5 dB. Taylor: the -30 dB that it is made for."""
    assert sidelobe_db(WINDOWS["hann"](PLACES)) == pytest.approx(-31.5, abs=0.3)
    assert sidelobe_db(WINDOWS["taylor"](PLACES)) == pytest.approx(-30, abs=1.0)


def test_a_chirp_is_tapered_over_its_whole_band():
    """Each sample stands for the N-th part of the band around it: the ends of the window lie half a sample beyond."""
    places = (np.arange(8) + 0.5) / 8 - 0.5
    expected = np.cos(np.pi * places) ** 2
    assert range_weights("hann", 8) == pytest.approx(expected / expected.mean(), abs=1e-12)
    assert range_weights(None, 8) == pytest.approx(np.ones(8))


def test_an_unknown_window_is_refused_before_any_work():
    with pytest.raises(UnknownNameError, match="unknown window 'han'. Did you mean 'hann'"):
        window_pair("han")


def test_the_aperture_is_tapered_along_its_two_widest_axes_from_end_to_end():
    """Hann: cos² of the place between the ends, along x and z here; along y, the narrowest, nothing."""
    from millisight.imaging._windows import aperture_weights

    x, y, z = np.meshgrid(np.linspace(0, 0.2, 9), np.linspace(-0.01, 0.01, 3), np.linspace(0.3, 0.4, 5), indexing="ij")
    weights = aperture_weights("hann", np.stack([x, y, z], axis=-1).reshape(-1, 3)).reshape(x.shape)
    expected = np.cos(np.pi / 2 * (x - 0.1) / 0.1) ** 2 * np.cos(np.pi / 2 * (z - 0.35) / 0.05) ** 2
    assert weights.mean() == pytest.approx(1)
    assert np.allclose(weights, expected / expected.mean(), atol=0.01)
    assert weights[[0, -1]].max() < 1e-4
    assert weights[:, :, [0, -1]].max() < 1e-4
    assert np.allclose(weights, weights[:, :1])
