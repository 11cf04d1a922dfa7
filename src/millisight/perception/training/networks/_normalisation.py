"""What networks normalise their channels by."""

from torch import nn

_GROUPS = 8


def normalised(how: str, channels: int) -> nn.Module:
    """The layer that normalises so many channels: "group", eighths of them over each image; "batch", each over a batch.

    The first makes training and use one function. The second uses in use what the channels were in training, so that
    what an image shows elsewhere, and how much of it is empty, changes nothing.
    """
    return nn.BatchNorm2d(channels) if how == "batch" else nn.GroupNorm(_GROUPS, channels)
