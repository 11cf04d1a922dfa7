"""The segmenter that needs no network: a random walker with priors.

Each pixel's value is the probability that a walker from there meets a positive prompt before a negative one (Grady
2006, doi:10.1109/TPAMI.2006.233). It steps to a neighbour the more easily the more alike the two are, and may end at
any pixel by that pixel's own brightness (priors: Grady 2005, doi:10.1109/CVPR.2005.239), which lets a handful of
prompts do. The probabilities x solve (L + g) x = g p + seeds, with the Laplacian L of the pixels' graph and priors p.

It knows nothing of what objects look like, and finds only what is brighter than its surroundings.
"""

import numpy as np

from millisight.core import checked_record
from millisight.core.errors import InputError
from millisight.data import Picture, Prompts
from millisight.perception.segmentation._segmentation import SEGMENTERS, Candidates

_DECADES = 3.0  # of power that are told apart: the published negatives lie below 0.02
_BETA = 20.0  # how much harder a step is between pixels as different as the two kinds of prompts: exp(-20)
_PULL = 0.1  # g: of a pixel's own brightness, against 1 for a neighbour that is alike
_WIDTH = 0.1  # of the step of the priors, where dark prompts are 0 and bright ones 1
_ACCURACY = 1e-5  # of the probabilities, relative
_MOST_STEPS = 1000  # some 40 are enough, since g bounds the condition of the system
_LEVELS = (0.4, 0.7, 0.85, 0.95)  # where that step is: one mask each, from the whole object to its brightest part


@SEGMENTERS.add("classical")
class ClassicalSegmenter:
    """A random walker with priors.

    Four masks are offered, for brightness near and far below the positive prompts', without holes but for those that
    hold a negative prompt; the best first by how well each parts bright from dark (Otsu's between-class variance, of
    the logarithm of power; of a photo, of its colours).
    """

    name = "classical"
    needs_prompts = True

    def segment(self, picture: Picture, prompts: Prompts | None) -> Candidates:
        """Four masks, (4, A, B).

        Raises
        ------
        InputError
            There is no positive prompt, or one lies beside the picture.
        """
        checked_record(picture, Picture, name="picture")
        if prompts is None or not prompts.positive.any():
            raise InputError('"classical" needs at least one positive prompt; draw some with power_prompts')
        prompts.check_on(picture)
        values = _values(picture)
        labels = _labels(values, prompts)
        bright = values[labels == 1].mean(axis=0)
        dark = values[labels == 0].mean(axis=0) if (labels == 0).any() else values.min(axis=(0, 1))
        span = float(((bright - dark) ** 2).sum())
        # Where nothing tells the two kinds apart, all is the object.
        share = (values - dark) @ (bright - dark) / span if span else np.ones(labels.shape)
        priors = [_step(share - level) for level in _LEVELS]
        conductances = _conductances(values, span or 1.0)
        found = [_walked(conductances, labels, prior) > 0.5 for prior in priors]
        masks = [_filled(mask, labels == 0) for mask in found]
        scores = np.array([_separation(share, mask) for mask in masks])
        order = np.argsort(-scores, kind="stable")
        return Candidates(masks=np.array(masks)[order], scores=scores[order])


def _values(picture: Picture) -> np.ndarray:
    """(A, B, C) what pixels are compared by, about 0 to 1: the logarithm of power, or a photo's colours."""
    if picture.power is None:
        return picture.rgb / 255.0
    floor = 10.0**-_DECADES
    return 1 + np.log10(np.maximum(picture.power, floor).astype(float))[..., None] / _DECADES


def _labels(values: np.ndarray, prompts: Prompts) -> np.ndarray:
    """(A, B) int8: 1 at positive prompts, 0 at negative ones, -1 elsewhere.

    Where there are no negative ones, the half of the picture's rim that is least like the positive ones is taken.
    """
    labels = np.full(values.shape[:2], -1, np.int8)
    labels[tuple(prompts.points[~prompts.positive].T)] = 0
    labels[tuple(prompts.points[prompts.positive].T)] = 1
    if prompts.positive.all():
        rim = np.ones(labels.shape, bool)
        rim[1:-1, 1:-1] = False
        unlike = ((values - values[labels == 1].mean(axis=0)) ** 2).sum(axis=-1)
        labels[rim & (labels < 0) & (unlike > np.median(unlike[rim]))] = 0
    return labels


def _step(share: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(np.clip(-share / _WIDTH, -50, 50)))


def _conductances(values: np.ndarray, span: float) -> list[np.ndarray]:
    """Between neighbours along the first axis (A - 1, B) and along the second (A, B - 1)."""
    return [np.exp(-_BETA / span * (np.diff(values, axis=axis) ** 2).sum(axis=-1)) for axis in (0, 1)]


def _walked(conductances: list[np.ndarray], labels: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """(A, B) probabilities; prompts have theirs."""
    from millisight.perception.segmentation._walk_kernels import walk  # Numba: not for --help

    free, fixed = labels < 0, np.maximum(labels, 0).astype(float)
    down, across = np.pad(conductances[0], ((1, 1), (0, 0))), np.pad(conductances[1], ((0, 0), (1, 1)))
    return walk(down, across, free, fixed, prior, _PULL, _ACCURACY, _MOST_STEPS)


def _filled(mask: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """The mask without its holes, but for those that hold a pixel known to lie `beside` the object."""
    from scipy.ndimage import binary_fill_holes, label

    holes = np.asarray(label(np.asarray(binary_fill_holes(mask)) & ~mask)[0])
    return mask | ((holes > 0) & ~np.isin(holes, holes[beside]))


def _separation(share: np.ndarray, mask: np.ndarray) -> float:
    """Otsu's between-class variance; 0 for a mask that is empty or full."""
    inside = float(mask.mean())
    return inside * (1 - inside) * float(share[mask].mean() - share[~mask].mean()) ** 2 if 0 < inside < 1 else 0.0
