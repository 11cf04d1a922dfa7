"""Whether the positions of a scan lie close enough for what it looks at, and what ghosts there are if not."""

from typing import NamedTuple

import numpy as np

from millisight.core import SPEED_OF_LIGHT, checked_array, checked_items, checked_number, checked_record, put, record
from millisight.core.errors import InputError
from millisight.data import Capture, Radar, Trajectory, VoxelGrid
from millisight.imaging._around import grid_around, scene_bounds
from millisight.imaging._ghosts import Line, lobe
from millisight.imaging._path_rows import rows_of_path
from millisight.simulation import needed_step

FAINTEST = -30.0
"""Ghosts that are fainter against their object are not told [dB]: the sidelobes of an aperture reach as far."""

_CHANNELS = 3_000  # of which a point spread is computed, about
_FEWEST = 12  # rows, or positions of a row, that are taken of many
_PLACES = (0.05, 0.5, 0.95)  # of reflectors, within their box
_BENT = 0.05  # of its length, by which a row may leave its chord
_SAME = 0.05  # wavelengths: rows nearer to each other are one


@record
class Ghost:
    """The grating lobe of a reflector.

    Attributes
    ----------
    reflector : (3,) its place [m]
    place : (3,) where the ghost is strongest [m]
    strength_db : against the reflector [dB]
    """

    reflector: np.ndarray
    place: np.ndarray
    strength_db: float

    def __post_init__(self) -> None:
        for name in ("reflector", "place"):
            put(self, **{name: checked_array(getattr(self, name), name=name, shape=(3,), unit="m")})
        put(self, strength_db=checked_number(self.strength_db, name="strength_db"))

    @property
    def distance(self) -> float:
        """From the reflector [m]."""
        return float(np.linalg.norm(self.place - self.reflector))

    def __repr__(self) -> str:
        return f"Ghost({self.distance * 100:.3g} cm from the object, {self.strength_db:.0f} dB)"


@record
class StepSampling:
    """The step between neighbouring positions in one direction.

    Attributes
    ----------
    step : [m]
    direction : (3,) unit vector
    needed : the largest step without ghosts in the view, lambda / (2 Delta) (primer 7) [m]; None: the view is unknown
    ghosts : one for each depth that has any, by depth; none where the step is small enough
    """

    step: float
    direction: np.ndarray
    needed: float | None = None
    ghosts: tuple[Ghost, ...] = ()

    def __post_init__(self) -> None:
        put(self, step=checked_number(self.step, name="step", unit="m", minimum=0))
        put(self, direction=checked_array(self.direction, name="direction", shape=(3,)))
        if self.needed is not None:
            put(self, needed=checked_number(self.needed, name="needed", unit="m", above=0))
        put(self, ghosts=checked_items(self.ghosts, Ghost, name="a ghost"))

    def __repr__(self) -> str:
        return f"StepSampling({self.step * 1e3:.3g} mm, {len(self.ghosts)} ghosts)"


@record
class Sampling:
    """How closely a scan samples its aperture, and what that does to images; see `sampling`.

    Attributes
    ----------
    wavelength : shortest of the band [m]
    receivers : channels at each position
    along : from position to position
    across : from row to row; None: the positions are not in three rows or more
    """

    wavelength: float
    receivers: int
    along: StepSampling
    across: StepSampling | None = None

    def __post_init__(self) -> None:
        put(self, wavelength=checked_number(self.wavelength, name="wavelength", unit="m", above=0))
        checked_record(self.along, StepSampling, name="along")
        if self.across is not None:
            checked_record(self.across, StepSampling, name="across")

    @property
    def steps(self) -> tuple[StepSampling, ...]:
        """Those that there are."""
        return (self.along,) if self.across is None else (self.along, self.across)

    @property
    def ghosts(self) -> tuple[Ghost, ...]:
        """All ghosts, the strongest first."""
        found = [ghost for step in self.steps for ghost in step.ghosts]
        return tuple(sorted(found, key=lambda ghost: -ghost.strength_db))

    @property
    def text(self) -> str:
        """The steps in a line, in wavelengths of the shortest wavelength."""
        told = f"{self._length(self.along.step)} from position to position"
        if self.across is not None:
            told += f", {self._length(self.across.step)} from row to row"
        return told + (f", {self.receivers} receivers" if self.receivers > 1 else "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each step that gives ghosts: how large it may be, how far away they are, how strong."""
        return tuple(self._warning(step) for step in self.steps if step.ghosts)

    def __repr__(self) -> str:
        ghosts = f"; strongest: {self.ghosts[0]!r}" if self.ghosts else ""
        return f"Sampling({self.text}{ghosts})"

    def _length(self, length: float) -> str:
        return f"{length * 1e3:.3g} mm ({length / self.wavelength:.2f} wavelengths)"

    def _warning(self, step: StepSampling) -> str:
        what = "positions" if step is self.along else "rows"
        distances = [f"{ghost.distance * 100:.2g}" for ghost in step.ghosts]
        far = min(distances, key=float), max(distances, key=float)
        loudest = max(ghost.strength_db for ghost in step.ghosts)
        return (
            f"{what} {self._length(step.step)} apart give ghosts (grating lobes) {' to '.join(dict.fromkeys(far))} cm "
            f"from the object along {_name(step.direction)}, up to {loudest:.0f} dB; this view needs "
            f"{self._length(step.needed or 0.0)}"
        )


def sampling(
    scan: Capture | Trajectory,
    grid: VoxelGrid | None = None,
    *,
    radar: Radar | None = None,
    reflectors: np.ndarray | None = None,
    ghosts: bool = True,
) -> Sampling:
    """The steps of a scan, and the ghosts (grating lobes) that they give in an image.

    A step s along a direction gives no ghosts in a view where (primer 7)

        s <= lambda / (2 Delta),

    Delta being the largest spread of sin(theta) over all that any position sees: lambda / (4 sin(theta_max)) where it
    sees the view under theta_max on both sides. Beyond that, ghosts lie at sin(theta') = sin(theta) + m lambda / (2 s).
    Their place and strength are those of the point spread there, computed of some thousand channels with the antennas,
    the bandwidth and the positions of the scan: bandwidth moves and smears ghosts, unequal steps spread them, receivers
    between the positions take them away. Ghosts outside of the grid, and those below -30 dB, are left out.

    Parameters
    ----------
    scan : a capture; or a trajectory that is planned, with its `radar`
    grid : voxels of the image; None: `grid_around` the capture. Without a known scene, steps alone are told
    radar : of a trajectory
    reflectors : (2, 3) box in which the objects lie [m]; None: the scene that was simulated, else the grid
    ghosts : whether to look for them, which takes some seconds where a step is larger than needed

    Returns
    -------
    Sampling
        `text` tells the steps, `warnings` the ghosts.

    Raises
    ------
    InputError
        There are fewer than two positions, or a trajectory has no radar.

    Examples
    --------
    >>> path = Trajectory.raster(size=(0.2, 0.2), step=0.004)
    >>> grid = VoxelGrid.regular((-0.08, -0.08, -0.02), (0.08, 0.08, 0.02), 0.002)
    >>> sampling(path, grid, radar=Radar.preset("mito-sim-77ghz"))
    Sampling(4 mm (1.07 wavelengths) from position to position, 4 mm (1.07 wavelengths) from row to row; strongest: \
Ghost(11.1 cm from the object, -11 dB))
    """
    if isinstance(scan, Capture):
        if radar is not None:
            raise InputError("a capture has a radar of its own; leave radar out")
        radar, path, tx, rx = scan.radar, scan.trajectory, scan.tx_positions, scan.rx_positions
        if scan.tx_points is not None or scan.rx_points is not None:
            path = Trajectory(times=path.times, positions=(tx.mean(axis=1) + rx.mean(axis=1)) / 2)
        if grid is None and (scene_bounds(scan) is not None or "image_grid" in scan.metadata):
            grid = grid_around(scan)
        reflectors = scene_bounds(scan) if reflectors is None else reflectors
    else:
        path = checked_record(scan, Trajectory, name="scan")
        if radar is None:
            raise InputError("a trajectory alone has no wavelength; pass radar, such as Radar.preset('iwr1443')")
        array = checked_record(radar, Radar, name="radar").array
        tx, rx = path.placed(array.tx_positions), path.placed(array.rx_positions)
    if len(path) < 2:
        raise InputError("a scan of one position has no step; expected two positions or more")
    wavelength = SPEED_OF_LIGHT / radar.waveform.frequencies.max()
    raster = _raster(path, wavelength)
    receivers = tx.shape[1] * rx.shape[1]
    if raster is None:
        steps = np.diff(path.positions[np.argsort(path.times, kind="stable")], axis=0)
        direction = np.linalg.svd(steps, full_matrices=False)[2][0]
        along = StepSampling(step=float(np.median(np.linalg.norm(steps, axis=1))), direction=direction)
        return Sampling(wavelength=wavelength, receivers=receivers, along=along)
    view = None if grid is None else checked_record(grid, VoxelGrid, name="grid").bounds
    if reflectors is not None:
        reflectors = checked_array(reflectors, name="reflectors", shape=(2, 3), unit="m")

    def judged(step: float, direction: np.ndarray, poses: np.ndarray) -> StepSampling:
        if view is None:
            return StepSampling(step=step, direction=direction)
        objects = view if reflectors is None else reflectors
        needed = needed_step(radar, direction, tx, rx, view, objects)
        if step <= needed or not ghosts:
            return StepSampling(step=step, direction=direction, needed=needed)
        line = Line(direction, step, np.ascontiguousarray(tx[poses]), np.ascontiguousarray(rx[poses]))
        found = _ghosts(line, radar, view, objects, raster.normal)
        return StepSampling(step=step, direction=direction, needed=needed, ghosts=found)

    along = judged(raster.step, raster.along, _some_rows(raster.rows, receivers))
    across = None
    if raster.across is not None:
        across = judged(raster.pitch, raster.across, _some_of_each(raster.rows, receivers))
    return Sampling(wavelength=wavelength, receivers=receivers, along=along, across=across)


def steps_of(capture: Capture) -> tuple[float, ...]:
    """The widest gaps between neighbouring phase centres along the rows of a scan, and across them [m].

    A phase centre lies half way between a transmitter and a receiver. Receivers that fill the gap between two positions
    or two rows count; where they do not fill it evenly, the widest of the smaller gaps is told. Images keep it as
    `SarImage.steps`.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    tuple
        Along and across; along alone where there are not three rows; nothing where there are no straight rows.
    """
    tx, rx = capture.tx_positions, capture.rx_positions
    path = capture.trajectory
    if len(path) < 2:
        return ()
    if capture.tx_points is not None or capture.rx_points is not None:
        path = Trajectory(times=path.times, positions=(tx.mean(axis=1) + rx.mean(axis=1)) / 2)
    raster = _raster(path, SPEED_OF_LIGHT / capture.radar.waveform.frequencies.max())
    if raster is None:
        return ()
    centres = ((tx[0][:, None] + rx[0][None]) / 2).reshape(-1, 3)
    gaps = [_widest_gap(centres @ raster.along, raster.step)]
    if raster.across is not None:
        gaps.append(_widest_gap(centres @ raster.across, raster.pitch))
    return tuple(round(gap, 7) for gap in gaps)


def _widest_gap(places: np.ndarray, step: float) -> float:
    """Between neighbours of places (C,) that are repeated every `step` [m]."""
    if step <= 0:
        return 0.0
    within = np.sort(places % step)
    return float(np.diff(np.append(within, within[0] + step)).max())


class _Raster(NamedTuple):
    """Straight rows (of the numbers of their poses, in order), their directions and steps [m]."""

    rows: list[np.ndarray]
    along: np.ndarray
    across: np.ndarray | None
    normal: np.ndarray
    step: float
    pitch: float


def _raster(path: Trajectory, wavelength: float) -> _Raster | None:
    """The rows of a path; None where it has none, or where they are bent."""
    places = path.positions
    # Without their ends, which may belong to the turn to the next row.
    poses = [row.poses[1:-1] if len(row.poses) > 4 else row.poses for row in rows_of_path(path)]
    if not poses:
        return None
    ways = np.array([places[row[-1]] - places[row[0]] for row in poses])
    along = np.sum(ways * np.sign(ways @ ways[0])[:, None], axis=0)
    along = _upward(along / np.linalg.norm(along))
    poses = [row[np.argsort(places[row] @ along)] for row in poses]
    for row in poses:
        away = places[row] - places[row[0]]
        chord = away[-1] / max(np.linalg.norm(away[-1]), 1e-12)
        if np.linalg.norm(away - np.outer(away @ chord, chord), axis=1).max() > _BENT * np.linalg.norm(away[-1]):
            return None
    step = float(np.median(np.concatenate([np.diff(places[row] @ along) for row in poses])))
    middles = np.array([places[row].mean(axis=0) for row in poses])
    apart = middles - middles.mean(axis=0)
    apart = apart - np.outer(apart @ along, along)
    across = _upward(np.linalg.svd(apart)[2][0])
    order = np.argsort(apart @ across)
    gaps = np.diff((apart @ across)[order])
    gaps = gaps[gaps > _SAME * wavelength]
    pitch = float(gaps.sum() / np.rint(gaps / np.median(gaps)).sum()) if len(gaps) else 0.0
    normal = np.linalg.svd(np.stack([along, across]))[2][2]
    poses = [poses[i] for i in order]
    if len(gaps) < 2:
        return _Raster(poses, along, None, normal, step, 0.0)
    return _Raster(poses, along, across, normal, step, pitch)


def _ghosts(line: Line, radar: Radar, view: np.ndarray, objects: np.ndarray, normal: np.ndarray) -> tuple[Ghost, ...]:
    """The strongest ghost of reflectors near, in the middle and far."""
    middle, found = objects.mean(axis=0), []
    through = [_through(objects, way) for way in (normal, line.direction)]
    for depth in _PLACES if through[0].any() else (0.5,):
        lobes = []
        for place in _PLACES:
            offset = (depth - 0.5) * through[0] + (place - 0.5) * through[1]
            for side in (1,) if place < 0.5 else (-1,) if place > 0.5 else (1, -1):
                strongest = lobe(line, radar, middle + offset, view, side)
                if strongest is not None:
                    lobes.append((strongest[1], middle + offset, strongest[0]))
        if lobes:
            magnitude, reflector, place = max(lobes, key=lambda one: one[0])
            if 20 * np.log10(magnitude) > FAINTEST:
                level = 20 * float(np.log10(magnitude))
                found.append(Ghost(reflector=reflector, place=place, strength_db=level))
    return tuple(found)


def _through(box: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(3,) the longest stretch along a direction (3,) in a box, through its middle."""
    slanted = np.abs(way) > 1e-6
    return float((np.ptp(box, axis=0)[slanted] / np.abs(way[slanted])).min()) * way


def _some_rows(rows: list[np.ndarray], channels: int) -> np.ndarray:
    """Poses of some whole rows: a lobe along the rows changes slowly from row to row."""
    few = max(_FEWEST, _CHANNELS // (channels * max(1, int(np.median([len(row) for row in rows])))))
    return np.concatenate([rows[i] for i in _evenly(len(rows), few)])


def _some_of_each(rows: list[np.ndarray], channels: int) -> np.ndarray:
    """Some poses of every row."""
    few = max(_FEWEST, _CHANNELS // (channels * len(rows)))
    return np.concatenate([row[_evenly(len(row), few)] for row in rows])


def _evenly(count: int, few: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(few, count)).round().astype(int))


def _upward(way: np.ndarray) -> np.ndarray:
    """The direction, or its opposite, such that its largest component is positive."""
    return way * np.sign(way[np.argmax(np.abs(way))])


def _name(direction: np.ndarray) -> str:
    """The axis that a direction is of, or its components."""
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) > 0.99:
        return "xyz"[axis]
    return f"({', '.join(f'{round(float(d), 2) + 0:g}' for d in direction)})"
