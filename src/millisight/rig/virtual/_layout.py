"""A world built: every surface and every object in its place, checked to be possible before anything is computed."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from millisight.core import box, rotation_from_euler_deg
from millisight.core.errors import CoverageError, InputError, MillisightError
from millisight.data import LAYERED, Layer, TriangleMesh, VoxelGrid, material_named
from millisight.meshes import ObjectPart, RayCaster, build_parts, mesh_of_table
from millisight.rig.virtual._published import image_grid
from millisight.rig.virtual._shading import ShadedMeshes
from millisight.rig.virtual._world import Carton, World, WorldObject


class PlacedObject(NamedTuple):
    """An object in its place: its number in the world, its name, and its parts; it does not move."""

    number: int
    name: str
    parts: tuple[ObjectPart, ...]

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) [m]"""
        return bounds_of(self.parts)


def place_name(world: World, number: int) -> str:
    """How messages call an object: by its place in the file and its name."""
    return f"objects[{number}] ({world.objects[number].name})"


def bounds_of(parts: tuple[ObjectPart, ...]) -> np.ndarray:
    bounds = np.array([part.mesh.bounds for part in parts])
    return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


def place_object(world: World, number: int) -> PlacedObject:
    item = world.objects[number]
    try:
        parts = _parts(item, world.folder)
    except MillisightError as error:
        raise error.at(place_name(world, number)) from error
    if any(item.rotate_deg):
        parts = _moved(parts, rotation=rotation_from_euler_deg(item.rotate_deg))
    lower, upper = bounds_of(parts)
    middle = (lower + upper) / 2
    at = world.scan.middle if item.at is None else item.at
    top = world.support.height
    height = at[2] if len(at) == 3 else top + (upper[2] - lower[2]) / 2
    shift = np.array([at[0], at[1], height]) - middle
    return PlacedObject(number, item.name, _moved(parts, translation=shift))


def _parts(item: WorldObject, folder: str) -> tuple[ObjectPart, ...]:
    """An object's parts as the catalogue or its file gives them."""
    if item.object is not None:
        parts = build_parts(item.object)
    else:
        mesh = mesh_of_table(Path(folder) / str(item.mesh), unit=item.unit)
        parts = (part_of(item.name, mesh, "metal"),)
    if item.material is None:
        return parts
    return tuple(part_of(part.name, part.mesh, item.material) for part in parts)


def part_of(name: str, mesh: TriangleMesh, material: str) -> ObjectPart:
    return ObjectPart(name=name, mesh=mesh, material=material_named(material))


def _moved(parts: tuple[ObjectPart, ...], **motion: np.ndarray) -> tuple[ObjectPart, ...]:
    return tuple(ObjectPart(name=p.name, mesh=p.mesh.moved(**motion), material=p.material) for p in parts)


FLOOR = -0.95
"""Height of the floor [m], of which the camera has a view and the radars none: absorber lies on it."""

_CLEARANCE = 0.03  # between the aperture and what is looked at [m]
_TOUCH = 1e-3  # bodies may overlap by this much and count as touching [m]
_NUT = 0.012  # thickness of the tripod's nut [m]
_POLE = 0.006  # radius of its pole [m]
_BLOCK = 0.20  # height of the styrofoam block [m]


class LayerPanel(NamedTuple):
    """A flat piece of layers: a corner (3,) and its two sides (3,) [m], the name of the stack, and its layers."""

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    stack: str
    layers: tuple[Layer, ...] = ()

    @property
    def mesh(self) -> TriangleMesh:
        corners = [self.corner, self.corner + self.u, self.corner + self.u + self.v, self.corner + self.v]
        return TriangleMesh(vertices=np.array(corners), faces=np.array([[0, 1, 2], [0, 2, 3]]))


class VisibleSurface(NamedTuple):
    """A mesh as the camera sees it: of which object (-1: none), of which material, and a name."""

    mesh: TriangleMesh
    material: str
    name: str
    object: int


class WorldLayout:
    """What a world looks like.

    Attributes
    ----------
    world : World
    objects : PlacedObject, in the world's order
    background : parts that are not looked at: support and walls
    panels : what hides the objects
    """

    def __init__(
        self,
        world: World,
        objects: tuple[PlacedObject, ...],
        background: tuple[ObjectPart, ...],
        panels: tuple[LayerPanel, ...],
    ):
        self.world: World = world
        self.objects: tuple[PlacedObject, ...] = objects
        self.background: tuple[ObjectPart, ...] = background
        self.panels: tuple[LayerPanel, ...] = panels
        self._view: ShadedMeshes | None = None

    @property
    def parts(self) -> tuple[ObjectPart, ...]:
        """All that the radars see, but for the panels: objects, then background."""
        return (*(part for item in self.objects for part in item.parts), *self.background)

    @property
    def surfaces(self) -> tuple[VisibleSurface, ...]:
        """All that the camera sees, the floor too."""
        own = [VisibleSurface(p.mesh, p.material.name, o.name, o.number) for o in self.objects for p in o.parts]
        behind = [VisibleSurface(part.mesh, part.material.name, "", -1) for part in self.background]
        hiding = [VisibleSurface(panel.mesh, panel.stack, "", -1) for panel in self.panels]
        floor = LayerPanel(np.array([-3.0, -3.0, FLOOR]), np.array([6.0, 0, 0]), np.array([0, 6.0, 0]), "floor")
        return (*own, *behind, *hiding, VisibleSurface(floor.mesh, "floor", "", -1))

    @property
    def view(self) -> ShadedMeshes:
        """`surfaces`, ready to be looked at."""
        if self._view is None:
            self._view = ShadedMeshes([surface.mesh for surface in self.surfaces])
        return self._view

    def uncovered(self) -> "WorldLayout":
        """The same without what hides the objects: the line of sight to them."""
        return self if not self.panels else WorldLayout(self.world, self.objects, self.background, ())


def build_layout(world: World) -> WorldLayout:
    """The world's layout.

    Raises
    ------
    InputError
        Things do not fit each other: an object through its support, through another, out of the image grid, through
        the carton or the radars' plane; the message names it.
    CoverageError
        The aperture does not cover an object.
    MeshError, FileError
        A mesh file cannot be used.
    """
    objects = tuple(place_object(world, i) for i in range(len(world.objects)))
    background = (*_support_parts(world), *_walls(world))
    _check_places(world, objects)
    _check_crossings(objects, world)
    panels = _carton_panels(world, objects)
    _check_panels(objects, panels)
    panels += _cloth_panels(world, objects, panels)
    _check_clearance(background, panels)
    return WorldLayout(world, objects, background, panels)


def block(lower: np.ndarray, upper: np.ndarray) -> TriangleMesh:
    """A cuboid from `lower` (3,) to `upper` (3,) [m]."""
    corners = np.array([[(lower, upper)[b][i] for i, b in enumerate(bits)] for bits in np.ndindex(2, 2, 2)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return TriangleMesh(vertices=corners, faces=np.array(faces))


def _support_parts(world: World) -> tuple[ObjectPart, ...]:
    """The nut on its pole, or the block."""
    support = world.support
    places = np.array([item.at[:2] if item.at else world.scan.middle for item in world.objects] or [world.scan.middle])
    x, y = (places.min(axis=0) + places.max(axis=0)) / 2 if support.at is None else support.at
    sx, sy = np.divide(support.size or (0.0, 0.0), 2)
    top = support.height
    if support.kind == "styrofoam":
        mesh = block(np.array([x - sx, y - sy, top - _BLOCK]), np.array([x + sx, y + sy, top]))
        return (part_of("styrofoam", mesh, "styrofoam"),)
    nut = block(np.array([x - sx, y - sy, top - _NUT]), np.array([x + sx, y + sy, top]))
    return tuple(part_of("tripod", mesh, "plastic") for mesh in (nut, _pole(np.array([x, y]), top - _NUT)))


def _pole(at: np.ndarray, top: float) -> TriangleMesh:
    """An upright bar of six sides from under the nut down to the floor."""
    turn = np.radians(60 * np.arange(6))
    ring = at + _POLE * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    corners = np.concatenate([np.column_stack([ring, np.full(6, height)]) for height in (FLOOR, top)])
    sides = [face for i in range(6) for j in [(i + 1) % 6] for face in ((i, j, j + 6), (i, j + 6, i + 6))]
    ends = [face for i in range(1, 5) for face in ((0, i + 1, i), (6, i + 6, i + 7))]
    return TriangleMesh(vertices=corners, faces=np.array(sides + ends))


def _walls(world: World) -> tuple[ObjectPart, ...]:
    return tuple(part_of("wall", block(np.array(w.lower), np.array(w.upper)), w.material) for w in world.walls)


def _carton_panels(world: World, objects: tuple[PlacedObject, ...]) -> tuple[LayerPanel, ...]:
    """Four walls around all objects, down to the support's face, and a lid."""
    carton = world.carton
    if carton is None:
        return ()
    turn = rotation_from_euler_deg((0.0, 0.0, carton.turn_deg))  # from the carton's axes to the world's
    if objects:
        bounds = np.array([bounds_of(_moved(item.parts, rotation=turn.T)) for item in objects])
        lower = bounds[:, 0].min(axis=0) - carton.clearance
        upper = bounds[:, 1].max(axis=0) + carton.clearance
    elif carton.size is None:
        raise InputError("carton: there is no object to put it around; add one, state its size, or leave it out")
    else:
        lower = upper = turn.T @ np.append(world.scan.middle, world.support.height)
    middle = (lower + upper) / 2
    if carton.at is not None:
        middle[:2] = turn[:2, :2].T @ carton.at
    extent = upper - lower
    lower, upper = middle - extent / 2, middle + extent / 2
    lower[2] = world.support.height
    if carton.size is not None:
        size = np.array(carton.size)
        lower[:2], upper[:2] = middle[:2] - size[:2] / 2, middle[:2] + size[:2] / 2
        upper[2] = lower[2] + size[2]
    else:
        upper[2] += (
            np.tan(np.radians(np.abs(carton.tilt_deg))) @ (upper - lower)[:2] / 2
        )  # of the middle, so that no corner is too low
    return tuple(
        panel._replace(corner=turn @ panel.corner, u=turn @ panel.u, v=turn @ panel.v)
        for panel in _box_panels(lower, upper, carton)
    )


def _box_panels(lower: np.ndarray, upper: np.ndarray, carton: Carton) -> tuple[LayerPanel, ...]:
    """Four walls, and the lid if there is one, along the carton's own axes."""
    x, y, z = np.diag(upper - lower)
    # Fronts outward.
    sides = [(lower, z, y), (lower + x, y, z), (lower, x, z), (lower + y, z, x)]
    if carton.lid:
        turn = rotation_from_euler_deg((carton.tilt_deg[1], -carton.tilt_deg[0], 0.0))
        u, v = turn @ x, turn @ y
        sides.append((lower + z + (x + y - u - v) / 2, u, v))
    return tuple(LayerPanel(corner, u, v, carton.stack, carton.layers) for corner, u, v in sides)


def _cloth_panels(
    world: World, objects: tuple[PlacedObject, ...], below: tuple[LayerPanel, ...]
) -> tuple[LayerPanel, ...]:
    """Level sheets over the carton, or over the objects."""
    cloth = world.cloth
    if cloth is None:
        return ()
    if not objects:
        raise InputError("cloth: there is no object to put it over; add one, or leave the cloth out")
    covered = [*(item.bounds for item in objects), *(panel.mesh.bounds for panel in below)]
    lower = np.min([bounds[0] for bounds in covered], axis=0) - cloth.overhang
    upper = np.max([bounds[1] for bounds in covered], axis=0) + cloth.overhang
    top = upper[2] - cloth.overhang
    x, y = np.diag(upper - lower)[:2]
    heights = top + cloth.gap * (1 + np.arange(cloth.layers))
    layers = LAYERED[cloth.stack]
    return tuple(LayerPanel(np.array([*lower[:2], height]), x, y, cloth.stack, layers) for height in heights)


def _check_places(world: World, objects: tuple[PlacedObject, ...]) -> None:
    """Every object on its support, below the radars, under the aperture, and within the image grids."""
    scan = world.scan
    for item in objects:
        name, (lower, upper) = place_name(world, item.number), item.bounds
        top = world.support.height
        if lower[2] < top - _TOUCH:
            raise InputError(
                f"{name} reaches {1000 * (top - lower[2]):.0f} mm through the {world.support.kind}'s upper face at "
                f"z = {top:g} m; give `at` two numbers to stand it there, or raise it to z = "
                f"{top + (upper[2] - lower[2]) / 2:.3f} m"
            )
        if upper[2] > -_CLEARANCE:
            raise InputError(
                f"{name} reaches up to z = {upper[2]:.3f} m; the radars move at z = 0 and need {_CLEARANCE:g} m above "
                "everything: lower it, lay it down with rotate_deg, or lower support.top"
            )
        extent = upper[:2] - lower[:2]
        for axis, wide, size in zip("xy", extent, scan.size, strict=True):
            if wide > size:
                raise CoverageError(
                    f"{name} is {wide * 100:.1f} cm wide along {axis}, the aperture only {size * 100:.1f} cm; enlarge "
                    "scan.size, or rotate it with rotate_deg"
                )
        first, last = np.array(scan.corner), np.add(scan.corner, scan.size)
        if (lower[:2] < first - _TOUCH).any() or (upper[:2] > last + _TOUCH).any():
            raise CoverageError(
                f"{name} lies at x {lower[0]:.3f} to {upper[0]:.3f}, y {lower[1]:.3f} to {upper[1]:.3f} m, the "
                f"aperture at x {first[0]:.3f} to {last[0]:.3f}, y {first[1]:.3f} to {last[1]:.3f} m; move one of them"
            )
        for radar in world.radars:
            _check_grid(name, item.bounds, image_grid(world, radar.name), radar.name)


def _check_grid(name: str, bounds: np.ndarray, grid: VoxelGrid, folder: str) -> None:
    lower, upper = grid.bounds
    if (bounds[0] < lower - 0.01 - _TOUCH).any() or (bounds[1] > upper + 0.01 + _TOUCH).any():
        raise InputError(
            f"{name} fills {box(*bounds)}; the published image grid of {folder} over this support is "
            f"{box(lower, upper)}: move it, or choose another support"
        )


def _check_crossings(objects: tuple[PlacedObject, ...], world: World) -> None:
    """No object through another, nor through a wall."""
    walls = [(f"walls[{i}]", (wall,)) for i, wall in enumerate(_walls(world))]
    others = [*((place_name(world, item.number), item.parts) for item in objects), *walls]
    for i, item in enumerate(objects):
        for other, parts in others[i + 1 :]:
            if _overlap(item.parts, parts):
                raise InputError(f"{place_name(world, item.number)} and {other} intersect; move one")


def _overlap(one: tuple[ObjectPart, ...], other: tuple[ObjectPart, ...]) -> bool:
    """Whether two bodies share more than `_TOUCH`: one's edges through the other's faces, or one inside the other."""
    (a, b), (c, d) = bounds_of(one), bounds_of(other)
    if (np.minimum(b, d) - np.maximum(a, c) < _TOUCH).any():
        return False
    return any(_pierces(x, y, closed=True) for x, y in ((one, other), (other, one)))


def _pierces(one: tuple[ObjectPart, ...], other: tuple[ObjectPart, ...], *, closed: bool) -> bool:
    """Whether edges of `one`, less `_TOUCH` all around, meet faces of `other`, or lie inside it where it is closed."""
    lower, upper = bounds_of(one)
    nearest, farthest = bounds_of(other)
    if (upper < nearest).any() or (farthest < lower).any():
        return False
    middle = (lower + upper) / 2
    shrink = 1 - 2 * _TOUCH / np.maximum(upper - lower, 4 * _TOUCH)
    caster = RayCaster.of([part.mesh for part in other])
    for part in one:
        vertices = middle + shrink * (part.mesh.vertices - middle)
        starts, stops = vertices[part.mesh.edges].transpose(1, 0, 2)
        if caster.crosses(starts, stops).any() or (closed and _inside(vertices[:1], other, caster)):
            return True
    return False


def _inside(point: np.ndarray, body: tuple[ObjectPart, ...], caster: RayCaster) -> bool:
    """Whether a point (1, 3) lies inside a closed body: a ray from there first meets a face from behind."""
    skew = np.array([[0.0123, 0.0456, 0.9989]])  # along no edge of a mesh that was drawn
    skew /= np.linalg.norm(skew)
    (face,), _ = caster.first(point, skew)
    normals = np.concatenate([part.mesh.face_normals for part in body])
    return bool(face >= 0 and normals[face] @ skew[0] > 0)


def _check_panels(objects: tuple[PlacedObject, ...], panels: tuple[LayerPanel, ...]) -> None:
    """No panel through an object."""
    for item in objects:
        for panel in panels:
            sheet = (part_of("panel", panel.mesh, "cardboard"),)
            if any(_pierces(x, y, closed=False) for x, y in ((item.parts, sheet), (sheet, item.parts))):
                raise InputError(
                    f"the carton cuts through objects[{item.number}] ({item.name}); enlarge carton.size, or leave it "
                    "out to get one that fits"
                )


def _check_clearance(background: tuple[ObjectPart, ...], panels: tuple[LayerPanel, ...]) -> None:
    """Support, walls, carton and cloth below the radars."""
    named = [*(("support or wall", part.mesh) for part in background)]
    named += [(f"the {panel.stack} over the objects", panel.mesh) for panel in panels]
    for name, mesh in named:
        if mesh.bounds[1, 2] > -_CLEARANCE:
            raise InputError(
                f"{name} reaches up to z = {mesh.bounds[1, 2]:.3f} m; the radars move at z = 0 and need "
                f"{_CLEARANCE:g} m above everything: lower it"
            )
