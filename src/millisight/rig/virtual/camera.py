"""The virtual camera: pictures with depth by ray casting, and exact masks of what they show.

A pinhole camera with a stereo pair behind it, as the published one: depth has the pair's noise, and holes where the
pair cannot match: on shiny metal, on what is clear, and where one of the two eyes does not see.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from millisight.capture.camera import CameraFrame, CameraMask, Intrinsics
from millisight.errors import InputError
from millisight.geometry import rotation_from_euler_deg
from millisight.imaging.grid import PixelGrid
from millisight.io.mito_setup import BASE_ORIGIN
from millisight.perception.segmentation import Mask
from millisight.records import checked_number, checked_numbers, checked_record, put, record
from millisight.rig.virtual.casting import Caster
from millisight.rig.virtual.looks import CLEAR, SHINY, look_of

if TYPE_CHECKING:
    from millisight.rig.virtual.stage import Stage

# Camera axes in the radar frame when it looks straight down: x right, y towards -y, z down.
_DOWN = np.diag([1.0, -1.0, -1.0])
_BASELINE = 0.055  # between the two eyes of a RealSense D415 [m]
_SUBPIXEL = 0.08  # rms error of a match [pixels]
_DEPTH_UNIT = 0.001  # [m]
_LIGHT = np.array([0.35, -0.45, 0.82]) / np.linalg.norm([0.35, -0.45, 0.82])
_FILL = np.array([-0.5, 0.3, 0.81]) / np.linalg.norm([-0.5, 0.3, 0.81])
_BLOTCH = 2.5  # size of a hole [pixels]


@record
class CameraSettings:
    """Where the camera is.

    Attributes
    ----------
    at : where the arm holds the radar frame for the picture [m]; None: so that the camera looks at the aperture's
        middle from 10 cm above it
    offset : hand-eye: the camera in the radar frame [m]
    tilt_deg : hand-eye: how far it is turned from looking straight down [degrees]
    depth_noise : of the stereo pair's own, 1 as of a RealSense D415, 0 for none
    holes : whether depth is missing on shiny and clear surfaces, and where one eye is covered
    """

    at: tuple[float, float, float] | None = None
    offset: tuple[float, float, float] = (0.0, 0.07, 0.02)
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depth_noise: float = 1.0
    holes: bool = True

    def __post_init__(self) -> None:
        put(
            self,
            at=None if self.at is None else checked_numbers(self.at, name="at", count=3, unit="m"),
            offset=checked_numbers(self.offset, name="offset", count=3, unit="m"),
            tilt_deg=checked_numbers(self.tilt_deg, name="tilt_deg", count=3, unit="deg"),
            depth_noise=checked_number(self.depth_noise, name="depth_noise", minimum=0),
            holes=checked_record(self.holes, bool, name="holes"),
        )

    def pose(self, radar_frame: np.ndarray) -> np.ndarray:
        """(4, 4) camera frame to radar frame of the world, with the arm at `radar_frame` (3,) [m]."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_euler_deg(self.tilt_deg) @ _DOWN
        pose[:3, 3] = np.add(radar_frame, self.offset)
        return pose


class View(NamedTuple):
    """What the pixels' rays meet, row after row: hits, points [m], normals towards the camera, directions."""

    mesh: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    directions: np.ndarray
    distance: np.ndarray


class VirtualCamera:
    """The camera of a virtual rig: a `Camera`.

    Parameters
    ----------
    settings : CameraSettings
    stage : what it looks at
    where : (3,) the radar frame's true place now [m], in the base frame
    rng : draws noise and holes
    """

    def __init__(
        self, settings: CameraSettings, stage: "Stage", where: Callable[[], np.ndarray], rng: np.random.Generator
    ):
        self._settings, self._stage, self._where, self._rng = settings, stage, where, rng
        self._pose: np.ndarray | None = None

    def shoot(self) -> CameraFrame:
        self._pose = self._settings.pose(self._where() - BASE_ORIGIN)
        (rng,) = self._rng.spawn(1)
        return render(self._stage, self._pose, self._settings, rng)

    @property
    def pose(self) -> np.ndarray:
        """(4, 4) camera frame to radar frame, where it took its last picture."""
        if self._pose is None:
            raise InputError("the camera has taken no picture; call shoot first")
        return self._pose


def render(stage: "Stage", pose: np.ndarray, settings: CameraSettings, rng: np.random.Generator) -> CameraFrame:
    """The frame of a camera with the `pose` (4, 4) in the radar frame; the frame's own pose is in the base frame."""
    intrinsics = Intrinsics.published()
    shape = (intrinsics.height, intrinsics.width)
    view = _look(stage, pose, intrinsics)
    # A second ray a pixel softens the edges of the picture.
    rgb = (_shade(stage, view) + _shade(stage, _look(stage, pose, intrinsics, 0.5))) / 2
    depth = view.distance * (view.directions @ pose[:3, 2])
    depth = np.where(np.isfinite(depth), depth, 0.0)
    if settings.depth_noise:
        sigma = settings.depth_noise * _SUBPIXEL * depth**2 / (intrinsics.fx * _BASELINE)
        depth += sigma * rng.standard_normal(len(depth))
    if settings.holes:
        depth[_holes(stage, view, pose, shape, rng)] = 0.0
    noisy = rgb.reshape(*shape, 3) * 255 + 1.5 * rng.standard_normal((*shape, 3))
    base = pose.copy()
    base[:3, 3] += BASE_ORIGIN
    return CameraFrame(
        rgb=np.clip(np.rint(noisy), 0, 255).astype(np.uint8),
        depth=np.rint(depth.reshape(shape) / _DEPTH_UNIT).astype(np.uint16),
        pose=base,
        intrinsics=intrinsics,
        depth_unit=_DEPTH_UNIT,
        metadata={"virtual": True},
    )


def object_pixels(stage: "Stage", pose: np.ndarray, number: int | None = None) -> np.ndarray:
    """(480, 640) bool: the pixels on which object `number` would be seen if nothing else were there (amodal).

    None: any of the objects.
    """
    intrinsics = Intrinsics.published()
    directions = _directions(pose, intrinsics)
    seen = _meets_objects(stage, number, pose[:3, 3], directions)
    return seen.reshape(intrinsics.height, intrinsics.width)


def visible_pixels(stage: "Stage", pose: np.ndarray, number: int | None = None) -> np.ndarray:
    """(480, 640) bool: the pixels on which object `number`, or any with None, is what is seen."""
    intrinsics = Intrinsics.published()
    view = stage.caster.first(pose[:3, 3], _directions(pose, intrinsics))
    owners = np.array([*(surface.object for surface in stage.surfaces), -1])
    seen = owners[view.mesh] >= 0 if number is None else owners[view.mesh] == number
    return seen.reshape(intrinsics.height, intrinsics.width)


def footprint(stage: "Stage", pixels: PixelGrid, number: int | None = None) -> Mask:
    """The pixels of a radar image, seen along z, over which object `number` (None: any) lies."""
    x, y = (axis.ravel() for axis in np.meshgrid(pixels.x, pixels.y, indexing="ij"))
    rays = np.stack([x, y, np.full(len(x), 1.0)], axis=1)
    down = np.broadcast_to([0.0, 0.0, -1.0], rays.shape)
    return Mask(grid_xy=pixels, inside=_meets_objects(stage, number, rays, down).reshape(pixels.shape))


def _meets_objects(stage: "Stage", number: int | None, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) bool: whether rays meet object `number`, or any with None, were nothing else there."""
    meshes = [part.mesh for thing in stage.objects if number in (None, thing.number) for part in thing.parts]
    if not meshes:
        return np.zeros(len(directions), dtype=bool)
    return Caster(meshes).first(origins, directions).mesh >= 0


def camera_mask(frame: CameraFrame, pixels: np.ndarray) -> CameraMask:
    """The mask as published: the pixels, and depth and points where there are any within it."""
    depth = np.where(pixels, frame.depth, 0).astype(frame.depth.dtype)
    return CameraMask(
        pixels=pixels,
        depth=depth,
        points=np.where(pixels[..., None], frame.points, np.nan),
        pose=frame.pose,
        depth_unit=frame.depth_unit,
    )


def _directions(pose: np.ndarray, intrinsics: Intrinsics, shift: float = 0.0) -> np.ndarray:
    """(H W, 3) unit vectors through the pixels' centres, or `shift` pixels right of and below them."""
    columns = (np.arange(intrinsics.width) + shift - intrinsics.cx) / intrinsics.fx
    rows = (np.arange(intrinsics.height) + shift - intrinsics.cy) / intrinsics.fy
    columns, rows = (axis.ravel() for axis in np.meshgrid(columns, rows))
    lengths = np.sqrt(columns**2 + rows**2 + 1)
    return np.stack([columns / lengths, rows / lengths, 1 / lengths], axis=1) @ pose[:3, :3].T


def _look(stage: "Stage", pose: np.ndarray, intrinsics: Intrinsics, shift: float = 0.0) -> View:
    directions = _directions(pose, intrinsics, shift)
    hits = stage.caster.first(pose[:3, 3], directions)
    reached = np.where(np.isfinite(hits.distance), hits.distance, 0.0)
    points = pose[:3, 3] + reached[:, None] * directions
    normals = stage.caster.normals(hits, points)
    away = np.einsum("ni,ni->n", normals, directions) > 0
    return View(hits.mesh, points, np.where(away[:, None], -normals, normals), directions, hits.distance)


def _shade(stage: "Stage", view: View) -> np.ndarray:
    """(n, 3) colours from 0 to 1: a lamp with shadows and a glint, a weaker one, and light from everywhere."""
    looks = [look_of(surface.material, surface.name) for surface in stage.surfaces]
    colours = np.array([*(look.colour for look in looks), (0.0, 0.0, 0.0)])
    gloss = np.array([*(look.gloss for look in looks), 0.0])
    lamp = np.clip(view.normals @ _LIGHT, 0.0, None)
    lit = np.flatnonzero(lamp > 0)
    starts = view.points[lit] + 1e-4 * view.normals[lit]
    lamp[lit[stage.caster.first(starts, np.broadcast_to(_LIGHT, starts.shape)).mesh >= 0]] = 0.0
    facing = np.clip(-np.einsum("ni,ni->n", view.normals, view.directions), 0.0, 1.0)
    halfway = _LIGHT - view.directions
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    glint = np.clip(np.einsum("ni,ni->n", view.normals, halfway), 0.0, 1.0) ** 60 * (lamp > 0)
    fill = np.clip(view.normals @ _FILL, 0.0, None)
    brightness = 0.25 + 0.15 * facing + 0.15 * fill + 0.55 * lamp
    return np.clip(colours[view.mesh] * brightness[:, None] + (gloss[view.mesh] * glint)[:, None], 0.0, 1.0)


def _holes(
    stage: "Stage", view: View, pose: np.ndarray, shape: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """(n,) bool: no depth. Whether a pixel is one is drawn in blotches, by chances that depend on the surface."""
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtr

    kinds = np.array([*(look_of(surface.material, surface.name).kind for surface in stage.surfaces), ""])[view.mesh]
    facing = np.clip(-np.einsum("ni,ni->n", view.normals, view.directions), 0.0, 1.0)
    # The pair's own lamp blinds it where metal throws it straight back; at grazing angles nothing comes back.
    chance = np.where(facing < 0.15, 0.5, 0.0)
    metal = np.where(facing > 0.985, 0.75, np.where(facing < 0.4, 0.6, 0.05))
    chance = np.where(kinds == SHINY, metal, np.where(kinds == CLEAR, 0.85, chance))
    field = gaussian_filter(rng.standard_normal(shape), _BLOTCH).ravel()
    drawn = ndtr(field / field.std()) < chance
    # What the second eye does not see has no match.
    second = pose[:3, 3] + _BASELINE * pose[:3, 0]
    covered = np.zeros(len(drawn), dtype=bool)
    hit = np.flatnonzero(view.mesh >= 0)
    starts = view.points[hit] + 5e-4 * view.normals[hit]
    covered[hit] = stage.caster.crosses(starts, np.broadcast_to(second, starts.shape))
    return drawn | covered | (view.mesh < 0)
