"""The GPU's kernels against the CPU's, in numba-cuda's simulator always and on a GPU wherever there is one."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from millisight.core import _device as device
from millisight.core.errors import DeviceError, InputError, UnknownNameError


def gpu_is_there():
    try:
        device.check_device("cuda")
    except DeviceError:
        return False
    return True


GPU = gpu_is_there()
CHECKS = 24


@pytest.fixture(scope="module", params=["simulator", *["gpu"] * GPU])
def differences(request):
    """{what: relative L2 difference}, found by a process of its own: Numba must be told before it is imported."""
    pytest.importorskip("numba_cuda")
    environment = dict(os.environ, NUMBA_ENABLE_CUDASIM=str(int(request.param == "simulator")))
    # But for what numba-cuda says as it is imported with NumPy 2.5.
    quiet = ["-W", "error", "-W", "ignore:The 'generic' unit for NumPy timedelta:DeprecationWarning"]
    command = [sys.executable, *quiet, str(Path(__file__).parent / "parity.py")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_the_gpu_agrees_with_the_cpu(differences):
    """Kernels, simulate and form_image: float32 rounds a path of ten waves to 1e-6 of a wave, on each in its own way;
    the interpolations of the fast image multiply that."""
    assert len(differences) == CHECKS
    largest = {what: 3e-5 if what == "fast" else 1e-5 for what in differences}
    assert {what: value for what, value in differences.items() if not value < largest[what]} == {}


def small_problem():
    radar = ms.Radar.preset("mito-sim-24ghz")
    trajectory = ms.Trajectory.raster(size=(0.01, 0.01), step=0.01)
    frames = np.ones((len(trajectory), 1, 1, radar.waveform.samples_per_chirp), np.complex64)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames), ms.VoxelGrid.regular((0, 0, 0), (0, 0, 0), 1)


@pytest.mark.skipif(GPU, reason="there is a GPU here")
@pytest.mark.parametrize("method", ["fast", "backprojection"])
def test_no_gpu_is_an_error_not_a_fall_back(method):
    pytest.importorskip("numba_cuda")
    with pytest.raises(DeviceError, match=r'no GPU that it can use .*use device="cpu"') as caught:
        ms.form_image(*small_problem(), method=method, device="cuda")
    assert "\n" not in str(caught.value)
    scene, capture = ms.Scene.from_mesh("rubiks_cube", vertices=100), small_problem()[0]
    with pytest.raises(DeviceError, match="no GPU"):
        ms.simulate(scene, capture.radar, capture.trajectory, device="cuda")


def test_numba_cuda_missing(monkeypatch):
    monkeypatch.setattr(device, "find_spec", lambda name: None)
    with pytest.raises(DeviceError, match=r"not installed: run pip install \"millisight\[cuda\]\""):
        device.check_device("cuda")


@pytest.mark.skipif(GPU, reason="there is a GPU here")
def test_numba_cuda_broken(monkeypatch):
    """A library that numba-cuda itself needs cannot be loaded."""
    pytest.importorskip("numba_cuda")
    monkeypatch.delattr(importlib.import_module("numba"), "cuda", raising=False)
    monkeypatch.setitem(sys.modules, "numba.cuda", None)
    with pytest.raises(DeviceError, match="no GPU"):
        device.check_device("cuda")


def test_unknown_devices():
    assert device.check_device("cpu") is None
    for door in (device.check_device, lambda name: ms.form_image(*small_problem(), device=name)):
        with pytest.raises(UnknownNameError, match=r"unknown device 'gpu'.*cpu, cuda"):
            door("gpu")


def test_exact_runs_on_the_cpu_alone():
    with pytest.raises(InputError, match="exact"):
        ms.form_image(*small_problem(), method="exact", device="cuda")
