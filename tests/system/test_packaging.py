"""The container file, the conda recipe and the lines that install: they agree with pyproject.toml and the tree."""

import fnmatch
import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
CONTAINER = ROOT / "packaging" / "Containerfile"


def instructions():
    """(instruction, its words) of the container file, continued lines joined."""
    text = re.sub(r"\\\n", " ", CONTAINER.read_text(encoding="utf-8"))
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines]


def test_the_container_file_copies_what_there_is_and_what_the_build_reads():
    found = instructions()
    assert found[0][0] == "FROM"
    ignored = CONTAINER.with_name("Containerfile.dockerignore").read_text(encoding="utf-8").split()
    assert ignored[0] == "*"
    taken = {line[1:] for line in ignored if line.startswith("!")}
    copied = [word for name, words in found if name == "COPY" for word in shlex.split(words)[:-1]]
    assert set(copied) == taken
    assert all((ROOT / name).exists() for name in copied)
    assert not any(fnmatch.fnmatch(name, pattern) for name in copied for pattern in ignored[1:])
    (license_file,) = PROJECT["license-files"]
    assert {PROJECT["readme"], license_file, "pyproject.toml", "src"} == set(copied)


def test_the_container_file_installs_and_starts_what_the_project_has():
    found = dict(instructions())
    major, minor = re.search(r"python:(\d+)\.(\d+)-slim$", found["FROM"]).groups()
    assert f"Programming Language :: Python :: {major}.{minor}" in PROJECT["classifiers"]
    name, _, extras = found["ARG"].partition("=")
    assert f"[${{{name}}}]" in found["RUN"]
    assert set(extras.split(",")) <= set(EXTRAS)
    (program,) = json.loads(found["ENTRYPOINT"])
    assert program in PROJECT["scripts"]


def test_the_conda_recipe_has_the_projects_dependencies():
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    assert (recipe["package"]["name"], recipe["package"]["version"]) == (PROJECT["name"], PROJECT["version"])
    assert recipe["about"]["license"] == PROJECT["license"]
    started = [f"{name} = {place}" for name, place in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == started
    wanted = {"python " + PROJECT["requires-python"]}
    for text in PROJECT["dependencies"]:
        name, version = re.fullmatch(r"([\w.-]+)(.*)", text).groups()
        wanted.add(f"{'matplotlib-base' if name == 'matplotlib' else name} {version}")  # without Qt
    assert set(recipe["requirements"]["run"]) == wanted
    assert (recipe_place := ROOT / "packaging" / "conda" / recipe["source"]["path"]).resolve() == ROOT, recipe_place


@pytest.mark.parametrize(
    "path", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*/*.md"))], ids=lambda path: path.name
)
def test_every_extra_that_a_page_installs_is_there(path):
    for extras in re.findall(r"millisight\[([\w,]+)\]", path.read_text(encoding="utf-8")):
        assert set(extras.split(",")) <= set(EXTRAS), extras
