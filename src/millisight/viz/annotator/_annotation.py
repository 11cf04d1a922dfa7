"""What the annotator's page asks of one picture, answered in plain values: masks for prompts, and saving both."""

import base64
import importlib.metadata
import io
import json
import threading
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from millisight.core import atomic_path, checked_integer, printable, write_text
from millisight.core.errors import FileError, InputError, MillisightError, UnknownNameError
from millisight.data import Mask, Prompts
from millisight.evaluation import PUBLISHED_DEPTHS, camera_mask_of
from millisight.io.mito import origin, write_published
from millisight.perception.segmentation import Segmenter, chosen, largest_share, segmenter
from millisight.viz.annotator._coarse import Coarse
from millisight.viz.annotator._subject import OpenedPicture

_MOST_POINTS = 1000
_LARGEST_FILE = 1 << 24  # of prompts
_PENDING = "mask_pending"  # key in them: the mask was not written yet
_PHOTO_PIXELS = 50_000
"""Of a photo that a segmenter without a network sees, so that it answers within a second."""


def segmenters_for(
    subject: OpenedPicture, *, sam: str | None = None, device: str = "cpu"
) -> dict[str, Segmenter | str]:
    """The segmenters that the page offers by name, the one to begin with first, or why one cannot work here.

    Parameters
    ----------
    subject : OpenedPicture
    sam : a model of Segment Anything; None: it is not offered
    device : "cpu" or "cuda", for Segment Anything

    Raises
    ------
    FileError, FormatError, DeviceError, InputError
        `sam` cannot be had.
    """
    found: dict[str, Segmenter | str] = {}
    for name in ("wave", "classical"):
        try:
            by = segmenter(name)
        except (MillisightError, ImportError) as error:
            found[name] = str(error)
        else:
            found[name] = by if subject.is_radar else Coarse(by, _PHOTO_PIXELS)
    if not subject.is_radar:
        found["wave"] = "it works on radar images only"
    missing = "start millisight annotate with --model MODEL"
    try:
        found["sam"] = missing if sam is None else segmenter("sam", model=sam, device=device)
    except ImportError as error:
        raise InputError(str(error)) from error
    return found


class Question(NamedTuple):
    """What a mask is wanted for: a segmenter's name, and points; None: there are none."""

    method: str
    prompts: Prompts | None

    def same(self, other: "Question | None") -> bool:
        return other is not None and self.plain == other.plain

    @property
    def plain(self) -> dict[str, Any]:
        return {"method": self.method, **points_of(self.prompts)}


class FoundMask(NamedTuple):
    """A mask (A, B) on the picture, the segmenter's score for it, how long it took [s], and what is odd about it."""

    inside: np.ndarray
    score: float | None
    seconds: float
    note: str


class Annotation:
    """One picture being annotated, by any number of threads, one question at a time.

    Parameters
    ----------
    subject : OpenedPicture
    mask_path : where the mask is saved: HDF5 of a radar image, PNG of a photo; in the published form where it ends in
        .pkl, `radar_masks*.pkl` of a radar image and `camera_masks*.pkl` of a camera frame, or .h5 of a camera frame
    depth_range : of the object in a camera frame, for the published form [m]
    segmenters : by name; a text in the place of one says why it cannot work here
    method : the segmenter to begin with; None: the first that can work

    Raises
    ------
    InputError, UnknownNameError
        `method` cannot work on this picture, or does not exist; the mask's name ends otherwise.
    FileError
        There are prompts of another picture where these would be saved.
    """

    def __init__(
        self,
        subject: OpenedPicture,
        mask_path: Path,
        *,
        segmenters: Mapping[str, Segmenter | str],
        method: str | None = None,
        depth_range: tuple[float, float] = PUBLISHED_DEPTHS,
    ) -> None:
        self._depths = depth_range
        self.subject: OpenedPicture = subject
        self.mask_path: Path = _checked_name(mask_path, subject)
        self.prompts_path: Path = prompts_beside(mask_path)
        self._lock = threading.Lock()
        self._segmenters = dict(segmenters)
        able = [name for name, by in segmenters.items() if not isinstance(by, str)]
        if not able:
            raise InputError(f"no segmenter can be used: {'; '.join(map(str, segmenters.values()))}")
        if method is not None:
            self._segmenter(method)
        self._last: tuple[Question, FoundMask] | None = None
        self.saved_now: bool = False
        earlier, whole = self._read_prompts(able[0])
        self._saved = earlier if whole else None
        self._question = earlier or Question(able[0], None)
        if method is not None:
            self._question = self._question._replace(method=method)

    @property
    def unsaved(self) -> bool:
        """Whether the page has other points than the files, or points and no file."""
        touched = self._question.prompts is not None or self._saved is not None
        return touched and not self._question.same(self._saved)

    def about(self) -> dict[str, Any]:
        """What the page needs to know at first; points are places on the screen, [column, row]."""
        grid, asked = self.subject.picture.grid_xy, self._question.plain
        columns, rows = self.subject.size
        return {
            "name": printable(self.subject.path.name),
            "folder": self.subject.origin.rpartition("/")[0],
            "radar": self.subject.is_radar,
            "columns": columns,
            "rows": rows,
            "spacing": self.subject.spacing,
            "x": None if grid is None else grid.x.tolist(),
            "y": None if grid is None else grid.y[::-1].tolist(),
            "colours": self.subject.colormaps,
            "methods": [
                {"name": name, "hindrance": by if isinstance(by, str) else None}
                for name, by in self._segmenters.items()
            ],
            "files": [printable(self.mask_path), printable(self.prompts_path)],
            "saved": self._saved is not None and self._question.same(self._saved),
            "question": {**asked, "points": self.subject.on_screen(asked["points"]).tolist()},
        }

    def picture(self, colours: str) -> bytes:
        """PNG for the screen.

        Raises
        ------
        UnknownNameError
        """
        if self.subject.is_radar and colours not in self.subject.colormaps:
            raise UnknownNameError("colour map", colours, self.subject.colormaps)
        return _png(self.subject.coloured(colours))

    def mask(self, asked: Any) -> dict[str, Any]:
        """The mask for what the page asks, its bits row by row on the screen.

        Raises
        ------
        InputError
            What was asked cannot be right, or the segmenter finds no mask.
        """
        question = self._checked(asked)
        with self._lock:
            self._question = question
            answer = self._answered(question)
        bits = np.packbits(self.subject.shown(answer.inside))
        spacing = self.subject.spacing
        return {
            "bits": base64.b64encode(bits.tobytes()).decode(),
            "pixels": int(answer.inside.sum()),
            "area": float(answer.inside.sum() * spacing[0] * spacing[1]) if self.subject.is_radar else None,
            "score": answer.score,
            "seconds": answer.seconds,
            "note": answer.note,
        }

    def save(self, asked: Any) -> dict[str, Any]:
        """Write the mask for what the page asks, and the prompts, with where they come from.

        Raises
        ------
        InputError, FileError
        """
        question = self._checked(asked)
        with self._lock:
            self._question = question
            answer = self._answered(question)
            told = self._provenance(question, answer)
            # The points first, as not saved yet: they mark the mask as made by hand, whatever comes between.
            self._write_prompts({**told, _PENDING: True})
            self._write(answer.inside, told)
            self._write_prompts(told)
            self._saved, self.saved_now = question, True
        return {"files": [printable(self.mask_path), printable(self.prompts_path)]}

    def _write_prompts(self, told: Mapping[str, Any]) -> None:
        lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in told.items())
        write_text(self.prompts_path, f"{{\n{lines}\n}}\n")

    def _write(self, inside: np.ndarray, told: Mapping[str, Any]) -> None:
        """The mask, in the form that its file's name asks for."""
        from millisight.io import save

        grid, frame = self.subject.picture.grid_xy, self.subject.frame
        if grid is None and self.mask_path.suffix.lower() == ".png":
            with atomic_path(self.mask_path) as temporary:
                temporary.write_bytes(_png(inside.astype(np.uint8) * 255))
            return
        mask: Any = None if grid is None else Mask(grid_xy=grid, inside=inside)
        if frame is not None:
            mask = camera_mask_of(frame, inside, depth_range=self._depths)
        if self.mask_path.suffix.lower() == ".pkl":
            write_published(self.mask_path, mask)
        else:
            save(self.mask_path, mask, extras={"segmentation": dict(told)})

    def finish(self) -> None:
        """Wait until nothing is being written."""
        self._lock.acquire(timeout=10)

    def _answered(self, question: Question) -> FoundMask:
        if self._last is None or not question.same(self._last[0]):
            self._last = question, self._found(question)
        return self._last[1]

    def _found(self, question: Question) -> FoundMask:
        picture, by = self.subject.picture, self._segmenter(question.method)
        if question.prompts is None and by.needs_prompts:
            return FoundMask(np.zeros(picture.shape, dtype=bool), None, 0.0, "")
        begun = time.perf_counter()
        candidates = by.segment(picture, question.prompts)
        seconds = time.perf_counter() - begun
        limit, inner = largest_share(picture), largest_share(picture, inner=True)
        inside, note = chosen(candidates, largest=limit, inner=inner), ""
        if inside is None:
            inside = candidates.masks[0]
            share = f"{100 * inside.mean():.0f} % of the picture"
            note = f"The mask covers {share}, which is large for an object: right-click what does not belong to it."
        rank = next(k for k, mask in enumerate(candidates.masks) if np.array_equal(mask, inside))
        return FoundMask(inside, float(candidates.scores[rank]), seconds, note)

    def _checked(self, asked: Any) -> Question:
        if not isinstance(asked, dict) or set(asked) != {"method", "points", "positive"}:
            raise InputError("expected a method, points and positive in the request; reload the page")
        self._segmenter(asked["method"])
        return Question(asked["method"], self._prompts(asked))

    def _segmenter(self, name: Any) -> Segmenter:
        if not isinstance(name, str) or name not in self._segmenters:
            raise UnknownNameError("segmenter", name, self._segmenters)
        by = self._segmenters[name]
        if isinstance(by, str):
            raise InputError(f"{name} cannot be used: {by}")
        return by

    def _prompts(self, asked: dict[str, Any]) -> Prompts | None:
        """Of places on the screen."""
        places = asked["points"]
        if not isinstance(places, list) or len(places) > _MOST_POINTS:
            raise InputError(f"points must be a list of {_MOST_POINTS} at most")
        if not places:
            return None
        if not all(isinstance(place, list) and len(place) == 2 for place in places):
            raise InputError("points must be pairs of a column and a row")
        for place in places:
            for value, limit in zip(place, self.subject.size, strict=True):
                if checked_integer(value, name="point", minimum=0) >= limit:
                    raise InputError(f"the point {place} is not on the picture")
        return Prompts.from_plain(
            {"points": self.subject.on_picture(np.array(places)).tolist(), "positive": asked["positive"]}
        )

    def _provenance(self, question: Question, answer: FoundMask) -> dict[str, Any]:
        other = self.subject.other_band
        return {
            **points_of(question.prompts),
            "method": question.method,
            "score": answer.score,
            "image": self.subject.origin,
            "image_sha256": self.subject.sha256,
            "other_band": None if other is None else origin(other),
            "mask": printable(self.mask_path.name),
            "made": f"{datetime.now(UTC).isoformat(timespec='seconds')} by millisight annotate, "
            f"millisight {importlib.metadata.version('millisight')}",
        }

    def _read_prompts(self, otherwise: str) -> tuple[Question | None, bool]:
        """What an earlier session saved of this picture, to go on from; and whether its mask is there, too."""
        path = self.prompts_path
        if not path.is_file():
            return None, False
        try:
            if path.stat().st_size > _LARGEST_FILE:
                raise InputError("it is too large")
            told = json.loads(path.read_text(encoding="utf-8"))
            if told["image_sha256"] != self.subject.sha256:
                raise InputError(f"it is of another picture, {told['image']}")
            points = {name: told[name] for name in ("points", "positive")}
            prompts = Prompts.from_plain(points) if told["points"] else None
            if prompts is not None:
                prompts.check_on(self.subject.picture)
        except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
            reason = error if isinstance(error, MillisightError) else "it holds something else"
            raise FileError(
                f"{printable(path)} would be overwritten, and is not an earlier annotation of this picture: {reason}; "
                "choose another --output, or move it away"
            ) from error
        whole = _PENDING not in told and self.mask_path.is_file()
        try:
            self._segmenter(told["method"])
        except (MillisightError, LookupError):
            return Question(otherwise, prompts), whole
        return Question(told["method"], prompts), whole


def _checked_name(mask_path: Path, subject: OpenedPicture) -> Path:
    """A name that a mask of this picture can have."""
    suffix = mask_path.suffix.lower()
    if subject.is_radar:
        known, start = (".h5", ".pkl"), "radar_masks"
    else:
        known, start = ((".png",) if subject.frame is None else (".png", ".h5", ".pkl")), "camera_masks"
    if suffix not in known:
        raise InputError(
            f"the mask would be written to {printable(mask_path)}; expected a name that ends in {' or '.join(known)}"
        )
    if suffix == ".pkl" and not mask_path.name.startswith(start):
        raise InputError(f"a mask in the published form is called {start}*.pkl, not {printable(mask_path.name)}")
    return mask_path


def prompts_beside(mask_path: Path) -> Path:
    """Where the prompts of a mask lie: mug.prompts.json beside mug.mask.h5."""
    return mask_path.with_name(f"{mask_path.stem.removesuffix('.mask')}.prompts.json")


def points_of(prompts: Prompts | None) -> dict[str, Any]:
    """The plain lists of prompts, empty for none."""
    return {"points": [], "positive": []} if prompts is None else prompts.plain


def _png(pixels: np.ndarray) -> bytes:
    from PIL import Image

    held = io.BytesIO()
    Image.fromarray(pixels).save(held, "PNG", compress_level=1)
    return held.getvalue()
