"""`millisight info`: what a file holds, in a few lines."""

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.capture.capture import Capture
from millisight.capture.radar import Radar, Waveform
from millisight.cli.console import in_options, say
from millisight.errors import FileError, InputError, MillisightError
from millisight.files import check_readable
from millisight.imaging.image import SarImage
from millisight.records import box


@dataclass(frozen=True, slots=True)
class _Declared:
    """What the options say of raw DCA1000 files."""

    samples: int | None
    receivers: int | None
    chirps: int | None
    order: str | None
    sample_swap: bool | None
    config: Path | None


def info(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="HDF5 files of millisight; raw radar files (DCA1000 .bin, TI .cfg, Position2Go .txt); arrays (.npy, "
            ".npz, .mat, .csv, .pkl); descriptions (.toml); mesh files.",
        ),
    ],
    samples: Annotated[int | None, typer.Option(help="Of .bin files: samples of a chirp and receiver.")] = None,
    receivers: Annotated[int | None, typer.Option(help="Of .bin files: receivers.")] = None,
    chirps: Annotated[int | None, typer.Option(help="Of .bin files: chirps of a frame.")] = None,
    order: Annotated[
        str | None,
        typer.Option(help="Of .bin files: the order that is declared: four-lane, two-lane or two-lane interleaved."),
    ] = None,
    sample_swap: Annotated[
        bool | None, typer.Option("--q-first/--i-first", help="Of .bin files: which part of a sample stands first.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="Of .bin files: the TI .cfg they were recorded with. [default: one beside it]")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(help="Where the files that a description names lie. [default: beside it]")
    ] = None,
) -> None:
    """Say what files hold: record, size, radar, provenance; of raw radar files their order, found out from the data.

    Settings of a .bin file that no option gives come from a .cfg or .json beside it, or from the data itself; what
    does not fit the data is warned of.

    Example: millisight info mug.capture.h5 mug.stl adc_data.bin
    """
    declared = _Declared(samples, receivers, chirps, order, sample_swap, config)
    failed = False
    for path in files:
        try:
            lines = _describe(path, declared, data)
        except MillisightError as error:
            failed = True
            typer.echo(f"millisight: {in_options(str(error))}", err=True)
            continue
        say(f"file: {path}")
        for line in lines:
            say(f"  {line}")
    if failed:
        raise typer.Exit(1)


def _describe(path: Path, declared: _Declared, data: Path | None) -> list[str]:
    if path.is_dir():
        return _folder_lines(path, data)
    path = check_readable(path)
    from millisight.scene.load import FORMATS

    suffix = path.suffix.lower().removeprefix(".")
    if suffix in FORMATS:
        return _mesh_lines(path)
    if suffix == "bin":
        from millisight.io.dca1000_report import describe_raw

        return describe_raw(
            path,
            samples=declared.samples,
            receivers=declared.receivers,
            chirps=declared.chirps,
            order=declared.order,
            sample_swap=declared.sample_swap,
            config=declared.config,
        )
    if suffix in _READERS:
        return _READERS[suffix](path)
    if suffix == "toml":
        return _description_lines(path, data)
    return _record_lines(path)


def _folder_lines(folder: Path, data: Path | None) -> list[str]:
    from millisight.io.description import description_in

    described = description_in(folder)
    if described is None:
        raise FileError(
            f"{folder} is a folder without a description (*.toml); expected a file, or for folders of the published "
            "dataset `millisight dataset info`"
        )
    return _description_lines(described, data)


def _mesh_lines(path: Path) -> list[str]:
    from millisight.scene.load import load_mesh

    mesh = load_mesh(path, unit="m")
    extent = " x ".join(f"{e:.4g}" for e in mesh.extent)
    return [f"mesh: {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {extent} in the file's unit"]


def _description_lines(path: Path, data: Path | None) -> list[str]:
    """What a description leads to, positions or not."""
    from millisight.io.description import read, read_frames

    try:
        content = read(path, data=data)
    except InputError:
        # Without positions nothing can be imaged, but what was measured can be told.
        radar, frames = read_frames(path, data=data)
        return [
            f"description: {frames.shape[0]} frames x {frames.shape[1]} TX x {frames.shape[2]} RX, "
            f"{frames.shape[3]} samples, without positions: it cannot be imaged",
            _radar_line(radar),
        ]
    if isinstance(content, Capture):
        return [f"description: of {content.metadata.get('source', path.name)}", *_capture_lines(content)]
    times, log = [row.times for row in content.rows], content.log.times
    return [
        f"description: {len(content.rows)} rows, {sum(map(len, times))} frames, to be placed by a log of "
        f"{len(content.log)} poses",
        _radar_line(content.radar),
        f"clocks: frames from {min(t[0] for t in times):.6g} to {max(t[-1] for t in times):.6g} s, log from "
        f"{log[0]:.6g} to {log[-1]:.6g} s",
    ]


def _array_lines(path: Path) -> list[str]:
    from millisight.io.arrays import array_shapes, read_arrays

    shapes = array_shapes(path)
    short = [name for name, shape in shapes.items() if math.prod(shape) <= _FEW]
    values = read_arrays(path, names=short, finite=False) if short else {}
    told = {name: f" = {', '.join(map(str, array.ravel().tolist()))}" for name, array in values.items()}
    return [
        f"array {name}: {' x '.join(map(str, shape)) or 'a number'}{told.get(name, '')}"
        for name, shape in shapes.items()
    ]


def _table_lines(path: Path) -> list[str]:
    from millisight.io.text_table import read_table

    table = read_table(path)
    rows, columns = table.values.shape
    return [f"table: {rows} rows x {columns} columns" + (f": {', '.join(table.names)}" if table.names else "")]


def _pickle_lines(path: Path) -> list[str]:
    """What a pickle holds; nothing in it is run."""
    from millisight.io.pickles import read_pickle

    content = read_pickle(path)
    if not isinstance(content, dict):
        return [f"pickle: {type(content).__name__}"]
    shapes = {key: getattr(value, "shape", None) for key, value in content.items()}
    return [
        f"{key}: {type(content[key]).__name__ if shape is None else ' x '.join(map(str, shape)) or 'a number'}"
        for key, shape in shapes.items()
    ]


def _config_lines(path: Path) -> list[str]:
    from millisight.io.ti_config import read_ti_config

    config = read_ti_config(path)
    frames = "until stopped" if not config.frames else f"{config.frames}"
    return [
        f"TI configuration: {_band(config.waveform)}, {config.waveform.samples_per_chirp} samples at "
        f"{config.waveform.sample_rate / 1e6:g} MHz",
        f"frames: {frames}, every {config.frame_period * 1e3:g} ms, {config.chirps_per_frame} chirps each, "
        f"{config.receivers} RX",
        f"order: {config.order or 'not said'}, {'Q' if config.sample_swap else 'I'} first",
    ]


def _position2go_lines(path: Path) -> list[str]:
    from millisight.io.position2go import read_position2go

    try:
        frames, chirps, receivers, samples = read_position2go(path).samples.shape
    except FileError:
        with suppress(FileError):  # other texts hold tables
            return _table_lines(path)
        raise
    return [f"Position2Go: {frames} frames x {chirps} chirps x {receivers} RX x {samples} samples"]


_FEW = 4  # values of an array, which are told
_READERS = {
    "npy": _array_lines,
    "npz": _array_lines,
    "mat": _array_lines,
    "csv": _table_lines,
    "tsv": _table_lines,
    "dat": _table_lines,
    "cfg": _config_lines,
    "txt": _position2go_lines,
    "pkl": _pickle_lines,
}


def _record_lines(path: Path) -> list[str]:
    from millisight.io.hdf5 import load, open_capture, provenance

    origin = provenance(path)
    by = f"millisight {origin['code_version']}, schema {origin['schema_version']}"
    made = [f"made: {origin['created']} by {by}", f"command: {origin['command']}"]
    if origin["created"] == "unknown":  # left out, so that equal content gives equal bytes
        made = [f"made: by {by}"]
    if origin["record"] == "Capture":
        with open_capture(path) as capture:
            return [*_capture_lines(capture), *made]
    record = load(path)
    lines = _image_lines(record) if isinstance(record, SarImage) else [f"record: {origin['record']}"]
    return [*lines, *made]


def _capture_lines(capture: Capture) -> list[str]:
    waveform, array = capture.radar.waveform, capture.radar.array
    lower, upper = capture.trajectory.positions.min(axis=0), capture.trajectory.positions.max(axis=0)
    return [
        f"record: Capture, {capture.channels} channels = {len(capture.trajectory)} poses "
        f"x {len(array.tx_positions)} TX x {len(array.rx_positions)} RX, {waveform.samples_per_chirp} samples",
        _radar_line(capture.radar),
        f"aperture: {box(lower, upper)}",
        *_history(capture.metadata),
    ]


def _radar_line(radar: Radar) -> str:
    resolution = radar.waveform.range_resolution * 100
    return (
        f"radar: {radar.name}, {_band(radar.waveform)}, range resolution {resolution:.3g} cm, "
        f"path offset {radar.path_offset:g} m"
    )


def _band(waveform: Waveform) -> str:
    first, last = waveform.frequencies[[0, -1]]
    return f"{first / 1e9:.4f} to {last / 1e9:.4f} GHz"


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
