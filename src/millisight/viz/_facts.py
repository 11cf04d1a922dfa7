"""What a record is, in a few words: what `millisight info` prints, and a notebook shows beside the picture."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from millisight.core import box
from millisight.data import (
    Capture,
    Instances,
    Mask,
    PointCloud,
    Radar,
    SarImage,
    Surface,
    TriangleMesh,
    VolumeMask,
    Waveform,
)
from millisight.imaging import sampling

_MOST_VOXELS = 8_000_000  # of which the peak is looked for quickly


def facts_of(record: Any, *, quick: bool = False) -> list[tuple[str, str]]:
    """Facts of a record: (name, fact), with one "step" for each entry of its history.

    Parameters
    ----------
    record : Capture, SarImage, Mask, Instances, VolumeMask, PointCloud, Surface or TriangleMesh; of others the kind
        alone is told
    quick : leave out what takes long to find in a large record
    """
    if isinstance(record, Capture):
        return [*_of_capture(record, quick), *_steps(record.metadata)]
    if isinstance(record, SarImage):
        return [*_of_image(record, quick), *_steps(record.metadata)]
    if isinstance(record, Mask):
        size = " x ".join(map(str, record.grid_xy.shape))
        inside = f"{int(record.inside.sum())} pixels, {100 * record.inside.mean():.1f} %"
        return [("record", f"Mask, {size} pixels"), ("grid", box(*record.grid_xy.bounds)), ("inside", inside)]
    if isinstance(record, Instances):
        size = " x ".join(map(str, record.grid_xy.shape))
        of = ", ".join(str(int(mask.inside.sum())) for mask in record)
        objects = f"{len(record)}" + (f", of {of} pixels" if of else "")
        return [("record", f"Instances, {size} pixels"), ("grid", box(*record.grid_xy.bounds)), ("objects", objects)]
    if isinstance(record, VolumeMask):
        size = " x ".join(map(str, record.grid.shape))
        inside = f"{int(record.inside.sum())} voxels, {100 * record.inside.mean():.1f} %"
        return [("record", f"VolumeMask, {size} voxels"), ("grid", box(*record.grid.bounds)), ("inside", inside)]
    if isinstance(record, PointCloud):
        facts = [("record", f"PointCloud, {len(record)} points")]
        if len(record):
            facts.append(("box", box(record.points.min(axis=0), record.points.max(axis=0))))
        return [*facts, *_steps(record.metadata)]
    if isinstance(record, Surface):
        size = f"{len(record.mesh.vertices)} vertices, {1e4 * record.mesh.area:.1f} cm²"
        return [("record", f"Surface, {size}"), ("box", box(*record.mesh.bounds)), *_steps(record.metadata)]
    if isinstance(record, TriangleMesh):
        size = f"{len(record.vertices)} vertices, {len(record.faces)} faces"
        return [("record", f"TriangleMesh, {size}"), ("box", box(*record.bounds))]
    return [("record", type(record).__name__)]


def radar_facts(radar: Radar) -> str:
    """A radar in a line."""
    resolution = radar.waveform.range_resolution * 100
    return (
        f"{radar.name}, {band_of(radar.waveform)}, range resolution {resolution:.3g} cm, "
        f"path offset {radar.path_offset:g} m"
    )


def band_of(waveform: Waveform) -> str:
    """The first and the last frequency."""
    first, last = waveform.frequencies[[0, -1]]
    return f"{first / 1e9:.4f} to {last / 1e9:.4f} GHz"


def _of_capture(capture: Capture, quick: bool) -> list[tuple[str, str]]:
    waveform, array, positions = capture.radar.waveform, capture.radar.array, capture.trajectory.positions
    size = (
        f"{capture.channels} channels = {len(capture.trajectory)} poses x {len(array.tx_positions)} TX "
        f"x {len(array.rx_positions)} RX, {waveform.samples_per_chirp} samples"
    )
    aperture = box(positions.min(axis=0), positions.max(axis=0))
    facts = [("record", f"Capture, {size}"), ("radar", radar_facts(capture.radar)), ("aperture", aperture)]
    if len(positions) < 2:
        return facts
    sampled = sampling(capture, ghosts=not quick)
    return [*facts, ("sampling", sampled.text), *(("warning", line) for line in sampled.warnings)]


def _of_image(image: SarImage, quick: bool) -> list[tuple[str, str]]:
    grid = image.grid
    facts = [("record", f"SarImage, {' x '.join(map(str, grid.shape))} voxels"), ("grid", box(*grid.bounds))]
    if not quick or grid.size <= _MOST_VOXELS:
        magnitude = image.magnitude
        index = np.unravel_index(np.argmax(magnitude), grid.shape)
        place = ", ".join(f"{axis[i]:.4f}" for axis, i in zip((grid.x, grid.y, grid.z), index, strict=True))
        facts.append(("peak", f"{magnitude[index]:.4g} at {place} m"))
    return facts


def _steps(metadata: Mapping[str, Any]) -> list[tuple[str, str]]:
    steps = []
    for entry in metadata.get("history", ()):
        settings = ", ".join(f"{k}={v}" for k, v in entry.items() if k not in ("step", "edge"))
        steps.append(("step", f"{entry.get('step', 'unknown')}({settings})"))
    return steps
