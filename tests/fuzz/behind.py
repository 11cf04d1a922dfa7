"""Formats behind others: attributes of a sealed file, what a scan keeps until it is whole, what lies beside."""

import json
import shutil
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from millisight.core import sealed
from millisight.core.errors import DamagedFileError

JSON_BEYOND = (b"[" * 100_000, b"1" * 4301, b"null", b"[null]", b'[{"24_ghz": [1e400, NaN]}]', b"\xff\xfe")


def attributes(folder: Path) -> tuple[bytes, Any]:
    """Every attribute of a sealed capture as a line, and what writes those lines into it, seals it and loads it."""
    import h5py

    import millisight as ms
    from helpers import forging, solid_mirrors
    from millisight.io import load, load_extras, provenance

    capture = solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.01, step=0.01)
    whole, changed = folder / "whole.h5", folder / "changed.h5"
    ms.save(whole, capture, extras={"a": {"b": [1]}, "c": np.arange(3)})
    with h5py.File(whole) as file:
        lines = list(_listed("/", file))
        file.visititems(lambda name, item: lines.extend(_listed(name, item)))
    valid = "\n".join(lines).encode()

    def parse(path: Path) -> None:
        """Each of the three that read attributes opens the file anew, which takes longest: whom the change concerns."""
        shutil.copyfile(whole, changed)
        told = path.read_bytes().decode("utf-8", "replace").replace("\0", "")
        new = [line for line in told.split("\n") if line not in lines]
        if new:
            forging.forge(changed, lambda file: _write(file, new))
        load(changed)
        for place, read in (("extras", load_extras), ("/|", provenance)):
            if not new or any(line.startswith(place) for line in new):
                read(changed)

    return valid, parse


def _listed(name: str, item: Any) -> Iterator[str]:
    for key, value in item.attrs.items():
        yield f"{name}|{key}|{value}"


def _write(file: Any, lines: list[str]) -> None:
    """The lines, as numbers where they are some; what HDF5 itself refuses is left out."""
    for line in lines:
        name, _, rest = line.partition("|")
        key, _, text = rest.partition("|")
        if not name or name not in file:
            continue
        value: Any = text
        for kind in (float, int):
            with suppress(ValueError):
                value = kind(text)
        with suppress(ValueError, TypeError, OverflowError, OSError, RuntimeError):
            file[name].attrs[key] = np.int64(value) if isinstance(value, int) else value


def checksums(folder: Path) -> tuple[bytes, Any]:
    """Checksums of sources, behind one of their own."""
    from millisight.datasets._convert import _read_cache

    place = folder / "checksums.json"

    def parse(path: Path) -> None:
        cache = path.read_bytes().decode("utf-8", "surrogateescape")
        place.write_text(sealed(cache))
        _read_cache(place)
        path.replace(place)
        _read_cache(place)

    return b'{"known": {"a": {"b": [1, 2, "00"]}}, "ours": ["c"]}', parse


def rows(folder: Path) -> tuple[bytes, Any]:
    """The list of rows of a scan that is not whole."""
    from millisight.rig._rows import Spool, _rows_listed

    place = folder / "scan"
    place.mkdir()

    def parse(path: Path) -> None:
        listed = path.read_bytes().decode("utf-8", "surrogateescape")
        for text in (sealed(listed).encode(), path.read_bytes()):
            (place / "rows.json").write_bytes(text)
            with suppress(DamagedFileError):
                for row in _rows_listed(place, ["77_ghz", "24_ghz"])[0]:
                    Spool(place, list(row.values()))

    told = {"77_ghz": [1700000000, 1.7e9, "0" * 64], "24_ghz": [1700000001, 1.7e9, "0" * 64]}
    return json.dumps({"rows": [told] * 2, "logs": ["0" * 64] * 2}).encode(), parse


def log(folder: Path) -> tuple[bytes, Any]:
    """The log of a row."""
    from millisight.rig._rows import _joined

    stream = BytesIO()
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    np.savez(stream, times=np.arange(3.0), positions=np.zeros((3, 3)), orientations=turns)
    return stream.getvalue(), lambda path: _joined([path])


def frames(folder: Path) -> tuple[bytes, Any]:
    """The frames of a row."""
    from millisight.rig._rows import Spool

    place = folder / "spool"
    place.mkdir()

    def parse(path: Path) -> None:
        path.replace(place / "0.npy")
        np.array(Spool(place, [(1, 1.0, "")])[0].frames)

    return saved_frames(), parse


def saved_frames() -> bytes:
    stream = BytesIO()
    np.save(stream, np.ones((2, 1, 1, 4), np.complex64))
    return stream.getvalue()


def prompts(folder: Path, subject: Any, segmenters: Any) -> tuple[bytes, Any]:
    """What an earlier session of the annotator saved beside its mask."""
    from millisight.viz.annotator import Annotation

    mask = folder / "earlier.mask.h5"
    told = {"image": "a", "image_sha256": subject.sha256, "method": "discs", "points": [[3, 4]], "positive": [True]}

    def parse(path: Path) -> None:
        path.replace(folder / "earlier.prompts.json")
        Annotation(subject, mask, segmenters=segmenters)

    return json.dumps(told).encode(), parse


def settings(folder: Path, recorded: bytes) -> tuple[bytes, Any]:
    """The settings beside a recording, as other programs write them."""
    from millisight.io.raw import _dca1000, describe_raw

    place = folder / "beside"
    place.mkdir()
    (place / "raw.bin").write_bytes(recorded)
    estimate, known = _dca1000.estimate_order, {}

    def estimated(counts: Any, **settings: Any) -> Any:
        """The order of values, for most settings asked before; working it out takes ten times as long as the rest."""
        if (asked := (counts[:].tobytes(), repr(settings))) not in known:
            known[asked] = estimate(counts, **settings)
        return known[asked]

    def parse(path: Path) -> None:
        path.replace(place / "raw.json")
        with mock.patch.object(_dca1000, "estimate_order", estimated):
            describe_raw(place / "raw.bin")

    return json.dumps({"numAdcSamples": 16, "numRx": 4, "chirps": 2, "frames": 3}).encode(), parse
