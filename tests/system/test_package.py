"""The package as a whole: what importing it costs, and that its wheel works where nothing else is installed."""

import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers import pictures
from helpers.small_demo import SMALL_DEMO

ROOT = Path(__file__).resolve().parents[2]

HEAVY = (
    "numba",
    "llvmlite",
    "scipy",
    "trimesh",
    "embreex",
    "manifold3d",
    "h5py",
    "matplotlib",
    "torch",
    "xarray",
    "typer",
    "rich",
)


def modules_after(code):
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys, json; print(json.dumps(sorted(sys.modules)))"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    return {name.split(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}


def test_import_brings_in_nothing_heavy():
    assert not modules_after("import millisight") & set(HEAVY)


def test_records_are_usable_without_anything_heavy():
    loaded = modules_after("import millisight as ms; ms.Radar.preset('iwr1443'); ms.Trajectory.published(77.5e9)")
    assert not loaded & set(HEAVY)


@pytest.mark.slow
def test_help_brings_in_nothing_heavy():
    code = "import sys; sys.argv = ['millisight', '--help']\nfrom millisight.cli.main import run\n"
    code += "try: run()\nexcept SystemExit: pass"
    assert not modules_after(code) & (set(HEAVY) - {"typer", "rich"})


def test_every_public_name_is_there():
    for name in ms.__all__:
        assert getattr(ms, name) is not None
    assert set(ms.__all__) <= set(dir(ms))
    with pytest.raises(AttributeError, match="formimage"):
        _ = ms.formimage


def test_the_core_asks_for_no_torch():
    required = importlib.metadata.requires("millisight") or []
    core = [r for r in required if "extra ==" not in r]
    assert any(r.startswith("numpy") for r in core)
    assert not [r for r in core if r.startswith(("torch", "transformers", "onnx", "xarray", "dask", "viser"))]


SMOKE = """
import millisight as ms
scene = ms.Scene.from_mesh("rubiks_cube", vertices=300)
radar, trajectory = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.1, 0.1), step=0.02)
capture = ms.simulate(scene, radar, trajectory, model="edge")
image = ms.form_image(capture, ms.VoxelGrid.regular((-0.03, -0.03, 0), (0.03, 0.03, 0.03), 0.01))
ms.save("i.h5", image)
print(ms.__file__, abs(ms.load("i.h5").values - image.values).max() == 0, image.magnitude.max() > 0)
"""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)],
        check=True, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    return next(folder.glob("millisight-*.whl"))


@pytest.mark.slow
def test_the_wheel_holds_what_the_code_reads(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert "millisight/py.typed" in names
    assert sum(name.startswith("millisight/data/presets/") for name in names) == 4
    assert sum(name.startswith("millisight/cli/shut_carton/") for name in names) == 6
    assert "millisight/viz/napari.yaml" in names
    assert not [name for name in names if name.startswith(("tests/", "docs/")) or name.endswith(".h5")]


@pytest.fixture(scope="module")
def clean(wheel, tmp_path_factory):
    """The folder of an environment that has the wheel, what it depends on by the index, and no extra.

    Modules are compiled as they are imported: far more are installed.
    """
    folder = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=120)
    subprocess.run([*pip_of(folder), "install", "--quiet", "--no-compile", str(wheel)], check=True, timeout=600)
    (package,) = folder.glob("lib/python*/site-packages/millisight")
    bring_kernels(package)
    return folder


def bring_kernels(package):
    """Copy what Numba compiled of the same source here, which would take a minute of compiling; see `COMPILED`.

    Its files name the source by time and size.
    """
    source, found = ROOT / "src" / "millisight", 0
    for path in package.rglob("*.py"):
        ours = source / path.relative_to(package)
        assert path.read_bytes() == ours.read_bytes()
        kept = list((ours.parent / "__pycache__").glob(f"{ours.stem}.*.nb[ic]"))
        if kept:
            (path.parent / "__pycache__").mkdir(exist_ok=True)
        for one in kept:
            shutil.copy(one, path.parent / "__pycache__")
        os.utime(path, ns=(ours.stat().st_atime_ns, ours.stat().st_mtime_ns))
        found += 1
    assert found > 100


def pip_of(folder):
    """This environment's pip, which works on another."""
    return [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(folder / "bin" / "python")]


@pytest.mark.slow
def test_the_wheel_works_in_a_clean_environment(clean, tmp_path):
    """Away from the source."""
    python = clean / "bin" / "python"
    done = subprocess.run(
        [python, "-I", "-c", SMOKE], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert str(clean) in done.stdout
    assert done.stdout.split()[1:] == ["True", "True"]
    told = subprocess.run([*pip_of(clean), "list"], capture_output=True, text=True, check=True, timeout=60).stdout
    assert "millisight" in told
    assert "torch" not in told
    shown = subprocess.run(
        [clean / "bin" / "millisight", "--version"], capture_output=True, text=True, check=True, timeout=60
    )
    assert shown.stdout.strip() == ms.__version__


COMPILED = """
from numba import prange
from millisight.core import kernel

@kernel(fastmath=True)
def total(values):
    found = 0.0
    for i in prange(len(values)):
        found += values[i]
    return found

if __name__ == "__main__":
    import numpy as np
    print(total(np.ones(7)))
"""


@pytest.mark.slow
def test_kernels_are_compiled_and_kept_in_a_clean_environment(clean, tmp_path):
    (tmp_path / "kernels.py").write_text(COMPILED)
    done = subprocess.run(
        [clean / "bin" / "python", "-I", "kernels.py"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.stdout == "7.0\n", done.stderr
    assert list((tmp_path / "__pycache__").glob("kernels.total-*.nbc"))


@pytest.mark.first
def test_the_wheel_runs_the_demo_without_extras(clean, tmp_path):
    """With one of its three objects: `make demo` images all three."""
    done = subprocess.run(
        [clean / "bin" / "python", "-I", "-c", SMALL_DEMO],
        cwd=tmp_path, capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "scissors in a shut carton: not segmented: " in done.stdout
    assert 'pip install "millisight[perception]"' in done.stdout
    _, _, through = pictures.panels(tmp_path / "demo" / "carton.png")
    assert np.ptp(pictures.brightness(through)) > 100
    assert (tmp_path / "demo" / "index.html").exists()
