"""How sure a result is: intervals of shares and of statistics, and exact tests of pairs."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from millisight.core import checked_integer, checked_record
from millisight.core.errors import InputError

_BLOCK = 2_000_000  # drawn numbers at once
_MOST_EXACT, _MOST_REACH = 500, 1_000_000  # of a sign-flip test: objects in whole numbers, and the sum


def wilson_interval(right: int, images: int, *, level: float = 0.95) -> tuple[float, float]:
    """The score interval of a share (Wilson 1927), by `scipy.stats.binomtest`.

    Raises
    ------
    InputError
        No images, more right than there are, or a level not between 0 and 1.

    Examples
    --------
    >>> [round(edge, 4) for edge in wilson_interval(29, 34)]
    [0.6987, 0.9355]
    """
    from scipy.stats import binomtest

    n = checked_integer(images, name="images")
    if checked_integer(right, name="right", minimum=0) > n:
        raise InputError(f"right is {right} of {n} images; expected no more than there are")
    low, high = binomtest(right, n).proportion_ci(confidence_level=_checked(level), method="wilson")
    return float(low), float(high)


def mcnemar(only_first: int, only_second: int) -> float:
    """Two-sided p of McNemar's exact test: a binomial test of the images on which two differ (McNemar 1947).

    Raises
    ------
    InputError
        A count below 0.

    Examples
    --------
    >>> mcnemar(8, 1)
    0.0390625
    """
    from scipy.stats import binomtest

    b, c = (checked_integer(value, name="count", minimum=0) for value in (only_first, only_second))
    return float(binomtest(b, b + c).pvalue) if b + c else 1.0


def sign_flip(differences: Sequence[int]) -> float:
    """Two-sided p of the exact sign-flip test (Fisher 1935): if the two were equal, the sign of each object would be
    random.

    By counting sums, not by listing all 2^n signs as `scipy.stats.permutation_test` does: exact for many objects.

    Parameters
    ----------
    differences : of each object, how many of its images the first has right that the second has not, less the other way

    Returns
    -------
    float
        The share of all 2^n signs under which the sum is at least as far from 0. It is never under 2 / 2^n, but for
        more than 500 objects, whose shares are float64.

    Raises
    ------
    InputError
        The differences add up to more than a million.
    """
    given = checked_record(differences, Sequence, name="differences")
    differences = [checked_integer(one, name="a difference", minimum=-(1 << 62)) for one in given]
    reach, far = sum(map(abs, differences)), abs(sum(differences))
    if reach > _MOST_REACH:
        raise InputError(f"the differences add up to {reach}; expected at most {_MOST_REACH}")
    if len(differences) > _MOST_EXACT:
        shares = np.ones(1)  # of sign patterns, by their sum from its least on
        for value in map(abs, differences):
            shares = (np.pad(shares, (2 * value, 0)) + np.pad(shares, (0, 2 * value))) / 2
        return float(shares[np.abs(np.arange(-reach, reach + 1)) >= far].sum())
    ways = {0: 1}  # number of sign patterns by their sum
    for value in differences:
        grown: dict[int, int] = defaultdict(int)
        for total, count in ways.items():
            grown[total + value] += count
            grown[total - value] += count
        ways = grown
    return sum(count for total, count in ways.items() if abs(total) >= far) / 2 ** len(differences)


def bootstrap_interval(
    values: Any,
    statistic: Callable[[np.ndarray], float] = np.median,
    *,
    level: float = 0.95,
    draws: int = 2000,
    rng: int | np.random.Generator = 0,
) -> tuple[float, float]:
    """The percentile bootstrap interval of a statistic (Efron 1979).

    `scipy.stats.bootstrap` draws in another order and gives other digits; published tables keep theirs.

    Parameters
    ----------
    values : (n,) or (n, k); drawn n times with replacement along the first axis, so that rows stay together
    statistic : of an array of that shape, one number
    level : share of the draws inside
    draws : number of draws
    rng : seed, or generator

    Raises
    ------
    InputError
        No values, some that are not finite, or a level not between 0 and 1.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim < 1 or not len(array):
        raise InputError(f"bootstrap_interval got values of shape {array.shape}; expected at least one")
    if not np.isfinite(array).all():
        raise InputError(f"bootstrap_interval got {(~np.isfinite(array)).sum()} values that are NaN or infinite")
    edge = (1 - _checked(level)) / 2
    picks = np.random.default_rng(rng).integers(0, len(array), size=(draws, len(array)))
    if statistic in (np.mean, np.median) or getattr(statistic, "func", None) is np.quantile:
        # Of many draws at once, which gives the same digits.
        of_rows: Any = statistic
        blocks = np.array_split(picks, min(draws, 1 + array.size * draws // _BLOCK))
        found = np.concatenate([of_rows(array[some].reshape(len(some), -1), axis=1) for some in blocks])
    else:
        found = [float(statistic(array[pick])) for pick in picks]
    low, high = np.quantile(found, [edge, (1 + level) / 2])
    return float(low), float(high)


def _checked(level: float) -> float:
    if not 0 < level < 1:
        raise InputError(f"level = {level:g}; expected a share between 0 and 1")
    return level
