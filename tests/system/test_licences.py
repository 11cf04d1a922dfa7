"""Everything that millisight installs, with all extras and their dependencies, has a licence that lets it be used."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest
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


def needed_by_the_project():
    """Its dependencies, and those of its extras by name."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    return project["dependencies"], project["optional-dependencies"]


def installed(pending):
    """Licences of all packages that are needed and installed, by name; those that are optional may be missing."""
    pending = list(pending)
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


def odd(found):
    """Those of these licences that may not be, or that nobody has judged."""
    return {
        name: licence[:80]
        for name, licence in found.items()
        if REFUSED.search(licence) or not re.search(WITHOUT_METADATA.get(name, PERMITTED), licence)
    }


def test_every_dependency_may_be_used_and_passed_on():
    always, extras = needed_by_the_project()
    found = installed([*always, *(one for extra in extras.values() for one in extra)])
    assert {"numpy", "scipy", "numba", "h5py", "trimesh", "embreex", "typer"} <= found.keys()
    assert len(found) > 30
    assert odd(found) == {}


def test_what_trains_may_be_used_and_passed_on():
    """By itself: the test above passes without torch, and what was not skipped is not repeated once torch is there."""
    pytest.importorskip("torch")
    found = installed(needed_by_the_project()[1]["train"])
    assert {Requirement(one).name for one in needed_by_the_project()[1]["train"]} <= found.keys()
    assert len(found) > 10
    assert odd(found) == {}
