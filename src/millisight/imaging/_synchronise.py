"""The clocks of radar and robot, brought together by the sharpness of the image."""

from collections.abc import Callable

import numpy as np

from millisight.core import checked_number, checked_record, record, seed_or_generator
from millisight.data import Capture, ClockCorrection, Trajectory, VoxelGrid, check_follows_log, check_log
from millisight.imaging import _focus as _focus
from millisight.imaging._focus import Focus, Scene
from millisight.imaging._row_turns import Guess, guess_from_rows, pattern_of, peak
from millisight.imaging._survey import Scan, Unobservable, check_way, parts_of, survey
from millisight.simulation import lattice

_SUBSETS = 10  # disjoint sets of frames, whose answers' scatter is the uncertainty
_MOST_SECONDS = 1e9  # of an offset
_LEAST_COHERENCE = 0.5
_SEARCH_SHARE = 0.25  # of the frames choose the scene and the start; the others are fitted
_SEARCH_CHANNELS, _FIT_CHANNELS = 4_000, 24_000
_SEARCH_PAIRS = 3e9  # voxel-channel pairs of the lattice
_STEP = 0.25  # turns of the fastest phase
_LATTICE = (9, 9, 9)  # places in a box
_SURELY = 0.95  # of the fastest phase at the places of a lattice: less than that at any place in its box
_MOST_STEPS = 25  # of the search for the offset, either way
_MOST_MOVES = 6  # steps uphill before the peak is fitted
_FLOOR = 0.01  # steps: what all sets of frames get wrong alike, which their scatter does not show
_PLACES_OF_LOG, _PLACES_OF_SCENE = 300, 20  # from which the fastest phase is taken


@record
class ClockEstimate:
    """What `estimate_clock` found.

    Attributes
    ----------
    clock : the correction, its reference time in the middle of the frames' times; None where it cannot be observed
    offset_uncertainty : standard error [s]; infinite without a clock
    drift_uncertainty : standard error [s/s]; infinite without a clock
    observable : whether the scan tells offset and drift
    reason : why it does not; empty where it does
    against : part of the way that runs against the main direction: 0.5 in a serpentine scan, 0 where rows run one way
    coarse_offset : from the rows alone [s]; 0 where the search did not come to that
    coherence : of the images of forward and backward rows, 0 to 1; 0 where the search did not come to that
    """

    clock: ClockCorrection | None
    offset_uncertainty: float
    drift_uncertainty: float
    observable: bool
    reason: str
    against: float
    coarse_offset: float
    coherence: float

    def __repr__(self) -> str:
        if self.clock is None:
            return f"ClockEstimate(not observable: {self.reason})"
        return (
            f"ClockEstimate(offset {self.clock.offset * 1e3:.3f} ± {self.offset_uncertainty * 1e3:.3f} ms, "
            f"drift {self.clock.drift * 1e6:.2f} ± {self.drift_uncertainty * 1e6:.2f} ppm "
            f"at {self.clock.reference_time:.3f} s)"
        )


def estimate_clock(
    capture: Capture,
    log: Trajectory,
    grid: VoxelGrid | None = None,
    *,
    max_offset: float = 0.1,
    max_drift: float = 200e-6,
    rng: int | np.random.Generator = 0,
    progress: Callable[[int, int], None] | None = None,
) -> ClockEstimate:
    """Estimate offset and drift of the robot's clock relative to the radar's, from the frames and the robot log.

    Rows that run forward and rows that run backward see the scene with a relative shift of the clock offset times their
    speeds; a drift makes this shift grow along the scan. Both are fitted together: first roughly from the rows, then
    for the largest sum of |I|⁴ around the brightest points of the scene, over random frames. The uncertainty is the
    scatter of the results from disjoint sets of frames.

    If an offset only shifts the whole image (all rows run in one direction), or the frames hold too little information
    (a radar at rest, too few rows, nothing bright), the result has no clock but a reason; it is never guessed.

    Parameters
    ----------
    capture : its trajectory's times are the radar clock's; its positions are not used
    log : poses of the radar frame in the world frame, on the robot's clock, times increasing
    grid : where the scene lies; None: under the aperture, at the path lengths where the frames change most
    max_offset, max_drift : search range in both directions [s], [s/s]
    rng : seed or generator for the random choice of frames
    progress : called with (steps done, steps in all)

    Raises
    ------
    InputError
        An argument is invalid, or frames and log do not overlap in time.
    """
    check_follows_log(checked_record(capture, Capture, name="capture"))
    check_log(log)
    if grid is not None:
        checked_record(grid, VoxelGrid, name="grid")
    limits = (
        min(checked_number(max_offset, name="max_offset", unit="s", above=0), _MOST_SECONDS),
        checked_number(max_drift, name="max_drift", unit="s/s", above=0),
    )
    generator = seed_or_generator(rng)
    found = {"against": 0.0, "coarse_offset": 0.0, "coherence": 0.0}
    try:
        clock, errors = _estimate(capture, log, grid, limits, generator, _Steps(progress, 6), found)
    except Unobservable as reason:
        return ClockEstimate(
            clock=None,
            offset_uncertainty=float("inf"),
            drift_uncertainty=float("inf"),
            observable=False,
            reason=str(reason),
            **found,
        )
    return ClockEstimate(
        clock=clock,
        offset_uncertainty=float(errors[0]),
        drift_uncertainty=float(errors[1]),
        observable=True,
        reason="",
        **found,
    )


class _Steps:
    """Counts the steps done for a call-back."""

    def __init__(self, progress: Callable[[int, int], None] | None, total: int):
        self._progress, self._done, self._total = progress, 0, total

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def _estimate(capture, log, grid, limits, rng, step_done, found) -> tuple[ClockCorrection, np.ndarray]:
    """The clock, and the standard errors (2,) of its offset and drift; `found` is filled on the way."""
    scan = survey(capture, log, *limits)
    found["against"] = scan.against
    wavelength = capture.radar.waveform.wavelength
    check_way(scan, wavelength)
    step_done()

    pattern = pattern_of(capture, rng)
    longest_late = limits[1] * scan.half
    guess = guess_from_rows(
        pattern, scan.rows, wavelength=wavelength, max_offset=limits[0], max_late=longest_late, rng=rng
    )
    if guess is None:
        raise Unobservable("the echoes do not change along the rows")
    found["coarse_offset"] = guess.offset
    step_done()

    start = scan.clock(guess.offset, 0.0)
    robot = np.clip(start.robot_times(capture.trajectory.times[scan.poses]), scan.log.times[0], scan.log.times[-1])
    positions = scan.log.at(robot).positions
    box = _focus.box_below(capture, positions, pattern.paths) if grid is None else grid.bounds
    # Where no scene in the box could be searched, none is looked for, which takes a minute for a large capture.
    slowest = _SURELY * float(_rates(capture, scan, lattice(box, _LATTICE)).min())
    _check_start(_count(guess.error, limits[0], _STEP / (slowest * scan.speed)), guess)

    # The frames that choose the scene and the start are not those that are fitted to it.
    searched = rng.random(len(scan.poses)) < _SEARCH_SHARE
    parts = parts_of(scan, robot, positions @ scan.direction, wavelength)
    scene = _focus.bright_scene(capture, scan.poses[searched], parts[searched], scan.log, start, box)
    step = _STEP / (_fastest(capture, scan, scene.points) * scan.speed)
    # The rows tell the offset; of a drift's trace in them too little can be told from chance.
    counts = _count(guess.error, limits[0], step), int(np.ceil(longest_late / step))
    _check_start(counts[0], guess)
    step_done()

    nodes = (2 * counts[0] + 1) * (2 * counts[1] + 1)
    many = int(np.clip(_SEARCH_PAIRS / (len(scene.points) * nodes), 1000, _SEARCH_CHANNELS))
    wide = Focus.on(scene.points, capture, _channels(capture, scan.poses[searched], many, rng), scan.log)
    rough = _sharpest(wide, scan, (guess.offset, 0.0), step, counts)
    step_done()

    focus = Focus.on(scene.points, capture, _channels(capture, scan.poses[~searched], _FIT_CHANNELS, rng), scan.log)
    best, errors = _refined(focus, scan, scene, rough, step, rng, step_done)
    clock = scan.clock(*best)
    found["coherence"] = _coherence(focus, scan, clock)
    if found["coherence"] < _LEAST_COHERENCE:
        raise Unobservable(
            f"rows that run forward and rows that run backward make images that are alike to {found['coherence']:.2f} "
            f"only, under {_LEAST_COHERENCE:g}: the scene is too faint, or the log is not that of the frames"
        )
    return clock, errors / (1, scan.half)


def _check_start(steps: int, guess: Guess) -> None:
    """Raise where the rows leave more steps to the search than it takes."""
    if steps > _MOST_STEPS:
        raise Unobservable(
            f"the rows determine the offset only to ± {guess.error * 1e3:.3g} ms, too coarse a start for the search by "
            "images: the echoes are too faint or too uniform"
        )


def _rates(capture: Capture, scan: Scan, points: np.ndarray) -> np.ndarray:
    """(V,) how fast the phase of each point (V, 3) turns along the rows, at most [cycles/m]."""
    some = scan.log.at(np.linspace(scan.log.times[0], scan.log.times[-1], _PLACES_OF_LOG))
    turning = (_focus.local_frequencies(capture, some, place) @ scan.direction for place in points)
    return np.array([np.abs(rates).max() for rates in turning])


def _fastest(capture: Capture, scan: Scan, points: np.ndarray) -> float:
    """How fast the phase of any of the points turns along the rows [cycles/m]."""
    return float(_rates(capture, scan, points[:: max(len(points) // _PLACES_OF_SCENE, 1)]).max())


def _sharpest(
    focus: Focus, scan: Scan, center: tuple[float, float], step: float, counts: tuple[int, int]
) -> np.ndarray:
    """(2,) the node of a lattice around `center`, offset and late [s], at which the sum of |I|⁴ is largest."""
    offsets, lates = (c + step * np.arange(-n, n + 1) for c, n in zip(center, counts, strict=True))
    values = [[_fourth(focus.image(scan.clock(offset, late))).sum() for late in lates] for offset in offsets]
    i, j = np.unravel_index(np.argmax(values), np.shape(values))
    return np.array([offsets[i], lates[j]])


def _refined(
    focus: Focus, scan: Scan, scene: Scene, start: np.ndarray, step: float, rng: np.random.Generator, step_done
) -> tuple[np.ndarray, np.ndarray]:
    """Offset and late (2,) at the top of the sum of |I|⁴, and their standard errors (2,) [s].

    The images of disjoint sets of frames are kept apart, so that the sum without each set in turn (the jackknife)
    tells what chance in the frames amounts to; leaving out groups of places tells the same of the scene.
    """
    sets = rng.permutation(len(focus.times)) % _SUBSETS
    groups = rng.permutation(scene.cells.max() + 1)[scene.cells] % _SUBSETS
    best = start
    for width in (1.0, 0.5):
        nodes = width * step * np.arange(-1, 2)
        for _ in range(_MOST_MOVES):
            images = _images(focus, scan, sets, best, nodes)  # (3, 3, sets, V)
            whole = images.sum(axis=2)
            sharpness = _fourth(whole).sum(axis=-1)
            move = np.subtract(np.unravel_index(np.argmax(sharpness), sharpness.shape), 1)
            if not move.any():
                break
            best = best + width * step * move
        step_done()
        top = peak(nodes, nodes, np.log(sharpness))
        if top is not None:
            best = best + np.clip(top, -width * step, width * step)
    if top is None or move.any():
        raise Unobservable("no clock makes the image sharpest: the scene is too faint, or too large")
    without_set = [_fourth(whole - images[:, :, k]).sum(axis=-1) for k in range(_SUBSETS)]
    without_group = [_fourth(whole[..., groups != k]).sum(axis=-1) for k in np.unique(groups)]
    errors = [np.full(2, _FLOOR * step), _jackknife(nodes, without_set)]
    if len(without_group) > 1:
        errors.append(_jackknife(nodes, without_group))
    error = np.sqrt(np.sum(np.square(errors), axis=0))
    if not error.max() < step:
        raise Unobservable(
            f"the image determines the offset only to ± {error[0] * 1e3:.3g} ms: the scene is too faint, or too uniform"
        )
    return best, error


def _images(focus: Focus, scan: Scan, sets: np.ndarray, center: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """(n, n, sets, V) complex64 images of each set of channels, at nodes (n,) [s] around an offset and a late."""
    images = np.empty((len(nodes), len(nodes), _SUBSETS, focus.points.shape[1]), dtype=np.complex64)
    for k in range(_SUBSETS):
        part = focus.some(sets == k)
        for a, b in np.ndindex(len(nodes), len(nodes)):
            images[a, b, k] = part.image(scan.clock(center[0] + nodes[a], center[1] + nodes[b]))
    return images


def _jackknife(nodes: np.ndarray, values: list[np.ndarray]) -> np.ndarray:
    """(2,) standard errors of the peak, from its places when each part in turn is left out."""
    tops = [peak(nodes, nodes, np.log(part)) for part in values]
    if any(top is None for top in tops):
        return np.full(2, np.inf)
    places = np.array([top for top in tops if top is not None])
    return np.sqrt((len(places) - 1) * places.var(axis=0))


def _fourth(image: np.ndarray) -> np.ndarray:
    """|I|⁴ in float64."""
    return np.abs(image).astype(float) ** 4


def _count(error: float, most: float, step: float) -> int:
    """How many steps to search either way: four standard errors, three steps at least, `most` [s] at most."""
    return int(np.ceil(min(max(4 * error, 3 * step), most) / step))


def _channels(capture: Capture, poses: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) numbers of pose, transmitter and receiver of at most `count` channels of the poses, in their order."""
    transmitters, receivers = capture.frames.shape[1:3]
    total = len(poses) * transmitters * receivers
    some = rng.choice(total, min(count, total), replace=False)
    pose, tx, rx = np.unravel_index(some, (len(poses), transmitters, receivers))
    order = np.argsort(poses[pose], kind="stable")
    return np.stack([poses[pose], tx, rx], axis=1)[order]


def _coherence(focus: Focus, scan: Scan, clock: ClockCorrection) -> float:
    """How alike, from 0 to 1, the images of the rows that run forward and of those that run backward are."""
    starts = np.array([row.times[0] for row in scan.rows])
    row = np.searchsorted(starts, clock.robot_times(focus.times)) - 1
    sign = np.array([r.sign for r in scan.rows])[np.maximum(row, 0)]
    forward, backward = (focus.some(sign == way).image(clock) for way in (1, -1))
    return float(abs(np.vdot(forward, backward)) / max(np.linalg.norm(forward) * np.linalg.norm(backward), 1e-30))
