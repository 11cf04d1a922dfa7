"""`millisight info`: describe files."""

import math
from contextlib import suppress
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from millisight.cli.console import answer, answer_json, complain, in_options, json_only
from millisight.cli.options import DataFolder
from millisight.core import check_readable
from millisight.core.errors import FileError, InputError, MillisightError
from millisight.data import RawScan


def info(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="HDF5 files of millisight; raw radar files (DCA1000 .bin and .pcap, TI .cfg, Position2Go .txt); "
            "arrays (.npy, .npz, .mat, .csv, .pkl, .s2p); descriptions (.toml); mesh files.",
        ),
    ],
    samples: Annotated[int | None, typer.Option(help="For .bin files: samples per chirp.")] = None,
    receivers: Annotated[int | None, typer.Option(help="For .bin files: number of receivers.")] = None,
    chirps: Annotated[int | None, typer.Option(help="For .bin files: chirps per frame.")] = None,
    order: Annotated[
        str | None,
        typer.Option(help="For .bin files: sample order: four-lane, two-lane or two-lane interleaved."),
    ] = None,
    sample_swap: Annotated[
        bool | None, typer.Option("--q-first/--i-first", help="For .bin files: which part of a sample comes first.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="For .bin files: TI .cfg of the recording. [default: one in the same folder]")
    ] = None,
    data: DataFolder = None,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help='Print one JSON document: {"files": [{"file", "facts": [{"name", "value"}]} or {"file", "error"}]}.',
        ),
    ] = False,
) -> None:
    """Describe files: record, size, radar and provenance. Of raw radar files, tell also the sample order found in them.

    Settings of a .bin file that are not given as options come from a .cfg or .json in its folder, or from the data.
    Settings that do not fit the data cause a warning.

    Example: millisight info mug.capture.h5 mug.stl adc_data.bin
    """
    declared = {
        "samples": samples, "receivers": receivers, "chirps": chirps, "order": order, "sample_swap": sample_swap,
        "config": config,
    }  # fmt: skip
    told: list[dict[str, Any]] = []
    for path in files:
        try:
            with json_only(as_json):
                lines = _describe(path, declared, data)
        except MillisightError as error:
            told.append({"file": str(path), "error": in_options(str(error))})
            complain(told[-1]["error"])
            continue
        # A line without a name is a remark.
        named = [line.partition(": ") if ": " in line else ("remark", "", line) for line in lines]
        told.append({"file": str(path), "facts": [{"name": name, "value": value} for name, _, value in named]})
        if not as_json:
            answer(f"file: {path}")
            for line in lines:
                answer(f"  {line}")
    if as_json:
        answer_json({"files": told})
    if any("error" in one for one in told):
        raise typer.Exit(1)


def _describe(path: Path, declared: dict[str, Any], data: Path | None) -> list[str]:
    if path.is_dir():
        return _folder_lines(path, data)
    path = check_readable(path)
    from millisight.meshes import FORMATS

    suffix = path.suffix.lower().removeprefix(".")
    if suffix in FORMATS:
        return _mesh_lines(path)
    if suffix in ("bin", "pcap"):
        from millisight.io.raw import describe_raw

        return describe_raw(path, **declared)
    if suffix in _READERS:
        return _READERS[suffix](path)
    if suffix == "toml":
        return _description_lines(path, data)
    from millisight.io.raw import RAW_FORMATS

    for name in RAW_FORMATS:
        if path.suffix.lower() in RAW_FORMATS[name].suffixes:
            return _raw_lines(name, path)
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
    from millisight.meshes import load_mesh

    mesh = load_mesh(path, unit="m")
    extent = " x ".join(f"{e:.4g}" for e in mesh.extent)
    return [f"mesh: {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, {extent} in the file's unit"]


def _description_lines(path: Path, data: Path | None) -> list[str]:
    """A description of raw data, with positions or without."""
    from millisight.io.description import read, read_frames
    from millisight.viz import radar_facts

    try:
        content = read(path, data=data)
    except InputError:
        # Without positions nothing can be imaged, but what was measured can be told.
        radar, frames = read_frames(path, data=data)
        return [
            f"description: {frames.shape[0]} frames x {frames.shape[1]} TX x {frames.shape[2]} RX, "
            f"{frames.shape[3]} samples, without positions: it cannot be imaged",
            f"radar: {radar_facts(radar)}",
        ]
    if not isinstance(content, RawScan):
        from millisight.cli.phase_sign import sign_line

        capture = content.to_capture()
        odd = (f"note: {note}" for note in capture.metadata.get("notes", ()))
        line = sign_line(capture)
        name = capture.metadata.get("source", path.name)
        return [f"description: of {name}", *_lines(capture), *odd, *([] if line is None else [line])]
    times, log = [row.times for row in content.rows], content.log.times
    return [
        f"description: {len(content.rows)} rows, {sum(map(len, times))} frames, to be placed by a log of "
        f"{len(content.log)} poses",
        f"radar: {radar_facts(content.radar)}",
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
    from millisight.io.arrays import read_table

    table = read_table(path)
    rows, columns = table.values.shape
    return [f"table: {rows} rows x {columns} columns" + (f": {', '.join(table.names)}" if table.names else "")]


def _touchstone_lines(path: Path) -> list[str]:
    from millisight.io.arrays import read_touchstone

    arrays = read_touchstone(path)
    frequencies = arrays.pop("f")
    return [
        f"Touchstone: {', '.join(arrays)} at {len(frequencies)} frequencies, {frequencies[0] / 1e9:.6g} to "
        f"{frequencies[-1] / 1e9:.6g} GHz"
    ]


def _pickle_lines(path: Path) -> list[str]:
    """The contents of a pickle; no code in it is executed."""
    from millisight.io.arrays import read_pickle

    content = read_pickle(path)
    if not isinstance(content, dict):
        return [f"pickle: {type(content).__name__}"]
    shapes = {key: getattr(value, "shape", None) for key, value in content.items()}
    return [
        f"{key}: {type(content[key]).__name__ if shape is None else ' x '.join(map(str, shape)) or 'a number'}"
        for key, shape in shapes.items()
    ]


def _config_lines(path: Path) -> list[str]:
    from millisight.io.raw import read_ti_config
    from millisight.viz import band_of

    config = read_ti_config(path)
    frames = "until stopped" if not config.frames else f"{config.frames}"
    return [
        f"TI configuration: {band_of(config.waveform)}, {config.waveform.samples_per_chirp} samples at "
        f"{config.waveform.sample_rate / 1e6:g} MHz",
        f"frames: {frames}, every {config.frame_period * 1e3:g} ms, {config.chirps_per_frame} chirps each, "
        f"{config.receivers} RX",
        f"order: {config.order or 'not stated'}, {'Q' if config.sample_swap else 'I'} first",
    ]


def _raw_lines(name: str, path: Path) -> list[str]:
    """A file of a format that has no lines of its own here, such as a plug-in's."""
    from millisight.io.raw import RAW_FORMATS

    entry = RAW_FORMATS[name]
    parameters = signature(entry.read).parameters
    missing = [key for key in entry.keys if key in parameters and parameters[key].default is Parameter.empty]
    if missing:
        return [f"{name}: state {', '.join(missing)} in a description (.toml), then describe that"]
    raw = entry.read(path)
    axes = "" if entry.axes is None else f" ({', '.join(entry.axes)})"
    lost = [] if raw.lost is None else [f"lost: {int(raw.lost.sum())} of {len(raw.lost)}"]
    remarks = [] if entry.remarks is None else entry.remarks(path)
    return [f"{name}: {' x '.join(map(str, raw.values.shape))} {raw.values.dtype}{axes}", *lost, *remarks]


def _position2go_lines(path: Path) -> list[str]:
    from millisight.io.raw import read_position2go

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
    **{f"s{ports}p": _touchstone_lines for ports in range(1, 10)},
}


def _record_lines(path: Path) -> list[str]:
    from millisight.io import load, open_capture, provenance

    origin = provenance(path)
    by = f"millisight {origin['code_version']}, schema {origin['schema_version']}"
    made = [f"made: {origin['created']} by {by}", f"command: {origin['command']}"]
    if origin["created"] == "unknown":  # left out, so that equal content gives equal bytes
        made = [f"made: by {by}"]
    if origin["record"] == "Capture":
        with open_capture(path) as capture:
            return [*_lines(capture), *made]
    return [*_lines(load(path)), *made]


def _lines(record: Any) -> list[str]:
    from millisight.viz import facts_of

    return [f"{name}: {fact}" for name, fact in facts_of(record)]
