"""A whole virtual rig: the devices of one world, and the truth that only they know."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from millisight.capture.trajectory import Trajectory
from millisight.errors import InputError, UnknownNameError
from millisight.io.mito_layout import experiment_folder
from millisight.io.mito_setup import BASE_ORIGIN, FRAME_PERIODS
from millisight.rig.plan import ScanPlan
from millisight.rig.protocols import Pose
from millisight.rig.virtual.arm import VirtualArm
from millisight.rig.virtual.camera import VirtualCamera
from millisight.rig.virtual.clocks import WorldTime
from millisight.rig.virtual.radar import Frames, RadarSettings, VirtualRadar
from millisight.rig.virtual.stage import Stage, build
from millisight.rig.virtual.world import World
from millisight.scene.material import LAYERED
from millisight.scene.objects import CATALOGUE

# Keys of the devices' random numbers: one that is added changes none of the others.
_ARM, _CAMERA, _RADAR = 1, 2, 3
_ABOVE = 0.10  # of the camera over the aperture [m]
_MOST_FRAMES = 1e8
_SAMPLED = 60  # frames
_SHARING = 10  # rows that share what the optics keep of one
_MOST_PLANNED = 200  # poses of a row
_VALUE_BYTES = {"77_ghz": 2, "24_ghz": 6}  # int16, and text


class VirtualRig:
    """The devices of a world: what `record_scan` takes, besides the plan.

    Parameters
    ----------
    world : World
    stage : `build(world)`, where it has been built already
    frames : what a perfect radar would measure; None: the optics of the stage

    Attributes
    ----------
    world, stage : as given
    arm, radars, camera : devices
    plan : ScanPlan of the world's scan
    """

    def __init__(self, world: World, *, stage: Stage | None = None, frames: Frames | None = None):
        self.world = world
        self.stage = build(world) if stage is None else stage
        now = WorldTime()
        self.arm = VirtualArm(world.arm, now, world.rng(_ARM))
        self._frames = frames or optics_of(self.stage)
        self.radars = tuple(
            VirtualRadar(settings, now, self._radar_frame, self._frames, world.rng(_RADAR, int(settings.folder[:2])))
            for settings in world.radars
        )
        self.camera = VirtualCamera(
            world.camera,
            self.stage,
            lambda: self.arm.true_positions(np.array([now.now]))[0],
            world.rng(_CAMERA),
        )
        self.plan = plan_of(world)

    def truth(self, folder: str) -> Trajectory:
        """Where the radar of `folder` truly was when it took its frames: radar frame [m], times of its own clock [s].

        Raises
        ------
        UnknownNameError
            The world has no such radar.
        """
        radar = self._radar(folder)
        times = radar.frame_times
        return Trajectory(times=radar.settings.clock.reading(times), positions=self._radar_frame(times) + radar.mount)

    def planned(self, folder: str) -> Trajectory:
        """Where it would have been had the arm kept to its plan; see `truth`."""
        radar = self._radar(folder)
        times = radar.frame_times
        positions = self.arm.planned_positions(times) - BASE_ORIGIN + radar.mount
        return Trajectory(times=radar.settings.clock.reading(times), positions=positions)

    @property
    def photo_pose(self) -> np.ndarray:
        """(4, 4) camera frame to radar frame, where the picture is to be taken."""
        return self.world.camera.pose(self.plan.photo.position - BASE_ORIGIN)  # type: ignore[union-attr]

    def estimated_seconds(self) -> float:
        """How long the echoes of the whole plan would take here [s], from those of a piece of its middle row."""
        start, end = self.plan.rows[len(self.plan.rows) // 2]
        length = float(np.linalg.norm(end.position - start.position))
        total = 0.0
        for radar in self.radars:
            moving = int(self.world.arm.duration(length) / radar.frame_period) + 1
            some = min(moving, _SAMPLED)
            share = (np.arange(some) - some / 2) / moving + 0.5
            places = start.position + share[:, None] * (end.position - start.position) - BASE_ORIGIN + radar.mount
            # The first call makes the model ready, which is then done for the whole scan. What the second casts anew
            # serves the rows near by, too.
            _seconds(self._frames, radar.settings, places[:1])
            first, again = (_seconds(self._frames, radar.settings, places) for _ in range(2))
            rows = len(self.plan.rows)
            total += moving / some * (rows * again + max(1.0, rows / _SHARING) * max(0.0, first - again))
        return total

    def estimated_bytes(self) -> int:
        """How large the raw files would be."""
        values = 0
        for radar in self.radars:
            shape = (int(radar.settings.chirps or 1), len(radar.radar.array.rx_positions))
            per_frame = 2 * int(np.prod(shape)) * radar.radar.waveform.samples_per_chirp
            values += _VALUE_BYTES[radar.folder] * per_frame * self.plan.frames(radar.frame_period)
        return values * len(self.plan.rows)

    def _radar(self, folder: str) -> VirtualRadar:
        for radar in self.radars:
            if radar.folder == folder:
                return radar
        raise UnknownNameError("radar of this world", folder, [radar.folder for radar in self.radars])

    def _radar_frame(self, times: np.ndarray) -> np.ndarray:
        """(n, 3) true positions of the radar frame in the world [m] at true times (n,) [s]."""
        return self.arm.true_positions(times) - BASE_ORIGIN


def _seconds(frames: Frames, settings: RadarSettings, positions: np.ndarray) -> float:
    started = time.perf_counter()
    frames(settings, Trajectory(times=np.arange(len(positions)), positions=positions))
    return time.perf_counter() - started


def experiment_folder_of(world: World, root: str | os.PathLike[str], number: int) -> Path:
    """Where a world's experiment goes in a dataset: under its first object's name and angles.

    What is not of the catalogue has the number 000; several objects stand in the name one after the other, and the
    empty scene is 000_background.
    """
    names = [CATALOGUE[o.object].ycb_id if o.object else f"000_{o.name}" for o in world.objects] or ["000_background"]
    angles = world.objects[0].rotate_deg if world.objects else (0.0, 0.0, 0.0)
    x, y, z = (round(angle) for angle in angles)
    return experiment_folder(root, "+".join(names), (x, y, z), number, world.sight)


def plan_of(world: World) -> ScanPlan:
    """The scan of a world in the base frame, with time for its slowest row.

    Raises
    ------
    InputError
        It would take more frames than any disk holds.
    """
    scan = world.scan
    rows = [
        (Pose(position=np.add(BASE_ORIGIN, (x, y0, 0.0))), Pose(position=np.add(BASE_ORIGIN, (x, y1, 0.0))))
        for x in scan.row_places
        for y0, y1 in [(scan.corner[1], scan.corner[1] + scan.size[1])]
    ]
    if scan.pattern == "serpentine":
        rows[1::2] = [(end, start) for start, end in rows[1::2]]
    middle = np.array([*scan.middle, _ABOVE]) - world.camera.offset
    photo = middle if world.camera.at is None else np.array(world.camera.at)
    row_time = 2 * world.arm.settle + world.arm.duration(scan.size[1])
    plan = ScanPlan(rows=tuple(rows), row_time=row_time, photo=Pose(position=photo + BASE_ORIGIN))
    paces = {f"the {radar.folder} radar": float(radar.frame_period or 0) for radar in world.radars}
    for what, period in (*paces.items(), ("the log", 1 / world.arm.log_rate)):
        count = len(rows) * row_time / period
        if not count <= _MOST_FRAMES:
            raise InputError(
                f"{what} would take {count:.3g} frames or poses, one each {period:g} s; expected {_MOST_FRAMES:.0e} at "
                "most: a faster arm, fewer rows, or a longer period"
            )
    return plan


def experiment_info(world: World) -> dict[str, Any]:
    """What `experiment_info.json` says of a world's scan.

    "aperture size" stands for the published pace of the frames and, at 24 GHz, for both receivers; "frame period" [s]
    says what the pace is where it is neither.
    """
    periods = {radar.folder: radar.frame_period for radar in world.radars}
    normal = all(period == FRAME_PERIODS[folder, "normal"] for folder, period in periods.items())
    size = "normal" if normal and "77_ghz" in periods else "almost-square"
    axes = [radar.rx_axis for radar in world.radars if radar.folder == "77_ghz"]
    info = {"aperture size": size, "rx offset": (axes and axes[0]) or "x", "background": world.support.kind}
    other = {folder: period for folder, period in periods.items() if period != FRAME_PERIODS[folder, size]}
    return info | ({"frame period": other} if other else {})


def optics_of(stage: Stage) -> Frames:
    """What a perfect radar measures of a stage, by the rig's optics."""
    from millisight.rig.virtual.occluders import Sheet
    from millisight.rig.virtual.optics import EchoModel, Part

    world = stage.world
    parts = tuple(Part(mesh=part.mesh, material=part.material) for part in stage.parts)
    sheets = tuple(Sheet(corner=p.corner, u=p.u, v=p.v, layers=LAYERED[p.stack]) for p in stage.panels)
    models: dict[RadarSettings, EchoModel] = {}

    def frames(settings: RadarSettings, trajectory: Trajectory) -> np.ndarray:
        if settings not in models:
            models[settings] = EchoModel(
                parts, settings.radar, _planned(world, settings), edges=world.optics.edges,
                bounces=world.optics.bounces, occluders=sheets, antenna=settings.antenna, rng=world.seed,
            )  # fmt: skip
        return models[settings].frames(trajectory)

    return frames


def _planned(world: World, settings: RadarSettings) -> Trajectory:
    """About where a radar's transmitter will be, in the radar frame."""
    along = np.linspace(0, 1, min(_MOST_PLANNED, plan_of(world).frames(settings.frame_period or 1.0)))[:, None]
    rows = [start.position + along * (end.position - start.position) for start, end in plan_of(world).rows]
    positions = np.concatenate(rows) - BASE_ORIGIN + np.array(settings.mount)
    return Trajectory(times=np.arange(len(positions)), positions=positions)
