"""The main job: the demo runs, real waves are imaged, real scans look like themselves."""

import html.parser
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.oracles import scans, shared
from helpers.small_demo import SMALL_DEMO
from millisight.meshes import build_object


def test_the_demo_does_the_main_job(tmp_path):
    """With one of its objects, unless MILLISIGHT_DEMO holds what `make demo` has just printed: that has all three."""
    if printed := os.environ.get("MILLISIGHT_DEMO"):
        folder, told_next, objects = Path(__file__).parents[2] / "demo", Path(printed).read_text(encoding="utf-8"), 3
    else:
        done = subprocess.run(
            [sys.executable, "-c", SMALL_DEMO],
            cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        folder, told_next, objects = tmp_path / "demo", done.stdout, 1
    images = sorted(folder.glob("*.image.h5"))
    assert len(images) == 2 * (objects + 1)  # objects and the carton, at two bands each
    for path in images:
        image = ms.load(path)
        assert image.magnitude.max() > 0
        assert image.metadata["simulated"]

    assert "what to try next" in told_next
    told = re.search(r"scissors in a shut carton: (.*)", told_next)[1]
    if importlib.util.find_spec("onnxruntime"):
        assert "handle" in told
        assert "sure" not in told or "not sure" in told
        mask = ms.load(folder / "carton.mask.h5")
        assert 5e-4 < mask.inside.sum() * 0.0025**2 < 5e-3
    else:
        assert "not segmented" in told
    # What it tells to try next works on what it wrote.
    scan = ms.read_capture(folder / "shut_carton" / "77_ghz.toml")
    assert scan.metadata["simulated"]
    # Their edges are hardly seen: without edges they agree much better, and lie the right way round.
    found = ms.locate(scan, build_object("scissors"), clutter="lid").best
    assert found.score > 0.6
    assert np.linalg.norm(found.place - [0.124, 0.204, -0.293]) < 0.02

    class Pictures(html.parser.HTMLParser):
        found: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag, attrs):
            if tag == "img":
                self.found.append(dict(attrs)["src"])

    Pictures().feed((folder / "index.html").read_text(encoding="utf-8"))
    assert len(Pictures.found) >= 5
    assert all((folder / name).stat().st_size > 20_000 for name in Pictures.found)


@pytest.mark.slow
def test_a_wrench_looks_like_a_wrench():
    """The specular image of a flat wrench correlates with its silhouette, at 77 GHz more than at 24 GHz."""
    scene = ms.Scene.from_mesh("adjustable_wrench", vertices=5000)
    trajectory = ms.Trajectory.raster(size=(0.24, 0.1), step=0.0019)
    grid = ms.VoxelGrid.regular((-0.11, -0.04, 0.0), (0.11, 0.04, 0.008), (0.002, 0.002, 0.004))
    vertices = scene.mesh.vertices
    silhouette = np.zeros(grid.shape[:2])
    places = np.round((vertices[:, :2] - [grid.x[0], grid.y[0]]) / 0.002).astype(int)
    silhouette[places[:, 0], places[:, 1]] = 1
    scores = {}
    for name in ("mito-sim-77ghz", "mito-sim-24ghz"):
        image = ms.form_image(ms.simulate(scene, ms.Radar.preset(name), trajectory), grid)
        scores[name] = np.corrcoef(image.project("z").ravel(), silhouette.ravel())[0, 1]
    assert scores["mito-sim-77ghz"] > 0.5
    assert scores["mito-sim-77ghz"] > scores["mito-sim-24ghz"] + 0.1


@pytest.mark.slow
@pytest.mark.parametrize("scan", [s.name for s in scans()] or ["none"])
def test_real_scans_run_through_the_main_job(scan):
    """Over a reduced aperture, 10.5 cm wide and 35 cm above the object's centre.

    Nearer or wider, the image of a ball peaks deeper: its echo has the range of its top but the curvature of its
    centre. A smooth ball has no edges: then, and only then, may the edge model stay dark.
    """
    scene = ms.Scene.from_mesh(shared("ycb", scan), vertices=7000)
    trajectory = ms.Trajectory.raster(size=(0.105, 0.105), step=0.0019, center=(0, 0, 0.35))
    lower, upper = scene.mesh.bounds
    grid = ms.VoxelGrid.regular(lower - 0.01, upper + 0.01, (0.003, 0.003, 0.004))
    shares = []
    for model in ("specular", "edge"):
        capture = ms.simulate(scene, ms.Radar.preset("mito-sim-77ghz"), trajectory, model=model)
        assert np.isfinite(capture.frames).all()
        shares.append(capture.metadata["lit_fraction"])
        if model == "edge" and not scene.mesh.sharp_vertices(20.0).any():
            assert shares[-1] == 0
            continue
        lit = lit_somewhere(scene, capture, model)
        assert lit.any()
        image = ms.form_image(capture, grid)
        assert np.linalg.norm(scene.mesh.vertices[lit] - image.peak, axis=1).min() < 0.01
    assert max(shares) >= 0.01


def lit_somewhere(scene, capture, model):
    """(V,) bool: vertices lit from some position of every tenth."""
    from millisight.simulation import scattering_model
    from millisight.simulation._scatterers import Scatterers

    scatterers = Scatterers(scene.mesh, scattering_model(model))
    antennas = np.ascontiguousarray(capture.tx_positions[::10])  # as in `simulate`: no other kernel is compiled
    lit = np.zeros(len(scene.mesh.vertices), dtype=bool)
    for start in range(0, len(antennas), 200):
        block = antennas[start : start + 200]
        lit[scatterers.indices] |= scatterers.weights(block, block).any(axis=(0, 1, 2))
    return lit
