"""The orders in which a DCA1000 file holds its samples, and how they are told from the data alone.

The radar deals complex words over its LVDS lanes, one lane a receiver ("four-lane") or two words at a time; the card
writes the lanes' first parts, then their second parts, as little-endian int16 (TI SWRA581, and readDCA1000.m therein):

    four-lane             I0 I1 I2 I3 Q0 Q1 Q2 Q3 a sample; lanes of receivers that are off hold zeros
    two-lane              receiver after receiver, I[n] I[n+1] Q[n] Q[n+1]
    two-lane interleaved  sample after sample, I0 I1 Q0 Q1 I2 I3 Q2 Q3
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from millisight.core import record
from millisight.core.errors import InputError, UnknownNameError

ORDERS = ("four-lane", "two-lane", "two-lane interleaved")
UNKNOWN = "unknown"

MIN_SCORE_DB = 8.0
"""White noise reached 5.7 dB in 8000 files of one or two chirps."""
MIN_MARGIN_DB = 3.0

_LANES = {"four-lane": 4, "two-lane": 2, "two-lane interleaved": 2}
_MAX_CHIRPS = 256  # looked at, spread over the file: more do not move the score
_MAX_VALUES = 1 << 22
_GUARD = 2  # bins beside zero on each side that hold the converter's offset, under a Hann window


def check_order(order: str) -> str:
    """`order`, which must be one of `ORDERS`; `UnknownNameError` otherwise."""
    if order not in ORDERS:
        raise UnknownNameError("sample order", order, ORDERS)
    return order


def fits(order: str, *, receivers: int, samples: int) -> bool:
    """Whether the words of a chirp can be dealt evenly over the order's lanes."""
    return receivers <= 4 and (order == "four-lane" or receivers * samples % 2 == 0)


def values_per_chirp(order: str, *, receivers: int, samples: int) -> int:
    """How many int16 values a chirp takes in a file.

    Raises
    ------
    InputError
        The words of a chirp cannot be dealt evenly over the lanes, or there are more receivers than lanes of their own.
    """
    if not fits(order, receivers=receivers, samples=samples):
        raise InputError(
            f"a {order} chirp cannot hold {samples} samples of {receivers} receivers; expected up to 4 receivers, and "
            "on two lanes an even number of words"
        )
    return 2 * samples * (4 if order == "four-lane" else receivers)


def unpack(counts: np.ndarray, order: str, *, receivers: int, samples: int, sample_swap: bool = False) -> np.ndarray:
    """(..., R, N) complex64 from int16 (..., V), V as `values_per_chirp`; `sample_swap`: Q stands first."""
    lanes = _LANES[order]
    parts = counts.reshape(*counts.shape[:-1], -1, 2, lanes)
    words = np.empty((*parts.shape[:-2], lanes), dtype=np.complex64)
    words.real, words.imag = parts[..., int(sample_swap), :], parts[..., 1 - int(sample_swap), :]
    if order == "two-lane":
        return words.reshape(*counts.shape[:-1], receivers, samples)
    interleaved = words.reshape(*counts.shape[:-1], samples, -1)
    return np.ascontiguousarray(np.swapaxes(interleaved, -1, -2)[..., :receivers, :])


def pack(frames: np.ndarray, order: str, *, sample_swap: bool = False) -> np.ndarray:
    """The inverse of `unpack`: little-endian int16 (..., V) from complex (..., R, N) of whole numbers."""
    *leading, receivers, samples = frames.shape
    values = values_per_chirp(order, receivers=receivers, samples=samples)
    lanes = _LANES[order]
    words = frames if order == "two-lane" else np.swapaxes(frames, -1, -2)
    if order == "four-lane":
        words = np.concatenate([words, np.zeros((*leading, samples, lanes - receivers), words.dtype)], axis=-1)
    words = words.reshape(*leading, -1, 1, lanes)
    real, imaginary = np.real(words), np.imag(words)
    parts = (imaginary, real) if sample_swap else (real, imaginary)
    return np.concatenate(parts, axis=-2).astype("<i2").reshape(*leading, values)


@record
class OrderEstimate:
    """What the data says of its own order.

    Attributes
    ----------
    order : one of `ORDERS`, or "unknown"
    margin_db : the best score over the next best of another layout [dB]
    scores : {order: dB}, how much more the lit side of its spectrum holds than the dark side, less how much its lines
        are lower than the sharpest reading's of the same pairs
    next_best : the order that `margin_db` is over
    bright_side : "positive" or "negative", where the spectrum lies when I is taken to stand first
    samples : N, of the chirps that were looked at: given, or worked out
    reason : why the order is unknown; empty where it is not
    """

    order: str
    margin_db: float
    scores: Mapping[str, float]
    next_best: str
    bright_side: str
    samples: int
    reason: str = ""


class _Reading(NamedTuple):
    """How the data looks when it is read in one way."""

    one_sided_db: float
    line_db: float
    side: str
    slow: bool  # its lines lie in the lowest 1/(2R) of the lit side


def estimate_order(counts: np.ndarray, *, receivers: int = 4, samples: int | None = None) -> OrderEstimate:
    """The order of int16 `counts` (n,), from which pairing of values gives a one-sided spectrum.

    The path to every reflector is positive, so that a complex chirp's beat frequencies all have one sign; wrong
    pairs mirror them. "two-lane" and "two-lane interleaved" pair alike, and may both look one-sided near zero:
    between them the sharper lines decide too. Real-only samples, read as real, split no line in two: where that
    reading does as well as the best complex one, the order is unknown.

    Parameters
    ----------
    receivers : R, 1 to 4; needed to tell the two-lane orders apart
    samples : N of a chirp; None: from the data's repetition, or windows of 256 where it has none
    """
    if samples is not None:
        return _estimate(counts, receivers, samples)
    samples = repeated_samples(counts, "two-lane", receivers=receivers) or 256
    estimate = _estimate(counts, receivers, samples)
    if estimate.order == "four-lane":
        return replace(estimate, samples=repeated_samples(counts, "four-lane", receivers=receivers) or samples)
    # Receivers that all see the same repeat within a two-lane chirp: then N is R times what it seems, and the shorter
    # chirps look interleaved.
    longer = _estimate(counts, receivers, samples * receivers)
    if estimate.order in (UNKNOWN, longer.order) or (estimate.order == "two-lane" and longer.order == UNKNOWN):
        return estimate
    if max(longer.scores.values()) < max(estimate.scores.values()) - 2 * MIN_MARGIN_DB:
        return estimate
    reason = f"{estimate.order} at {samples} samples a chirp, {longer.order} at {longer.samples}; give samples"
    return replace(estimate, order=UNKNOWN, reason=reason)


def _estimate(counts: np.ndarray, receivers: int, samples: int) -> OrderEstimate:
    layouts = [o for o in ORDERS if not (receivers == 1 and o == ORDERS[2])]  # with one receiver, both are one
    readings = {order: _complex_reading(counts, order, receivers, samples) for order in layouts}
    scores = {order: reading.one_sided_db for order, reading in readings.items()}
    if receivers > 1:
        _compare_two_lanes(scores, readings, counts, receivers, samples)
    best, second = sorted(layouts, key=lambda order: -scores[order])[:2]
    margin = scores[best] - scores[second]
    reason = ""
    if scores[best] < MIN_SCORE_DB:
        reason = "no pairing gives a one-sided spectrum: noise, silence, or another format"
    elif _real_score(counts, best, receivers, samples) > scores[best] - MIN_MARGIN_DB:
        reason = "the values look like real samples, not like pairs of I and Q"
    elif margin < MIN_MARGIN_DB:
        reason = f"{best} and {second} fit equally well"
    return OrderEstimate(
        order=UNKNOWN if reason else best,
        margin_db=round(margin, 2),
        scores={order: round(scores.get(order, scores["two-lane"]), 2) for order in ORDERS},
        next_best=second,
        bright_side=readings[best].side,
        samples=samples,
        reason=reason,
    )


def _compare_two_lanes(
    scores: dict[str, float], readings: dict[str, _Reading], counts: np.ndarray, receivers: int, samples: int
) -> None:
    """Correct the scores of the two-lane orders, which pair alike: the blurred one loses what its lines are lower.

    Interleaved receivers that all see the same look like one receiver's slow words in turn, and sharper; but then
    nothing happens where one receiver should end and the next begin.
    """
    in_turn, interleaved = ORDERS[1:]
    sharper = readings[in_turn].line_db - readings[interleaved].line_db
    if readings[in_turn].slow and not _receivers_end(counts, receivers, samples):
        scores[in_turn] = min(scores[in_turn], scores[interleaved])
        sharper = min(sharper, 0.0)
    scores[interleaved if sharper > 0 else in_turn] -= abs(sharper)


def _receivers_end(counts: np.ndarray, receivers: int, samples: int) -> bool:
    """Whether two-lane words jump, beyond chance, from each receiver's last to the next one's first."""
    chirps = _some_chirps(counts, values_per_chirp("two-lane", receivers=receivers, samples=samples))
    words = unpack(chirps, "two-lane", receivers=receivers, samples=samples)
    inside = np.abs(words[..., receivers::receivers] - words[..., receivers - 1 : -1 : receivers]) ** 2
    between = np.abs(words[:, 1:, 0] - words[:, :-1, -1]) ** 2
    return bool(between.mean() > inside.mean() * (1 + 4 / np.sqrt(between.size)))


def repeated_samples(counts: np.ndarray, order: str, *, receivers: int) -> int | None:
    """An even N of a chirp, from the lag at which the data repeats itself (chirps hardly differ), or None."""
    step = values_per_chirp(order, receivers=receivers, samples=2)
    counts = np.asarray(counts[: 1 << 19], dtype=np.float64)
    counts = counts[: len(counts) // step * step].reshape(-1, step)
    if len(counts) < 64:
        return None
    counts = (counts - counts.mean(axis=0)).ravel()
    size = len(counts)
    lags = np.arange(0, size // 2, step)
    likeness = np.fft.irfft(np.abs(np.fft.rfft(counts, 2 * size)) ** 2)[lags] / (size - lags)
    if not likeness[0] > 0:
        return None
    later = likeness[8:] / likeness[0]
    first = int(np.argmax(later > later.max() - 0.02))
    near = later[first : first + (first + 8) // 16 + 1]  # the top of the first hill as high as any
    lag = 8 + first + int(np.argmax(near))
    # Chirps go on repeating; what repeats within a chirp fades.
    again = likeness[[k * lag for k in (1, 2, 4, 8) if k * lag < len(likeness)]]
    return 2 * lag if len(again) > 2 and again.min() > max(0.2 * likeness[0], 0.8 * again.max()) else None


def _some_chirps(counts: np.ndarray, values: int) -> np.ndarray:
    """(K, values) of some chirps spread over `counts`; those that hold only zeros left out."""
    there = len(counts) // values
    many = min(there, _MAX_CHIRPS, max(1, _MAX_VALUES // values))
    taken = np.unique(np.linspace(0, there - 1, many).astype(int)).tolist()
    # One by one: of a file that was not read, only these are.
    some = np.concatenate([counts[:0], *(counts[i * values : (i + 1) * values] for i in taken)]).reshape(-1, values)
    return some[some.any(axis=-1)]


def _complex_reading(counts: np.ndarray, order: str, receivers: int, samples: int) -> _Reading:
    receivers = 4 if order == "four-lane" else receivers  # a lane that is off adds nothing
    half = samples // 2
    if half <= _GUARD + 1 or not fits(order, receivers=receivers, samples=samples):
        return _Reading(0.0, 0.0, UNKNOWN, False)
    chirps = _some_chirps(counts, values_per_chirp(order, receivers=receivers, samples=samples))
    if not len(chirps):
        return _Reading(0.0, 0.0, UNKNOWN, False)
    power = _mean_power(unpack(chirps, order, receivers=receivers, samples=samples), np.fft.fft)
    upper, lower, doubt = _lit_pairs(power[:, _GUARD:half], power[:, -_GUARD:-half:-1], len(chirps))
    positive = upper.sum() >= lower.sum()
    bright, dark = (upper, lower) if positive else (lower, upper)
    total = max(bright.sum(), 0) + doubt
    line = (np.square(bright).sum() + doubt**2) / total if total else 0.0  # a receiver that gives one value
    slow = bright[:, : half // (2 * receivers)].sum() > 0.95 * bright.sum()
    return _Reading(
        _ratio_db(bright.sum(), dark.sum(), doubt), _db(line), "positive" if positive else "negative", bool(slow)
    )


def _real_score(counts: np.ndarray, order: str, receivers: int, samples: int) -> float:
    """As `one_sided_db`, for real samples: how unlike the lines are to those in the mirrored place.

    Pairs (I, Q) read as two real samples of one receiver split each line in two, about a quarter of the rate; real
    samples read as pairs do the like, so that the two readings are rivals on equal terms. Where such a pair would be
    of two receivers, it looks one-sided by chance of angle only, and an order's own words read so split no line
    either: then the real reading has to be the better one by far.
    """
    half, top = samples // 4, samples // 2
    chirps = _some_chirps(counts, receivers * samples)
    if not len(chirps) or half <= _GUARD + 1:
        return 0.0
    in_turn = chirps.reshape(len(chirps), receivers, samples)
    interleaved = chirps.reshape(len(chirps), samples, receivers).swapaxes(1, 2)
    scores = []
    for series, handicap in ((in_turn, 0.0), (interleaved, 10.0 if _LANES[order] % receivers else 0.0)):
        power = _mean_power(series.astype(np.float32), np.fft.rfft)
        a, b, doubt = _lit_pairs(power[:, _GUARD:half], power[:, top - _GUARD : top - half : -1], len(chirps))
        scores.append(_ratio_db(np.maximum(a, b).sum(), np.minimum(a, b).sum(), doubt) - handicap)
    return max(scores)


def mean_spectrum(
    counts: np.ndarray, order: str, *, receivers: int, samples: int, sample_swap: bool = False
) -> np.ndarray:
    """(N,) mean power spectrum of some chirps of int16 `counts` (n,), over all receivers; zeros where there is none."""
    chirps = _some_chirps(counts, values_per_chirp(order, receivers=receivers, samples=samples))
    if not len(chirps):
        return np.zeros(samples)
    words = unpack(chirps, order, receivers=receivers, samples=samples, sample_swap=sample_swap)
    return _mean_power(words, np.fft.fft).mean(axis=0)


def _mean_power(chirps: np.ndarray, transform) -> np.ndarray:
    """(R, bins) mean power spectrum of (K, R, N) chirps, Hann window, offset of each chirp taken off."""
    window = np.hanning(chirps.shape[-1] + 1)[:-1]
    power = np.zeros(transform(chirps[0] * window).shape)
    many = max(1, (1 << 16) // chirps[0].size)
    for start in range(0, len(chirps), many):
        some = chirps[start : start + many]
        power += (np.abs(transform((some - some.mean(axis=-1, keepdims=True)) * window)) ** 2).sum(axis=0)
    return power / len(chirps)


def _lit_pairs(one: np.ndarray, other: np.ndarray, chirps: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Power over the noise's floor (R, B) where a bin or its mirror image is lit (0 elsewhere), and its doubt.

    Of a mean of `chirps` powers of noise, whose distribution is Gamma's, the floor is found from the lower quartile
    (Wilson and Hilferty's approximation), lit is what noise exceeds once in 10^5 bins, and the doubt is four times
    the standard deviation of the sum.
    """
    quartile = (1 - 1 / (9 * chirps) - 0.6745 / (3 * np.sqrt(chirps))) ** 3
    floor = np.quantile(np.concatenate([one, other], axis=-1), 0.25, axis=-1, keepdims=True) / quartile
    threshold = floor * (4.5 / np.sqrt(chirps) + 6 / chirps)
    lit = (one - floor > threshold) | (other - floor > threshold)
    doubt = 4 * np.sqrt((floor**2 / chirps * (1 + lit.sum(axis=-1, keepdims=True))).sum())
    return np.where(lit, one - floor, 0), np.where(lit, other - floor, 0), float(doubt)


def _ratio_db(bright: float, dark: float, doubt: float) -> float:
    doubt = max(doubt, 1e-9)
    return _db((max(bright, 0) + doubt) / (max(dark, 0) + doubt))


def _db(ratio: float) -> float:
    return float(10 * np.log10(max(ratio, 1e-30)))
