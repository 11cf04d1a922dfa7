"""`millisight info`: what a file holds, in a few lines."""

from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.capture.capture import Capture
from millisight.cli.console import in_options, say
from millisight.errors import MillisightError
from millisight.files import check_readable
from millisight.imaging.image import SarImage
from millisight.records import box


def info(
    files: Annotated[list[Path], typer.Argument(help="HDF5 files of millisight, or mesh files.")],
) -> None:
    """Say what files hold: record, size, radar, provenance.

    Example: millisight info mug.capture.h5 mug.stl
    """
    failed = False
    for path in files:
        try:
            lines = _describe(path)
        except MillisightError as error:
            failed = True
            typer.echo(f"millisight: {in_options(str(error))}", err=True)
            continue
        say(f"file: {path}")
        for line in lines:
            say(f"  {line}")
    if failed:
        raise typer.Exit(1)


def _describe(path: Path) -> list[str]:
    path = check_readable(path)
    from millisight.scene.load import FORMATS, load_mesh

    if path.suffix.lower().removeprefix(".") in FORMATS:
        mesh = load_mesh(path, unit="m")
        extent = " x ".join(f"{e:.4g}" for e in mesh.extent)
        return [f"mesh: {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {extent} in the file's unit"]
    from millisight.io.hdf5 import load, open_capture, provenance

    origin = provenance(path)
    made = f"made: {origin['created']} by millisight {origin['code_version']}, schema {origin['schema_version']}"
    command = f"command: {origin['command']}"
    if origin["record"] == "Capture":
        with open_capture(path) as capture:
            return [*_capture_lines(capture), made, command]
    record = load(path)
    lines = _image_lines(record) if isinstance(record, SarImage) else [f"record: {origin['record']}"]
    return [*lines, made, command]


def _capture_lines(capture: Capture) -> list[str]:
    waveform, array = capture.radar.waveform, capture.radar.array
    first, last = waveform.frequencies[[0, -1]]
    lower, upper = capture.trajectory.positions.min(axis=0), capture.trajectory.positions.max(axis=0)
    return [
        f"record: Capture, {capture.channels} channels = {len(capture.trajectory)} poses "
        f"x {len(array.tx_positions)} TX x {len(array.rx_positions)} RX, {waveform.samples_per_chirp} samples",
        f"radar: {capture.radar.name}, {first / 1e9:.4f} to {last / 1e9:.4f} GHz, "
        f"range resolution {waveform.range_resolution * 100:.3g} cm, path offset {capture.radar.path_offset:g} m",
        f"aperture: {box(lower, upper)}",
        *_history(capture.metadata),
    ]


def _image_lines(image: SarImage) -> list[str]:
    grid = image.grid
    return [
        f"record: SarImage, {' x '.join(map(str, grid.shape))} voxels",
        f"grid: {box(*grid.bounds)}",
        f"peak: {image.magnitude.max():.4g} at {', '.join(f'{p:.4f}' for p in image.peak)} m",
        *_history(image.metadata),
    ]


def _history(metadata: Any) -> list[str]:
    steps = []
    for entry in metadata.get("history", ()):
        settings = ", ".join(f"{k}={v}" for k, v in entry.items() if k not in ("step", "edge"))
        steps.append(f"step: {entry.get('step', 'unknown')}({settings})")
    return steps
