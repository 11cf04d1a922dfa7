"""`millisight collect`: from WORLD.toml to a folder in the published layout."""

import re
import shutil

import numpy as np
import pytest
import trimesh
import typer
from typer.testing import CliRunner

from millisight.cli.collect import collect
from millisight.cli.console import in_options
from millisight.core.errors import CoverageError, FileError, FormatError, InputError, MeshError, UnknownNameError
from millisight.io import load
from millisight.io.mito import read_experiment, read_published
from millisight.rig.virtual import World

TINY = """
[[objects]]
object = "golf_ball"
at = [0.03, 0.07]
[scan]
size = [0.06, 0.06]
corner = [0, 0.04]
row_spacing = 0.02
[arm]
speed = 0.5
acceleration = 5
settle = 0.05
[[radars]]
preset = "position2go"
frame_period = 0.02
mount = [0, 0, 0]
"""


def command(folder, monkeypatch):
    """Runs the command in a folder, where the world lies as tiny.toml."""
    app = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(collect)
    monkeypatch.chdir(folder)
    (folder / "tiny.toml").write_text(TINY)
    return lambda *arguments: CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture
def run(tmp_path, monkeypatch):
    return command(tmp_path, monkeypatch)


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """A folder in which the world was scanned, its truth written, and what was said: for reading only."""
    folder = tmp_path_factory.mktemp("collected")
    with pytest.MonkeyPatch.context() as patch:
        return folder, command(folder, patch)("tiny.toml", "-o", "data", "--truth", "truth")


def test_a_mesh_without_a_unit_is_told_in_the_words_of_the_file(run, tmp_path):
    trimesh.creation.box((170, 40, 8)).export(tmp_path / "tool.stl")
    (tmp_path / "w.toml").write_text('[[objects]]\nmesh = "tool.stl"\n')
    with pytest.raises(MeshError, match=r"^w\.toml: objects\[0\] \(tool\): tool\.stl is 170 m wide") as caught:
        raise run("w.toml", "--dry-run").exception
    told = in_options(str(caught.value))
    assert told.endswith('? In its table, write unit = "mm" or unit = "cm", or unit = "m" to keep it')


@pytest.mark.slow
def test_a_world_becomes_an_experiment(collected):
    tmp_path, done = collected
    assert done.exit_code == 0, done.output
    folder = tmp_path / "data/058_golf_ball/robot_collected/0_0_0/exp1/los"
    assert "object: golf_ball, x 0.008" in done.output
    assert "scan: 4 rows of 6 cm, 20 mm apart, at 0.5 m/s" in done.output
    assert "24_ghz: " in done.output
    assert "estimate: " in done.output
    assert f"wrote {folder.relative_to(tmp_path)}" in done.output
    capture = read_experiment(folder, "24_ghz").to_capture(min_distance=0)
    assert capture.frames.any(axis=(1, 2, 3)).all()
    frame = read_published(folder / "unprocessed/camera/continuous.pkl").record
    truth = load(tmp_path / "truth/24_ghz.path.h5")
    assert len(truth) == 4 * (len(truth) // 4) > 40
    assert np.abs(truth.positions[:, 2]).max() < 2e-3
    mask = load(tmp_path / "truth/camera.mask.h5")
    assert mask.pixels.sum() > 500
    assert np.array_equal(mask.pose, frame.pose)
    assert load(tmp_path / "truth/24_ghz.footprint.h5").inside.sum() == pytest.approx(np.pi * 8.5**2, rel=0.1)
    with np.load(tmp_path / "truth/camera.masks.npz") as masks:
        assert np.array_equal(masks["0_golf_ball.visible"], mask.pixels)
    assert World.from_toml(tmp_path / "truth/world.toml").objects[0].object == "golf_ball"


@pytest.mark.slow
def test_a_dry_run_draws_and_writes_no_data(run, tmp_path):
    done = run("tiny.toml", "--dry-run", "--plot", "world.png")
    assert done.exit_code == 0, done.output
    assert "estimate: " in done.output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tiny.toml", "world.png"]
    assert (tmp_path / "world.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        (TINY.replace("golf_ball", "golf_bal"), FormatError, r"tiny.toml: objects\[0\]: unknown catalogue object"),
        (TINY.replace("golf_ball", "cracker_box"), CoverageError, r"objects\[0\] \(cracker_box\) is 21.4 cm wide"),
        (TINY.replace("speed", "sped"), FormatError, r"tiny.toml: arm.sped: unknown key"),
    ],
)
def test_bad_worlds_are_refused_before_anything_is_written(run, tmp_path, text, error, words):
    (tmp_path / "tiny.toml").write_text(text)
    done = run("tiny.toml", "-o", "data")
    assert isinstance(done.exception, error)
    assert re.search(words, str(done.exception))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tiny.toml"]


def test_an_experiment_that_is_there_stays(run, tmp_path):
    folder = tmp_path / "data/058_golf_ball/robot_collected/0_0_0/exp3/los"
    folder.mkdir(parents=True)
    done = run("tiny.toml", "-o", "data", "--experiment", 3)
    assert isinstance(done.exception, FileError)
    assert "choose another --experiment" in str(done.exception)
    assert list(folder.iterdir()) == []


def test_rigs_that_are_not_there(run):
    done = run("tiny.toml", "--rig", "real")
    assert isinstance(done.exception, UnknownNameError)
    assert "Known: virtual" in str(done.exception)


def test_help_teaches(run):
    text = run("--help").output
    assert "--dry-run --plot world.png" in text
    assert 'objects = [{ object = "mug" }]' in text


def test_the_sampling_is_told_and_ghosts_are_warned_of(run, tmp_path):
    done = run("tiny.toml", "--dry-run")
    assert (
        "sampling of 24_ghz: 10 mm (0.81 wavelengths) from position to position, 20 mm (1.62 wavelengths)"
        in done.output
    )
    assert re.search(r"warning: rows 20 mm .* give ghosts .* cm from the object along x, up to -\d+ dB", done.output)
    (tmp_path / "tiny.toml").write_text(
        TINY.replace("row_spacing = 0.02", "row_spacing = 0.003").replace("0.5\n", "0.15\n")
    )
    done = run("tiny.toml", "--dry-run")
    assert "3 mm (0.24 wavelengths) from position to position, 3 mm (0.24 wavelengths) from row to row" in done.output
    assert "warning" not in done.output


@pytest.mark.slow
def test_live_images_stand_beside_the_scan(run, collected, tmp_path):
    """And the same scan has the same truth, which may lie there already."""
    shutil.copytree(collected[0] / "truth", tmp_path / "truth")
    (tmp_path / "truth" / ".truth.part").mkdir()
    (tmp_path / "truth" / ".truth.part" / "of a run that was killed").touch()
    done = run("tiny.toml", "-o", "data", "--live", "--no-browser", "--truth", "truth")
    assert done.exit_code == 0, done.output
    assert [path.name for path in (tmp_path / "truth").iterdir() if path.name.startswith(".")] == []
    assert re.search(r"live image at http://127\.0\.0\.1:\d+/\S{20,}/", done.output)
    assert re.search(r"24_ghz: images [\d.]+ s behind the arm at most, all rows are scanned", done.output)
    assert len(read_experiment(tmp_path / "data/058_golf_ball/robot_collected/0_0_0/exp1/los", "24_ghz").rows) == 4


@pytest.mark.slow
def test_a_folder_with_other_truth_is_refused_before_the_scan(run, tmp_path):
    """The world itself was overwritten by the truth's `world.toml`."""
    (tmp_path / "world.toml").write_text(TINY)
    done = run("world.toml", "-o", "data", "--truth", ".")
    assert isinstance(done.exception, FileError)
    assert "world.toml is of another scan, and would be overwritten; choose another folder" in str(done.exception)
    assert (tmp_path / "world.toml").read_text() == TINY
    assert not (tmp_path / "data").exists()
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "camera.mask.h5").write_bytes(b"mine")
    done = run("tiny.toml", "-o", "data", "--truth", "truth")
    assert "camera.mask.h5 is there already, was not made here, and would be overwritten" in str(done.exception)
    assert (tmp_path / "truth" / "camera.mask.h5").read_bytes() == b"mine"
    assert [path.name for path in (tmp_path / "truth").iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize(
    "large",
    [
        "walls = [{lower=[-9,-9,-1], upper=[900,1,-0.9], material='wood'}]",
        "carton = {size=[100,100,0.2]}",
        "cloth = {overhang=50}",
        "support = {kind='styrofoam', size=[100,100]}",
    ],
)
def test_surfaces_of_gigabytes_are_refused(large, run, tmp_path):
    (tmp_path / "tiny.toml").write_text(f"{large}\n{TINY}")
    done = run("tiny.toml", "-o", "data", "--dry-run")
    assert isinstance(done.exception, InputError)
    assert "expected at most" in str(done.exception)
