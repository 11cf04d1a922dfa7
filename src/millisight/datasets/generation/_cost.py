"""What jobs will cost, told before they start: core-seconds and bytes, from figures measured once and scaled to here.

The rig's optics cost, for each row of the aperture, a pass over all patches, and for each frame and receiver one more,
times the sheets that a wave may cross. Patches are about ten a square wavelength, and no fewer than faces.
"""

import time
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from millisight.data import Radar, Scene, Trajectory, VoxelGrid
from millisight.datasets.generation._recipe import Simulator
from millisight.rig.virtual import ScanSettings, VirtualRig, World, WorldLayout, WorldObject, build_layout, optics_of

# Measured on one core of an AMD EPYC (Zen 5, 2.6 GHz), see benchmarks/test_generate.py [s].
_JOB = 1.0  # building the world, and files
_ROW, _ROW_PATCH = 0.03, 5e-6
_PATCH, _SHEET_PATCH = 1.6e-8, 6e-9
_PATCHES = 10.0  # a square wavelength
_FRAME = {"77_ghz": 0.4e-3, "24_ghz": 6e-3}  # noise, and the raw file written and read
_PICTURE = 1.6
_PAIR, _CHANNEL, _VOXEL = 1.7e-9, 8e-5, 1e-6  # imaging: direct, or factorised
_VERTEX_PAIR, _VERTEX = 6e-9, 2e-4  # the simulator: a vertex seen from a position, and resampling

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
    wall: float  # how long they take with so many workers [s]


def total(costs: Iterable[Cost], workers: int) -> Total:
    """The cost of jobs that as many workers share, each of one core."""
    costs = list(costs)
    seconds = sum(cost.seconds for cost in costs)
    longest = max((cost.seconds for cost in costs), default=0.0)
    spool = sum(sorted((cost.spool for cost in costs), reverse=True)[:workers])
    return Total(len(costs), seconds, sum(cost.kept for cost in costs), spool, max(seconds / workers, longest))


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
        seconds += rows * row_seconds(stage, radar.radar, moving) + frames * _FRAME[radar.name]
        seconds += _imaging_seconds(frames * receivers, grid)
        kept += grid.size * _IMAGE_BYTES + np.prod(grid.shape[:2]) + frames * _PLACE_BYTES
        if keep == "captures":
            kept += frames * (receivers * radar.radar.waveform.samples_per_chirp * 8 + 2 * _PLACE_BYTES)
    raw = rig.estimated_bytes()
    if camera:
        seconds += _PICTURE
        kept += _PICTURE_BYTES[world.sight]
    return Cost(seconds, kept + (raw if keep == "raw" else 0), 2 * raw)


def row_seconds(stage: WorldLayout, radar: Radar, frames: float) -> float:
    """Of one core, for the echoes of a row of so many frames."""
    squared = radar.waveform.wavelength**2
    solid = sum(_PATCHES * part.mesh.area / squared + len(part.mesh.faces) for part in stage.parts)
    sheet = sum(_PATCHES * panel.mesh.area / squared for panel in stage.panels)
    receivers = len(radar.array.rx_positions)
    frame = receivers * (_PATCH * solid + (solid + sheet) * len(stage.panels) * _SHEET_PATCH)
    return _ROW + _ROW_PATCH * (solid + sheet) + frames * frame


def simulator_cost(scene: Scene, trajectory: Trajectory, grid: VoxelGrid, settings: Simulator) -> Cost:
    """Of the simulated images of a scene, one a model."""
    models, positions = len(settings.models), len(trajectory)
    vertices = settings.vertices * len(scene.objects)
    seconds = _JOB + vertices * _VERTEX
    seconds += models * (positions * vertices * _VERTEX_PAIR + _imaging_seconds(positions, grid))
    kept = models * (grid.size * _IMAGE_BYTES + np.prod(grid.shape[:2]))
    return Cost(seconds, float(kept), 0.0)


def _imaging_seconds(channels: float, grid: VoxelGrid) -> float:
    direct = channels * grid.size * _PAIR
    return min(direct, 1.0 + channels * _CHANNEL + grid.size * _VOXEL)


def slowness() -> float:
    """How much longer than on the machine of the figures a small row of echoes takes here, by one core."""
    import numba

    world = World(objects=(WorldObject(object="golf_ball", at=(0.1, 0.1)),), scan=ScanSettings(size=(0.2, 0.2)))
    stage, settings, frames = build_layout(world), world.radars[0], 40
    optics = optics_of(stage)
    places = np.column_stack([np.full(frames, 0.1), np.linspace(0.05, 0.15, frames), np.zeros(frames)])
    row = Trajectory(times=np.arange(frames), positions=places)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        optics(settings, row)  # it may compile
        started = time.perf_counter()
        optics(settings, row)
        return (time.perf_counter() - started) / row_seconds(stage, settings.radar, frames)
    finally:
        numba.set_num_threads(threads)
