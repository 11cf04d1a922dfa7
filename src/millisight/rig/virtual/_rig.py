"""A whole virtual rig: the devices of one world, and the truth that only they know, also in files of its own."""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from millisight.core import alone, atomic_path, checked_path, make_folder, move_into, printable, toml_of
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.data import CameraMask, Trajectory
from millisight.io import save
from millisight.io.mito import FRAMES
from millisight.rig import ArmPose, ScanPlan
from millisight.rig.virtual._arm import VirtualArm
from millisight.rig.virtual._camera import VirtualCamera, camera_mask, footprint, object_pixels, render, visible_pixels
from millisight.rig.virtual._layout import WorldLayout, build_layout
from millisight.rig.virtual._published import BASE_ORIGIN, image_grid
from millisight.rig.virtual._radar import Frames, VirtualRadar
from millisight.rig.virtual._settings import RadarSettings, WorldTime
from millisight.rig.virtual._world import World

_WORLD_NAME = "world.toml"
_STAGE = ".truth.part"  # where the files of the truth are made

# Keys of the devices' random numbers: one that is added changes none of the others.
_ARM, _CAMERA, _RADAR = 1, 2, 3
_ABOVE = 0.10  # of the camera over the aperture [m]
_MOST_FRAMES = 5e6  # half a day of an arm's log, and half a gigabyte before the first frame
_SAMPLED = 60  # frames
_SHARING = 10  # rows that share what the optics keep of one
_MOST_PLANNED = 200  # poses of a row
_VALUE_BYTES = {"77_ghz": 2, "24_ghz": 6}  # int16, and text
_ZERO_BYTES = 2  # of text


class VirtualRig:
    """The devices of a world, for `record_scan`.

    Parameters
    ----------
    world : World
    layout : `build_layout(world)`, where it has been built already
    frames : what a perfect radar would measure; None: the optics of the layout

    Attributes
    ----------
    world, layout : as given
    arm, radars, camera : devices
    plan : ScanPlan of the world's scan
    """

    def __init__(self, world: World, *, layout: WorldLayout | None = None, frames: Frames | None = None):
        self.world: World = world
        self.layout: WorldLayout = build_layout(world) if layout is None else layout
        now = WorldTime()
        self.arm: VirtualArm = VirtualArm(world.arm, now, world.rng(_ARM))
        self._frames = frames or optics_of(self.layout)
        self.radars: tuple[VirtualRadar, ...] = tuple(
            VirtualRadar(settings, now, self._radar_frame, self._frames, world.rng(_RADAR, int(settings.name[:2])))
            for settings in world.radars
        )
        self.camera: VirtualCamera = VirtualCamera(
            world.camera,
            self.layout,
            lambda: self.arm.true_positions(np.array([now.now]))[0],
            world.rng(_CAMERA),
        )
        self.plan: ScanPlan = plan_of(world)

    def truth(self, name: str) -> Trajectory:
        """True trajectory of the radar `name` at its frames: radar frame [m], times on its own clock [s].

        Raises
        ------
        UnknownNameError
            The world has no such radar.
        """
        radar = self._radar(name)
        times = radar.frame_times
        return Trajectory(times=radar.settings.clock.reading(times), positions=self._radar_frame(times) + radar.mount)

    def planned(self, name: str) -> Trajectory:
        """Where it would have been had the arm kept to its plan; see `truth`."""
        radar = self._radar(name)
        times = radar.frame_times
        positions = self.arm.planned_positions(times) - BASE_ORIGIN + radar.mount
        return Trajectory(times=radar.settings.clock.reading(times), positions=positions)

    @property
    def photo_pose(self) -> np.ndarray:
        """(4, 4) camera frame to radar frame, where the picture is to be taken."""
        return self.world.camera.pose(self.plan.photo.position - BASE_ORIGIN)  # ty: ignore[missing-union-attribute]

    def estimated_seconds(self, clock: Callable[[], float] = time.perf_counter) -> float:
        """Estimated time to compute the echoes of the whole plan on this machine [s], from a part of its middle row.

        `clock` tells the time; with `time.process_time` it is that of the processor.
        """
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
            _seconds(clock, self._frames, radar.settings, places[:1])
            first, again = (_seconds(clock, self._frames, radar.settings, places) for _ in range(2))
            rows = len(self.plan.rows)
            total += moving / some * (rows * again + max(1.0, rows / _SHARING) * max(0.0, first - again))
        return total

    def estimated_bytes(self) -> int:
        """Estimated size of the raw files. The rows of text at 24 GHz are filled up with zeros, as published."""
        values = 0
        for radar in self.radars:
            shape = (int(radar.settings.chirps or 1), len(radar.radar.array.rx_positions))
            per_frame = 2 * int(np.prod(shape)) * radar.radar.waveform.samples_per_chirp
            frames = self.plan.frames(radar.frame_period)
            values += _VALUE_BYTES[radar.name] * per_frame * frames
            if radar.name == "24_ghz":
                values += _ZERO_BYTES * per_frame * (-frames % FRAMES["24_ghz", "normal"])
        return values * len(self.plan.rows)

    def _radar(self, name: str) -> VirtualRadar:
        for radar in self.radars:
            if radar.name == name:
                return radar
        raise UnknownNameError("radar of this world", name, [radar.name for radar in self.radars])

    def _radar_frame(self, times: np.ndarray) -> np.ndarray:
        """(n, 3) true positions of the radar frame in the world [m] at true times (n,) [s]."""
        return self.arm.true_positions(times) - BASE_ORIGIN


def _seconds(clock: Callable[[], float], frames: Frames, settings: RadarSettings, positions: np.ndarray) -> float:
    started = clock()
    frames(settings, Trajectory(times=np.arange(len(positions)), positions=positions))
    return clock() - started


def plan_of(world: World) -> ScanPlan:
    """The scan of a world in the base frame, with time for its slowest row; an error if no disk holds its frames."""
    scan = world.scan
    rows = scan.rows(BASE_ORIGIN)
    middle = np.array([*scan.middle, _ABOVE]) - world.camera.offset
    photo = middle if world.camera.at is None else np.array(world.camera.at)
    row_time = 2 * world.arm.settle + world.arm.duration(scan.size[1])
    plan = ScanPlan(rows=rows, row_time=row_time, photo=ArmPose(position=photo + BASE_ORIGIN))
    paces = {f"the {radar.name} radar": float(radar.frame_period or 0) for radar in world.radars}
    for what, period in (*paces.items(), ("the log", 1 / world.arm.log_rate)):
        count = float(len(rows) * row_time) / period
        if not count <= _MOST_FRAMES:
            raise InputError(
                f"{what} would take {count:.3g} frames or poses, one every {period:g} s; expected at most "
                f"{_MOST_FRAMES:.0e}: use a faster arm, fewer rows, or a longer period"
            )
    return plan


def optics_of(layout: WorldLayout) -> Frames:
    """What a perfect radar measures of a layout, by the rig's optics."""
    # Numba is loaded when echoes are computed, not when a world is checked.
    from millisight.rig.virtual._echoes import EchoModel, Part
    from millisight.rig.virtual._occluders import Sheet

    world = layout.world
    parts = tuple(Part(mesh=part.mesh, material=part.material) for part in layout.parts)
    sheets = tuple(Sheet(corner=p.corner, u=p.u, v=p.v, layers=p.layers) for p in layout.panels)
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


def line_of_sight_mask(rig: VirtualRig) -> CameraMask:
    """The objects' pixels in the picture of the same scene with nothing before it, as the published masks are made."""
    layout, pose = rig.layout.uncovered(), rig.camera.pose
    frame = render(layout, pose, rig.world.camera, np.random.default_rng(rig.world.seed))
    return camera_mask(frame, visible_pixels(layout, pose))


def write_object_masks(rig: VirtualRig, folder: Path) -> None:
    """Write each object's pixels in the picture into `camera.masks.npz`: see `write_truth`."""
    masks = {}
    for item in rig.layout.objects:
        masks[f"{item.number}_{item.name}.amodal"] = object_pixels(rig.layout, rig.camera.pose, item.number)
        masks[f"{item.number}_{item.name}.visible"] = visible_pixels(rig.layout, rig.camera.pose, item.number)
    with atomic_path(folder / "camera.masks.npz") as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **masks)


def write_truth(rig: VirtualRig, folder: str | os.PathLike[str]) -> Path:
    """Write the truth of a scan into `folder`, made where it is missing; the same scan gives the same bytes.

    - `<radar>.path.h5`, a Trajectory: where the radar was when it took each frame, radar frame, times of its own clock;
    - `<radar>.footprint.h5`, a Mask: the pixels of the published image grid over which objects lie; with several also
      `<radar>.<number>_<name>.footprint.h5` of each;
    - `camera.mask.h5`, a CameraMask: the objects in the picture as if nothing hid them;
    - `camera.masks.npz`: of each object `<number>_<name>.amodal`, (480, 640) bool, its pixels if it were alone, and
      `.visible`, those on which it is seen;
    - `world.toml`.

    Raises
    ------
    FileError
        It cannot be written, or holds other files of these names, which stay.
    """
    check_truth(rig, folder)
    folder = make_folder(folder)
    stage = folder / _STAGE
    with alone(folder, printable(folder)):
        shutil.rmtree(stage, ignore_errors=True)  # of a run that was killed
        try:
            _write_truth(rig, make_folder(stage), folder)
            # The world last: where it is, the rest is.
            for path in sorted(stage.iterdir(), key=lambda path: path.name == _WORLD_NAME):
                move_into(path, folder / path.name, known=False)
        finally:
            shutil.rmtree(stage, ignore_errors=True)
    return folder


def check_truth(rig: VirtualRig, folder: str | os.PathLike[str]) -> None:
    """Refuse a folder with another scan's truth, before the scan.

    Raises
    ------
    FileError
    """
    path = checked_path(folder) / _WORLD_NAME
    if path.exists() and path.read_bytes() != toml_of(rig.world.seen_from(folder)).encode():
        raise FileError(f"{printable(path)} is of another scan, and would be overwritten; choose another folder")


def _write_truth(rig: VirtualRig, to: Path, folder: Path) -> None:
    """All files of the truth into `to`, from where they go to `folder`."""
    layout = rig.layout
    several = layout.objects if len(layout.objects) > 1 else ()
    for radar in rig.radars:
        save(to / f"{radar.name}.path.h5", rig.truth(radar.name), reproducible=True)
        grid = image_grid(rig.world, radar.name).xy
        for number, name in [(None, ""), *((item.number, f".{item.number}_{item.name}") for item in several)]:
            mask = footprint(layout, grid, number)
            save(to / f"{radar.name}{name}.footprint.h5", mask, reproducible=True)
    if layout.objects:
        save(to / "camera.mask.h5", line_of_sight_mask(rig), reproducible=True)
        write_object_masks(rig, to)
    rig.world.seen_from(folder).to_toml(to / _WORLD_NAME)
