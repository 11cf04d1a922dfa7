"""Solids from a few numbers: the drawing tools with which the catalogue's objects are made.

Everything here is in millimetres, as on a workshop drawing; `mesh_of` turns the finished solid into metres.
Plan views are manifold3d cross sections in the x-y plane, solids are manifold3d manifolds: closed and
outward-wound by construction, through every union and cut. manifold3d is imported when a solid is first made.

Round parts turn by 9° a facet or less, oval ones by 15°: below the 20° at which an edge counts as sharp (the
paper's Eq. 7), so that tessellation makes no edges that the real object does not have. The rims of thin sheet
are coarser: to the radar they are edges.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from millisight.core.errors import InputError, MeshError
from millisight.data import TriangleMesh

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

Triple = tuple[float, float, float]

CHORD = 2.0  # longest side of a facet across a curve [mm]: about half a wavelength at 77 GHz
FEWEST = 40  # sides of the smallest circle: 9° a side
FLAT = (0.0, 0.0, 1.0)  # the normal of the table: a rod bent within the page
UPRIGHT = (0.0, 1.0, 0.0)  # a rod bent up from it, in the x-z plane
MOST_STRETCH = 0.10  # a drawing further from its declared size than this is a mistake, not a rounding


def log_uniform(rng: np.random.Generator, lowest: float, highest: float) -> float:
    """A number between two, evenly drawn in its logarithm."""
    return float(np.exp(rng.uniform(np.log(lowest), np.log(highest))))


def sides(radius: float) -> int:
    """How many sides a circle of this radius [mm] gets, a multiple of four."""
    return max(FEWEST, 4 * int(np.ceil(2 * np.pi * radius / CHORD / 4)))


# ---- curves ------------------------------------------------------------------------------------------------


def curve(points: ArrayLike, *, closed: bool = False, step: float = CHORD, along: int = 3) -> np.ndarray:
    """A smooth curve through (K, D) points, sampled every `step` mm: (N, D).

    Cubic Hermite pieces, their tangents from the neighbours, weighted by distance (Catmull-Rom). Columns from
    `along` on ride with the curve without counting for its length: a radius, say.
    """
    knots = np.asarray(points, dtype=float)
    if closed:
        knots = np.concatenate([knots[-1:], knots, knots[:2]])
    else:
        knots = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    gaps = np.linalg.norm(np.diff(knots[:, :along], axis=0), axis=1)[:, None]
    slopes = np.diff(knots, axis=0) / gaps
    tangents = (slopes[:-1] * gaps[1:] + slopes[1:] * gaps[:-1]) / (gaps[:-1] + gaps[1:])
    pieces = []
    for a, b, ta, tb, (gap,) in zip(knots[1:-2], knots[2:-1], tangents[:-1], tangents[1:], gaps[1:-1], strict=True):
        u = np.linspace(0, 1, int(np.ceil(gap / step)) + 1)[:-1, None]
        pieces.append(
            a * (1 + 2 * u) * (1 - u) ** 2
            + b * u**2 * (3 - 2 * u)
            + gap * (ta * u * (1 - u) ** 2 + tb * u**2 * (u - 1))
        )
    return np.concatenate(pieces if closed else [*pieces, knots[-2:-1]])


def ellipse(
    along: float, across: float, *, at: tuple[float, float] = (0, 0), exponent: float = 2.0, count: int = 80
) -> np.ndarray:
    """(count, 2) points around an ellipse of these half axes; nearly a rectangle with an exponent of 4."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.asarray(at) + (along, across) * (np.sign(around) * np.abs(around) ** (2 / exponent))


# ---- plan views --------------------------------------------------------------------------------------------


def ring(count: int, radius: float = 1.0) -> np.ndarray:
    """(count, 2) points evenly on a circle about the origin, the first at +x."""
    turn = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


def outline(points: ArrayLike) -> "CrossSection":
    """The area inside a polygon of (K, 2) points, in either order."""
    from manifold3d import CrossSection, FillRule

    return CrossSection([np.asarray(points, dtype=float)], FillRule.NonZero)


def smooth_outline(points: ArrayLike) -> "CrossSection":
    """The area inside a smooth closed curve through (K, 2) points; points are kept where the curve bends."""
    return outline(curve(points, closed=True, step=0.4, along=2)).simplify(0.01)


def disc(radius: float, at: tuple[float, float] = (0, 0)) -> "CrossSection":
    """A disc around a point."""
    from manifold3d import CrossSection

    return CrossSection.circle(radius, sides(radius)).translate(at)


def strip(points: ArrayLike, widths: ArrayLike) -> "CrossSection":
    """A strip along a polyline of (K, 2) points, with round ends; `widths`: one, or one a point."""
    from manifold3d import CrossSection, OpType

    points = np.asarray(points, dtype=float)
    discs = [disc(w / 2, p) for p, w in zip(points, np.broadcast_to(widths, len(points)), strict=True)]
    pieces = [CrossSection.batch_hull(pair) for pair in pairwise(discs)]
    return CrossSection.batch_boolean(pieces, OpType.Add)


def fillet(area: "CrossSection", radius: float) -> "CrossSection":
    """The area with its corners, outer and inner, rounded to `radius`; parts thinner than twice that go."""
    from manifold3d import JoinType

    for offset in (-radius, 2 * radius, -radius):
        area = area.offset(offset, JoinType.Round, 2.0, FEWEST)
    return area.simplify(0.005)


# ---- solids ------------------------------------------------------------------------------------------------


def plate(area: "CrossSection", thickness: float, *, z: float = 0.0) -> "Manifold":
    """The area, made `thickness` thick about height `z`."""
    return area.extrude(thickness).translate((0, 0, z - thickness / 2))


def block(size: Triple, *, at: Triple = (0, 0, 0)) -> "Manifold":
    """A box with crisp edges around a point."""
    from manifold3d import Manifold

    return Manifold.cube(size, True).translate(at)


def rounded_block(size: Triple, radius: float, *, at: Triple = (0, 0, 0)) -> "Manifold":
    """A box around a point, its edges and corners rounded to `radius`."""
    from manifold3d import Manifold

    half = np.asarray(size, dtype=float) / 2 - radius
    corner = Manifold.sphere(radius, sides(radius))
    corners = [corner.translate(half * (i, j, k)) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
    return Manifold.batch_hull(corners).translate(at)


def sphere(radius: float, *, at: Triple = (0, 0, 0)) -> "Manifold":
    """A sphere around a point."""
    from manifold3d import Manifold

    # manifold3d divides an octahedron: in the middle of its faces the sides come out 1.4 times longer.
    return Manifold.sphere(radius, sides(1.4 * radius)).translate(at)


def revolve(profile: ArrayLike, *, axis: str = "z") -> "Manifold":
    """A polygon of (K, 2) points (radius, height), radius >= 0, turned about the axis."""
    profile = np.asarray(profile, dtype=float)
    return _along(outline(profile).revolve(sides(profile[:, 0].max())), axis)


def cylinder(radius: float, length: float, *, axis: str = "z", at: Triple = (0, 0, 0)) -> "Manifold":
    """A cylinder around a point."""
    profile = [(0, -length / 2), (radius, -length / 2), (radius, length / 2), (0, length / 2)]
    return revolve(profile, axis=axis).translate(at)


def shell(wall: ArrayLike, thickness: float) -> "Manifold":
    """A vessel: the line of its wall, (K, 2) points (radius, height), made thick and turned about z."""
    # 0.05 mm off the curve is a hundredth of a wavelength at 77 GHz, and saves half the facets.
    area = strip(wall, thickness).simplify(0.05)
    return area.revolve(sides(area.bounds()[2]))


def loft(rings: np.ndarray, *, closed: bool = False) -> "Manifold":
    """The skin over (K, N, 3) rings of N points each; `closed`: the last ring joins the first.

    An open end is closed by a fan from the middle of its ring, which must see all of it.
    """
    from manifold3d import Manifold, Mesh64

    count, around = rings.shape[:2]
    here = np.arange(count * around).reshape(count, around)
    there = np.roll(here, -1, axis=0) if closed else here[1:]
    here = here if closed else here[:-1]
    a, b, c, d = (g.ravel() for g in (here, np.roll(here, -1, 1), np.roll(there, -1, 1), there))
    faces = [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    vertices = rings.reshape(-1, 3)
    if not closed:
        first, last = np.arange(around), np.arange(around) + (count - 1) * around
        hub = len(vertices)
        faces.append(np.stack([np.full(around, hub), np.roll(first, -1), first], 1))
        faces.append(np.stack([np.full(around, hub + 1), last, np.roll(last, -1)], 1))
        vertices = np.concatenate([vertices, rings[0].mean(0)[None], rings[-1].mean(0)[None]])
    triangles = np.concatenate(faces)
    corners = vertices[triangles]
    if np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        triangles = triangles[:, ::-1]
    return Manifold(Mesh64(vertices, np.ascontiguousarray(triangles, dtype=np.uint64)))


def tube(
    path: np.ndarray, radii: ArrayLike, *, normal: Triple, closed: bool = False, around: int | None = None
) -> "Manifold":
    """A rod along an (N, 3) path that lies in the plane with this normal.

    `radii`: one number, one a point (N,), or two (1, 2) or (N, 2): in the path's plane, and across it. `around`:
    how many sides the rod has, where it is so thin that the usual number would be wasted.
    """
    radii = np.asarray(radii, dtype=float)
    radii = np.broadcast_to(radii[:, None] if radii.ndim == 1 else radii, (len(path), 2))
    ahead = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    if not closed:
        ahead[0], ahead[-1] = path[1] - path[0], path[-1] - path[-2]
    up = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    aside = np.cross(up, ahead / np.linalg.norm(ahead, axis=1, keepdims=True))
    angle = np.linspace(0, 2 * np.pi, around or sides(radii.max()), endpoint=False)[:, None]
    offsets = np.cos(angle) * (radii[:, :1] * aside)[:, None] + np.sin(angle) * radii[:, 1:, None] * up
    return loft(path[:, None] + offsets, closed=closed)


def body(stations: ArrayLike, *, exponent: float = 2.0, rounding: tuple[float, float] = (0, 0)) -> "Manifold":
    """A smooth body along x: a bottle, a handle, a grip.

    Parameters
    ----------
    stations : (K, 5) rows of x, the section's centre y and z, its half width (y) and half height (z) [mm]
    exponent : 2 makes sections elliptic, 4 nearly rectangular (a superellipse)
    rounding : radius of the edge at the first and at the last end [mm]
    """
    rows = curve(stations, along=1)
    x = rows[:, 0]
    start, stop = rounding
    arc = 1 - np.cos(np.linspace(0, np.pi / 2, FEWEST // 4 + 1))
    inner = x[(x > x[0] + start + 1e-6) & (x < x[-1] - stop - 1e-6)]
    places = np.unique(np.concatenate([x[[0, -1]], x[0] + start * arc, inner, x[-1] - stop * arc]).round(9))
    rows = np.stack([np.interp(places, x, column) for column in rows.T], axis=1)
    half = rows[:, 3:]
    for radius, depth in ((start, places - places[0]), (stop, places[-1] - places)):
        if radius:
            lost = 1 - np.sqrt(1 - np.clip(1 - depth / radius, 0, 1) ** 2)
            half = half - np.minimum(radius, half - 0.05) * lost[:, None]
    around = ellipse(1, 1, exponent=exponent, count=sides(half.max()))
    rings = rows[:, None, 1:3] + half[:, None] * around
    return loft(np.concatenate([np.broadcast_to(places[:, None, None], (*rings.shape[:2], 1)), rings], axis=2))


def bent(solid: "Manifold", lift: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> "Manifold":
    """The solid with every point lifted by `lift(x, y)` [mm], its facets made small enough to follow."""
    return solid.refine_to_length(1.5 * CHORD).warp_batch(
        lambda points: np.column_stack([points[:, :2], points[:, 2] + lift(points[:, 0], points[:, 1])])
    )


def union(*solids: "Manifold") -> "Manifold":
    """All solids as one."""
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean(solids, OpType.Add)


# ---- finishing ---------------------------------------------------------------------------------------------


def stretched(solid: "Manifold", size: Triple) -> "Manifold":
    """The solid scaled along x, y and z to fill a box of this size [mm]: the last few percent of a drawing.

    Raises
    ------
    InputError
        The drawing is more than 10 % off; scaling would distort it.
    """
    return solid.scale(_stretch(solid, size))


def stretched_parts(parts: "Mapping[str, Manifold]", size: Triple) -> "dict[str, Manifold]":
    """The parts of one thing, scaled together so that their union fills a box of this size [mm].

    Raises
    ------
    InputError
        As `stretched`.
    """
    scale = _stretch(union(*parts.values()), size)
    return {name: solid.scale(scale) for name, solid in parts.items()}


def _stretch(solid: "Manifold", size: Triple) -> np.ndarray:
    """(3,) scale along x, y and z that makes the solid fill a box of this size."""
    lower, upper = np.reshape(solid.bounding_box(), (2, 3))
    scale = np.asarray(size, dtype=float) / (upper - lower)
    if (np.abs(scale - 1) > MOST_STRETCH).any():
        drawn, wanted = (" x ".join(f"{v:.1f}" for v in values) for values in (upper - lower, size))
        raise InputError(
            f"the solid is drawn {drawn} mm large; expected {wanted} mm within 10 %: redraw it, or correct the size"
        )
    return scale


def apart(parts: "Mapping[str, Manifold]") -> "dict[str, Manifold]":
    """The parts without what they share: where two overlap, the one named first keeps the place."""
    cut: dict[str, Manifold] = {}
    for name, solid in parts.items():
        cut[name] = solid - union(*cut.values()) if cut else solid
    return cut


def mesh_of(solid: "Manifold", *, centre: ArrayLike | None = None, pieces: bool = False) -> TriangleMesh:
    """The solid [mm] as a mesh [m], its bounding box, or the given `centre` [mm], at the origin.

    Several pieces that do not touch are taken for a mistake, unless `pieces`.
    """
    from manifold3d import Error

    # Booleans leave slivers where surfaces nearly coincide; a micrometre is far below every wavelength here.
    solid = solid.simplify(1e-3)
    count = len(solid.decompose())
    if solid.status() != Error.NoError or count < 1 or (count > 1 and not pieces):
        raise MeshError(
            f"the solid has {count} pieces and status {solid.status().name}; expected one piece without "
            "error: let its parts overlap, and check that no part crosses itself"
        )
    mesh = solid.to_mesh64()
    # Booleans can leave a vertex that no face uses.
    used, faces = np.unique(np.asarray(mesh.tri_verts), return_inverse=True)
    vertices = np.asarray(mesh.vert_properties)[used, :3]
    middle = middle_of(solid) if centre is None else np.asarray(centre, dtype=float)
    return TriangleMesh(vertices=(vertices - middle) / 1000, faces=faces.reshape(-1, 3))


def middle_of(solid: "Manifold") -> np.ndarray:
    """(3,) the middle of the solid's bounding box [mm]."""
    return np.reshape(solid.bounding_box(), (2, 3)).mean(axis=0)


def _along(solid: "Manifold", axis: str) -> "Manifold":
    """The solid with its z axis turned onto the axis named."""
    turns = {"x": (0, 90, 0), "y": (-90, 0, 0), "z": (0, 0, 0)}
    if axis not in turns:
        raise InputError(f"axis is {axis!r}; expected 'x', 'y' or 'z'")
    return solid.rotate(turns[axis])
