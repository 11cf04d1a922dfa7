"""Flat and slightly bent tops: their phases tell how they lie and bend, and where they end.

Within its outline a slice of the image has the wave of a top, see `_top_wave`. Less that wave's phases the slice is
real and positive there, and half as high at the edges.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from millisight.core import checked_array, put, record
from millisight.data import Mask, SarImage, VoxelGrid
from millisight.perception.segmentation._heights import distance_of, echo_height, growth_with_distance, pixel_sides
from millisight.perception.segmentation._parts import parts_of
from millisight.perception.segmentation._phases import (
    cleaned_under,
    parts_to_look_at,
    phase_sign,
    reaches_edge,
    wavenumber_of,
    why_no_forms,
)
from millisight.perception.segmentation._rims import rim_above
from millisight.perception.segmentation._round import CORNERS, CUT
from millisight.perception.segmentation._top_wave import AGREEING, TopWave, top_wave

_EDGE = 0.5  # of the amplitude on the plane, where it ends
_BEYOND = 0.008  # of the mask, the edge may lie [m]
_AROUND, _GOES_ON = 0.016, 0.5  # of the mask, and more of what lies there than this: a plane that is not the mask's [m]
_MOST_OF_IT = 0.45  # of a part, that a plane covers
_NARROWEST = 0.015  # of a plane: a cylinder's crest seems to be one [m]
_OUTLINED = 0.8  # intersection over union with a rectangle or an ellipse
_LEAST_PIXELS = 8  # of a top
_AS_LONG = 0.9  # of an ellipse's longer diameter, the other of a disc
_STEP, _TELLING = 0.005, 0.1  # between heights of a top's halves, which are two tops; of a top as wide as this [m]
_LEAST_UPRIGHT = 0.01  # square of a normal's z
_CLOSE = 0.045  # slices whose waves tell a top's height, to that in which the wave was found [m]
_HOLE = 0.25  # of a top's power, that the image had there before sheets were taken off, at most
_BENT_DEG = 3.0  # from edge to edge, from which on a top is called bent


@record
class Flat:
    """A flat or slightly bent top, seen along z.

    Attributes
    ----------
    kind : "rectangle" or "ellipse"
    centre : (3,) of the outline, on the top [m]
    normal : (3,) unit vector there, towards the antennas: z positive, unless the image was seen from below
    axis : (3,) unit vector at right angles to it along the longer side, x + y positive
    sides : (2,) length and width, or diameters [m]
    curvatures : (2, 2) symmetric, along the longer side and across [1/m]: above 0 on the diagonal where it bulges up,
        below where it is hollow; beside the diagonal its twist
    share : of the mask's part that it covers
    rim : how far above it a rim echoes that goes around it, as of an open vessel, to about a centimetre [m]; None:
        there is none within 4 to 15 cm
    cut : whether its outline reaches the picture's edge, beyond which it may go on: sides and kind are of what is seen
    inside : (A, B) bool, its pixels
    """

    kind: str
    centre: np.ndarray
    normal: np.ndarray
    axis: np.ndarray
    sides: np.ndarray
    curvatures: np.ndarray
    share: float
    cut: bool
    inside: np.ndarray
    rim: float | None = None

    def __post_init__(self) -> None:
        for name in ("centre", "normal", "axis", "sides", "curvatures"):
            shape = {"sides": (2,), "curvatures": (2, 2)}.get(name, (3,))
            put(self, **{name: checked_array(getattr(self, name), name=name, shape=shape)})
        put(self, inside=checked_array(self.inside, name="inside", shape=("A", "B"), dtype=bool))

    def __repr__(self) -> str:
        return f"Flat({self})"

    def __str__(self) -> str:
        (x, y, z), (length, width) = self.centre, 1e3 * self.sides
        size = f"{length:.0f} x {width:.0f} mm around ({x:.3f}, {y:.3f}, {z:.3f}) m"
        bends = zip(self.bends_deg, ("along", "across"), strict=True)
        words = [
            (bend, f"{'bulges' if bend > 0 else 'hollow'} by {abs(bend):.0f} degrees {way}") for bend, way in bends
        ]
        words.append((self.twist_deg, f"twisted by {abs(self.twist_deg):.0f} degrees"))
        told = [f", {text}" for turned, text in words if abs(turned) >= _BENT_DEG]
        form = f"{'bent' if told else 'flat'} {self.kind} of {size}, {self.tilt_deg:.1f} degrees from level"
        rim = "" if self.rim is None else f", about {1e3 * self.rim:.0f} mm below a rim"
        return f"{form}{''.join(told)}{rim}{CUT if self.cut else ''}"

    @property
    def tilt_deg(self) -> float:
        """Between the normal and z."""
        return float(np.degrees(np.arccos(min(abs(self.normal[2]), 1.0))))

    @property
    def bends_deg(self) -> np.ndarray:
        """(2,) by how much the normal turns from edge to edge, along the longer side and across."""
        return np.degrees(np.diag(self.curvatures) * self.sides)

    @property
    def twist_deg(self) -> float:
        """By how much the normal turns sideways from end to end along the longer side."""
        return float(np.degrees(self.curvatures[0, 1] * self.sides[0]))

    @property
    def short(self) -> str:
        """Its size in few letters, for pictures."""
        return f"{1e3 * self.sides[0]:.0f} x {1e3 * self.sides[1]:.0f} mm"

    @property
    def outline(self) -> np.ndarray:
        """(N, 2) x and y of its outline, seen along z, closed [m]."""
        angle = np.linspace(0, 2 * np.pi, 73)
        shape = CORNERS if self.kind == "rectangle" else np.stack([np.cos(angle), np.sin(angle)], axis=1)
        axes = np.stack([self.axis, np.cross(self.normal, self.axis)])
        return self.centre[:2] + shape @ (self.sides[:, None] / 2 * axes[:, :2])

    @property
    def plain(self) -> dict[str, Any]:
        """All but the pixels, as JSON has it."""
        vectors = {name: getattr(self, name).tolist() for name in ("centre", "normal", "axis", "sides", "curvatures")}
        return {"kind": self.kind, **vectors, "share": self.share, "cut": self.cut, "rim": self.rim}

    @property
    def turned_over(self) -> "Flat":
        """Mirrored in z."""
        up = np.array([1, 1, -1])
        return replace(self, centre=self.centre * up, normal=self.normal * up, axis=self.axis * up)


def find_flat(mask: Mask, image: SarImage, *, covered: bool = False) -> tuple[Flat, ...]:
    """The flat and slightly bent tops of the parts of a mask: place, normal, axis, sides, bend, by the image's phases.

    A part has one if most of it has the phases of one wave, plane or about one or two centres of curvature. Steps and
    holes are no hindrance, where the waves on both sides have the same direction. What bends to a radius of less than
    14 cm, is narrower than 15 mm, covers less than 45 % of its part, or is neither a rectangle nor an ellipse is left
    out.

    Parameters
    ----------
    mask : Mask
    image : in which it was found, on the same pixels: at 77 GHz, its phases as `form_image` leaves them, or their
        negatives; lids and cloths are taken off
    covered : whether a lid is known to lie over the scene

    Returns
    -------
    tuple of Flat, at most one of each part; empty where the image is one of magnitudes, its pixels are too coarse for
        its phases, above 3.1 mm, or its echoes do not fall to a fifth above and below the object, as at 24 GHz

    Raises
    ------
    InputError
        The mask is on other pixels than the image.
    """
    cleaned = cleaned_under(mask, image, covered=covered)
    if cleaned is None:
        return ()
    found = flat_things(mask.inside, cleaned)
    return tuple(one for one in found if not _is_hole(one, image, cleaned))


def _is_hole(top: Flat, image: SarImage, cleaned: SarImage) -> bool:
    """Whether a top came with taking off sheets: where an object hides a part of a table, a hole of its shape is left.

    What is taken off with a lid may be a table below it as well.
    """
    slice_ = int(abs(image.grid.z - top.centre[2]).argmin())
    before, after = (one.values[..., slice_][top.inside] for one in (image, cleaned))
    return bool(np.vdot(before, before).real < _HOLE * np.vdot(after, after).real)


def flat_things(mask: np.ndarray, image: SarImage) -> list[Flat]:
    """The flat tops of the parts of a mask (A, B) on an image's pixels; see `find_flat`.

    image : its sheets taken off; its echoes tell heights
    """
    if why_no_forms(image):
        return []
    if image.seen_from == "below":
        return [one.turned_over for one in flat_things(mask, image.turned_over)]
    tops = []
    for part in parts_to_look_at(mask, image):
        if (top := _flat(part, image)) is not None:
            rim = rim_above(top.inside, float(top.centre[2]), part=part, mask=mask, image=image)
            tops.append(replace(top, rim=rim))
    return tops


def _flat(whole: np.ndarray, image: SarImage) -> Flat | None:
    """What is flat in a part (A, B) of a mask, if most of it is, and that ends about where the part does."""
    from scipy.ndimage import distance_transform_edt

    margins = [round(_AROUND / side) + 1 for side in pixel_sides(image)]
    box = tuple(slice(max(i.min() - n, 0), i.max() + n + 1) for i, n in zip(np.nonzero(whole), margins, strict=True))
    grid = VoxelGrid(x=image.grid.x[box[0]], y=image.grid.y[box[1]], z=image.grid.z)
    near, part = SarImage(grid=grid, values=image.values[box], metadata=image.metadata), whole[box]
    wave = top_wave(part, near, wavenumber_of(image))
    if wave is None:
        return None
    level = _EDGE * float(np.median(wave.values.real[wave.inside]))
    away = np.asarray(distance_transform_edt(~part, sampling=pixel_sides(near)))
    beside = (away > _BEYOND) & (away <= _AROUND)
    if beside.any() and (wave.values.real[beside] >= level).mean() > _GOES_ON:
        return None
    inside = _extent(wave, (away <= _BEYOND) & (wave.values.real >= level))
    share = float((inside & part).sum() / part.sum())
    if (
        inside.sum() < _LEAST_PIXELS
        or min(inside.any(axis=axis).sum() for axis in (0, 1)) < 2  # a row has no halves
        or share < _MOST_OF_IT
        or abs(wave.values[inside].sum()) < AGREEING * np.abs(wave.values[inside]).sum()
    ):
        return None
    lie = _lie_of(wave, inside, near)
    if lie is None:
        return None
    outline = _outline(inside, grid, lie.normal)
    if outline.alike < _OUTLINED or outline.sides[1] < _NARROWEST:
        return None
    along = outline.along
    if outline.kind == "ellipse" and outline.sides[1] > _AS_LONG * outline.sides[0] and lie.bends(outline.sides[0]):
        along = lie.most_bent  # a disc has no longer side
    rise = -lie.normal[:2] / lie.normal[2]
    axis = np.array([*along, rise @ along])
    axis *= (1 if along.sum() > 0 else -1) / np.linalg.norm(axis)
    curvatures = lie.curvatures(np.stack([axis, np.cross(lie.normal, axis)]))
    everywhere = np.zeros(whole.shape, bool)
    everywhere[box] = inside
    return Flat(
        kind=outline.kind, centre=np.array([*outline.centre, lie.height]), normal=lie.normal, axis=axis,
        sides=outline.sides, curvatures=curvatures, share=share, cut=reaches_edge(everywhere), inside=everywhere,
    )  # fmt: skip


class _Lie(NamedTuple):
    """How a top lies in space.

    Attributes
    ----------
    normal : (3,) unit vector in its middle, z positive
    turning : (2, 2) of the wave's direction over x and y, seen along z [1/m]
    height : of the middle [m]
    above : of the slice in which the wave was found over that [m]
    """

    normal: np.ndarray
    turning: np.ndarray
    height: float
    above: float

    def curvatures(self, axes: np.ndarray) -> np.ndarray:
        """(2, 2) of the top along two unit vectors (2, 3) on it [1/m]."""
        turned = axes[:, :2] @ self.turning
        seen = axes @ np.column_stack([turned, -(turned @ self.normal[:2]) / self.normal[2]]).T
        seen = (seen + seen.T) / 2
        return seen @ np.linalg.inv(np.eye(2) - self.above * seen)  # the slice is farther from the centres, or nearer

    def bends(self, length: float) -> bool:
        """Whether the normal turns noticeably more over a length [m] one way than another."""
        return bool(np.degrees(np.ptp(np.linalg.eigvalsh(self.turning)) * length) >= _BENT_DEG)

    @property
    def most_bent(self) -> np.ndarray:
        """(2,) unit vector of the direction, seen along z, in which it bends most."""
        values, ways = np.linalg.eigh(self.turning)
        return ways[:, np.abs(values).argmax()]


def _lie_of(wave: TopWave, inside: np.ndarray, image: SarImage) -> _Lie | None:
    """How a top lies whose wave is found inside (A, B); None where it may be two, or its height or sign is not told."""
    grid, values, z, wavenumber = image.grid, image.values[inside], image.grid.z, wavenumber_of(image)
    places = np.stack([axis[some] for axis, some in zip((grid.x, grid.y), np.nonzero(inside), strict=True)], axis=1)
    middle = places.mean(axis=0)
    across = wave.phase.slopes_at(middle) / wavenumber
    upright = np.sqrt(max(1 - across @ across, _LEAST_UPRIGHT))
    # What of each slice has the phases of the wave: leftovers of a lid have not.
    sums = np.exp(-1j * wave.phase.on(grid))[inside] @ values
    power = np.square(np.abs(sums), dtype=float)
    top = int(power.argmax())
    turns = wavenumber * upright * (z - z[top])
    other = int((power * (1 - np.cos(2 * turns))).argmax())
    sign = phase_sign(sums[other] * np.conj(sums[top]), turns[other], image)
    if not sign or top in (0, len(z) - 1):
        return None
    normal, turning, away = np.array([*(sign * across), upright]), sign * wave.phase.bends / wavenumber, places - middle
    close = abs(z - wave.height) <= _CLOSE

    def height_of(some: np.ndarray) -> float:
        """Of the middle, by some of the places."""
        power = _powers(values[some][:, close], away[some], z[close] - wave.height, normal, turning, sign * wavenumber)
        growth = growth_with_distance(z[close], z[top], distance_of(image, z[top]))
        on_average = echo_height(power / growth, z[close])
        rise = away[some] @ normal[:2] / normal[2] + np.einsum("ni,ij,nj->n", away[some], turning, away[some]) / 2
        return on_average + float(rise.mean())

    # Tops whose heights differ by half a wavelength have the same phases. Of narrow ones heights of halves tell less.
    for aside in np.linalg.eigh(np.cov(away.T))[1].T @ away.T:
        step = height_of(aside > 0) - height_of(aside <= 0)
        if abs(step) > _STEP * max(1.0, (_TELLING / np.ptp(aside)) ** 2):
            return None
    height = height_of(np.ones(len(away), bool))
    return _Lie(normal, turning, height, wave.height - height)


def _powers(
    values: np.ndarray,
    places: np.ndarray,
    above: np.ndarray,
    normal: np.ndarray,
    turning: np.ndarray,
    wavenumber: float,
) -> np.ndarray:
    """(Z,) of values (N, Z) at places (N, 2) in slices so far above a wave's (Z,), by the wave as it is in each.

    Farther from the centres of curvature a wave bends less. It moves along its normal.
    """
    bends = turning @ np.linalg.inv(np.eye(2) + above[:, None, None] * turning)
    moved = places - above[:, None, None] * normal[:2] / normal[2]
    phases = wavenumber * (moved @ normal[:2] + np.einsum("zni,zij,znj->zn", moved, bends, moved) / 2)
    sums = np.abs((np.exp(-1j * phases) * values.T).sum(axis=1))
    return np.square(sums, dtype=float)


def _extent(wave: TopWave, high: np.ndarray) -> np.ndarray:
    """(A, B) the part of where a wave is `high` that holds most of its plane, holes filled."""
    from scipy.ndimage import binary_fill_holes

    parts, _ = parts_of(high)
    shares = np.bincount(parts[wave.inside], minlength=2)
    shares[0] = 0
    return binary_fill_holes(parts == shares.argmax()) if shares.any() else wave.inside


class _Outline(NamedTuple):
    """What an outline is like; see `Flat`. Centre and direction along its longer side are seen along z, (2,).

    alike : its intersection with this over their union
    """

    alike: float
    kind: str
    centre: np.ndarray
    along: np.ndarray
    sides: np.ndarray


def _outline(inside: np.ndarray, grid: VoxelGrid, normal: np.ndarray) -> _Outline:
    """Rectangle or ellipse of the same moments as the pixels (A, B) of a plane, whichever is more like them."""
    places = np.stack(np.meshgrid(grid.x, grid.y, indexing="ij"), axis=-1)
    centre = places[inside].mean(axis=0)
    # Down its slope a plane is longer than it is seen.
    slope = normal[:2] / max(float(np.hypot(*normal[:2])), 1e-12)
    longer = np.eye(2) + (1 / normal[2] - 1) * np.outer(slope, slope)
    flat = (places - centre) @ longer @ [1, 1j]
    # Of a square the second moments do not tell how it is turned, of others the fourth may not.
    angles = np.angle((flat[inside] ** 2).sum()) / 2, (np.angle((flat[inside] ** 4).sum()) + np.pi) / 4
    found = []
    for angle in angles:
        turned = flat * np.exp(-1j * angle)
        spreads = turned.real[inside].std(), turned.imag[inside].std()
        u, v = abs(turned.real) / spreads[0], abs(turned.imag) / spreads[1]
        for kind, size, filled in (
            ("rectangle", np.sqrt(12), np.maximum(u, v) <= np.sqrt(3)), ("ellipse", 4.0, np.hypot(u, v) <= 2)
        ):  # fmt: skip
            found.append((float((filled & inside).sum() / (filled | inside).sum()), kind, angle, size, spreads))
    alike, kind, angle, size, spreads = max(found)
    if spreads[1] > spreads[0]:
        angle, spreads = angle + np.pi / 2, spreads[::-1]
    along = np.linalg.solve(longer, [np.cos(angle), np.sin(angle)])
    return _Outline(alike, kind, centre, along / np.linalg.norm(along), size * np.array(spreads))
