"""The virtual camera: pictures with depth by ray casting, and exact masks of what they show.

A pinhole camera with a stereo pair behind it, as the published one: depth has the pair's noise, and holes where the
pair cannot match: on shiny metal, on what is clear, and where one of the two eyes does not see.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from millisight.core.errors import InputError
from millisight.data import CameraFrame, CameraMask, Intrinsics, Mask, PixelGrid
from millisight.meshes import RayCaster
from millisight.rig.virtual._appearance import CLEAR, SHINY, appearance_of
from millisight.rig.virtual._layout import WorldLayout
from millisight.rig.virtual._published import BASE_ORIGIN
from millisight.rig.virtual._settings import CameraSettings

_BASELINE = 0.055  # between the two eyes of a RealSense D415 [m]
_SUBPIXEL = 0.08  # rms error of a match [pixels]
_DEPTH_UNIT = 0.001  # [m]
_LIGHT = np.array([0.35, -0.45, 0.82]) / np.linalg.norm([0.35, -0.45, 0.82])
_FILL = np.array([-0.5, 0.3, 0.81]) / np.linalg.norm([-0.5, 0.3, 0.81])
_BLOTCH = 2.5  # size of a hole [pixels]


class RenderedView(NamedTuple):
    """What the pixels' rays meet, row after row: hits, points [m], normals towards the camera, directions."""

    mesh: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    directions: np.ndarray
    distance: np.ndarray


class VirtualCamera:
    """The camera of a virtual rig: a `Camera`; `where()` is the radar frame's true place now (3,) [m], in the base."""

    def __init__(
        self, settings: CameraSettings, layout: WorldLayout, where: Callable[[], np.ndarray], rng: np.random.Generator
    ):
        self._settings, self._layout, self._where, self._rng = settings, layout, where, rng
        self._pose: np.ndarray | None = None

    def shoot(self) -> CameraFrame:
        self._pose = self._settings.pose(self._where() - BASE_ORIGIN)
        (rng,) = self._rng.spawn(1)
        return render(self._layout, self._pose, self._settings, rng)

    @property
    def pose(self) -> np.ndarray:
        """(4, 4) camera frame to radar frame, where it took its last picture."""
        if self._pose is None:
            raise InputError("the camera has taken no picture; call shoot first")
        return self._pose


_FARTHEST = np.iinfo(np.uint16).max  # depth in units, as a camera's file holds it


def render(layout: WorldLayout, pose: np.ndarray, settings: CameraSettings, rng: np.random.Generator) -> CameraFrame:
    """The frame of a camera with the `pose` (4, 4) in the radar frame; the frame's own pose is in the base frame."""
    intrinsics = Intrinsics.published()
    shape = (intrinsics.height, intrinsics.width)
    view = _view(layout, pose, intrinsics)
    # A second ray a pixel softens the edges of the picture.
    rgb = (_shade(layout, view) + _shade(layout, _view(layout, pose, intrinsics, 0.5))) / 2
    depth = view.distance * (view.directions @ pose[:3, 2])
    depth = np.where(np.isfinite(depth), depth, 0.0)
    if settings.depth_noise:
        sigma = settings.depth_noise * _SUBPIXEL * depth**2 / (intrinsics.fx * _BASELINE)
        depth += sigma * rng.standard_normal(len(depth))
    if settings.holes:
        depth[_holes(layout, view, pose, shape, rng)] = 0.0
    units = np.rint(depth.reshape(shape) / _DEPTH_UNIT)
    noisy = rgb.reshape(*shape, 3) * 255 + 1.5 * rng.standard_normal((*shape, 3))
    base = pose.copy()
    base[:3, 3] += BASE_ORIGIN
    return CameraFrame(
        rgb=np.clip(np.rint(noisy), 0, 255).astype(np.uint8),
        depth=np.where((units >= 0) & (units <= _FARTHEST), units, 0).astype(np.uint16),  # beyond, none is known
        pose=base,
        intrinsics=intrinsics,
        depth_unit=_DEPTH_UNIT,
        metadata={"virtual": True},
    )


def object_pixels(layout: WorldLayout, pose: np.ndarray, number: int | None = None) -> np.ndarray:
    """(480, 640) bool: the pixels on which object `number` would be seen if nothing else were there (amodal).

    None: any of the objects.
    """
    intrinsics = Intrinsics.published()
    directions = _directions(pose, intrinsics)
    seen = _meets_objects(layout, number, pose[:3, 3], directions)
    return seen.reshape(intrinsics.height, intrinsics.width)


def visible_pixels(layout: WorldLayout, pose: np.ndarray, number: int | None = None) -> np.ndarray:
    """(480, 640) bool: the pixels on which object `number`, or any with None, is what is seen."""
    intrinsics = Intrinsics.published()
    mesh = layout.view.first(pose[:3, 3], _directions(pose, intrinsics))[0]
    owner = np.array([*(surface.object for surface in layout.surfaces), -1])[mesh]
    seen = owner >= 0 if number is None else owner == number
    return seen.reshape(intrinsics.height, intrinsics.width)


def footprint(layout: WorldLayout, pixels: PixelGrid, number: int | None = None) -> Mask:
    """The pixels of a radar image, seen along z, over which object `number` (None: any) lies."""
    x, y = (axis.ravel() for axis in np.meshgrid(pixels.x, pixels.y, indexing="ij"))
    rays = np.stack([x, y, np.full(len(x), 1.0)], axis=1)
    down = np.broadcast_to([0.0, 0.0, -1.0], rays.shape)
    return Mask(grid_xy=pixels, inside=_meets_objects(layout, number, rays, down).reshape(pixels.shape))


def _meets_objects(layout: WorldLayout, number: int | None, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) bool: whether rays meet object `number`, or any with None, were nothing else there."""
    meshes = [part.mesh for item in layout.objects if number in (None, item.number) for part in item.parts]
    if not meshes:
        return np.zeros(len(directions), dtype=bool)
    return RayCaster.of(meshes).first(origins, directions)[0] >= 0


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


def _view(layout: WorldLayout, pose: np.ndarray, intrinsics: Intrinsics, shift: float = 0.0) -> RenderedView:
    directions = _directions(pose, intrinsics, shift)
    mesh, face, distance = layout.view.first(pose[:3, 3], directions)
    reached = np.where(np.isfinite(distance), distance, 0.0)
    points = pose[:3, 3] + reached[:, None] * directions
    normals = layout.view.normals(face, points)
    away = np.einsum("ni,ni->n", normals, directions) > 0
    return RenderedView(mesh, points, np.where(away[:, None], -normals, normals), directions, distance)


def _shade(layout: WorldLayout, view: RenderedView) -> np.ndarray:
    """(n, 3) colours from 0 to 1: a lamp with shadows and a glint, a weaker one, and light from everywhere."""
    appearances = [appearance_of(surface.material, surface.name) for surface in layout.surfaces]
    colours = np.array([*(one.colour for one in appearances), (0.0, 0.0, 0.0)])
    gloss = np.array([*(one.gloss for one in appearances), 0.0])
    lamp = np.clip(view.normals @ _LIGHT, 0.0, None)
    lit = np.flatnonzero(lamp > 0)
    starts = view.points[lit] + 1e-4 * view.normals[lit]
    lamp[lit[layout.view.first(starts, np.broadcast_to(_LIGHT, starts.shape))[0] >= 0]] = 0.0
    facing = np.clip(-np.einsum("ni,ni->n", view.normals, view.directions), 0.0, 1.0)
    halfway = _LIGHT - view.directions
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    glint = np.clip(np.einsum("ni,ni->n", view.normals, halfway), 0.0, 1.0) ** 60 * (lamp > 0)
    fill = np.clip(view.normals @ _FILL, 0.0, None)
    brightness = 0.25 + 0.15 * facing + 0.15 * fill + 0.55 * lamp
    return np.clip(colours[view.mesh] * brightness[:, None] + (gloss[view.mesh] * glint)[:, None], 0.0, 1.0)


def _holes(
    layout: WorldLayout, view: RenderedView, pose: np.ndarray, shape: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """(n,) bool: no depth. Whether a pixel is one is drawn in blotches, by chances that depend on the surface."""
    from scipy.ndimage import gaussian_filter
    from scipy.special import ndtr

    kinds = np.array([*(appearance_of(surface.material, surface.name).kind for surface in layout.surfaces), ""])[
        view.mesh
    ]
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
    covered[hit] = layout.view.caster.crosses(starts, np.broadcast_to(second, starts.shape))
    return drawn | covered | (view.mesh < 0)
