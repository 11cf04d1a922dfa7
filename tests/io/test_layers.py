"""What saving and reading load, and that no module of the files' room leads back to itself."""

import ast
import subprocess
import sys
from pathlib import Path

import millisight

SOURCE = Path(millisight.__file__).parent
RECORDS_ALONE = ("core", "data", "io")

SAVE = """
import sys, tempfile
import numpy as np
import millisight as ms
grid = ms.VoxelGrid.regular((0, 0, 0), (0.1, 0.1, 0.1), 0.05)
image = ms.SarImage(grid=grid, values=np.zeros(grid.shape, np.complex64))
path = tempfile.mkdtemp() + "/image.h5"
ms.save(path, image)
ms.load(path)
print(" ".join(name for name in sys.modules if name.startswith("millisight.")))
"""


def rooms(names):
    return {name.split(".")[1] for name in names}


def test_saving_loads_records_and_no_algorithm():
    ran = subprocess.run([sys.executable, "-c", SAVE], capture_output=True, text=True, check=True)
    loaded = ran.stdout.split()
    assert "millisight.io._hdf5" in loaded
    assert rooms(loaded) == set(RECORDS_ALONE)


def imports(path, known):
    """The modules of ours that a module imports anywhere, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("millisight"):
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inside if inside <= known else {node.module}
    return found


def modules():
    """Every module of io, by name, with what it imports; a front leads to all that its stub names."""
    paths = {
        ".".join(["millisight", *path.relative_to(SOURCE).with_suffix("").parts]).removesuffix(".__init__"): path
        for path in sorted((SOURCE / "io").rglob("*.py"))
    }
    found = {name: imports(path, set(paths)) for name, path in paths.items()}
    for name, path in paths.items():
        stub = path.with_suffix(".pyi")
        if stub.exists():
            tree = ast.parse(stub.read_text(encoding="utf-8"))
            found[name] |= {f"{name}.{node.module}" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    return found


def test_io_imports_records_alone():
    found = modules()
    assert len(found) > 25
    outside = {(name, target) for name, targets in found.items() for target in targets if "." in target}
    assert {target.split(".")[1] for _, target in outside} == set(RECORDS_ALONE)


def test_io_has_no_circle():
    left = modules()
    while left:
        leaves = [name for name, targets in left.items() if not targets & set(left)]
        assert leaves, f"a circle among {sorted(left)}"
        for name in leaves:
            del left[name]
