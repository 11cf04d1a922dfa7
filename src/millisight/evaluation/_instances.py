"""Metrics of several objects in one image: each true object is matched with one found object at most."""

from typing import NamedTuple

import numpy as np

from millisight.core import checked_number, checked_record
from millisight.data import Instances
from millisight.evaluation._metrics import check_same_grid


class InstanceScores(NamedTuple):
    """How well objects were found.

    Attributes
    ----------
    found, true : numbers of objects
    matches : (number of the found, number of the true object, IoU), from 1 on, of pairs that share a pixel
    precision, recall : share of the found, and of the true, objects whose pair has an IoU of the threshold at least;
        1 of none
    mean_iou : mean over the true objects of the IoU with the one each is matched with, 0 without; without true objects
        1 where none was found, and 0 otherwise
    """

    found: int
    true: int
    matches: tuple[tuple[int, int, float], ...]
    precision: float
    recall: float
    mean_iou: float


def score_instances(found: Instances, truth: Instances, *, threshold: float = 0.5) -> InstanceScores:
    """Match found with true objects, so that the sum of their IoUs is largest (Hungarian method), and score them.

    Parameters
    ----------
    found, truth : on one grid
    threshold : IoU from which on an object counts as found

    Raises
    ------
    InputError
        They lie on different grids.
    """
    from scipy.optimize import linear_sum_assignment

    checked_record(found, Instances, name="found")
    checked_record(truth, Instances, name="truth")
    threshold = checked_number(threshold, name="threshold", above=0)
    check_same_grid(found.grid_xy, truth.grid_xy, of="instances")
    shared = np.zeros((len(found) + 1, len(truth) + 1))
    np.add.at(shared, (found.labels.ravel(), truth.labels.ravel()), 1)
    sizes = shared.sum(axis=1)[1:, None], shared.sum(axis=0)[None, 1:]
    inner = shared[1:, 1:]
    ious = inner / np.maximum(sizes[0] + sizes[1] - inner, 1)
    matches = tuple(
        (int(i) + 1, int(j) + 1, float(ious[i, j]))
        for i, j in zip(*linear_sum_assignment(ious, maximize=True), strict=True)
        if ious[i, j] > 0
    )
    hits = sum(iou >= threshold for _, _, iou in matches)
    none = float(len(found) == 0)
    return InstanceScores(
        found=len(found),
        true=len(truth),
        matches=matches,
        precision=hits / len(found) if len(found) else 1.0,
        recall=hits / len(truth) if len(truth) else 1.0,
        mean_iou=sum(iou for _, _, iou in matches) / len(truth) if len(truth) else none,
    )
