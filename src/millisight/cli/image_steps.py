"""What `millisight image` does with one capture: background, clocks, focus, sheets, and the image."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.cli.console import progress, say, say_sampling
from millisight.cli.grids import check_memory, parse_grid
from millisight.cli.sources import Opened, Source, sources
from millisight.core import file_version, printable, toml_of
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Capture, SarImage, VoxelGrid
from millisight.imaging import (
    CLUTTER,
    METHODS,
    WINDOWS,
    DetectedSheet,
    SheetRemoval,
    form_as_published,
    form_image,
    form_image_to,
    image_slabs,
    memory_needed,
    remove_sheets,
    sampling,
    sheets_told,
)

if TYPE_CHECKING:
    from millisight.calibration import RadarCalibration


_LOOKED_AT = 200  # poses, of which it is told how much a background took
_BORDER = 0.12  # of the scan's, that a lid which ends within it may reach, by its corners too


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """The options that are the same for every capture."""

    grid: str | None
    method: str | None
    window: str | None
    tolerance: float | None
    clock: str
    focus: str
    clutter: str | None
    data: Path | None
    background: list[Source]
    calibration: "Sequence[RadarCalibration]"
    as_published: bool
    outline: str | None
    db: bool
    colormap: str | None = None
    memory: float | None = None  # [bytes]
    device: str = "cpu"

    def asked(self, source: Source) -> dict[str, Any]:
        """What decides the values of the image of a capture, as its metadata hold it."""
        values = {name: getattr(self, name) for name in ("grid", "method", "window", "tolerance", "clock")}
        if self.focus != "none":
            values["focus"] = self.focus
        if self.as_published:
            values["as_published"] = True
        if self.clutter is not None:
            values["clutter"] = self.clutter
        if self.calibration:
            values["calibration"] = [toml_of(one) for one in self.calibration]
        return {**values, "background": [one.name for one in self.background], "files": self._files_of(source)}

    def _files_of(self, source: Source) -> str:
        """A checksum of the files that the image is made of, known by names, sizes and times."""
        found = hashlib.sha256()
        for one in (source, *self.background):
            for path in one.files(self.data):
                line = " ".join([printable(path.name), *map(str, file_version(path.stat()))])
                found.update(f"{line}\n".encode())
        return found.hexdigest()


def image_of(opened: Opened, source: Source, settings: ImageSettings, label: str) -> SarImage:
    """The image of a capture, with all that comes before and after it.

    Takes a known lid that ends within scan and image off the image, which shows its edges better than frames do.
    """
    capture, voxels, clutter = prepared(opened, source, settings, label)
    found, middle = remove_sheets(capture, clutter=clutter, grid=voxels), capture.radar.waveform.center_frequency
    if clutter == "lid" and found.sheets and all(_ends_within(sheet, voxels) for sheet in found.sheets):
        formed = _form(capture, voxels, settings, label)
        of_image = remove_sheets(formed, clutter=clutter, frequency=middle)
        if of_image.sheets:
            return _told(of_image, clutter)
        say("clutter: the image does not show the lid that the frames show; it is taken off these, and imaged again")
        del formed, of_image
    formed = _form(_told(found, clutter), voxels, settings, label)
    return formed if found.sheets else _told(remove_sheets(formed, clutter=clutter, frequency=middle), clutter)


def large_image_of(
    path: Path, opened: Opened, source: Source, settings: ImageSettings, memory: float, label: str
) -> tuple[float, np.ndarray] | None:
    """Write the image in slabs, of at most that memory [bytes]; its peak and its place [m]. None: it fits whole."""
    capture, voxels = opened.capture, parse_grid(settings.grid, opened.capture)
    needed = memory_needed(capture, voxels)
    if needed <= memory:
        return None
    slabs = len(image_slabs(capture, voxels, memory=memory))
    say(
        f"memory: the image takes about {needed / 1e9:.2g} GB whole; it is formed in {slabs} slabs of at most "
        f"{memory / 1e9:.2g} GB, with {8 * voxels.size / 1e9:.2g} GB on disk for what is done"
    )
    capture, voxels, clutter = prepared(opened, source, settings, label)
    found = remove_sheets(capture, clutter=clutter, grid=voxels)
    capture = _told(found, clutter)
    if clutter != "none" and not found.sheets:
        raise InputError(
            "no sheet was found in the frames, and an image in slabs cannot be searched for one: leave --clutter out, "
            "or give more --memory"
        )
    method, window = _stated_settings(capture, settings)
    with progress(f"{label}image by {method}") as report:
        return form_image_to(
            path, capture, voxels, memory=memory, method=method, window=window, tolerance=settings.tolerance,
            asked=settings.asked(source), progress=report,
        )  # fmt: skip


def prepared(opened: Opened, source: Source, settings: ImageSettings, label: str) -> tuple[Capture, VoxelGrid, str]:
    """The capture as it is imaged, the voxels, and what clutter is to be taken off."""
    capture = without_background(
        opened.capture, source, settings.background, settings.data, as_published=settings.as_published
    )
    capture = _calibrated(capture, settings.calibration)
    voxels = parse_grid(settings.grid, capture)
    if settings.memory is None:
        check_memory(capture, voxels)
    capture = on_time(Opened(capture, opened.log), voxels, settings.clock, label)
    say(f"grid: {' x '.join(map(str, voxels.shape))} voxels, {capture.channels} channels")
    if len(capture.trajectory) > 1:
        with progress(f"{label}sampling"):
            sampled = sampling(capture, voxels)
        say_sampling(sampled)
    capture = _in_focus(capture, voxels, settings.focus, label)
    return capture, voxels, settings.clutter or _stated(capture).get("clutter") or "none"


@contextmanager
def one_opened(source: Path, radar: str | None, data: Path | None) -> Iterator[tuple[Opened, Source]]:
    """The one capture at a path, open, and where it was found; what is odd about it is said.

    Raises
    ------
    InputError
        The path holds several captures.
    """
    found = sources([source], radar)
    if len(found) != 1:
        names = ", ".join(one.name for one in found)
        raise InputError(f"{source} holds {len(found)} captures ({names}); pass one, or choose with --radar")
    with found[0].opened(data) as opened:
        for note in (*opened.notes, *oddities(opened.capture)):
            say(note)
        yield opened, found[0]


def one_capture(source: Path, radar: str | None, data: Path | None) -> tuple[Capture, str]:
    """The one capture at a path, in memory, and a name for its outputs.

    Raises
    ------
    InputError
        The path holds several captures.
    """
    with one_opened(source, radar, data) as (opened, found):
        capture = opened.capture
        if not capture.in_memory:
            capture = replace(capture, frames=capture.frames_of(slice(0, len(capture.trajectory))))
        return capture, found.name


def oddities(capture: Capture) -> list[str]:
    """Warnings of what is possible, but more often a unit that was forgotten."""
    found = []
    frequency, extent = capture.radar.waveform.center_frequency, float(capture.trajectory.extent.max())
    if not 1e8 <= frequency <= 1e12:
        found.append(f"warning: the centre frequency is {frequency:.3g} Hz; is its unit right?")
    if extent > 10 and not capture.metadata.get("far_field"):
        found.append(f"warning: the aperture is {extent:.3g} m large; is the unit of the positions right?")
    short = [name for step in capture.metadata.get("history", ()) for name in step.get("short_rows", ())]
    if short:
        which = short[0] if len(short) == 1 else f"{short[0]} and {len(short) - 1} more"
        found.append(f"warning: {which}: far fewer frames than other rows; was the file cut short?")
    return found


def _stated(capture: Capture) -> Mapping[str, Any]:
    """The image settings of the capture's description."""
    stated: Any = capture.metadata.get("imaging")
    return stated if isinstance(stated, Mapping) else {}


def check_stated(capture: Capture, settings: ImageSettings) -> None:
    stated = _stated(capture)
    for key, known in (("method", METHODS), ("window", ("none", *WINDOWS)), ("clutter", CLUTTER)):
        if stated.get(key) and not getattr(settings, key) and stated[key] not in known:
            raise UnknownNameError(f"{key} in {capture.metadata.get('description')}, [image]:", stated[key], known)


def _told(found: SheetRemoval[Any], clutter: str) -> Any:
    """The capture or the image without sheets; what was taken is said, or why nothing was, if it was asked for."""
    if clutter != "none":
        what = "image" if isinstance(found.result, SarImage) else "frames"
        for sheet in found.sheets:
            _tell(sheet, what)
        if not found.sheets:
            say(f"clutter: nothing taken off the {what}: {found.reason}")
    return found.result


def tell_sheets(metadata: Mapping[str, Any], clutter: str) -> None:
    """Say which sheets were taken off before the result with these metadata was made."""
    told = sheets_told(metadata)
    for sheet in told:
        _tell(sheet, "image or the frames")
    if clutter != "none" and not told:
        say("clutter: nothing taken off")


def _tell(sheet: DetectedSheet, what: str) -> None:
    say(f"clutter: a sheet taken off the {what}: {sheet}; {100 * sheet.power:.0f} % of its power")


def _ends_within(sheet: DetectedSheet, grid: VoxelGrid) -> bool:
    """Whether a lid that was found in frames ends within the scan and the grid, on all sides."""
    ends = zip((grid.x, grid.y), sheet.lower, sheet.upper, strict=True)
    return sheet.border < _BORDER and all(axis.min() < low and high < axis.max() for axis, low, high in ends)


def _form(capture: Capture, voxels: VoxelGrid, settings: ImageSettings, label: str) -> SarImage:
    """The image; what the command line leaves open is as the capture's description states it."""
    if settings.as_published:
        say("as published: the nearest of 4096 range bins below, and the phase of the first frequency, not paper Eq. 1")
        with progress(f"{label}image as published") as report:
            return form_as_published(capture, voxels, progress=report)
    method, window = _stated_settings(capture, settings)
    with progress(f"{label}image by {method}") as report:
        return form_image(
            capture, voxels, method=method, window=window, tolerance=settings.tolerance, device=settings.device,
            progress=report,
        )  # fmt: skip


def _stated_settings(capture: Capture, settings: ImageSettings) -> tuple[str, Any]:
    """Method and window as asked, or as the capture's description states them."""
    stated = _stated(capture)
    window = settings.window or stated.get("window") or "none"
    return settings.method or str(stated.get("method", "fast")), None if window == "none" else window


def without_background(
    capture: Capture, source: Source, empties: Sequence[Source], data: Path | None, *, as_published: bool = False
) -> Capture:
    """The capture less the empty scene's, where one is given for its radar: pose by pose, or its first frame."""
    if not empties:
        return capture
    from millisight.calibration import subtract_background

    for empty in empties:
        if empty.radar == source.radar:
            with empty.opened(data, "read background", as_published=as_published) as opened:
                cleaned, what = None, "its first frame is taken off all"
                if not as_published:
                    with suppress(InputError):  # other poses; another radar is refused below
                        cleaned = subtract_background(capture, opened.capture, frame="same")
                        what = "it has the same poses, and each frame is taken off its own"
                cleaned = cleaned or subtract_background(capture, opened.capture, frame="first")
                say(f"background: {what}; {_left_db(capture, cleaned):.1f} dB of the power are left")
                return cleaned
    say(f"background: no capture of the {source.radar} radar; nothing is subtracted")
    return capture


def _left_db(before: Capture, after: Capture) -> float:
    """The power of some frames after over that before [dB]."""
    some = slice(0, min(_LOOKED_AT, len(before.trajectory)))
    had, left = (float((np.abs(one.frames_of(some)) ** 2).sum()) for one in (before, after))
    return 10 * float(np.log10(max(left, 1e-30) / max(had, 1e-30)))


def _calibrated(capture: Capture, calibrations: "Sequence[RadarCalibration]") -> Capture:
    """The capture with the calibration of its radar, where one is given."""
    if not calibrations:
        return capture
    name = capture.radar.name
    for one in calibrations:
        if one.radar == name:
            say(f"calibration: {name}: mount, path offset and gains of the channels")
            return one.apply(capture)
    say(f"warning: no --calibration is of the radar {name}; it is imaged as it is")
    return capture


def on_time(opened: Opened, voxels: VoxelGrid, clock: str, label: str) -> Capture:
    """The capture, its poses put right for the clocks' offset and drift where that was asked for."""
    if clock == "given":
        return opened.capture
    if opened.log is None:
        raise InputError(f"--clock {clock} needs a robot log, and this capture has none")
    from millisight.calibration import retime
    from millisight.imaging import estimate_clock

    with progress(f"{label}clock") as report:
        found = estimate_clock(opened.capture, opened.log, voxels, progress=report)
    if found.clock is None:
        say(f"clock: not observable: {found.reason}")
        return opened.capture
    offset, drift = found.clock.offset * 1e3, found.clock.drift * 1e6
    side = "behind" if offset < 0 else "ahead"
    say(
        f"clock: the robot's clock is {side} by {abs(offset):.2f} +- {found.offset_uncertainty * 1e3:.2f} ms at "
        f"{found.clock.reference_time:.3f} s, and drifts by {drift:.1f} +- {found.drift_uncertainty * 1e6:.1f} ppm"
        f"{'' if clock == 'apply' else '; not corrected (use --clock apply)'}"
    )
    return retime(opened.capture, opened.log, found.clock) if clock == "apply" else opened.capture


def _in_focus(capture: Capture, voxels: VoxelGrid, focus: str, label: str) -> Capture:
    """The capture, its path put right by the sharpness of the image where that was asked for."""
    if focus == "none":
        return capture
    from millisight.imaging import autofocus

    with progress(f"{label}focus") as report:
        found = autofocus(capture, voxels, focus=focus, progress=report)
    if "rows" in found.applied:
        worst = float(abs(found.row_offsets).max())
        say(f"focus: rows corrected by up to {worst:.1f} +- {found.row_uncertainty:.1f} frames")
    if found.applied:
        farthest = 1e3 * float((found.displacements**2).sum(axis=1).max()) ** 0.5
        say(
            f"focus: poses corrected by up to {farthest:.2f} mm (along the line of sight +- "
            f"{1e3 * found.uncertainty:.3f} mm); contrast increased by {100 * (found.gain - 1):.0f} %"
        )
    if found.reason:
        say(f"focus: {found.reason}")
    return found.capture
