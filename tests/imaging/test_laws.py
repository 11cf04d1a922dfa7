"""The laws of imaging, for every imager."""

import millisight as ms
from helpers.laws import ImagerLaws


class TestExact(ImagerLaws):
    method = "exact"
    tolerance = 1e-5


class TestBackprojection(ImagerLaws):
    method = "backprojection"


class TestFast(ImagerLaws):
    method = "fast"


class TestYardstick(ImagerLaws):
    """`image_at`, in float64 on frames of single precision."""

    tolerance = 1e-5

    def imager(self, capture, grid):
        waveform = capture.radar.waveform
        values = ms.image_at(
            capture.frames,
            capture.tx_positions,
            capture.rx_positions,
            waveform.frequencies,
            grid.points,
            capture.radar.path_offset,
        )
        return values.reshape(grid.shape)
