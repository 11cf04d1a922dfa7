"""How true simulated images are: their points against measured ones, aligned; the best over weights (paper Eq. 12).

Images combine linearly, I = (a1 I_specular + a2 I_edge) / (a1 + a2), so that no weight needs an image of its own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from millisight.core import check_known, checked_number, checked_numbers, put, record
from millisight.core.errors import InputError
from millisight.data import PointCloud, SarImage
from millisight.evaluation._alignment import MODES, Alignment, align
from millisight.evaluation._point_cloud import FScore, f_score, point_cloud
from millisight.imaging import combine

SPECULAR, EDGE = (1.0, 0.0), (0.0, 1.0)

WEIGHTS: tuple[tuple[float, float], ...] = (
    SPECULAR,
    *((1 / (1 + ratio), ratio / (1 + ratio)) for ratio in 2.0 ** np.arange(-6, 4)),
    EDGE,
)
"""W of (a1, a2): both parts alone, and ratios a2 / a1 from 1/64 to 8, an octave apart. The paper prints no W."""


@record
class CloudSettings:
    """Settings to make, align and compare point clouds. The main text of the paper states neither tau_P nor tau_F.

    Attributes
    ----------
    threshold : tau_P, of both images: a share of the largest |I|, or with `relative=False` in their unit
    relative : what `threshold` is
    within : tau_F [m]
    mode : of the alignment: "translation", since simulated objects are turned as the measured ones; or "rigid"
    flat : compare the means along z
    weights : W
    """

    threshold: float = 0.3
    relative: bool = True
    within: float = 0.01
    mode: str = "translation"
    flat: bool = False
    weights: Sequence[tuple[float, float]] = WEIGHTS

    def __post_init__(self) -> None:
        threshold = checked_number(self.threshold, name="threshold", minimum=0)
        if self.relative and not threshold < 1:
            raise InputError(f"threshold is {threshold:g}; expected less than 1, a share of the image's maximum")
        check_known("mode of alignment", self.mode, MODES)
        given = [checked_numbers(pair, name="weights", count=2, minimum=0) for pair in self.weights]
        if not all(a1 + a2 > 0 for a1, a2 in given):
            raise InputError("weights hold (0, 0); expected at least one of the two above zero")
        shares = [(a1 / (a1 + a2), a2 / (a1 + a2)) for a1, a2 in given]
        put(
            self,
            threshold=threshold,
            within=checked_number(self.within, name="within", unit="m", above=0),
            weights=tuple(dict.fromkeys((*shares, SPECULAR, EDGE))),  # the parts alone are rows of the table
        )

    def cloud(self, image: SarImage) -> PointCloud:
        """The image's points."""
        return point_cloud(image, self.threshold, relative=self.relative, flat=self.flat)


class WeightTrial(NamedTuple):
    """What one pair of weights scores.

    Attributes
    ----------
    weights : (a1, a2), their sum 1
    score : F-score of the simulated cloud against the measured one
    points : number of points of the simulated cloud
    converged : whether the alignment converged; False where there was none
    translation : shift of the simulated cloud [m]; None: not aligned
    problem : why there was no alignment; "" otherwise
    """

    weights: tuple[float, float]
    score: FScore
    points: int
    converged: bool
    translation: tuple[float, float, float] | None = None
    problem: str = ""


class SimulatorComparison(NamedTuple):
    """A measured image against a specular and an edge image, for every weight.

    Attributes
    ----------
    points : number of points of the measured cloud
    trials : one for each pair of weights in W
    """

    points: int
    trials: tuple[WeightTrial, ...]

    @property
    def best(self) -> WeightTrial:
        """max F over W (paper Eq. 12); the first of equals."""
        return max(self.trials, key=lambda trial: trial.score.f)

    @property
    def specular(self) -> WeightTrial:
        """The trial of the specular image alone."""
        return self.of(SPECULAR)

    @property
    def edge(self) -> WeightTrial:
        """The trial of the edge image alone."""
        return self.of(EDGE)

    def of(self, weights: tuple[float, float]) -> WeightTrial:
        """The trial of these weights, which must be in W."""
        return next(trial for trial in self.trials if np.allclose(trial.weights, weights))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd: clouds without points or of a single one, alignments that did not converge."""
        notes = [f"measured cloud {_few(self.points)}"] if self.points < 2 else []
        named = {"best": self.best, "specular": self.specular, "edge": self.edge}
        notes += [f"{name} cloud {_few(trial.points)}" for name, trial in named.items() if trial.points < 2]
        return (
            *notes,
            *(f"{n}: ICP did not converge" for n, t in named.items() if not t.converged and not t.problem),
            *(f"{name}: {t.problem}" for name, t in named.items() if t.problem and t.points > 1 and self.points > 1),
        )


def _few(points: int) -> str:
    return "is a single point" if points else "is empty"


def compare(
    measured: SarImage, specular: SarImage, edge: SarImage, settings: CloudSettings | None = None
) -> SimulatorComparison:
    """F-scores of all combinations of two simulated images with a measured one.

    Parameters
    ----------
    measured : SarImage
    specular, edge : on one grid, which need not be the measured one's: the clouds are aligned
    settings : default `CloudSettings()`

    Raises
    ------
    InputError
        The two simulated images are on different grids.
    """
    settings = settings or CloudSettings()
    there = settings.cloud(measured)
    trials = [
        _trial(weights, settings.cloud(combine(specular, edge, weights)), there, settings)
        for weights in settings.weights
    ]
    return SimulatorComparison(len(there), tuple(trials))


def aligned(simulated: PointCloud, measured: PointCloud, mode: str) -> Alignment:
    """The simulated cloud on the measured one, as `compare` aligns them.

    Raises
    ------
    InputError
        One of them has too few points.
    """
    return align(simulated.points, measured.points, mode=mode)


def _trial(weights: tuple[float, float], cloud: PointCloud, there: PointCloud, settings: CloudSettings) -> WeightTrial:
    try:
        moved = aligned(cloud, there, settings.mode)
    except InputError as error:
        return WeightTrial(weights, FScore(0.0, 0.0), len(cloud), False, problem=str(error))
    score = f_score(there.points, moved.apply(cloud.points), settings.within)
    x, y, z = (float(v) for v in moved.translation)
    return WeightTrial(weights, score, len(cloud), moved.converged, (x, y, z))


def sensitivity(
    measured: SarImage,
    simulated: SarImage,
    settings: CloudSettings,
    *,
    thresholds: Sequence[float],
    distances: Sequence[float],
) -> np.ndarray:
    """(thresholds, distances) F-scores of one simulated image, aligned again for each tau_P.

    Parameters
    ----------
    thresholds : values of tau_P, as `settings.relative` says
    distances : values of tau_F [m]
    """
    scores = np.zeros((len(thresholds), len(distances)))
    for i, threshold in enumerate(thresholds):
        clouds = [
            point_cloud(image, threshold, relative=settings.relative, flat=settings.flat)
            for image in (measured, simulated)
        ]
        try:
            moved = aligned(clouds[1], clouds[0], settings.mode).apply(clouds[1].points)
        except InputError:  # too few points: nothing matches
            continue
        scores[i] = [f_score(clouds[0].points, moved, within).f for within in distances]
    return scores
