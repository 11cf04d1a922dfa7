"""Sheets over a scene, such as the lid of a carton: their echo found, told, and taken off images and frames."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, overload

import numpy as np

from millisight.core import (
    SPEED_OF_LIGHT,
    check_known,
    checked_integer,
    checked_number,
    checked_numbers,
    checked_record,
    put,
    record,
    with_step,
)
from millisight.core.errors import InputError
from millisight.data import Capture, PixelGrid, SarImage, VoxelGrid
from millisight.imaging._scale import at_usual_scale, scaled
from millisight.imaging._sides import NOT_LOOKED_AT, mirrored, side_of

if TYPE_CHECKING:
    from millisight.imaging._sheet_fit import Cells, SheetFit  # needs SciPy: not for --help

CLUTTER = ("none", "lid", "auto")
"""What may be said of sheets over the objects."""

Cleaned = TypeVar("Cleaned", bound=SarImage | Capture)

_LEAST_EXPLAINED = {"auto": 0.75, "lid": 0.6}  # of a sheet's echo
_LEAST_BORDER = 0.25  # of the scene's, that a sheet reaches
_LEAST_SHARE = 0.15  # of the scene
_LARGE = 0.06  # sheets so large are no object's top [m²]
_LEAST_LID = 0.004  # what ends within the scene and is smaller is no lid [m²]
_WITHIN, _GOES_ON = 0.01, 0.1  # farther within a lid's edges [m]; weight of its cells where a wide sheet goes on
_SAME = 0.6  # of the cells of either fit, where both found the same lid
_RING = 2  # cells along the scene's border
_ATTEMPTS = 4  # flat things that are looked at, besides the sheets that are taken


@record
class DetectedSheet:
    """A sheet that was found: a lid, a cloth, a wall, or the flat top of something large.

    Attributes
    ----------
    height : z in the middle of where it is seen [m], to a fraction of the range resolution
    tilt_deg : (2,) by how much it rises along x and along y, in the middle [degrees]
    lower, upper : (2,) corners of the box around where it is seen, x and y [m]
    area : where it is seen [m²]
    border : share of the scene's border where it is seen: 1 for a lid that reaches beyond the scene on all sides
    explained : how sure it is: median share, over its area, of the echo's power that follows the fitted sheet
    power : what was taken, over the power of the whole image or of all frames; 0 where it was left
    corners : of a lid that is turned about z: x and y of its four, counterclockwise [m]; else none
    """

    height: float
    tilt_deg: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]
    area: float
    border: float
    explained: float
    power: float
    corners: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        put(
            self,
            height=checked_number(self.height, name="height", unit="m"),
            tilt_deg=checked_numbers(self.tilt_deg, name="tilt_deg", count=2, unit="degrees"),
            lower=checked_numbers(self.lower, name="lower", count=2, unit="m"),
            upper=checked_numbers(self.upper, name="upper", count=2, unit="m"),
        )
        for name in ("area", "border", "explained", "power"):
            put(self, **{name: checked_number(getattr(self, name), name=name, minimum=0)})
        put(self, corners=_checked_corners(self.corners))

    def __str__(self) -> str:
        (x0, y0), (x1, y1) = self.lower, self.upper
        return (
            f"z = {100 * self.height:.1f} cm, tilted by {self.tilt_deg[0]:.1f} and {self.tilt_deg[1]:.1f} "
            f"degrees along x and y, over {100 * (x1 - x0):.0f} x {100 * (y1 - y0):.0f} cm, "
            f"{100 * self.explained:.0f} % explained"
        )

    def box_on(self, grid: PixelGrid) -> np.ndarray:
        """(X, Y) bool, the pixels whose centres lie in the box around where it is seen, or within a turned lid."""
        x, y = grid.x[:, None], grid.y
        if self.corners:
            ends = zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True)
            return np.logical_and.reduce([(x1 - x0) * (y - y0) >= (y1 - y0) * (x - x0) for (x0, y0), (x1, y1) in ends])
        return (self.lower[0] <= x) & (x <= self.upper[0]) & (self.lower[1] <= y) & (y <= self.upper[1])


def sheets_told(metadata: Mapping[str, Any], *, clutter: str | None = None) -> tuple[DetectedSheet, ...]:
    """The sheets that were taken off before, as a history tells them; those that cannot be read are left out.

    Parameters
    ----------
    metadata : of an image, a capture or what was made of them
    clutter : of the steps that count, "lid" or "auto"; None: all
    """
    found: list[DetectedSheet] = []
    for step in metadata.get("history", ()):
        if step.get("step") == "remove_sheets" and clutter in (None, step.get("clutter")):
            sheets = step.get("sheets")
            for sheet in sheets if isinstance(sheets, (list, tuple)) else ():
                try:
                    found.append(DetectedSheet(**sheet))
                except (TypeError, InputError):  # written by another program
                    continue
    return tuple(found)


def _checked_corners(value: Any) -> tuple[tuple[float, float], ...]:
    """Four places counterclockwise around something, or none."""
    if not isinstance(value, Iterable):
        raise InputError(f"corners is {value!r}; expected four places, or none")
    corners = [checked_numbers(corner, name="corners", count=2, unit="m") for corner in value]
    if len(corners) not in (0, 4):
        raise InputError(f"corners has {len(corners)} places; expected four, or none")
    area = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True)) / 2
    if corners and not area > 0:
        raise InputError(f"corners is {corners}; expected four places, counterclockwise around the lid")
    return tuple((x, y) for x, y in corners)


@record
class SheetRemoval(Generic[Cleaned]):
    """What `remove_sheets` made and found.

    Attributes
    ----------
    result : the image or the capture without the sheets' echoes, its history telling what was taken; the given one
        where nothing was
    sheets : those taken, the first found first
    left : flat things that were found and left, since they may be the tops of objects, or lie behind the grid
    reason : why nothing was taken; empty where something was
    """

    result: Cleaned
    sheets: tuple[DetectedSheet, ...]
    left: tuple[DetectedSheet, ...]
    reason: str

    def __repr__(self) -> str:
        if not self.sheets:
            return f"SheetRemoval(nothing taken: {self.reason})"
        return f"SheetRemoval({'; '.join(map(str, self.sheets))})"


@overload
def remove_sheets(
    scene: SarImage, *, clutter: str = "auto", frequency: float | None = None, grid: None = None, most: int = 2
) -> SheetRemoval[SarImage]: ...


@overload
def remove_sheets(
    scene: Capture, *, clutter: str = "auto", frequency: None = None, grid: VoxelGrid | None = None, most: int = 2
) -> SheetRemoval[Capture]: ...


def remove_sheets(
    scene: Any,
    *,
    clutter: str = "auto",
    frequency: float | None = None,
    grid: VoxelGrid | None = None,
    most: int = 2,
) -> Any:
    """Take the echo of sheets off an image or the frames of a capture: lids, cloths, walls (primer 18).

    A sheet is a mirror: each column of voxels, and each pose, holds the echo of the part straight below, with a phase
    that follows the sheet's height. A surface of the second degree takes that phase off: height, tilt up to 8 degrees,
    bow. What is left changes slowly over centimetres; it is fitted by splines, robustly, so that cells which hold
    something else tell nothing, and under an object the sheet goes on from its surroundings. Only the fitted echo is
    taken. What is flat and ends within the scene, such as the top of a can, is left, unless it is larger than 600 cm²:
    from above a small lid looks like the top of a box. Say `clutter="lid"` where you know of one: what is flat and
    largest is then the lid, wherever it ends.

    Take wide sheets off the frames: an image has ripples from the aperture's edges, which are fitted, too, by a factor
    of each row and column. Take a known lid that ends within the scene off the image: its edges go with it, also those
    of one that is turned about z.

    Parameters
    ----------
    scene : SarImage, seen from above along z; or Capture, frames in memory or on disk
    clutter : "auto": take sheets that explain three quarters of the echoes where they are seen; "lid": 60 %, and also
        one that ends within the scene, since one is known to be there; "none": take nothing
    frequency : centre of the band [Hz], of an image; None: as its history tells. A capture states its own
    grid : what will be imaged of a capture. A sheet more than half a range resolution behind it hides nothing and is
        left: a wall or a floor, whose echo is not told from that of an object in front where the band is narrow
    most : sheets at most

    Returns
    -------
    SheetRemoval
        With the scene as it was, and a reason, where no sheet is sure.

    Raises
    ------
    UnknownNameError, InputError
        An argument is invalid, a capture has layers, or nothing tells an image's frequency.
    """
    check_known("clutter", clutter, CLUTTER)
    most = checked_integer(most, name="most", minimum=1)
    lowest = -np.inf
    if isinstance(scene, SarImage):
        frequency = scene.frequency if frequency is None else frequency
        if frequency is None:
            raise InputError("this image does not state its frequency; pass frequency=79e9, for example [Hz]")
        if grid is not None:
            raise InputError("an image has its own grid; leave grid out")
        centre = checked_number(frequency, name="frequency", unit="Hz", above=0)
    elif isinstance(scene, Capture):
        if frequency is not None:
            raise InputError("a capture states its own frequencies; leave frequency out")
        centre = scene.radar.waveform.center_frequency
        if grid is not None:
            waveform = scene.radar.waveform
            margin = SPEED_OF_LIGHT / (4 * waveform.bandwidth) if waveform.bandwidth else np.inf
            lowest = float(checked_record(grid, VoxelGrid, name="grid").z.min()) - margin
    else:
        raise InputError(f"remove_sheets got {type(scene).__name__}; expected an image or a capture")
    if clutter == "none":
        return SheetRemoval(result=scene, sheets=(), left=(), reason="nothing was asked for")
    side = side_of(scene, grid)
    if side == "below":
        return mirrored(remove_sheets, scene, grid, clutter=clutter, frequency=frequency, most=most)
    if side in NOT_LOOKED_AT:
        return SheetRemoval(result=scene, sheets=(), left=(), reason=NOT_LOOKED_AT[side])
    usual, scale = at_usual_scale(scene)
    echoes, wave_number = _echoes_of(usual, lowest, clutter), 2 * np.pi * centre / SPEED_OF_LIGHT
    sheets, left = _search(echoes, wave_number, most, clutter, lowest)
    if not sheets:
        return SheetRemoval(result=scene, sheets=(), left=left, reason=_reason(left, lowest))
    told = [asdict(sheet) for sheet in sheets]
    metadata = with_step(scene.metadata, "remove_sheets", clutter=clutter, sheets=told, **echoes.told())
    cleaned = echoes.cleaned(metadata)
    return SheetRemoval(
        result=cleaned if scale == 1 else scaled(cleaned, 1 / scale), sheets=sheets, left=left, reason=""
    )


class _Echoes(Protocol):
    """What is searched: an image or frames."""

    ripples: bool

    @property
    def cells(self) -> "Cells": ...

    def first_fit(self, wave_number: float) -> "SheetFit | None": ...

    def sharpened(self, fit: "SheetFit") -> "SheetFit": ...

    def take(self, fit: "SheetFit") -> float: ...

    def height(self, fit: "SheetFit") -> float: ...

    def told(self) -> dict[str, float]: ...

    def cleaned(self, metadata: Mapping[str, Any]) -> Any: ...


def _echoes_of(scene: Any, lowest: float, clutter: str) -> _Echoes:
    if isinstance(scene, SarImage):
        from millisight.imaging._sheet_image import ImageScene

        return ImageScene(scene)
    from millisight.imaging._sheet_frames import FrameScene

    # The thresholds of "auto" were chosen with the leakage, by which what ends within the scene goes on beyond it.
    return FrameScene(scene, lowest, leaking=clutter == "auto")


def _search(
    echoes: _Echoes, wave_number: float, most: int, clutter: str, lowest: float
) -> tuple[tuple[DetectedSheet, ...], tuple[DetectedSheet, ...]]:
    """The sheets, taken from `echoes` one after the other, and what is flat and was left."""
    from scipy.ndimage import binary_dilation

    from millisight.imaging._sheet_fit import fit_sheet

    sheets: list[DetectedSheet] = []
    left: list[DetectedSheet] = []
    passed_over = np.zeros((1, 1), dtype=bool)
    first = None  # over all cells
    while len(sheets) < most and len(left) < _ATTEMPTS:
        cells = echoes.cells
        cells = cells._replace(counts=np.where(passed_over, 0, cells.counts))
        if first is None:
            fit = first = echoes.first_fit(wave_number)
        else:
            fit = fit_sheet(cells, wave_number, ripples=echoes.ripples)
        if fit is None or fit.explained < _LEAST_EXPLAINED[clutter]:
            break
        sheet = _told(fit, cells, echoes.height(fit), wave_number)
        wide = float(fit.support.mean()) >= _LEAST_SHARE and (sheet.border >= _LEAST_BORDER or sheet.area >= _LARGE)
        if wide and sheet.height >= lowest:
            if clutter == "lid" and not sheets:
                lid = _lid(echoes, wave_number, lowest, first)
                if lid is not None and _better(lid, fit, sheet, cells):
                    fit, sheet = lid
                    left.clear()
            sheets.append(replace(sheet, power=echoes.take(fit)))
        else:
            left.append(sheet)
            passed_over = passed_over | np.asarray(binary_dilation(fit.support, iterations=3), dtype=bool)
    if clutter == "lid" and not sheets and (lid := _lid(echoes, wave_number, lowest, first)) is not None:
        sheets.append(replace(lid[1], power=echoes.take(lid[0])))
        left.clear()  # parts of it, fitted worse
    return tuple(sheets), tuple(left)


def _lid(
    echoes: _Echoes, wave_number: float, lowest: float, whole: "SheetFit | None"
) -> "tuple[SheetFit, DetectedSheet] | None":
    """What reflects like one mirror over the largest place: a known lid, which may end within the scene.

    In frames the `whole` fit, over all cells, is preferred where it found the same: a lid's edges echo to poses beside
    it as well.
    """
    from millisight.imaging._sheet_fit import fit_sheet
    from millisight.imaging._sheet_place import lid_place

    place = lid_place(echoes.cells, wave_number, lobes=echoes.ripples)
    fit = None if place is None else fit_sheet(echoes.cells, wave_number, ripples=echoes.ripples, place=place)
    if fit is None or fit.explained < _LEAST_EXPLAINED["lid"]:
        return None
    if whole is not None and not echoes.ripples and whole.explained >= _LEAST_EXPLAINED["lid"]:
        shared = (whole.support & fit.support).sum()
        if shared >= _SAME * max(whole.support.sum(), fit.support.sum()):
            fit = whole
    fit = echoes.sharpened(fit)
    lid = _told(fit, echoes.cells, echoes.height(fit), wave_number)
    return (fit, lid) if lid.area >= _LEAST_LID and lid.height >= lowest else None


def _better(lid: "tuple[SheetFit, DetectedSheet]", whole: "SheetFit", sheet: DetectedSheet, cells: "Cells") -> bool:
    """Whether a lid is rather taken than a sheet that was found over all cells.

    With its edges and grating lobes a lid may pass for a wider sheet, which explains less. But where the wide sheet
    does not go on, the `lid` may be a bright top below it: then it must explain as much in all.
    """
    fit, told = lid
    if told.area * told.explained > sheet.area * sheet.explained:
        return True
    if fit.place is None or told.explained <= sheet.explained:
        return False
    inside = fit.place.wider(-_WITHIN).inside(cells.x[:, None], cells.y)
    return bool(inside.any()) and float(np.median(whole.weights[inside])) > _GOES_ON


def _reason(left: tuple[DetectedSheet, ...], lowest: float) -> str:
    """Why no sheet was taken."""
    if not left:
        return "no sheet is sure"
    behind = [sheet.height for sheet in left if sheet.height < lowest]
    if behind:
        return f"what is flat there, at z = {100 * behind[0]:.1f} cm, lies behind the grid and hides nothing of it"
    return "what is flat there ends within the scene and may be an object's top"


def _told(fit: "SheetFit", cells: "Cells", height: float, wave_number: float) -> DetectedSheet:
    """The sheet in words and numbers, nothing taken yet."""
    inside = [np.flatnonzero(fit.support.any(axis=axis)) for axis in (1, 0)]
    ends = [
        (float(places[some[0]]), float(places[some[-1]]))
        for places, some in zip((cells.x, cells.y), inside, strict=True)
    ]
    middle = [np.array(np.mean(end)) for end in ends]
    slopes = [float(fit.phase.coefficients @ slope) for slope in fit.phase.slopes(*middle)]
    ring = np.zeros(fit.support.shape, dtype=bool)
    for axis, count in enumerate(ring.shape):
        if count > 2 * _RING:
            some = np.moveaxis(ring, axis, 0)
            some[:_RING], some[-_RING:] = True, True
    steps = [float(np.diff(places).mean()) if len(places) > 1 else 1e-9 for places in (cells.x, cells.y)]
    return DetectedSheet(
        height=height,
        tilt_deg=(_tilt_deg(slopes[0], wave_number), _tilt_deg(slopes[1], wave_number)),
        lower=(ends[0][0], ends[1][0]),
        upper=(ends[0][1], ends[1][1]),
        area=float(fit.support.sum()) * steps[0] * steps[1],
        border=float(fit.support[ring].mean()) if ring.any() else 1.0,
        explained=min(max(fit.explained, 0.0), 1.0),
        power=0.0,
        corners=tuple((float(a), float(b)) for a, b in fit.place.corners) if fit.place and fit.place.turn else (),
    )


def _tilt_deg(slope: float, wave_number: float) -> float:
    """Of a mirror whose echo's phase has that slope [rad/m]: 2 k sin(tilt)."""
    return float(np.degrees(np.arcsin(np.clip(slope / (2 * wave_number), -1, 1))))
