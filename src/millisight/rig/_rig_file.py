"""A rig file: which devices there are, where they are reached and mounted, and the scan they are to do."""

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import (
    check_known,
    checked_number,
    checked_numbers,
    printable,
    put,
    quoted,
    read_toml,
    record,
    record_from_table,
    turn_between_deg,
)
from millisight.core.errors import DeviceError, FormatError, InputError
from millisight.data import CameraFrame, VoxelGrid
from millisight.io.mito import BASE_ORIGIN, SIGHTS, checked_radar
from millisight.rig._protocols import ArmPose
from millisight.rig._recorder import ScanPlan
from millisight.rig._scan_settings import ScanSettings
from millisight.rig.drivers import DRIVERS

_STILL, _STILL_DEG = 5e-4, 0.1  # how far an arm that stands may seem to move [m], [degrees]
_START = 0.5  # how long an arm may take from a request to its first motion [s]


LAYOUTS = ("published", "captures")
"""What a scan is written as: an experiment of the published layout, or captures of our own, which take any radar."""


@record
class ImageBox:
    """The voxels of the images, in their frame.

    Attributes
    ----------
    lower, upper : middles of the first and the last voxel [m]
    spacing : along x, y and z [m]
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    spacing: tuple[float, float, float]

    def __post_init__(self) -> None:
        put(
            self,
            lower=checked_numbers(self.lower, name="lower", count=3, unit="m"),
            upper=checked_numbers(self.upper, name="upper", count=3, unit="m"),
            spacing=checked_numbers(self.spacing, name="spacing", count=3, unit="m", above=0),
        )
        _ = self.grid

    @property
    def box(self) -> dict[str, list[float]]:
        """As `VoxelGrid.regular` takes it."""
        return {"lower": list(self.lower), "upper": list(self.upper), "spacing": list(self.spacing)}

    @property
    def grid(self) -> VoxelGrid:
        return VoxelGrid.regular(**self.box)


@record
class RigFile:
    """A rig as its file describes it.

    Attributes
    ----------
    arm, radars, camera : tables of the devices: `driver`, a name of `millisight.rig.drivers.DRIVERS`, and its keys; no
        camera: no picture
    scan : the aperture in the frame of the images, at z = 0
    origin : of that frame in the arm's base frame, axes parallel [m]
    object : what is scanned, for the folder's name: `<id>_<name>` such as "025_mug"
    rotate_deg : how it is turned, for the folder's name [degrees]
    sight : "los", or "nlos" where something hides it
    background : what it stands on: "tripod" or "styrofoam", or what else there is
    layout : "published": the radars are called "77_ghz" and "24_ghz"; "captures": HDF5 files of our own, any radars
    image : voxels of the images; None: as the published layout has them, and with "captures" none, so that `image`
        needs a grid
    photo : where the arm holds the radar frame for the picture, in the frame of the images [m]; None: over the
        aperture's middle
    """

    arm: Mapping[str, Any]
    radars: tuple[Mapping[str, Any], ...]
    scan: ScanSettings
    camera: Mapping[str, Any] | None = None
    origin: tuple[float, float, float] = BASE_ORIGIN
    object: str = "000_scan"
    rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sight: str = "los"
    background: str = "tripod"
    layout: str = LAYOUTS[0]
    image: ImageBox | None = None
    photo: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        check_known("kind of sight", self.sight, SIGHTS)
        check_known("layout", self.layout, LAYOUTS)
        if not self.radars:
            raise InputError("radars is empty; expected at least one [[radars]] table")
        put(
            self,
            origin=checked_numbers(self.origin, name="origin", count=3, unit="m"),
            rotate_deg=checked_numbers(self.rotate_deg, name="rotate_deg", count=3, unit="deg"),
            photo=None if self.photo is None else checked_numbers(self.photo, name="photo", count=3, unit="m"),
        )


class Report(NamedTuple):
    """How one device is.

    Attributes
    ----------
    name : what it is and its driver: "arm (ur)"
    lines : what it says of itself
    error : why it cannot be used; None: it can
    """

    name: str
    lines: list[str]
    error: str | None


class Lab:
    """The devices of a rig file, and the plan of its scan. Making one talks to no device.

    Within `with`, all devices are open; afterwards they are at rest and closed.

    Attributes
    ----------
    file : RigFile
    arm, radars, camera : the devices; camera None: there is none
    plan : ScanPlan

    Raises
    ------
    FormatError
        A key or a value of a device cannot be right; the message names the place.
    InputError
        The scan leaves the arm's workspace, two radars have one name, or one that the layout does not know.
    """

    def __init__(self, file: RigFile, *, folder: str | os.PathLike[str] = ".", source: str = "rig file"):
        self.file: RigFile = file
        self._devices: list[tuple[str, Any]] = []
        self.arm: Any = self._device("arm", file.arm, "arm", folder, source)
        self.radars: tuple[Any, ...] = tuple(
            self._device("radar", table, f"radars[{i}]", folder, source) for i, table in enumerate(file.radars)
        )
        names = [radar.name for radar in self.radars]
        if file.layout == LAYOUTS[0]:
            for name in names:
                checked_radar(name)
        if len(set(names)) < len(names):
            raise InputError(f"the radars are called {quoted(names)}; expected different names")
        self.camera: Any = None
        if file.camera is not None:
            self.camera = self._device("camera", file.camera, "camera", folder, source)
            self.camera.place = self._camera_place
        self.plan: ScanPlan = self._plan()

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> "Lab":
        """The lab of a rig file; files that it names are found beside it.

        Raises
        ------
        FileError, FormatError, InputError
        """
        source = printable(path)
        file = record_from_table(RigFile, read_toml(path, "a rig"), source)
        return cls(file, folder=Path(path).parent, source=source)

    def __enter__(self) -> "Lab":
        try:
            for _, device in self._devices:
                device.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close every device, the arm last."""
        for _, device in reversed(self._devices):
            device.close()

    def photo(self) -> tuple[CameraFrame, ArmPose]:
        """One picture where the arm is now, and the pose of the radar frame there; nothing is moved.

        Arm and camera must be open; the radars need not.

        Raises
        ------
        InputError
            There is no camera.
        DeviceError
            The arm moved meanwhile, or a device failed.
        """
        if self.camera is None:
            raise InputError("the rig has no camera; add a [camera] table to the rig file")
        (position, turned), frame = self._camera_place(), self.camera.shoot()
        there, then = self._camera_place()
        moved = float(np.linalg.norm(there - position))
        angle = float(turn_between_deg(turned, then))
        if moved > _STILL or angle > _STILL_DEG:
            raise DeviceError(
                f"the arm moved by {1000 * moved:.1f} mm and {angle:.1f} degrees while the picture was taken; wait "
                "until it stands, and take it again"
            )
        return frame, ArmPose(position=there, orientation=then)

    def check(self) -> list[Report]:
        """Talk to each device, in the order of the file; none keeps the others from being asked."""
        reports = []
        for name, device in self._devices:
            try:
                device.open()
                reports.append(Report(name, device.check(), None))
            except (InputError, OSError, RuntimeError) as error:
                reports.append(Report(name, [], str(error)))
            finally:
                device.close()
        return reports

    def _device(self, kind: str, table: Mapping[str, Any], place: str, folder: Any, source: str) -> Any:
        name = table.get("driver")
        if not isinstance(name, str):
            raise FormatError(f"{source}: {place}: driver is missing; add one of {', '.join(DRIVERS)}")
        driver = DRIVERS[name]
        if driver.kind != kind:
            raise FormatError(f"{source}: {place}: {name} is a driver of a {driver.kind}; expected one of a {kind}")
        rest = {key: value for key, value in table.items() if key != "driver"}
        hidden = {"folder": str(folder)} if any(f.name == "folder" for f in fields(driver.settings)) else {}
        device = driver.make(record_from_table(driver.settings, rest, source, place, **hidden))
        self._devices.append((f"{getattr(device, 'name', kind)} ({name})", device))
        return device

    def _plan(self) -> ScanPlan:
        file, limits = self.file, self.arm.limits
        rows = file.scan.rows(file.origin)
        for i, row in enumerate(rows):
            for pose, end in zip(row, ("start", "end"), strict=True):
                limits.check(pose, f"the {end} of row {i + 1}")
        photo = None
        if self.camera is not None:
            photo = ArmPose(position=np.add(file.origin, file.photo or (*file.scan.middle, 0.0)))
            limits.check(photo, "photo")
        time = _START + 2 * limits.settle + limits.duration(file.scan.size[1])
        return ScanPlan(rows=rows, row_time=checked_number(time, name="row_time", unit="s"), photo=photo)

    def _camera_place(self) -> tuple[np.ndarray, np.ndarray]:
        """Position and orientation of the radar frame now, in the base frame, for the camera's picture."""
        log = self.arm.log()
        turned = (0.0, 0.0, 0.0, 1.0) if log.orientations is None else log.orientations[-1]
        return log.positions[-1], np.array(turned)
