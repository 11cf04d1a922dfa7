"""The classifiers' networks in torch, for training: the paper's, and a small one that uses more of what radar gives."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from millisight.perception.classification import CLASSIFIER_CHANNELS
from millisight.perception.training._beside import Beside
from millisight.perception.training.networks._normalisation import normalised

_MAGNITUDE = CLASSIFIER_CHANNELS.index("magnitude")
_PAPER_SIDE = 224
_PAPER_WIDTHS = (16, 128, 256, 512, 512)
_PAPER_STRIDES = (2, 2, 2, 2, 1)
_PAPER_POOLED = 2
_PAPER_CONNECTED = (1024, 512, 256)


class SmallNetwork(nn.Module):
    """Four times two convolutions, the first of which halves; mean and maximum over what is left; one layer more.

    It sees all channels: the mask, the paper's projection, levels of eight slices along z, the other band.

    Parameters
    ----------
    classes : how many
    normalisation : "group": groups of eighths of the channels, over each image, so that training and use are one
        function; "batch": each channel, over a batch, in use by what it was in training
    widths : of the four sizes, in channels
    """

    def __init__(self, classes: int, normalisation: str = "group", widths: Sequence[int] = (32, 64, 96, 128)):
        super().__init__()
        steps: list[nn.Module] = []
        for inputs, outputs in zip((len(CLASSIFIER_CHANNELS), *widths[:-1]), widths, strict=True):
            for channels, stride in ((inputs, 2), (outputs, 1)):
                convolution = nn.Conv2d(channels, outputs, 3, stride=stride, padding=1, bias=False)
                steps += [convolution, normalised(normalisation, outputs), nn.ReLU()]
        self.seen: nn.Sequential = nn.Sequential(*steps)
        self.dropout: nn.Dropout = nn.Dropout(0.3)
        self.last: nn.Linear = nn.Linear(2 * widths[-1], classes)

    def forward(self, channels: Tensor) -> Tensor:
        """(N, classes) logits of channels (N, C, S, S)."""
        x = self.seen(channels)
        return self.last(self.dropout(torch.cat([x.mean(dim=(2, 3)), x.amax(dim=(2, 3))], dim=1)))


class PaperNetwork(nn.Module):
    """The paper's, smaller: five convolutions, fully connected layers, from the masked projection alone.

    Convolutions of 3 x 3 with strides 2, 2, 2, 2, 1 and connected layers as in its released form, which has one layer
    more than the paper's three: 1024, 512, 256, classes. There 512 x 11 x 11 values join the two, and 62 of its 68
    million weights with them; here the last 14 x 14 are averaged to 2 x 2. `ReleasedNetwork` is the released form.
    """

    def __init__(self, classes: int):
        super().__init__()
        steps: list[nn.Module] = []
        for a, b, stride in zip((1, *_PAPER_WIDTHS), _PAPER_WIDTHS, _PAPER_STRIDES, strict=False):
            steps += [nn.Conv2d(a, b, 3, stride=stride, padding=1), nn.ReLU()]
        self.seen: nn.Sequential = nn.Sequential(*steps)
        sizes = (_PAPER_WIDTHS[-1] * _PAPER_POOLED**2, *_PAPER_CONNECTED)
        layers: list[nn.Module] = []
        for a, b in pairwise(sizes):
            layers += [nn.Linear(a, b), nn.ReLU()]
        self.connected: nn.Sequential = nn.Sequential(*layers, nn.Linear(sizes[-1], classes))

    def forward(self, channels: Tensor) -> Tensor:
        """(N, classes) logits of channels (N, C, S, S)."""
        magnitude = channels[:, _MAGNITUDE : _MAGNITUDE + 1]
        x = self.seen(functional.interpolate(magnitude, size=(_PAPER_SIDE, _PAPER_SIDE), mode="bilinear"))
        return self.connected(functional.avg_pool2d(x, x.shape[-1] // _PAPER_POOLED).flatten(1))


class Members(nn.Module):
    """Networks of one kind, each with weights of its own; their answers are averaged.

    In training a batch is dealt out to the members: each sees other examples.

    Parameters
    ----------
    members : the networks that learn
    beside : networks that are trained already, and stay as they are
    """

    def __init__(self, members: Sequence[nn.Module], beside: Sequence[nn.Module] = ()):
        super().__init__()
        self.members: nn.ModuleList = nn.ModuleList(members)
        self.beside: nn.ModuleList = nn.ModuleList(beside).requires_grad_(False)

    def forward(self, channels: Tensor) -> Tensor:
        """(N, classes) the mean of all logits; in training the logits of each member for its share of the batch."""
        if not self.training:
            return torch.stack([one(channels) for one in (*self.members, *self.beside)]).mean(dim=0)
        dealt = channels.tensor_split(len(self.members))
        return torch.cat([one(some) for one, some in zip(self.members, dealt, strict=True)])


def classifier_network(
    name: str, classes: int, normalisation: str = "group", members: int = 1, beside: Sequence[Beside] = ()
) -> nn.Module:
    """The network "small", normalised so, or "paper", with new weights from torch's generator; or so many of them.

    With networks `beside` it answers by the mean of their logits and its own; they do not learn.
    """

    def made() -> nn.Module:
        return SmallNetwork(classes, normalisation) if name == "small" else PaperNetwork(classes)

    learning = [made() for _ in range(members)]
    if members == 1 and not beside:
        return learning[0]
    return Members(learning, [one.load_into(made()) for one in beside])
