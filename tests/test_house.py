"""The structure: fronts, circles, the size of modules, and what saving a file loads."""

import ast
import functools
import importlib
import json
import re
import subprocess
import sys
import typing
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
MODULES = sorted((SOURCE / "millisight").rglob("*.py"))
STUBS = sorted((SOURCE / "millisight").rglob("__init__.pyi"))
IMPORT = re.compile(r"\bfrom (millisight[\w.]*) import \(?([\w, ]+)|\bimport (millisight[\w.]*)")

# Tests of what lies behind a front: kernels, parsers of bytes, and the like.
INTERNALS = json.loads((Path(__file__).with_name("internals.json")).read_text())


def name_of(path):
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMED = {name_of(path) for path in MODULES}


def room_of(module):
    """The package whose front a module lies behind: all before the first part with an underscore."""
    parts = module.split(".")
    private = [i for i, part in enumerate(parts) if part.startswith("_")]
    return ".".join(parts[: private[0]]) if private else module


@functools.cache
def imports_of(path):
    """The import statements of a file, those inside functions too; read once for all tests."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in statements(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


def statements(node):
    """All within a node: expressions, of which there are ten times as many, are passed over."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, part, ()):
            yield inner
            yield from statements(inner)


def imported(path):
    """(line, module) of every import of millisight in a file."""
    for node in imports_of(path):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and (node.module or "").startswith("millisight"):
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield node.lineno, whole if whole in NAMED else node.module
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name.startswith("millisight"))


def test_rooms_import_each_other_by_their_fronts():
    """A module reaches behind the front of its own room alone, and of the rooms that hold that."""
    assert len(MODULES) > 150
    reached = [
        f"{path.relative_to(SOURCE)}:{line} imports {module}"
        for path in MODULES
        for line, module in imported(path)
        if room_of(module) != module and not f"{name_of(path)}.".startswith(f"{room_of(module)}.")
    ]
    assert reached == []


def test_no_module_imports_itself_by_way_of_others():
    graph = {name_of(path): {module for _, module in imported(path)} for path in MODULES}
    # A front is lazy: it loads what is asked of it, so an edge to it is an edge to that module.
    for path in MODULES:
        for node in imports_of(path):
            if isinstance(node, ast.ImportFrom) and node.module in FRONTS:
                graph[name_of(path)] |= {FRONTS[node.module].get(alias.name, node.module) for alias in node.names}
    graph = {name: {to for to in targets if to not in FRONTS and to != name} for name, targets in graph.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def _front(stub):
    room = name_of(stub.with_suffix(".py"))
    found = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            home = f"{room}.{node.module}" if node.module else room
            found |= {alias.name: home for alias in node.names}
    return room, found


FRONTS = dict(map(_front, STUBS))


@pytest.mark.parametrize("room", FRONTS)
def test_every_public_name_is_there(room):
    if room.startswith("millisight.viz.viewer"):
        pytest.importorskip("viser", reason="needs viser: make setup")
    if room == "millisight.perception.training.networks":
        pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    front = importlib.import_module(room)
    assert len(FRONTS[room]) > 0
    for name in FRONTS[room]:
        if FRONTS[room][name].endswith("._torch"):
            pytest.importorskip("torch", reason="torch is not installed: make setup-train")
        assert getattr(front, name) is not None
    assert set(front.__all__) == set(FRONTS[room])


def test_a_room_and_a_name_of_its_parent_differ():
    both = [f"{room}.{name}" for room, names in FRONTS.items() for name in names if f"{room}.{name}" in FRONTS]
    home = {f"{room}.{name}": target for room, names in FRONTS.items() for name, target in names.items()}
    assert [name for name in both if home[name] != name.rpartition(".")[0]] == []


@pytest.mark.parametrize("folder", ["docs", "examples", "README.md"])
def test_what_users_read_imports_public_names(folder):
    place = ROOT / folder
    suffixes = (".py", ".md", ".ipynb", ".rst")
    files = [place] if place.is_file() else [path for path in place.rglob("*") if path.suffix in suffixes]
    count, wrong = 0, []
    for path in files:
        for match in IMPORT.finditer(path.read_text(encoding="utf-8")):
            count += 1
            module = match[1] or match[3]
            names = [name.split(" as ")[0].strip() for name in (match[2] or "").split(",")]
            if any(part.startswith("_") for part in [*module.split("."), *names]):
                wrong.append(f"{path.relative_to(ROOT)}: {match[0]}")
    assert count > 0
    assert wrong == []


def test_tests_of_behaviour_import_public_names():
    reaching = sorted(
        {
            path.relative_to(ROOT / "tests").as_posix()
            for path in (ROOT / "tests").rglob("*.py")
            for _, module in imported(path)
            if room_of(module) != module
        }
    )
    assert [path for path in reaching if path not in INTERNALS] == []
    assert [path for path in INTERNALS if path not in reaching] == []


NAMES = [  # room, function, its argument, and where the room keeps the names
    ("millisight.simulation", "simulate", "model", "SCATTERING_MODELS"),
    ("millisight.imaging", "form_image", "method", "METHODS"),
    ("millisight.imaging", "form_image", "window", "WINDOWS"),
    ("millisight.perception.segmentation", "segment", "method", "SEGMENTERS"),
    ("millisight.perception.classification", "classify", "method", "CLASSIFIERS"),
]


@pytest.mark.parametrize(("room", "function", "argument", "names"), NAMES)
def test_editors_are_told_names_that_there_are(room, function, argument, names):
    """And any other text is as good: plug-ins add names."""
    front = importlib.import_module(room)
    hint = typing.get_type_hints(getattr(front, function))[argument]
    told, kinds = set(), [hint]
    while kinds:
        kind = kinds.pop()
        if typing.get_origin(kind) is typing.Literal:
            told |= set(typing.get_args(kind))
        else:
            kinds += typing.get_args(kind)
    assert len(told) >= 2
    assert told <= set(getattr(front, names))
    assert str in typing.get_args(hint)


def test_modules_stay_short():
    assert {name_of(p): n for p in MODULES if (n := len(p.read_text(encoding="utf-8").splitlines())) > 400} == {}


def test_only_records_call_upper_rooms_late():
    """And the result of an evaluation, which is one with pictures."""
    late = {name_of(path) for path in MODULES if re.search(r"(?<![\w.])late\(", path.read_text(encoding="utf-8"))}
    assert {name for name in late if not name.startswith("millisight.data.")} == {
        "millisight.core._late",
        "millisight.evaluation._task",
    }


def test_saving_loads_records_and_files_alone():
    code = (
        "import sys, millisight as ms; ms.save; ms.load;"
        "print(*sorted({m.split('.')[1] for m in sys.modules if m.startswith('millisight.')}))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(answer.stdout.split()) == {"core", "data", "io"}
