"""Titles of exhibits, by their files."""

import os
from pathlib import Path

from millisight.core import printable
from millisight.io import mito


def titles_of(paths: list[Path], paired: list[bool]) -> list[str]:
    """A title for each image; where two would be the same, their folders come with them."""
    titles = [_title(path, pair) for path, pair in zip(paths, paired, strict=True)]
    return [
        f"{printable(path.resolve().parent.name)}/{title}" if titles.count(title) > 1 else title
        for path, title in zip(paths, titles, strict=True)
    ]


def _title(path: Path, paired: bool) -> str:
    """What a file shows, in words: by its place in the published layout, or by its name."""
    parts = Path(mito.origin(os.path.abspath(path))).parts
    kind = mito.kind_of("radars", path.name)
    if len(parts) < 3 or kind is None:
        name = path.name.removesuffix(path.suffix).removesuffix(".image")
        for word in ("specular", "edges", "edge") if paired else ():
            name = name.replace(word, "")
        return printable(name.strip(". -_") or path.stem) + (", specular + edge" if paired else "")
    called = mito.object_of(parts[0])
    words = [called[1] if called else parts[0]]
    words += [part.replace("_", "/") + "°" for part in parts if mito.angles_of(part) and part != "0_0_0"]
    words += [part for part in parts if (mito.experiment_of(part) or 1) > 1]
    words += ["simulated"] if "simulation" in parts else []
    words += [part.upper() for part in parts if part in mito.SIGHTS]
    words += [part.replace("_ghz", " GHz") for part in parts if part in mito.RADARS]
    words += [] if paired or not kind[1] else [kind[1].strip("_")]
    return printable(", ".join(words).replace("_", " "))
