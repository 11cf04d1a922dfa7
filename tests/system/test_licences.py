"""Everything that millisight installs, with all extras and their dependencies, has a licence that lets it be used."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
PERMITTED = re.compile(
    r"apache|bsd|mit\b|isc\b|psf|python software foundation|mpl|mozilla|zlib|cc0|0bsd|cnri|hpnd|unlicense|llvm", re.I
)
REFUSED = re.compile(r"\b(a?gpl|general public|proprietary|non-?commercial|sspl|busl)\b", re.I)
WITHOUT_METADATA = {"embreex": r"Redistribution and use in source and binary forms"}
"""Packages that hold the text of their licence where others name it, and what it says."""


def licence_of(package):
    told = package.metadata
    listed = [name.rpartition("::")[2] for name in told.get_all("Classifier") or () if name.startswith("License")]
    return told.get("License-Expression") or "; ".join(listed) or told.get("License") or ""


def installed():
    """Licences of all packages that are needed and installed, by name; those that are optional may be missing."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    pending = [*project["dependencies"], *(one for extra in project["optional-dependencies"].values() for one in extra)]
    found = {}
    while pending:
        needed = Requirement(pending.pop())
        name = re.sub(r"[-_.]+", "-", needed.name).lower()
        if name in found or not (needed.marker is None or needed.marker.evaluate({"extra": ""})):
            continue
        try:
            package = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        found[name] = licence_of(package)
        pending += package.requires or ()
    return found


def test_every_dependency_may_be_used_and_passed_on():
    found = installed()
    assert {"numpy", "scipy", "numba", "h5py", "trimesh", "embreex", "typer"} <= found.keys()
    assert len(found) > 30
    odd = {
        name: licence[:80]
        for name, licence in found.items()
        if REFUSED.search(licence) or not re.search(WITHOUT_METADATA.get(name, PERMITTED), licence)
    }
    assert odd == {}
