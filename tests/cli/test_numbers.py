"""Numbers at the edge of what they hold: refused by the command line as by Python, in the same words, before work."""

import time

import pytest

import millisight as ms
from helpers import solid_mirrors
from helpers.commands import run_here
from millisight.core.errors import InputError

RADAR = ms.Radar.preset("mito-sim-24ghz")
SIMULATE = ("simulate", "golf_ball", "--vertices", "100", "--radar", RADAR.name, "-o", "o.h5")
IMAGE = ("image", "c.h5", "-o", "o.h5", "--grid")
BOX = "0m:1cm:{0}m,0m:1cm:{0}m,0m:1cm:{0}m"
BEYOND = "9" * 400
"""Infinite as a float."""


def grid(upper, spacing=0.01):
    return ms.VoxelGrid.regular((0, 0, 0), (upper, 0.01, 0.01), spacing)


def formed(tolerance):
    return ms.form_image(ms.load("c.h5"), grid(0.01), tolerance=tolerance)


def simulated(**options):
    trajectory = ms.Trajectory.raster(size=0.0, step=0.1)
    return ms.simulate(ms.Scene.from_mesh("golf_ball", vertices=100), RADAR, trajectory, rng=0, **options)


SAME = {
    "step": ((*SIMULATE, "--step={}m"), lambda x: ms.Trajectory.raster(size=(0.3, 0.22), step=x),
             ("-1e38", "1e-320", "0", BEYOND)),
    "aperture": ((*SIMULATE, "--step=10cm", "--aperture={0}x{0}m"), lambda x: ms.Trajectory.raster(size=x, step=0.1),
                 ("1e38", "-1e38", "3.4e38", "1e308", BEYOND)),
    "snr_db": ((*SIMULATE, "--step=10cm", "--snr-db={}"), lambda x: simulated(snr_db=x),
               ("nan", "inf", "1e38", "-1e38", "1e308", BEYOND)),
    "tau_deg": ((*SIMULATE, "--step=10cm", "--tau-deg={}"), lambda x: simulated(tau_deg=x),
                ("nan", "inf", "1e38", "-1e38", "0", BEYOND)),
    "spacing": ((*IMAGE, BOX), lambda x: grid(0.01, x), ("-1e38", "1e-45", "1e-320", "0", "1e-9", BEYOND)),
    "upper": ((*IMAGE, "0m:{}m:1cm,0m:1cm:1cm,0m:1cm:1cm"), grid, ("1e38", "-1e38", "3.4e38", "1e308", "1e8", BEYOND)),
    "tolerance": ((*IMAGE, BOX.format("0.01"), "--tolerance={}"), formed,
                  ("nan", "1e38", "-1e38", "1e-45", "1e-320", "0", "1e308", BEYOND)),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("numbers")
    ms.save(folder / "c.h5", solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.02, step=0.01))
    return folder


@pytest.mark.parametrize("name", SAME)
def test_absurd_numbers_are_refused_in_the_same_words(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    words, python, values = SAME[name]
    assert len(values) >= 4
    for value in values:
        began = time.process_time()
        code, _, _, told = run_here(*(word.format(value) for word in words))
        with pytest.raises(InputError) as refused:
            python(float(value))
        assert (code, told) == (1, str(refused.value))
        assert len(told) < 250
        assert time.process_time() - began < 5
    assert [path.name for path in folder.iterdir()] == ["c.h5"]


@pytest.mark.parametrize("value", ["1e-320", "1e-45", "1e38", "3.4e38", "1e308"])
def test_what_can_be_meant_is_done(value):
    """A box narrower than a voxel is one voxel; and any aperture smaller than a step is one position."""
    size, step = (float(value), 0.01) if float(value) < 1 else (0.3, float(value))
    assert len(ms.Trajectory.raster(size=size, step=step)) == 1
    assert ms.VoxelGrid.regular((0, 0, 0), (size, 0, 0), step).shape == (1, 1, 1)


@pytest.mark.parametrize("length", [1e200, 1e308, 1e-320, 0.0, 1e38])
def test_turns_of_absurd_length_are_refused_without_a_warning(length):
    from millisight.calibration import PosedPicture
    from millisight.rig import ArmPose

    turn = (0.0, 0.0, 0.0, length)
    for make in (
        lambda: ms.Trajectory(times=[0.0], positions=[[0, 0, 0]], orientations=[turn]),
        lambda: ArmPose(position=(0, 0, 0), orientation=turn),
        lambda: PosedPicture(file="1.png", position=(0, 0, 0), orientation=turn),
        lambda: ms.PointCloud(points=[[0, 0, 0]], magnitude=[1.0], normals=[turn[1:]]),
    ):
        with pytest.raises(InputError, match="unit"):
            make()


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (("image", "c.h5", "-o", "o.h5"), ", or pass --memory"),
        (("surface", "c.h5", "-o", "o.ply"), ""),
        (("locate", "c.h5", "--mesh", "golf_ball", "-o", "o.json"), ""),
    ],
    ids=lambda given: given[0] if given else "",
)
def test_ten_thousand_million_voxels_are_refused_before_work(words, advice, folder, monkeypatch):
    monkeypatch.chdir(folder)
    axis = "0m:21.54cm:0.1mm"
    began = time.process_time()
    code, _, _, told = run_here(*words, "--grid", f"{axis},{axis},{axis}")
    assert time.process_time() - began < 5
    assert code == 1
    assert "the image of 1e+10 voxels takes about" in told
    assert told.endswith(f"use a coarser --grid{advice}")
    assert [path.name for path in folder.iterdir()] == ["c.h5"]
