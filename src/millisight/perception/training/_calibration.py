"""How sure a classifier may be of its answers: the temperature and the threshold that suit the validation scenes."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.perception.training._loop import run

if TYPE_CHECKING:
    from torch import nn

_SURE = 0.95  # of the answers that are given should be right: on validation
_FEWEST = 100  # answers that a calibration of their own takes
_FEWEST_OBJECTS = 10  # that are answered about surely


def cross_entropy(logits: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(N,) -log of the probability of the right class, of logits (N, C) and labels (N,)."""
    shifted = logits - logits.max(axis=1, keepdims=True)
    return np.log(np.exp(shifted).sum(axis=1)) - shifted[np.arange(len(labels)), labels]


def weights_of(labels: np.ndarray, prior: np.ndarray | None) -> np.ndarray:
    """(N,) what an answer about each of labels (N,) counts, so that classes are as frequent as in `prior` (C,); None:
    each counts as much."""
    if prior is None:
        return np.ones(len(labels))
    return (prior / np.maximum(np.bincount(labels, minlength=len(prior)), 1))[labels]


def best_temperature(logits: np.ndarray, labels: np.ndarray, prior: np.ndarray | None = None) -> float:
    """The number by which logits (N, C) are divided so that the mean cross-entropy is least.

    Guo et al. 2017, "On Calibration of Modern Neural Networks". With the shares `prior` (C,) of the classes, their
    logarithms are added to what is divided, and answers count as `weights_of` says.
    """
    from scipy.optimize import minimize_scalar

    weights = weights_of(labels, prior)
    found: Any = minimize_scalar(
        lambda power: np.average(cross_entropy(scaled(logits, 2**power, prior), labels), weights=weights),
        bounds=(-3, 5), method="bounded",
    )  # fmt: skip
    return round(float(2**found.x), 4)


def best_threshold(
    logits: np.ndarray, labels: np.ndarray, objects: np.ndarray | None = None, weights: np.ndarray | None = None
) -> float:
    """The lowest confidence from which on 95 % of the answers are right.

    Parameters
    ----------
    logits : (N, C)
    labels : (N,) indices of the right classes
    objects : (N,) numbers of what was seen: each counts as one, however often it was, and ten of them must have
        answers; None: every answer counts
    weights : (N,) what each counts, the same for all answers about an object; None: 1
    """
    right, confidence = _answers(logits, labels)
    weights = np.ones(len(labels)) if weights is None else weights
    _, numbers = np.unique(np.arange(len(labels)) if objects is None else objects, return_inverse=True)
    hits, seen, counts = np.zeros((3, numbers.max() + 1))
    counts[numbers], found = weights, None
    for i in np.argsort(-confidence, kind="stable"):
        hits[numbers[i]] += right[i]
        seen[numbers[i]] += 1
        some = seen > 0
        share = np.average(hits[some] / seen[some], weights=counts[some])
        if (objects is None or some.sum() >= _FEWEST_OBJECTS) and share >= _SURE:
            found = confidence[i]
    return round(float(confidence.max() if found is None else found), 4)


def calibration_of(
    logits: np.ndarray, labels: np.ndarray, covered: np.ndarray, objects: np.ndarray, prior: np.ndarray | None = None
) -> dict[str, dict[str, float]]:
    """Temperature and threshold of the answers about "covered" and about "open" objects, each where there are many.

    Parameters
    ----------
    logits : (N, C)
    labels : (N,) indices of the right classes
    covered : (N,) bool, whether the brightest of the image was a sheet's
    objects : (N,) see `best_threshold`
    prior : (C,) see `best_temperature`
    """
    found: dict[str, dict[str, float]] = {}
    for name, some in (("open", ~covered), ("covered", covered)):
        if some.sum() >= _FEWEST:
            temperature = best_temperature(logits[some], labels[some], prior)
            threshold = best_threshold(
                scaled(logits[some], temperature, prior), labels[some], objects[some], weights_of(labels[some], prior)
            )
            found[name] = {"temperature": temperature, "threshold": threshold}
    return found


def scaled(logits: np.ndarray, temperature: float, prior: np.ndarray | None) -> np.ndarray:
    """(N, C) logarithms of what the classes' probabilities are proportional to."""
    return logits / temperature + (0.0 if prior is None else np.log(prior))


def novelty_scores(novelty: np.ndarray, shown: Sequence[str], known: np.ndarray) -> dict[str, Any]:
    """The limit above which an answer is not given, and how well novelty parts what is of a class from what is not.

    Parameters
    ----------
    novelty : (N,) probabilities
    shown : (N,) what each example shows
    known : (N,) bool, whether it is of a class

    Returns
    -------
    dict
        "limit", which 95 % of what is of a class stay below; by what is of none the area under the receiver's operating
        characteristic, "auroc", and the share that is refused, "refused".
    """
    limit = float(np.quantile(novelty[known], _SURE))
    auroc, refused = {}, {}
    for name in sorted({name for name, own in zip(shown, known, strict=True) if not own}):
        some = novelty[[one == name for one in shown]]
        auroc[name] = round(area_under_curve(novelty[known], some), 4)
        refused[name] = round(float((some > limit).mean()), 4)
    return {"limit": round(limit, 4), "auroc": auroc, "refused": refused}


def area_under_curve(low: np.ndarray, high: np.ndarray) -> float:
    """The share of pairs of a value of `low` (N,) and one of `high` (M,) in which the latter is the larger; ties half.

    The area under the receiver's operating characteristic, by ranks (Mann and Whitney 1947).
    """
    from scipy.stats import rankdata

    ranks = rankdata(np.concatenate([low, high]))[len(low) :]
    return float((ranks.sum() - len(high) * (len(high) + 1) / 2) / (len(low) * len(high)))


def answer_scores(logits: np.ndarray, labels: np.ndarray, weights: np.ndarray | None = None) -> dict[str, float]:
    """Accuracy, mean confidence and mean cross-entropy ("surprise", as descriptions of weights call it)."""
    right, confidence = _answers(logits, labels)
    every = {"accuracy": right, "mean confidence": confidence, "surprise": cross_entropy(logits, labels)}
    scores = {name: np.average(values, weights=weights) for name, values in every.items()}
    return {"examples": len(labels)} | {name: round(float(value), 4) for name, value in scores.items()}


def _answers(logits: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) whether the most probable class is the right one, and its probability."""
    probabilities = np.exp(logits - logits.max(axis=1, keepdims=True))
    probabilities /= probabilities.sum(axis=1, keepdims=True)
    return logits.argmax(axis=1) == labels, probabilities.max(axis=1)


def logits_of(network: "nn.Module", inputs: Iterable[np.ndarray]) -> np.ndarray:
    """(N, classes) float64 logits of N inputs (K, C, S, S), each the mean over its K views."""
    return np.stack([run(network, one.astype(np.float32)).mean(dim=0).double().cpu().numpy() for one in inputs])
