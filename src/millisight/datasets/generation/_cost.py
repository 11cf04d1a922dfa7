"""What jobs will cost, told before they start: core-seconds and bytes, from figures measured once and scaled to here.

The rig's optics cost, for each frame, a pass over all patches and faces, which the receivers share. Patches are about
ten a square wavelength. Those of objects are also seen by way of one another, and sheets are crossed on the way.
"""

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from statistics import median
from typing import NamedTuple

import numpy as np

from millisight.data import Radar, Scene, Trajectory, VoxelGrid
from millisight.datasets.generation._recipe import Simulator
from millisight.io.mito import FRAMES
from millisight.rig.virtual import ScanSettings, VirtualRig, World, WorldLayout, WorldObject, build_layout, optics_of

# Processor time of one core of an AMD EPYC (Zen 5, 2.6 GHz), see benchmarks/test_generate.py [s].
_JOB = 0.4  # building the world, and files
_ECHO = 22e-5  # a frame, whatever there is
_BEHIND, _OBJECT, _SHEET, _FACE = 6e-9, 49e-9, 23e-9, 5e-9  # a frame: patches of each kind, and faces
_PATCHES = 10.0  # a square wavelength
_FRAME = {"77_ghz": 0.5e-3, "24_ghz": 1.7e-3}  # noise, the arm's log, and the raw file written and read
_PICTURE = 0.65
_START, _PAIR, _CHANNEL, _VOXEL = 0.4, 0.7e-9, 2.0e-5, 0.5e-6  # imaging: direct, or factorised
_VERTEX_PAIR, _VERTEX = 2.5e-9, 0.8e-4  # the simulator: a vertex seen from a position, and resampling

_PROBES = 7
_ALL_ROWS = 1.0  # what all rows take over what the middle one tells
# What whole recipes may take over what is told: with a probe of a small row (0.8 and 1.26 did), and of their own jobs.
_FIGURES, _OWN = (0.6, 1.6), (0.85, 1.2)

_IMAGE_BYTES = 8  # a voxel
_PICTURE_BYTES = {"los": 11_000_000, "nlos": 1_600_000}
_PLACE_BYTES = 32  # of a frame in the files of paths


class Cost(NamedTuple):
    """Of a job."""

    seconds: float  # of one core
    kept: float  # bytes that stay
    spool: float  # bytes on disk while it runs


class Total(NamedTuple):
    """Of all jobs."""

    jobs: int  # how many
    core_seconds: float  # sum
    kept: float  # sum, in bytes
    spool: float  # most bytes on disk besides, with so many workers
    wall: float  # how long they take with so many workers, each on a core that is free [s]
    low: float = 1.0  # the times are likely to be between so many
    high: float = 1.0  # and so many times these


def total(costs: Iterable[Cost], workers: int, slowness: "Slowness") -> Total:
    """The cost of jobs that as many workers share, each of one core; the range is that of the probes and figures."""
    costs = [cost._replace(seconds=cost.seconds * slowness.median) for cost in costs]
    seconds = sum(cost.seconds for cost in costs)
    longest = max((cost.seconds for cost in costs), default=0.0)
    spool = sum(sorted((cost.spool for cost in costs), reverse=True)[:workers])
    ends = slowness.low, slowness.high
    low, high = (factor * end / slowness.median for factor, end in zip(slowness.figures, ends, strict=True))
    return Total(
        len(costs), seconds, sum(cost.kept for cost in costs), spool, max(seconds / workers, longest), low, high
    )


def rig_cost(stage: WorldLayout, grids: Mapping[str, VoxelGrid], *, keep: str, camera: bool) -> Cost:
    """Of a scan of this stage by its world's radars, and of their images on `grids`."""
    world = stage.world
    rig = VirtualRig(world, layout=stage)
    seconds, kept = _JOB, 0.0
    rows = len(rig.plan.rows)
    for radar in rig.radars:
        receivers = len(radar.radar.array.rx_positions)
        moving = world.arm.duration(world.scan.size[1]) / radar.frame_period + 2
        grid, frames = grids[radar.name], rows * moving
        seconds += rows * row_seconds(stage, radar.radar, moving)
        seconds += rows * _written(moving, radar.name, keep) * _FRAME[radar.name]
        seconds += _imaging_seconds(frames * receivers, grid)
        kept += grid.size * _IMAGE_BYTES + math.prod(grid.shape[:2]) + frames * _PLACE_BYTES
        if keep == "captures":
            kept += frames * (receivers * radar.radar.waveform.samples_per_chirp * 8 + 2 * _PLACE_BYTES)
    raw = rig.estimated_bytes()
    if camera:
        seconds += _PICTURE
        kept += _PICTURE_BYTES[world.sight]
    return Cost(seconds, kept + (raw if keep == "raw" else 0), 2 * raw)


def _echo_seconds(rig: VirtualRig) -> float:
    """Of one core, for the echoes of all rows, by the figures."""
    duration, rows = rig.world.arm.duration(rig.world.scan.size[1]), len(rig.plan.rows)
    each = (row_seconds(rig.layout, radar.radar, duration / radar.frame_period + 2) for radar in rig.radars)
    return rows * sum(each)


def _written(frames: float, radar: str, keep: str) -> float:
    """Frames in the files of a row of so many: the published ones at 24 GHz are filled up."""
    whole = FRAMES["24_ghz", "normal"]
    return math.ceil(frames / whole) * whole if keep == "raw" and radar == "24_ghz" else frames


def row_seconds(stage: WorldLayout, radar: Radar, frames: float) -> float:
    """Of one core, for the echoes of a row of so many frames."""
    patches = _PATCHES / radar.waveform.wavelength**2  # a square metre
    kinds = (
        (_BEHIND, stage.background),
        (_OBJECT, tuple(part for item in stage.objects for part in item.parts)),
        (_SHEET, stage.panels),
    )
    frame = sum(cost * patches * part.mesh.area for cost, parts in kinds for part in parts)
    return frames * (_ECHO + frame + _FACE * sum(len(part.mesh.faces) for part in stage.parts))


def simulator_cost(scene: Scene, trajectory: Trajectory, grid: VoxelGrid, settings: Simulator) -> Cost:
    """Of the simulated images of a scene, one a model."""
    models, positions = len(settings.models), len(trajectory)
    vertices = settings.vertices * len(scene.objects)
    seconds = _JOB + vertices * _VERTEX
    seconds += models * (positions * vertices * _VERTEX_PAIR + _imaging_seconds(positions, grid))
    kept = models * (grid.size * _IMAGE_BYTES + math.prod(grid.shape[:2]))
    return Cost(seconds, float(kept), 0.0)


def _imaging_seconds(channels: float, grid: VoxelGrid) -> float:
    direct = channels * grid.size * _PAIR
    return min(direct, _START + channels * _CHANNEL + grid.size * _VOXEL)


class Slowness(NamedTuple):
    """How much longer work takes one core here than on the machine of the figures."""

    median: float = 1.0  # of probes
    low: float = 1.0  # least of them
    high: float = 1.0  # largest of them
    figures: tuple[float, float] = _FIGURES  # what the work may take over that, besides


def slowness_of(scans: Iterable[tuple[WorldLayout, float]], done: Callable[[], object] = lambda: None) -> Slowness:
    """What scans take, by the processor time of their middle rows, over the core-seconds that the figures say and that
    are given beside: scans that stand for equal shares of the work. `done` is called after each.

    With the median, the mean of these shares, come two standard errors of it.
    """
    from millisight.core import numba

    threads, ratios = numba.get_num_threads(), []
    numba.set_num_threads(1)
    try:
        for stage, told in scans:
            rig = VirtualRig(stage.world, layout=stage)
            rest = max(told - _echo_seconds(rig), 0.0)
            ratios.append((_ALL_ROWS * rig.estimated_seconds(time.process_time) + rest) / told)
            done()
    finally:
        numba.set_num_threads(threads)
    mean = float(np.mean(ratios))
    sigma = float(np.std(ratios, ddof=1) / np.sqrt(len(ratios))) if len(ratios) > 1 else 0.0
    return Slowness(mean, max(mean - 2 * sigma, min(ratios)), min(mean + 2 * sigma, max(ratios)), _OWN)


@cache
def slowness() -> Slowness:
    """The processor time of a small row of echoes, several times, over that on the machine of the figures.

    It is measured once a process: little work is estimated by it. Processor time does not count how long other
    programs have the core; that they share its caches and clock still shows, by a factor of 1.5 on a busy machine, and
    is told by the range.
    """
    from millisight.core import numba

    world = World(objects=(WorldObject(object="golf_ball", at=(0.1, 0.1)),), scan=ScanSettings(size=(0.2, 0.2)))
    stage, settings, frames = build_layout(world), world.radars[0], 40
    optics = optics_of(stage)
    places = np.column_stack([np.full(frames, 0.1), np.linspace(0.05, 0.15, frames), np.zeros(frames)])
    row = Trajectory(times=np.arange(frames), positions=places)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        optics(settings, row)  # it may compile
        probes = [processor_seconds(lambda: optics(settings, row)) for _ in range(_PROBES)]
    finally:
        numba.set_num_threads(threads)
    told = row_seconds(stage, settings.radar, frames)
    return Slowness(median(probes) / told, min(probes) / told, max(probes) / told)


def processor_seconds(work: Callable[[], object]) -> float:
    """Processor time of this process for some work, all threads together."""
    started = time.process_time()
    work()
    return time.process_time() - started


class Remaining:
    """Core-seconds of jobs that are done and of those to do, which finished jobs of their kind correct.

    Parameters
    ----------
    told : kind and estimated core-seconds of each job, by name
    slowness : by which these are multiplied until a job is done
    """

    def __init__(self, told: Mapping[str, tuple[str, float]], slowness: float):
        self._left = dict(told)
        self._slowness = slowness
        self._done = 0.0
        self._told: defaultdict[str, float] = defaultdict(float)
        self._took: defaultdict[str, float] = defaultdict(float)

    def finish(self, job: str, took: float | None) -> tuple[int, int]:
        """Core-seconds done, and in all, once this job took so many; None: it failed, and nobody knows."""
        kind, told = self._left.pop(job)
        if took is None:
            self._done += told * self._ratio(kind)
        else:
            self._told[kind] += told
            self._took[kind] += took
            self._done += took
        done = max(1, math.ceil(self._done))
        return done, done + math.ceil(sum(told * self._ratio(kind) for kind, told in self._left.values()))

    def _ratio(self, kind: str) -> float:
        """What was taken over what was told: of jobs of the kind, else of all, else as probed."""
        if self._told[kind]:
            return self._took[kind] / self._told[kind]
        told = sum(self._told.values())
        return sum(self._took.values()) / told if told else self._slowness
