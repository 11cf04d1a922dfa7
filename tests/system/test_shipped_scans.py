"""The shipped worlds and the defaults give no ghosts."""

from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here
from millisight.imaging import grid_around
from millisight.simulation import aperture_over

WORLDS = sorted((Path(__file__).parents[2] / "examples" / "worlds").glob("*.toml"))


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS, ids=lambda path: path.stem)
def test_shipped_worlds_give_no_ghosts(world, tmp_path, monkeypatch):
    from millisight.rig.virtual import VirtualRig

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(VirtualRig, "estimated_seconds", lambda self: 1.0)  # which computes echoes
    code, out, _, error = run_here("collect", world, "--dry-run")
    assert code == 0, error
    lines = [line for line in out.splitlines() if line.startswith("sampling of ")]
    assert len(lines) >= 1
    assert "warning" not in out


@pytest.mark.parametrize("name", ["mug", "cracker_box", "phillips_screwdriver", "skillet_lid", "golf_ball"])
@pytest.mark.parametrize("preset", ["mito-sim-77ghz", "mito-sim-24ghz"])
def test_the_default_step_gives_no_ghosts(name, preset):
    scene, radar = ms.Scene.from_mesh(name, vertices=None), ms.Radar.preset(preset)
    path, around = aperture_over(scene, radar), grid_around(scene, radar.waveform.wavelength / 2)
    found = ms.sampling(path, around, radar=radar, reflectors=scene.mesh.bounds)
    assert found.warnings == ()
    assert 0.2 * found.wavelength < found.across.step <= found.along.step * 1.001 + found.wavelength
    largest = max(step.step for step in found.steps)
    assert largest == pytest.approx(radar.waveform.wavelength / 2, rel=0.01) or name in ("skillet_lid", "cracker_box")
    assert np.isfinite([step.needed for step in found.steps]).all()


def test_the_scans_of_the_readme_give_no_ghosts():
    simulated = ms.Radar.preset("mito-sim-77ghz")
    grid = ms.VoxelGrid.regular((-0.08, -0.08, -0.06), (0.08, 0.08, 0.06), (0.002, 0.002, 0.004))
    assert ms.sampling(ms.Trajectory.raster(size=(0.2, 0.2), step=0.0019), grid, radar=simulated).warnings == ()
    for name, preset, size, step in (
        ("adjustable_wrench", "mito-sim-24ghz", (0.25, 0.1), 0.006),
        ("mug", "iwr1443", (0.30, 0.22), 0.002),
        ("mug", "mito-sim-77ghz", (0.30, 0.22), 0.002),
    ):
        scene, radar = ms.Scene.from_mesh(name, vertices=None), ms.Radar.preset(preset)
        path = ms.Trajectory.raster(size=size, step=step)
        found = ms.sampling(path, grid_around(scene, 0.002), radar=radar, reflectors=scene.mesh.bounds)
        assert found.warnings == ()
