"""`examples/plugin`, installed: its model, radar, raw format and colour map are found by name, and used."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PLUGIN = Path(__file__).parents[2] / "examples" / "plugin"
CODE = """
import json
import numpy as np
import millisight as ms
from millisight.viz import set_colormap

scene = ms.Scene.from_mesh("rubiks_cube", vertices=800)
radar = ms.Radar.preset("example-60ghz")
trajectory = ms.Trajectory.raster(size=(0.06, 0.06), step=0.002)
lambert, diffuse = (ms.simulate(scene, radar, trajectory, model=m) for m in ("lambert", "diffuse"))
image = ms.form_image(lambert, ms.VoxelGrid.regular((-0.05, -0.05, 0), (0.05, 0.05, 0.04), 0.005))
set_colormap("night")
image.plot().savefig("cube.png")
set_colormap(None)
import pathlib
from millisight_example.readers import write_counts
counts = np.arange(64 * 2 * 8).reshape(64, 2, 8) * (1 + 2j)
write_counts("scan.counts", counts)
pathlib.Path("scan.toml").write_text(
    '[radar]\\nstart_frequency = 60e9\\nstep = 1e8\\nrx_positions = [[0, 0, 0], [0.01, 0, 0]]\\n'
    '[frames]\\nfile = "scan.counts"\\nphase_sign = -1\\n[positions]\\nraster = { step = 0.01, counts = [8, 8] }\\n'
)
read = ms.read_capture("scan.toml")
print(json.dumps({
    "counts": bool(np.array_equal(read.frames[:, 0], counts)),
    "receivers": len(radar.array.rx_positions),
    "weaker": float(np.abs(lambert.frames).mean() / np.abs(diffuse.frames).mean()),
    "peak": image.peak.tolist(),
    "model": lambert.metadata["history"][0]["model"],
}))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder that holds the plug-in as pip installs it."""
    folder = tmp_path_factory.mktemp("plugin")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*command, "--target", str(folder), str(PLUGIN)], check=True, timeout=300, capture_output=True)
    return folder


def run(installed, folder, *command):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False
    )


@pytest.mark.slow
def test_what_it_adds_is_used_by_name(installed, tmp_path):
    done = run(installed, tmp_path, sys.executable, "-c", CODE)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["counts"]
    assert found["receivers"] == 2
    assert 0.2 < found["weaker"] < 0.98
    # The cube's top is 28.5 mm above its centre.
    assert abs(found["peak"][2] - 0.0285) < 0.01
    assert found["model"] == "lambert"
    assert (tmp_path / "cube.png").stat().st_size > 5000


@pytest.mark.slow
def test_the_command_line_offers_it(installed, tmp_path):
    command = [sys.executable, "-m", "millisight.cli.main", "simulate", "rubiks_cube", "--vertices", "500"]
    command += ["--aperture", "8x8cm", "--step", "4mm", "--radar", "example-60ghz", "--model", "lambert", "-o", "c.h5"]
    done = run(installed, tmp_path, *command)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "c.h5").exists()


def test_without_it_the_name_is_unknown(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", "import millisight as ms; ms.Radar.preset('example-60ghz')"],
        capture_output=True, text=True, check=False, timeout=60, cwd=tmp_path,
    )  # fmt: skip
    assert "unknown radar 'example-60ghz'" in done.stderr
