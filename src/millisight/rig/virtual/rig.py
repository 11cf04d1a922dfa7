"""A whole virtual rig: the devices of one world, and the truth that only they know."""

from typing import Any

import numpy as np

from millisight.capture.trajectory import Trajectory
from millisight.errors import UnknownNameError
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

# Keys of the devices' random numbers: one that is added changes none of the others.
_ARM, _CAMERA, _RADAR = 1, 2, 3
_ABOVE = 0.10  # of the camera over the aperture [m]


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
        time = WorldTime()
        self.arm = VirtualArm(world.arm, time, world.rng(_ARM))
        frames = frames or optics_of(self.stage)
        self.radars = tuple(
            VirtualRadar(settings, time, self._radar_frame, frames, world.rng(_RADAR, int(settings.folder[:2])))
            for settings in world.radars
        )
        self.camera = VirtualCamera(
            world.camera,
            self.stage,
            lambda: self.arm.true_positions(np.array([time.now]))[0],
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
        for radar in self.radars:
            if radar.folder == folder:
                return radar.truth
        raise UnknownNameError("radar of this world", folder, [radar.folder for radar in self.radars])

    def _radar_frame(self, times: np.ndarray) -> np.ndarray:
        """(n, 3) true positions of the radar frame in the world [m] at true times (n,) [s]."""
        return self.arm.true_positions(times) - BASE_ORIGIN


def plan_of(world: World) -> ScanPlan:
    """The scan of a world in the base frame, with time for its slowest row."""
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
    return ScanPlan(
        rows=tuple(rows),
        row_time=2 * world.arm.settle + world.arm.duration(scan.size[1]),
        photo=Pose(position=photo + BASE_ORIGIN),
    )


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
    from millisight.rig.virtual.optics import Part, echoes

    world = stage.world
    parts = tuple(Part(mesh=part.mesh, material=part.material) for part in stage.parts)
    sheets = tuple(Sheet(corner=p.corner, u=p.u, v=p.v, layers=LAYERED[p.stack]) for p in stage.panels)

    def frames(settings: RadarSettings, trajectory: Trajectory) -> np.ndarray:
        # One seed for all rows: a rough surface is the same from wherever it is looked at.
        return echoes(
            parts, settings.radar, trajectory, edges=world.optics.edges, bounces=world.optics.bounces,
            occluders=sheets, antenna=settings.antenna, rng=world.seed,
        )  # fmt: skip

    return frames
