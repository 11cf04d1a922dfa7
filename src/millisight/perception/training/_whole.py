"""Whole scenes to train on: objects off the middle, sheets over and under them, clutter and noise, images as cleaned.

Imaging is linear: simulated images of objects (`_scenes`) and of sheets (`_sheets`), each in its place and of its own
strength, add up to the image of a scene. The sheets are then taken off by `remove_sheets`, as when the networks are
used, so that they learn what is left of a sheet, and what of an object.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from millisight.core import check_known, checked_integer, checked_number, printable, put, record
from millisight.core.errors import DamagedFileError
from millisight.data import SarImage, VoxelGrid
from millisight.perception import SPACING, taken_db, without_sheets
from millisight.perception.training import _augmentation as augmentation
from millisight.perception.training._bands import BANDS, DEPTH, check_arrays, read_arrays, write_arrays
from millisight.perception.training._scenes import SceneParts
from millisight.perception.training._sheets import SheetParts

_SIDES = 0.20, 0.36  # of scenes [m]
_FADED = 5  # pixels over which an object's image ends
_MIDDLES = {"77_ghz": 79e9, "24_ghz": 24.125e9}  # of the bands [Hz]
_STEPS_DB = 0.25  # of the stored levels
_KNOWN = 0.5  # of the scenes with a lid are known to have one
_STANDS = 0.6  # of the scenes with no object show what it would lie on
_NUMBERS = "empty", "several", "covered", "uneven", "round"
_ROUND_DB = -30, -6  # of the edges of what is round, less than of others
_GAP = 0.005, 0.10  # between the objects and the sheet over them [m]


ECHOES = ("both", "edge", "specular")
"""Which of the simulator's two answers objects have; `both` is the paper's way."""


@record
class WholeSettings:
    """How whole scenes are made.

    Attributes
    ----------
    views : scenes of each simulated object
    empty : share of the scenes with no object
    several : share of the scenes with two or three objects
    covered : share of the scenes with a sheet over the objects
    sheets : simulated sheets, which the scenes share; 0: there is none in any scene
    parts : of the objects' echoes: "both", "edge" or "specular"
    uneven : how much an object's brightness changes from place to place at most, a standard deviation [dB]
    round : share of the objects whose edges hardly echo, as of what is round; the simulator takes their outline for
        an edge
    """

    views: int = 6
    empty: float = 0.08
    several: float = 0.2
    covered: float = 0.65
    sheets: int = 64
    parts: str = "both"
    uneven: float = 0.0
    round: float = 0.0

    def __post_init__(self) -> None:
        check_known("parts", self.parts, ECHOES)
        put(
            self,
            views=checked_integer(self.views, name="views"),
            sheets=checked_integer(self.sheets, name="sheets", minimum=0),
            **{n: checked_number(getattr(self, n), name=n, minimum=0) for n in _NUMBERS},
        )


class WholeScene(NamedTuple):
    """A scene as a network may see it.

    Attributes
    ----------
    objects : (A, B) uint8, the number of the object over each pixel, from 1 on; 0: none
    covered : whether a sheet lies over the objects
    levels : by band, 77 GHz at least, (A, B, Z) uint8, power of the cleaned image in steps below its maximum
    raw : by band (A, B) uint8, the same of the mean magnitude along z before anything was taken
    taken_db : by band, the maximum of the cleaned image over that before [dB]
    """

    objects: np.ndarray
    covered: bool
    levels: dict[str, np.ndarray]
    raw: dict[str, np.ndarray]
    taken_db: dict[str, float]

    def power(self, band: str) -> np.ndarray:
        """(A, B, Z) float32 of the cleaned image, 1 at its maximum."""
        return _power_of(self.levels[band])

    def raw_power(self, band: str) -> np.ndarray:
        """(A, B) float32 of the image before, the mean magnitude along z squared, 1 at its maximum."""
        return _power_of(self.raw[band])


def cached_whole_scene(
    key: str,
    settings: WholeSettings,
    parts: Callable[[np.random.Generator], tuple[Sequence[SceneParts], Sequence[Callable[[], SheetParts]]]],
    *,
    seed: Sequence[int],
    folder: str | os.PathLike[str],
    among: str,
) -> WholeScene:
    """The scene of that key: read from `folder`, or composed of drawn parts and written there.

    Parameters
    ----------
    among : what the parts are drawn from; a scene that was drawn from others is another one

    Raises
    ------
    DamagedFileError
    """
    of = [key, list(seed), settings.empty, settings.several, settings.covered, settings.sheets, settings.parts, among]
    # Scenes as before have the same names as before.
    made_of = json.dumps([*of, settings.uneven, settings.round] if settings.uneven or settings.round else of)
    path = Path(folder) / f"whole-{hashlib.sha256(made_of.encode()).hexdigest()[:16]}.npz"
    if not path.exists():
        rng = np.random.default_rng([*seed, *key.encode()])
        _write(path, compose(*parts(rng), settings, rng))
    return _read(path)


def compose(
    objects: Sequence[SceneParts],
    sheets: Sequence[Callable[[], SheetParts]],
    settings: WholeSettings,
    rng: np.random.Generator,
) -> WholeScene:
    """A scene of these objects, perhaps none, some of whose sheets are used, drawn from `rng`.

    Parameters
    ----------
    objects : at least one; an empty scene is one without it
    sheets : functions that give two sheets and a stand, called where they are needed; or none
    """
    empty = bool(rng.random() < settings.empty)
    if empty:
        objects = objects[:1]
    covered = bool(rng.random() < settings.covered) and bool(sheets)
    plan = _Plan(objects, sheets, covered, rng, empty=empty, uneven=settings.uneven)
    known = plan.covered and bool(rng.random() < _KNOWN)
    gains = [augmentation.drawn_gains(rng) for _ in objects]
    if settings.parts != "both":
        left_out = "specular" if settings.parts == "edge" else "edge"
        gains = [{**one, left_out: 0.0} for one in gains]
    if settings.round:
        gains = [
            {**one, "edge": one["edge"] * augmentation.amplitude(rng, *_ROUND_DB)}
            if rng.random() < settings.round
            else one
            for one in gains
        ]
    weaker = [1.0, *(augmentation.amplitude(rng, -10, 3) for _ in objects[1:])]
    if empty:
        weaker, gains = [0.0], [{**gains[0], "plate": 0.0}]
    images = {}
    for band in (band for band in BANDS if all(band in one.images for one in objects)):
        mine = gains if band == BANDS[0] else [augmentation.other_gains(one, rng) for one in gains]
        images[band] = plan.image(band, mine, weaker, rng)
    levels, raw, taken = {}, {}, {}
    axes = [SPACING * np.arange(size) for size in plan.shape[:2]]
    grid = VoxelGrid(x=axes[0], y=axes[1], z=DEPTH * np.arange(plan.shape[2]))
    for band, values in images.items():
        before = SarImage(grid=grid, values=values.astype(np.complex64))
        after = without_sheets(before, frequency=_MIDDLES[band], covered=known)
        power = np.square(after.magnitude)
        levels[band] = _levels_of(power)
        raw[band] = _levels_of(np.square(before.magnitude.mean(axis=2)))
        taken[band] = taken_db(after)
    inside = np.zeros_like(plan.objects) if empty else plan.objects
    return WholeScene(inside, plan.covered, levels, raw, taken)


class _Plan:
    """Where everything lies on the scene's lattice."""

    def __init__(
        self,
        objects: Sequence[SceneParts],
        sheets: Sequence[Callable[[], SheetParts]],
        covered: bool,
        rng: np.random.Generator,
        *,
        empty: bool = False,
        uneven: float = 0.0,
    ):
        self._objects, self.covered, self._uneven = objects, covered, uneven
        sides = np.round(rng.uniform(*_SIDES, 2) / SPACING).astype(int)
        sizes = np.array([one.inside.shape for one in objects])
        sides = np.maximum(sides, sizes.max(axis=0) - 12)
        gap = round(rng.uniform(*_GAP) / DEPTH)
        above = (gap if covered else 0) + int(rng.integers(2, 6))
        top = max(one.level for one in objects) + int(rng.integers(0, 3))
        self.shape = (int(sides[0]), int(sides[1]), top + above)
        self.objects = np.zeros(self.shape[:2], np.uint8)
        self._corners: list[tuple[int, int, int]] = []
        for number, one in enumerate(objects, 1):
            corner = self._free(one, rng)
            self._corners.append((*corner, 0))
            seen, own = _overlap(self.shape[:2], corner, one.inside.shape)
            self.objects[seen] = np.where(one.inside[own], number, self.objects[seen])
        places = np.argwhere(self.objects) if self.objects.any() else np.array([sides // 2])
        middle = places.mean(axis=0)
        self._placed: list[tuple[SheetParts, tuple[int, int, int], np.ndarray | None]] = []
        if covered:
            lid = sheets[0]()
            self._placed.append((lid, self._under(lid, middle, top + gap, rng), None))
        if empty and sheets and rng.random() < _STANDS:
            stand = sheets[2]()
            lowest = min(one.level for one in objects)
            self._placed.append((stand, self._under(stand, middle, lowest, rng), None))
        if sheets and rng.random() < 0.25:
            # A floor, in the shadow of the objects; or, higher than all, cloth or a second lid.
            second = sheets[1]()
            if rng.random() < 0.6 or not covered:
                lowest = min(one.level for one in objects) - int(rng.integers(3, 9))
                shadow = 1 - augmentation.blurred_once((self.objects > 0).astype(np.float32), 2.0)
                self._placed.append((second, self._under(second, middle, lowest, rng), shadow))
            else:
                higher = top + gap + int(rng.integers(1, 4))
                self._placed.append((second, self._under(second, middle, higher, rng), None))

    def _free(self, one: SceneParts, rng: np.random.Generator) -> tuple[int, int]:
        """A corner of an object's window, where the object lies in the scene and on no other, if there is one."""
        lit = np.argwhere(one.inside)
        if not len(lit):
            return 0, 0
        low, high = -lit.min(axis=0), np.array(self.shape[:2]) - 1 - lit.max(axis=0)
        low, high = np.minimum(low, high), np.maximum(low, high)
        corner = (0, 0)
        for _ in range(20):
            x, y = rng.integers(low, high + 1).tolist()
            corner = (x, y)
            seen, own = _overlap(self.shape[:2], corner, one.inside.shape)
            if not (one.inside[own] & (self.objects[seen] > 0)).any():
                break
        return corner

    def _under(
        self, sheet: SheetParts, middle: np.ndarray, level: int, rng: np.random.Generator
    ) -> tuple[int, int, int]:
        """A corner of a sheet's image such that it lies at a level, over the objects' middle."""
        size = np.array(sheet.images[BANDS[0]].shape[:2])
        slack = np.array([min(abs(sheet.reach[:2]).min(), 0.12), min(abs(sheet.reach[2:]).min(), 0.12)]) / SPACING
        corner = np.round(middle - (size - 1) / 2 + rng.uniform(-0.7, 0.7, 2) * slack).astype(int)
        # The image must reach over the whole scene.
        corner = np.clip(corner, np.minimum(np.array(self.shape[:2]) - size, 0), 0)
        return int(corner[0]), int(corner[1]), level - sheet.level

    def image(
        self, band: str, gains: Sequence[dict[str, float]], weaker: Sequence[float], rng: np.random.Generator
    ) -> np.ndarray:
        """(X, Y, Z) complex image of the scene by one radar."""
        total = np.zeros(self.shape, np.complex64)
        for one, corner, gain, share in zip(self._objects, self._corners, gains, weaker, strict=True):
            lit = share * augmentation.object_image(one, band, gain)
            if self._uneven:
                lit = lit * augmentation.patches(lit.shape[:2], rng, highest_db=self._uneven)[..., None]
            lit = lit + gain["plate"] * one.images[band][2]
            _add(total, _faded(lit), corner, np.exp(2j * np.pi * rng.random()))
        if rng.random() < 0.5:  # multipath between the objects and their surroundings
            total = total + augmentation.echo(total, rng, highest_db=-12, sideways=3)
        if self.covered and rng.random() < 0.5:  # and between them and the lid
            total = total + augmentation.echo(total, rng, highest_db=-8, sideways=0)
        strong = (-20, 25) if band == BANDS[0] else (-25, 12)
        for sheet, corner, shadow in self._placed:
            uneven = 1 + rng.uniform(0, 0.03) * augmentation.clouds(sheet.images[band].shape[:2], rng)
            one = sheet.images[band] * uneven[..., None].astype(np.float32)
            placed = np.zeros_like(total)
            _add(placed, one, corner, augmentation.amplitude(rng, *strong) * np.exp(2j * np.pi * rng.random()))
            if rng.random() < 0.5:  # within its layers
                placed = placed + augmentation.echo(placed, rng, highest_db=-8, sideways=0)
            total = total + (placed if shadow is None else placed * shadow[..., None])
        if rng.random() < 0.4:
            total = total + augmentation.clutter(self.shape, rng) * augmentation.amplitude(rng, -40, -12)
        noise = rng.standard_normal((2, *self.shape), dtype=np.float32)
        peak = abs(total).max()
        return augmentation.with_noise(total, noise, augmentation.amplitude(rng, -70, -30)) if peak > 0 else (
            noise[0] + 1j * noise[1]
        )  # fmt: skip


def _overlap(
    shape: Sequence[int], corner: Sequence[int], size: Sequence[int]
) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of an array of `shape` and of one of `size` whose first element lies at `corner` of it, where both are."""
    starts = [max(c, 0) for c in corner]
    stops = [max(min(c + n, s), max(c, 0)) for c, n, s in zip(corner, size, shape, strict=True)]
    seen = tuple(slice(a, b) for a, b in zip(starts, stops, strict=True))
    own = tuple(slice(a - c, b - c) for a, b, c in zip(starts, stops, corner, strict=True))
    return seen, own


def _add(total: np.ndarray, image: np.ndarray, corner: Sequence[int], factor: complex) -> None:
    seen, own = _overlap(total.shape, corner, image.shape)
    total[seen] += np.complex64(factor) * image[own]


def _faded(image: np.ndarray) -> np.ndarray:
    """An object's image (X, Y, Z), which goes to 0 at its sides."""
    ramps = [np.minimum(1, (0.5 + np.minimum(np.arange(n), n - 1 - np.arange(n))) / _FADED) for n in image.shape[:2]]
    return image * (ramps[0][:, None] * ramps[1])[..., None].astype(np.float32)


def _levels_of(power: np.ndarray) -> np.ndarray:
    """uint8 steps below the maximum; 255 of what is weaker."""
    relative = np.maximum(power / max(power.max(), 1e-30), 1e-30)
    return np.clip(np.round(-10 * np.log10(relative) / _STEPS_DB), 0, 255).astype(np.uint8)


def _power_of(levels: np.ndarray) -> np.ndarray:
    table = 10 ** (-_STEPS_DB * np.arange(256) / 10)
    return table.astype(np.float32)[levels]


def _write(path: Path, scene: WholeScene) -> None:
    nothing = np.zeros((0, 0), np.uint8)
    of_bands = {f"{band}_levels": scene.levels.get(band, nothing) for band in BANDS}
    of_bands |= {f"{band}_raw": scene.raw.get(band, nothing) for band in BANDS}
    taken = np.array([scene.taken_db.get(band, 0.0) for band in BANDS])
    write_arrays(path, {"objects": scene.objects, "covered": np.array(scene.covered), "taken": taken, **of_bands})


def _read(path: Path) -> WholeScene:
    names = [f"{band}_{what}" for band in BANDS for what in ("levels", "raw")]
    held = read_arrays(path, "objects", "covered", "taken", *names)
    bands: list[str] = [band for band in BANDS if held[f"{band}_raw"].size]
    if BANDS[0] not in bands or held["objects"].ndim != 2:
        raise DamagedFileError(f"{printable(path)} is not a scene of this training: it has no image; delete it")
    shape = held["objects"].shape
    expected: dict[str, tuple[type, tuple[int, ...]]] = {"objects": (np.uint8, shape), "covered": (np.bool_, ())}
    for band in bands:
        expected |= {
            f"{band}_levels": (np.uint8, (*shape, *held[f"{band}_levels"].shape[2:3])), f"{band}_raw": (np.uint8, shape)
        }  # fmt: skip
    check_arrays(path, held, expected | {"taken": (np.floating, (len(BANDS),))})
    levels, raw = ({band: held[f"{band}_{what}"] for band in bands} for what in ("levels", "raw"))
    taken = {band: float(held["taken"][BANDS.index(band)]) for band in bands}
    return WholeScene(held["objects"], bool(held["covered"]), levels, raw, taken)
