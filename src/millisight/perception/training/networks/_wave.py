"""The `wave` network in torch, for training: a small U-Net."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from millisight.perception.segmentation import WAVE_CHANNELS
from millisight.perception.training.networks._normalisation import normalised


class WaveNetwork(nn.Module):
    """Logits of "here lies the object", a pixel each.

    After Ronneberger, Fischer & Brox, "U-Net" (2015): three halvings and back, at each size what was before is beside
    what comes from below.

    Parameters
    ----------
    widths : of the four sizes, in channels
    normalisation : "group": groups of eighths of the channels, over each image, so that training and use are one
        function; "batch": each channel, over a batch, in use by what it was in training, so that what an image shows
        elsewhere, and how much of it is empty, changes nothing
    """

    def __init__(self, widths: Sequence[int] = (16, 32, 64, 96), normalisation: str = "group"):
        super().__init__()
        inputs = (len(WAVE_CHANNELS), *widths[:-1])
        pairs = zip(inputs, widths, strict=True)
        self.down: nn.ModuleList = nn.ModuleList(_block(a, b, normalisation) for a, b in pairs)
        pairs = zip(widths[:0:-1], widths[-2::-1], strict=True)
        self.up: nn.ModuleList = nn.ModuleList(_block(below + beside, beside, normalisation) for below, beside in pairs)
        self.last: nn.Conv2d = nn.Conv2d(widths[0], 1, 1)

    def forward(self, channels: Tensor) -> Tensor:
        """(N, A, B) logits of channels (N, C, A, B), A and B multiples of 8."""
        passed, x = [], channels
        for i, block in enumerate(self.down):
            x = block(functional.max_pool2d(x, 2) if i else x)
            passed.append(x)
        for block, beside in zip(self.up, passed[-2::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0, mode="nearest"), beside], dim=1))
        return self.last(x).squeeze(1)


def _block(inputs: int, outputs: int, normalisation: str) -> nn.Sequential:
    steps: list[nn.Module] = []
    for width in (inputs, outputs):
        steps += [
            nn.Conv2d(width, outputs, 3, padding=1, bias=False),
            normalised(normalisation, outputs),
            nn.ReLU(inplace=True),
        ]
    return nn.Sequential(*steps)
