"""Several objects in one image: a map of scores cut into one part for each peak that stands out.

The map is flooded from its peaks downwards. Where the floods of two peaks meet, at a saddle, the lower peak ends in the
higher one if it rises less than `prominence` above the saddle; otherwise they stay apart, and the saddle is the border:
a watershed merged by the depth of saddles (Chazal et al. 2013, "Persistence-based clustering", doi:10.1145/2535927).
Of each part only what lies so far below its own peak is the object, so that a dim object beside a bright one keeps its
outline. How far depends on what is seen: a flat face is as bright throughout, and at its edge has half its amplitude; a
round body shows a glint, and its flanks far below it.
"""

from typing import Any

import numpy as np

from millisight.core import check_known, checked_number, checked_record, put, record, widths_in_samples
from millisight.core.errors import InputError
from millisight.data import Instances, Prompts, SarImage
from millisight.imaging import SheetRemoval
from millisight.perception import HIGH_BAND, project, without_sheets
from millisight.perception.segmentation._heights import beneath, between, lid_over, without_support
from millisight.perception.segmentation._parts import parts_of
from millisight.perception.segmentation._segmentation import (
    Segmenter,
    checked_segmenter,
    find_mask,
    largest_share,
    segmenter,
)

_NEIGHBOURS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
_LOWEST_DB = -120.0
_DARK = 10  # percentile of the picture


@record
class InstanceSettings:
    """How objects are told apart in an image; the defaults suit 77 GHz images of the virtual rig.

    Attributes
    ----------
    smoothing : standard deviation of the Gaussian by which the picture's power is averaged first [m]
    dimmest_db : below the picture's maximum, of an object's peak
    contrast_db : above the darkest tenth of the picture, where objects begin
    prominence_db : by which a peak rises above the saddle to a higher one, or else it is part of that one's object; and
        above where objects begin, or else there is none
    face_db, glint_db : below an object's own peak, to which it reaches: of a flat face, and of anything else
    flat : share of the area down to `glint_db` that lies above `face_db`, from which on it is a flat face
    smallest : area of an object [m^2]
    """

    smoothing: float = 0.002
    dimmest_db: float = 23.0
    contrast_db: float = 10.0
    prominence_db: float = 7.0
    face_db: float = 8.0
    glint_db: float = 26.0
    flat: float = 0.16
    smallest: float = 5e-5

    def __post_init__(self) -> None:
        put(
            self,
            smoothing=checked_number(self.smoothing, name="smoothing", unit="m", minimum=0),
            **{
                name: checked_number(getattr(self, name), name=name, unit="dB", minimum=0)
                for name in ("dimmest_db", "contrast_db", "prominence_db", "face_db", "glint_db")
            },
            flat=checked_number(self.flat, name="flat", minimum=0),
            smallest=checked_number(self.smallest, name="smallest", unit="m^2", minimum=0),
        )


def split_instances(
    scores: np.ndarray,
    *,
    lowest: float,
    prominence: float,
    drops: tuple[float, float] = (np.inf, np.inf),
    flat: float = 0.0,
    smallest: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Cut a map of scores into one part for each peak that stands out.

    Parameters
    ----------
    scores : (A, B), higher on objects: decibels, or probabilities; -inf or nan where there is none
    lowest : what lies below it belongs to nothing
    prominence : by which a peak rises above `lowest`, and above the saddle to a higher peak
    drops : below its own peak, to which a part reaches: one that is flat on top, and another
    flat : share of the pixels down to the second of `drops` that lie above the first, above which a part is flat on top
    smallest : number of pixels of a part

    Returns
    -------
    labels (A, B) int32, from 1 on by falling peak and 0 elsewhere, and the peaks (K,).

    Raises
    ------
    InputError
        An argument is none of these.

    Examples
    --------
    >>> split_instances([[0, 5, 3, 2.5, 4, 0]], lowest=1, prominence=1)[0].tolist()
    [[0, 1, 1, 2, 2, 0]]
    >>> split_instances([[0, 5, 3, 2.5, 4, 0]], lowest=1, prominence=2)[0].tolist()
    [[0, 1, 1, 1, 1, 0]]
    """
    from scipy.ndimage import binary_fill_holes

    heights = np.asarray(scores, float)
    if heights.ndim != 2:
        raise InputError(f"scores have the shape {heights.shape}; expected (A, B)")
    for name, value in (("prominence", prominence), ("drops", min(drops)), ("flat", flat), ("smallest", smallest)):
        if not value >= 0:
            raise InputError(f"{name} is {value}; expected 0 or more")
    basins, tops = _flooded(np.where(np.isnan(heights), -np.inf, heights), lowest, prominence)
    parts = []
    for number, top in enumerate(tops, 1):
        if top - lowest >= prominence:
            face, glint = ((basins == number) & (heights >= top - drop) for drop in drops)
            inside = _around_peak(face if face.sum() > flat * glint.sum() else glint, heights)
            if inside.sum() >= smallest:
                parts.append((top, inside))
    parts.sort(key=lambda part: -part[0])
    labels = np.zeros(heights.shape, np.int32)
    for number, (_, inside) in enumerate(parts, 1):
        labels[inside] = number
    for number in range(1, len(parts) + 1):
        labels[(labels == 0) & np.asarray(binary_fill_holes(labels == number))] = number
    return labels, np.array([top for top, _ in parts])


def _flooded(heights: np.ndarray, lowest: float, prominence: float) -> tuple[np.ndarray, list[float]]:
    """Basins (A, B) from 1 on, of peaks that rise by `prominence` above their saddles, and the heights of the peaks."""
    rows, columns = heights.shape
    order = np.argsort(-heights, axis=None, kind="stable")
    order = order[heights.ravel()[order] >= lowest]
    values = heights.ravel().tolist()
    owner: dict[int, int] = {}  # of pixels: the peak's pixel that flooded them
    parent: dict[int, int] = {}  # of peaks: themselves, or a higher one that they are part of

    def peak_of(pixel: int) -> int:
        peak = owner[pixel]
        while parent[peak] != peak:
            parent[peak] = parent[parent[peak]]
            peak = parent[peak]
        return peak

    for pixel in order.tolist():
        i, j = divmod(pixel, columns)
        near = [(i + di) * columns + j + dj for di, dj in _NEIGHBOURS if 0 <= i + di < rows and 0 <= j + dj < columns]
        known = [one for one in near if one in owner]
        if not known:
            owner[pixel] = parent[pixel] = pixel
            continue
        owner[pixel] = peak_of(max(known, key=values.__getitem__))
        met = sorted({peak_of(one) for one in known}, key=values.__getitem__, reverse=True)
        for peak in met[1:]:
            if values[peak] - values[pixel] < prominence:
                parent[peak] = met[0]
    basins = np.zeros(heights.size, np.int32)
    numbers: dict[int, int] = {}
    for pixel in owner:
        basins[pixel] = numbers.setdefault(peak_of(pixel), len(numbers) + 1)
    return basins.reshape(heights.shape), [values[peak] for peak in numbers]


def _around_peak(inside: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """The connected part (A, B) that holds the highest pixel."""
    if not inside.any():
        return inside
    parts, _ = parts_of(inside)
    return parts == parts.flat[np.where(inside, heights, -np.inf).argmax()]


def instance_levels(image: SarImage, *, smoothing: float = 0.0, values: str = "mean") -> np.ndarray:
    """(X, Y) power of an image projected along z, averaged over `smoothing` [m], in decibels below its maximum.

    Raises
    ------
    UnknownNameError
        No such projection.
    """
    from scipy.ndimage import gaussian_filter

    seen: Any = project(image, values=values).power
    power = np.square(seen, dtype=float)
    smooth = np.asarray(gaussian_filter(power, widths_in_samples(smoothing, image.grid.x, image.grid.y)))
    return 10 * np.log10(np.maximum(smooth / max(smooth.max(), 1e-300), 10 ** (_LOWEST_DB / 10)))


def segment_instances(
    image: SarImage,
    *,
    other_band: SarImage | None = None,
    method: str | Segmenter | None = None,
    settings: InstanceSettings | None = None,
    prompts: Prompts | None = None,
    rng: int | np.random.Generator | None = None,
    condition: str = "los",
    values: str = "mean",
    largest: float | None = None,
    support: float | None = None,
) -> Instances:
    """Segment every object in an image: one mask for each, none where there is no object.

    Parameters
    ----------
    image : SarImage; of a covered scene, a lid is taken off it (`millisight.imaging.remove_sheets`)
    other_band : the same scene at the radar's other frequency, for `method`
    method : a segmenter by name, or one, to whose mask the objects are restricted, of any size; None: to none
    settings : InstanceSettings; None: the defaults
    prompts, rng : of the segmenter, see `segment`
    condition : "nlos" where something is known to cover the scene: objects then lie below it, and not beside it; "los"
    values : projection of |I| along z, "mean", "max" or "rms"
    largest : share of the picture that an object may cover; None: `largest_share`
    support : height z of what the objects lie on [m]: what rises no higher is no object; None: unknown

    Returns
    -------
    Instances
        On the image's grid seen along z. An object's score is its peak over the darkest tenth of the picture [dB].

    Raises
    ------
    InputError, UnknownNameError
        As `segment`, of the segmenter; or another band is given, and no segmenter.
    """
    if other_band is not None and method is None:
        raise InputError('other_band is for the segmenter; pass one with it, such as method="wave", or leave it out')
    settings = InstanceSettings() if settings is None else checked_record(settings, InstanceSettings, name="settings")
    check_known("condition", condition, ("los", "nlos"))
    if support is not None:
        support = checked_number(support, name="support", unit="m")
    covered = condition == "nlos"
    if support is not None and not covered:
        image = without_support(checked_record(image, SarImage, name="image"), support)
    cleaned = without_sheets(image, frequency=HIGH_BAND, covered=True) if covered else image
    picture = project(cleaned, values=values)
    if picture.power is None or not picture.power.any():
        return Instances(grid_xy=image.grid.xy, labels=np.zeros(image.grid.xy.shape, np.int32), scores=np.zeros(0))
    levels = instance_levels(cleaned, smoothing=settings.smoothing, values=values)
    dark = float(np.percentile(levels, _DARK))
    shown = levels
    if method is not None:
        by = segmenter(method) if isinstance(method, str) else checked_segmenter(method)
        other = None if other_band is None else project(other_band, values=values)
        seen = project(image, other_band=other_band, values=values)
        found = find_mask(
            by, seen, other=other, prompts=prompts, rng=rng, condition=condition, largest=1.0, support=support
        )
        shown = np.where(found.inside, levels, -np.inf)
    area = float(np.prod([np.ptp(axis) / max(len(axis) - 1, 1) for axis in (image.grid.x, image.grid.y)]))
    limit = largest_share(picture) if largest is None else largest
    how: dict[str, Any] = {
        "lowest": dark + settings.contrast_db,
        "prominence": settings.prominence_db,
        "flat": settings.flat,
        "smallest": max(1, round(settings.smallest / area)) if area else 1,
    }
    labels, peaks = split_instances(shown, drops=(settings.face_db, settings.glint_db), **how)
    # Down to a glint's flanks a face may reach into what is left of a lid all around it.
    large = [number for number in range(1, len(peaks) + 1) if (labels == number).mean() > limit]
    faces = split_instances(shown, drops=(settings.face_db, settings.face_db), **how)[0] if large else labels
    for number in large:
        whole = labels == number
        face = faces.flat[np.where(whole, shown, -np.inf).argmax()]
        labels[whole & (faces != face)] = 0
    taken, lid = lid_over(image, cleaned) if covered else (None, None)
    likely = [
        number
        for number, peak in enumerate(peaks, 1)
        if peak >= -settings.dimmest_db and (labels == number).mean() <= limit
    ]
    fits = [number for number in likely if _lies_there(labels == number, cleaned, support, lid, taken)]
    if not fits and support is None:  # what was taken for the lid may be a floor
        fits = [number for number in likely if _lies_there(labels == number, cleaned, None, None, taken)]
    kept = np.zeros(labels.shape, np.int32)
    for new, number in enumerate(fits, 1):
        kept[labels == number] = new
    return Instances(grid_xy=image.grid.xy, labels=kept, scores=np.array([peaks[number - 1] - dark for number in fits]))


def _lies_there(
    inside: np.ndarray,
    cleaned: SarImage,
    support: float | None,
    lid: float | None,
    taken: SheetRemoval[SarImage] | None,
) -> bool:
    """Whether an object may lie where a mask (X, Y) is: above the support, below the lid that was taken, if any."""
    low = between(inside, cleaned, support=support, lid=lid, surely=True)
    if taken is None or not taken.sheets:
        return bool(low.any())
    return bool(beneath(low, cleaned, taken, surely=True).any())
