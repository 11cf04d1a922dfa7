"""`millisight image` and `info` on raw files: descriptions, experiments of the published layout, batches, clocks."""

import shutil

import numpy as np
import pytest

import millisight as ms
from commands import refused, run
from millisight.io.mito_layout import read_experiment
from miniature import MUG, fault_folder
from oracles import shared


@pytest.fixture(scope="module")
def mug(miniature):
    """The folder of an object with two experiments, in and out of sight."""
    return miniature.healthy / MUG


def test_an_experiment_of_the_published_layout(mug, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    code, _, err = run("image", los, "--radar", "77_ghz", "--grid", "1cm", "-o", "i.h5", cwd=tmp_path)
    assert code == 0, err
    image = ms.load(tmp_path / "i.h5")
    assert image.grid.shape == (55, 60, 22)  # the published box over the tripod, coarser
    assert [step["step"] for step in image.metadata["history"]][-2:] == ["place_frames", "form_image"]
    direct = ms.form_image(read_experiment(los, "77_ghz").to_capture(), image.grid)
    np.testing.assert_array_equal(image.values, direct.values)


def test_a_whole_object_at_once(mug, tmp_path):
    """Both radars of four scans; what is imaged is passed over when resumed."""
    code, out, err = run("image", mug, "--grid", "2cm", "-o", "images", "--plot", "pictures", cwd=tmp_path)
    assert code == 0, err
    assert "imaged 8 of 8 captures" in out
    images = sorted(path.name for path in (tmp_path / "images").iterdir())
    assert len(images) == 8
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 8
    assert images[0] == f"{MUG}.0_0_90.exp1.los.24_ghz.image.h5"
    (tmp_path / "images" / images[3]).unlink()
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "images").iterdir()}
    code, out, err = run("image", mug, "--grid", "2cm", "-o", "images", "--resume", cwd=tmp_path)
    assert code == 0, err
    assert "imaged 1 of 8 captures, 7 done before" in out
    now = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "images").iterdir()}
    assert set(now) == set(images)
    assert {name: now[name] for name in kept} == kept


def test_a_bad_experiment_does_not_stop_the_rest(mug, miniature, tmp_path):
    bad = fault_folder(miniature.faults, "log_backwards")
    los = next(mug.glob("robot_collected/*/exp1/los"))
    code, out, err = run("image", bad, los, "--radar", "77_ghz", "--grid", "2cm", "-o", "images", cwd=tmp_path)
    assert code == 1
    assert "imaged 1 of 2 captures" in out
    assert "failed: 1" in err
    assert err.count("expected times that increase") == 2  # as it happens, and at the end
    assert len(list((tmp_path / "images").iterdir())) == 1


def test_a_background_is_subtracted_from_every_frame(mug, miniature, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    arguments = ["image", los, "--radar", "24_ghz", "--grid", "2cm"]
    code, _, err = run(*arguments, "-o", "with.h5", cwd=tmp_path)
    assert code == 0, err
    empty = miniature.healthy / "000_background"
    code, _, err = run(*arguments, "--background", empty, "-o", "without.h5", cwd=tmp_path)
    assert code == 0, err
    before, after = ms.load(tmp_path / "with.h5"), ms.load(tmp_path / "without.h5")
    assert "subtract_background" in [step["step"] for step in after.metadata["history"]]
    assert np.abs(before.values - after.values).max() > 0.01 * before.magnitude.max()
    line = refused(*arguments[:2], "--radar", "77_ghz", "--background", empty, "-o", "x.h5", cwd=tmp_path)
    assert "holds no capture of the 77_ghz radar" in line


DESCRIPTION = """
[radar]
preset = "mito-sim-24ghz"

[frames]
file = "cube.npz"
array = "data"
axes = ["x", "y", "sample"]
phase_sign = -1

[positions]
raster = { step = [0.01, 0.01], center = [0, 0, 0.2] }

[image]
lower = [-0.05, -0.05, 0.0]
upper = [0.05, 0.05, 0.02]
spacing = 0.005
window = "hann"
"""


@pytest.fixture
def described(tmp_path):
    """A folder with a description and the array that it describes."""
    scene = ms.Scene.from_mesh("rubiks_cube", vertices=500)
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.01)
    capture = ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), trajectory, model="edge")
    folder = tmp_path / "scan"
    folder.mkdir()
    np.savez(folder / "cube.npz", data=capture.frames.reshape(11, 11, 256))
    (folder / "scan.toml").write_text(DESCRIPTION)
    return folder, capture


def test_a_plain_folder_with_a_description(described, tmp_path):
    folder, capture = described
    code, out, err = run("image", "scan", "--plot", "i.png", cwd=tmp_path)
    assert code == 0, err
    assert "wrote scan/scan.image.h5" in out
    image = ms.load(folder / "scan.image.h5")
    direct = ms.form_image(capture, image.grid, window="hann")
    assert image.grid.shape == (21, 21, 5)
    assert np.abs(image.values - direct.values).max() < 1e-6 * direct.magnitude.max()

    code, out, err = run("image", folder / "scan.toml", "--window", "none", "-o", "plain.h5", cwd=tmp_path)
    assert code == 0, err
    assert np.abs(ms.load(tmp_path / "plain.h5").values - direct.values).max() > 0.01 * direct.magnitude.max()

    (tmp_path / "elsewhere").mkdir()
    shutil.move(folder / "cube.npz", tmp_path / "elsewhere" / "cube.npz")
    assert "cube.npz" in refused("image", "scan", "-o", "i.h5", cwd=tmp_path)
    code, _, err = run("image", "scan", "--data", "elsewhere", "-o", "i.h5", cwd=tmp_path)
    assert code == 0, err


def test_what_holds_no_capture_is_refused(tmp_path, described):
    (tmp_path / "empty").mkdir()
    assert "empty holds no capture" in refused("image", "empty", cwd=tmp_path)
    assert "needs a robot's log" in refused("image", "scan", "--clock", "apply", "-o", "i.h5", cwd=tmp_path)
    assert "unknown --clock" in refused("image", "scan", "--clock", "yes", cwd=tmp_path)
    (tmp_path / "notes.md").write_text("nothing")
    line = refused("image", "notes.md", cwd=tmp_path)
    assert "notes.md" in line


def test_info_on_raw_files(described, tmp_path, miniature, mug):
    raw = next(mug.glob("robot_collected/*/exp1/los/unprocessed/radars/77_ghz/radar_data/*.bin"))
    code, out, err = run("info", raw, "scan", "scan/cube.npz", "--samples", "512", cwd=tmp_path)
    assert code == 0, err
    assert "order: four-lane" in out
    assert "array data: 11 x 11 x 256" in out
    assert "121 poses x 1 TX x 1 RX, 256 samples" in out
    code, out, err = run("info", raw, "--samples", "512", "--order", "two-lane interleaved", cwd=tmp_path)
    assert code == 0, err
    assert "warning: order two-lane interleaved (declared) does not fit" in out


def test_info_finds_the_order_of_a_real_capture(tmp_path):
    path = shared("captures", "iwr1443_adc_data20251124114141.bin")
    code, out, err = run("info", path, cwd=tmp_path)
    assert code == 0, err
    assert "order: two-lane interleaved, " in out
    assert "frames: 50 x 8 chirps x 4 RX x 256 samples" in out
    assert "strongest 19" in out
