"""`millisight image` and `info` on raw files: descriptions, experiments of the published layout, batches, clocks."""

import os
import shutil

import numpy as np
import pytest

import millisight as ms
from helpers.commands import refused, run, run_here
from helpers.miniature import MUG, fault_folder
from helpers.mirrors import DEVICES, capture_of, mirror, points, raster
from helpers.oracles import shared
from millisight.cli import image_steps
from millisight.io.mito import read_experiment


@pytest.fixture(scope="module")
def mug(miniature):
    """The folder of an object with two experiments, in and out of sight."""
    return miniature.healthy / MUG


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Commands run within this process, but for the first."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_an_experiment_of_the_published_layout(mug, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    code, _, err = run("image", los, "--radar", "77_ghz", "--grid", "1cm", "-o", "i.h5", cwd=tmp_path)
    assert code == 0, err
    image = ms.load(tmp_path / "i.h5")
    assert image.grid.shape == (55, 61, 22)  # the published box over the tripod, coarser
    assert [step["step"] for step in image.metadata["history"]][-2:] == ["place_frames", "form_image"]
    direct = ms.form_image(read_experiment(los, "77_ghz").to_capture(), image.grid)
    np.testing.assert_array_equal(image.values, direct.values)


@pytest.mark.slow
def test_a_log_that_lacks_poses_while_the_arm_moved(mug, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    code, out, err, _ = run_here("image", los, "--radar", "77_ghz", "--grid", "2cm", "-o", "whole.h5")
    assert code == 0, err
    assert "robot log" not in out
    gap = shutil.copytree(los.parent, tmp_path / MUG / "robot_collected" / "0_0_0" / "exp1") / "los"
    (path,) = gap.glob("unprocessed/radars/77_ghz/antenna*.npz")
    with np.load(path) as file:
        log = dict(file)
    count = len(next(iter(log.values())))
    kept = np.ones(count, dtype=bool)
    whole = read_experiment(gap, "77_ghz").log
    far = np.linalg.norm(whole.positions[24:] - whole.positions[:-24], axis=1)
    kept[np.argmax(far) + 1 : np.argmax(far) + 24] = False
    np.savez(path, **{name: values[kept] if len(values) == count else values for name, values in log.items()})
    code, out, err, _ = run_here("image", gap, "--radar", "77_ghz", "--grid", "2cm", "-o", "gap.h5")
    assert code == 0, err
    assert "warning: the robot log tells nothing for " in out
    assert " frames are guessed; check the connection to the robot, and scan again" in out


@pytest.mark.slow
def test_a_whole_object_at_once(mug, tmp_path):
    """Both radars of four scans; what is imaged is passed over when resumed."""
    code, out, err, _ = run_here("image", mug, "--grid", "2cm", "-o", "images", "--plot", "pictures")
    assert code == 0, err
    assert "imaged 8 of 8 captures" in out
    images = sorted(path.name for path in (tmp_path / "images").iterdir())
    assert len(images) == 8
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 8
    assert images[0] == f"{MUG}.0_0_90.exp1.los.24_ghz.image.h5"
    (tmp_path / "images" / images[3]).unlink()
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "images").iterdir()}
    code, out, err, _ = run_here("image", mug, "--grid", "2cm", "-o", "images", "--resume")
    assert code == 0, err
    assert "imaged 1 of 8 captures, 7 already done" in out
    (tmp_path / "pictures" / f"{MUG}.0_0_90.exp1.los.24_ghz.png").unlink()
    arguments = ["image", mug / "robot_collected" / "0_0_90" / "exp1", "--radar", "24_ghz", "-o", "images", "--resume"]
    code, out, err, _ = run_here(*arguments, "--grid", "2cm", "--plot", "pictures")
    assert code == 0, err
    assert "imaged 0 of 2 captures, 2 already done" in out
    picture = tmp_path / "pictures" / f"{MUG}.0_0_90.exp1.los.24_ghz.png"
    assert picture.exists()
    drawn = picture.read_bytes()
    # A picture that is older than the image may show another one; an outline is drawn of what is imaged again.
    picture.write_bytes(b"of an earlier image")
    os.utime(picture, ns=(0, 0))
    code, out, err, _ = run_here(*arguments, "--grid", "2cm", "--plot", "pictures")
    assert (code, picture.read_bytes()) == (0, drawn), err
    picture.unlink()
    code, out, err, _ = run_here(*arguments, "--grid", "2cm", "--plot", "pictures", "--outline", "mug")
    assert code == 0, err
    assert "imaged 1 of 2 captures, 1 already done" in out
    assert picture.read_bytes() != drawn
    code, out, err, _ = run_here(*arguments, "--grid", "3cm")  # other options, another image
    assert code == 0, err
    assert "imaged 2 of 2 captures" in out
    raw = next((mug / "robot_collected" / "0_0_90" / "exp1" / "los").rglob("24_ghz/radar_data/*"))
    raw.touch()  # the capture may be another one of the same name
    code, out, err, _ = run_here(*arguments, "--grid", "3cm")
    assert code == 0, err
    assert "imaged 1 of 2 captures, 1 already done" in out
    (mug / "robot_collected" / "0_0_90" / "exp1" / "experiment_info.json").touch()  # it places the receivers
    code, out, err, _ = run_here(*arguments, "--grid", "3cm")
    assert code == 0, err
    assert "imaged 2 of 2 captures" in out
    kept = {name: time for name, time in kept.items() if ".exp1." not in name or ".24_ghz." not in name}
    now = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "images").iterdir()}
    assert set(now) == set(images)
    assert {name: now[name] for name in kept} == kept


def test_a_bad_experiment_does_not_stop_the_rest(mug, miniature, tmp_path):
    bad = fault_folder(miniature.faults, "log_backwards")
    los = next(mug.glob("robot_collected/*/exp1/los"))
    code, out, err, _ = run_here("image", bad, los, "--radar", "77_ghz", "--grid", "2cm", "-o", "images")
    assert code == 1
    assert "imaged 1 of 2 captures" in out
    assert "failed: 1" in err
    assert err.count("expected times that increase") == 2  # as it happens, and at the end
    assert len(list((tmp_path / "images").iterdir())) == 1


def test_what_is_odd_about_an_experiment_is_said(miniature, tmp_path):
    gap = fault_folder(miniature.faults, "zero_gap")
    code, out, err, _ = run_here("image", gap, "--grid", "2cm", "-o", "i.h5")
    assert code == 0, err
    assert "1 lost" in out
    assert "warning: adc_data1700000001.bin: 1 of 14 frames lost, wholly or in part" in out


@pytest.mark.slow
def test_a_converted_dataset_is_imaged_too(mug, miniature, tmp_path):
    code, _, err, _ = run_here(
        "dataset", "convert", miniature.healthy, "--object", MUG, "--workers", "1", "-o", "converted"
    )
    assert code == 0, err
    arguments = ["--radar", "77_ghz", "--grid", "2cm", "-o"]
    code, out, err, _ = run_here("image", tmp_path / "converted" / MUG, *arguments, "a")
    assert code == 0, err
    assert "imaged 4 of 4 captures" in out
    code, _, err, _ = run_here("image", mug, *arguments, "b")
    assert code == 0, err
    names = sorted(path.name for path in (tmp_path / "b").iterdir())
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == names
    for name in names:
        np.testing.assert_array_equal(ms.load(tmp_path / "a" / name).values, ms.load(tmp_path / "b" / name).values)


def test_a_background_is_subtracted_from_every_frame(mug, miniature, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    arguments = ["image", los, "--radar", "24_ghz", "--grid", "2cm"]
    code, _, err, _ = run_here(*arguments, "-o", "with.h5")
    assert code == 0, err
    empty = miniature.healthy / "000_background"
    raw = mug / "robot_collected" / "0_0_90" / "exp1" / "nlos" / "unprocessed" / "radars" / "24_ghz"
    code, _, err, _ = run_here(*arguments, "--background", empty, "-o", "without.h5")
    assert code == 0, err
    before, after = ms.load(tmp_path / "with.h5"), ms.load(tmp_path / "without.h5")
    assert "subtract_background" in [step["step"] for step in after.metadata["history"]]
    assert np.abs(before.values - after.values).max() > 0.01 * before.magnitude.max()
    line = refused("image", los, "--radar", "77_ghz", "--background", raw, "-o", "x.h5")
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


@pytest.mark.slow
def test_a_plain_folder_with_a_description(described, tmp_path):
    folder, capture = described
    code, out, err, _ = run_here("image", "scan", "--plot", "i.png")
    assert code == 0, err
    assert "wrote scan/scan.image.h5" in out
    image = ms.load(folder / "scan.image.h5")
    direct = ms.form_image(capture, image.grid, window="hann")
    assert image.grid.shape == (21, 21, 5)
    assert np.abs(image.values - direct.values).max() < 1e-6 * direct.magnitude.max()

    code, out, err, _ = run_here("image", folder / "scan.toml", "--window", "none", "-o", "plain.h5")
    assert code == 0, err
    assert np.abs(ms.load(tmp_path / "plain.h5").values - direct.values).max() > 0.01 * direct.magnitude.max()

    code, out, err, _ = run_here("image", "scan", "-o", "images", "--plot", "pictures")
    assert code == 0, err
    assert "wrote images/scan.image.h5" in out  # a folder, since a folder was given
    assert (tmp_path / "pictures" / "scan.png").is_file()

    (tmp_path / "elsewhere").mkdir()
    shutil.move(folder / "cube.npz", tmp_path / "elsewhere" / "cube.npz")
    assert "cube.npz" in refused("image", "scan", "-o", "i.h5")
    code, _, err, _ = run_here("image", "scan", "--data", "elsewhere", "-o", "i.h5")
    assert code == 0, err


@pytest.mark.slow
def test_a_lid_is_taken_off_where_it_is_asked_for(tmp_path):
    device, path = DEVICES["24 GHz"], raster(step=0.005)
    spot = points(device, path, [[0, 0, -0.25]], 0.02)
    ms.save(tmp_path / "covered.h5", capture_of(device, path, spot + mirror(device, path, -0.2, tilt_deg=(0, 1))))
    ms.save(tmp_path / "open.h5", capture_of(device, path, spot))
    grid = ("--grid=-8cm:8cm:4mm,-8cm:8cm:4mm,-26cm:-18cm:2cm",)
    powers = {}
    for name, clutter in (("covered", "lid"), ("covered", "none"), ("covered", "auto"), ("open", "auto")):
        code, out, err, _ = run_here("image", f"{name}.h5", *grid, "--clutter", clutter, "-o", f"{name}-{clutter}.h5")
        assert code == 0, err
        told = {"lid": "taken off the frames: z = ", "none": "grid:", "auto": "clutter: "}[clutter]
        assert told in out
        image = ms.load(tmp_path / f"{name}-{clutter}.h5")
        powers[name, clutter] = np.linalg.norm(image.values)
        steps = [step["step"] for step in image.metadata["history"]]
        assert ("remove_sheets" in steps) == (name == "covered" and clutter != "none")
    assert powers["covered", "lid"] < 0.5 * powers["covered", "none"]
    assert abs(powers["covered", "lid"] / powers["open", "auto"] - 1) < 0.2
    assert "clutter" in refused("image", "open.h5", *grid, "--clutter", "box", "-o", "i.h5")


@pytest.mark.slow
def test_a_known_lid_that_ends_within_the_image_goes_with_its_edges(tmp_path):
    device, path = DEVICES["77 GHz"], raster()
    sides = [(axis, sign * 0.045, -sign) for axis in (0, 1) for sign in (-1, 1)]
    spot, lid = points(device, path, [[0, 0, -0.25]], 0.02), mirror(device, path, -0.2, sides=sides)
    told = {}
    for name, frames in (("carton", spot + lid), ("spot", spot)):
        ms.save(tmp_path / f"{name}.h5", capture_of(device, path, frames))
        grid = "--grid=-8cm:8cm:2.5mm,-8cm:8cm:2.5mm,-28cm:-18cm:1cm"
        code, told[name], err, _ = run_here("image", f"{name}.h5", grid, "--clutter", "lid", "-o", f"{name}-image.h5")
        assert code == 0, err
    assert "clutter: a sheet taken off the image: z = -20" in told["carton"]
    assert "clutter: nothing taken off the image: " in told["spot"]
    cleaned, truth = (ms.load(tmp_path / f"{name}-image.h5") for name in told)
    level = abs(truth.grid.z + 0.2) < 0.025
    assert abs(cleaned.values - truth.values)[..., level].max() < 0.25 * truth.magnitude.max()


@pytest.mark.slow
def test_a_known_lid_wider_than_the_scan_is_taken_off_the_frames(tmp_path):
    """Frames see it under their poses alone, which are fewer than the image's pixels."""
    device, path = DEVICES["77 GHz"], raster(size=(0.12, 0.12))
    ms.save(tmp_path / "wide.h5", capture_of(device, path, mirror(device, path, -0.2)))
    grid = "--grid=-9cm:9cm:4mm,-9cm:9cm:4mm,-26cm:-18cm:1cm"
    code, out, err, _ = run_here("image", "wide.h5", grid, "--clutter", "lid", "-o", "image.h5")
    assert code == 0, err
    assert "clutter: a sheet taken off the frames: z = -20" in out


def test_a_forgotten_unit_and_a_wrong_order_are_warned_of(described, mug, tmp_path):
    folder, _ = described
    text = DESCRIPTION.replace("step = [0.01, 0.01]", "step = [10, 10]")
    (folder / "scan.toml").write_text(text)
    code, out, err, _ = run_here("image", "scan", "-o", "i.h5")
    assert code == 0, err
    assert "warning: the aperture is 100 m large; is the unit of the positions right?" in out
    raw = next(mug.glob("robot_collected/*/exp1/los/unprocessed/radars/77_ghz/radar_data/*.bin"))
    (folder / "scan.toml").write_text(WRONG_ORDER.format(path=raw))
    code, out, err, _ = run_here("image", "scan", "-o", "i.h5")
    assert code == 0, err
    assert f"warning: {raw.name}: order two-lane interleaved (declared) does not fit" in out


WRONG_ORDER = """
[radar]
preset = "iwr1443"

[frames]
file = "{path}"
samples = 512
order = "two-lane interleaved"
phase_sign = 1

[positions]
raster = {{ step = 0.002, counts = [1, 14] }}

[image]
lower = [0, 0, -0.3]
upper = [0.01, 0.01, -0.3]
spacing = 0.01
"""


def test_what_holds_no_capture_is_refused(tmp_path, described):
    (tmp_path / "empty").mkdir()
    assert "empty holds no capture" in refused("image", "empty")
    assert "needs a robot log" in refused("image", "scan", "--clock", "apply", "-o", "i.h5")
    assert "unknown --clock" in refused("image", "scan", "--clock", "yes")
    (tmp_path / "notes.md").write_text("nothing")
    line = refused("image", "notes.md")
    assert "notes.md" in line


def test_info_on_raw_files(described, tmp_path, miniature, mug):
    raw = next(mug.glob("robot_collected/*/exp1/los/unprocessed/radars/77_ghz/radar_data/*.bin"))
    code, out, err, _ = run_here("info", raw, "scan", "scan/cube.npz", "--samples", "512")
    assert code == 0, err
    assert "order: four-lane" in out
    assert "array data: 11 x 11 x 256" in out
    assert "121 poses x 1 TX x 1 RX, 256 samples" in out
    code, out, err, _ = run_here("info", raw, "--samples", "512", "--order", "two-lane interleaved")
    assert code == 0, err
    assert "warning: order two-lane interleaved (declared) does not fit" in out


def test_info_finds_the_order_of_a_real_capture(tmp_path):
    path = shared("captures", "iwr1443_adc_data20251124114141.bin")
    code, out, err, _ = run_here("info", path)
    assert code == 0, err
    assert "order: two-lane interleaved, " in out
    assert "frames: 50 x 8 chirps x 4 RX x 256 samples" in out
    assert "strongest 19" in out


def test_a_grid_beyond_this_machine_is_refused_before_any_work(mug, tmp_path):
    los = next(mug.glob("robot_collected/*/exp1/los"))
    grid = "-10m:10m:4mm,-10m:10m:4mm,-1m:1m:1mm"
    line = refused("image", los, "--radar", "77_ghz", f"--grid={grid}", "-o", "i.h5")
    assert "the image of 5e+10 voxels takes about" in line
    assert "use a coarser --grid, or pass --memory" in line


def test_the_device_is_handed_on(tmp_path, monkeypatch):
    path = raster(step=0.05)
    ms.save(tmp_path / "c.h5", capture_of(DEVICES["24 GHz"], path, points(DEVICES["24 GHz"], path)))
    plain, asked = image_steps.form_image, []

    def on_the_cpu(*arguments, device, **settings):
        asked.append(device)
        return plain(*arguments, **settings)

    monkeypatch.setattr(image_steps, "form_image", on_the_cpu)
    monkeypatch.setattr("millisight.cli.image.check_device", lambda name: None)
    grid = "--grid=-1cm:1cm:1cm,-1cm:1cm:1cm,-26cm:-24cm:1cm"
    code, _, err, _ = run_here("image", "c.h5", grid, "--device", "cuda", "-o", "i.h5")
    assert code == 0, err
    assert asked == ["cuda"]


def test_a_device_that_cannot_do_it(tmp_path):
    assert "unknown device 'tpu'" in refused("image", "c.h5", "--device", "tpu")
    line = refused("image", "c.h5", "--device", "cuda", "--memory", "8GB")
    assert "--device cuda is for whole images" in line


def test_windows_and_tolerances_are_told_as_options(tmp_path):
    assert "Known: hann, none, taylor." in refused("image", "c.h5", "--window", "hamming", cwd=tmp_path)
    line = refused("image", "c.h5", "--tolerance", "5", cwd=tmp_path)
    assert line.endswith("expected 0.0005 to 0.1, an image's relative error: for less, use --method exact")


def test_without_a_gpu_the_option_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("millisight.core._device.find_spec", lambda name: None)
    line = refused("image", "c.h5", "--device", "cuda")
    assert "--device cuda needs numba-cuda, which is not installed" in line
    assert line.endswith("or use --device cpu")


def test_a_capture_cut_short_while_it_is_imaged_is_an_error(tmp_path, monkeypatch):
    path = raster(step=0.05)
    ms.save(tmp_path / "c.h5", capture_of(DEVICES["24 GHz"], path, points(DEVICES["24 GHz"], path)))
    parse = image_steps.parse_grid

    def cut_and_parse(*arguments):
        os.truncate("c.h5", os.path.getsize("c.h5") // 2)
        return parse(*arguments)

    monkeypatch.setattr(image_steps, "parse_grid", cut_and_parse)
    code, _, _, error = run_here("image", "c.h5", "--grid", "-1cm:1cm:1cm,-1cm:1cm:1cm,-26cm:-24cm:1cm", "-o", "i.h5")
    assert code == 1
    assert "frames of poses" in error
    assert not (tmp_path / "i.h5").exists()
