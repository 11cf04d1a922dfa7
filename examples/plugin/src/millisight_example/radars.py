"""A radar preset."""

import numpy as np

import millisight as ms


def example_60ghz() -> ms.Radar:
    """A radar at 60 GHz with 4 GHz of bandwidth, and two receivers half a wavelength apart. No real device."""
    return ms.Radar(
        name="example-60ghz",
        waveform=ms.Waveform(start_frequency=60e9, slope=4e9 / 51.2e-6, sample_rate=5e6, samples_per_chirp=256),
        array=ms.AntennaArray(
            tx_positions=np.zeros((1, 3)), rx_positions=np.array([[-0.005, 0.0, 0.0], [-0.0075, 0.0, 0.0]])
        ),
        path_offset=0.0,
    )
