"""`millisight segment` as a user meets it: one image, a dataset, prompts, and what cannot be."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import millisight as ms
from commands import run
from millisight.cli.app import app
from millisight.errors import MillisightError
from millisight.io.hdf5 import load_extras
from millisight.io.mito_layout import experiment_folder, radar_folder, write_published

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.145, 0.195, 0.01), (0.005, 0.005, 0.01))


def image(seed=0, bright=(slice(8, 16), slice(10, 24))):
    """A bright rectangle on speckle, 30 x 40 pixels."""
    values = np.full(GRID.shape, 0.01)
    values[bright] = 1
    return ms.SarImage(grid=GRID, values=values * np.random.default_rng(seed).rayleigh(size=GRID.shape))


def inside(folder, monkeypatch, *arguments):
    """The command within this process: exit code, what it printed, and the error that `millisight` would print."""
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(app, ["segment", *arguments])
    if isinstance(done.exception, MillisightError):
        return 1, done.output, str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output, ""


def found(path):
    mask = ms.load(path)
    assert isinstance(mask, ms.Mask)
    assert mask.inside[9:15, 11:23].mean() > 0.95
    assert mask.inside.mean() < 0.15
    return mask, load_extras(path)["segmentation"]


def test_one_image_gives_a_mask_and_a_picture(tmp_path, monkeypatch):
    ms.save(tmp_path / "mug.image.h5", image())
    ms.save(tmp_path / "mug24.h5", image(1))
    asked = ["segment", "mug.image.h5", "--other-band", "mug24.h5", "--method", "classical", "--seed", "3"]
    code, out, err = run(*asked, cwd=tmp_path)
    assert code == 0, err
    assert "by classical from" in out
    assert "wrote mug.mask.h5" in out
    mask, told = found(tmp_path / "mug.mask.h5")
    direct = ms.segment(image(), other_band=image(1), method="classical", rng=3)
    np.testing.assert_array_equal(mask.inside, direct.inside)
    assert (told["image"], told["other_band"]) == ("mug.image.h5", "mug24.h5")
    assert (told["method"], told["seed"], told["condition"]) == ("classical", 3, "los")
    drawn = ms.power_prompts(ms.project(image()), other=ms.project(image(1)), rng=3)
    assert {name: told[name] for name in ("points", "positive")} == drawn.plain
    assert (tmp_path / "mug.mask.png").read_bytes().startswith(b"\x89PNG")
    again = [*asked, "-o", "again.h5", "--no-picture"]
    assert inside(tmp_path, monkeypatch, *again[1:])[0] == 0
    np.testing.assert_array_equal(ms.load(tmp_path / "again.h5").inside, mask.inside)
    assert not (tmp_path / "again.png").exists()


@pytest.fixture
def dataset(tmp_path):
    """Two sights of one object by both radars, and an image that cannot be segmented."""
    for sight in ("los", "nlos"):
        folder = experiment_folder(tmp_path / "data", "004_sugar_box", (0, 0, 0), 1, sight)
        for radar in ("77_ghz", "24_ghz"):
            to = radar_folder(folder, radar, processed=True)
            to.mkdir(parents=True)
            blank = sight == "nlos" and radar == "24_ghz"
            one = ms.SarImage(grid=GRID, values=np.zeros(GRID.shape)) if blank else image()
            write_published(to / "processed_image.pkl", one)
    return tmp_path


def test_a_dataset_is_gone_through_and_what_failed_is_said_at_the_end(dataset):
    code, out, err = run("segment", "data", "--method", "classical", "-o", "masks", cwd=dataset)
    assert code == 1
    assert "segmented 3 of 4 images" in out
    assert "004_sugar_box.0_0_0.exp1.nlos.24_ghz: picture is blank" in err
    assert "failed: 1" in err
    assert "Traceback" not in err
    names = sorted(path.name for path in (dataset / "masks").glob("*.h5"))
    stem = "004_sugar_box.0_0_0.exp1"
    assert names == [f"{stem}.{name}.mask.h5" for name in ("los.24_ghz", "los.77_ghz", "nlos.77_ghz")]
    for name in names:
        _, told = found(dataset / "masks" / name)
        assert told["condition"] == name.split(".")[3]
        assert told["image"].startswith("004_sugar_box/robot_collected/")
    assert len(list((dataset / "masks").glob("*.png"))) == 3


def test_both_bands_of_experiments(dataset, monkeypatch):
    asked = ("data", "--method", "classical", "--multispectral", "-o", "masks")
    code, out, _ = inside(dataset, monkeypatch, *asked)
    assert code == 1
    assert "segmented 1 of 2 images" in out
    assert "in both bands" in out  # the other one is blank
    _, told = found(dataset / "masks" / "004_sugar_box.0_0_0.exp1.los.77_ghz.mask.h5")
    assert told["other_band"].endswith("los/processed/radars/24_ghz/processed_image.pkl")


def test_prompts_of_a_file(tmp_path, monkeypatch):
    ms.save(tmp_path / "a.h5", image())
    plain = {"points": [[12, 15], [2, 2]], "positive": [True, False]}
    (tmp_path / "p.json").write_text(json.dumps({**plain, "method": "wave"}))
    asked = ("a.h5", "--method", "classical", "--prompts", "p.json")
    code, _, error = inside(tmp_path, monkeypatch, *asked)
    assert code == 0, error
    _, told = found(tmp_path / "a.mask.h5")
    assert {name: told[name] for name in plain} == plain
    assert told["seed"] is None
    for text, message in (
        ('{"points": [[1, 2]]}', "p.json holds no prompts"),
        ("[1", "p.json is no JSON"),
        ('{"points": [[30, 2]], "positive": [true]}', "30 x 40 pixels"),
        ('{"points": [[1]], "positive": [true]}', "p.json: points has shape"),
    ):
        (tmp_path / "p.json").write_text(text)
        assert message in inside(tmp_path, monkeypatch, *asked)[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.h5", "--method", "sem"], "unknown segmenter 'sem'"),
        (["a.h5", "--condition", "carton"], "unknown --condition 'carton'"),
        (["mask.h5", "--method", "classical"], "mask.h5 holds a Mask; expected a SarImage"),
        (["a.h5", "--method", "sam", "--model", "nowhere"], "nowhere is no folder with a model"),
        (["a.h5", "--multispectral", "--method", "classical"], "--other-band"),
        (["a.h5", "--method", "classical", "-o", "a.h5"], "would be overwritten"),
        (["empty", "--method", "classical"], "empty holds no image"),
        (["a.h5", "mask.h5", "--other-band", "a.h5"], "belong to one image"),
    ],
)
def test_what_cannot_be_is_refused_and_writes_nothing(tmp_path, monkeypatch, arguments, message):
    (tmp_path / "empty").mkdir()
    ms.save(tmp_path / "a.h5", image())
    ms.save(tmp_path / "mask.h5", ms.Mask(grid_xy=GRID.xy, inside=np.zeros((30, 40), bool)))
    assert message in inside(tmp_path, monkeypatch, *arguments)[2]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "empty", "mask.h5"]


def test_the_help_teaches():
    shown = re.sub(r"\s+", " ", CliRunner().invoke(app, ["segment", "--help"]).output)
    for text in (
        "Example: millisight segment mug.image.h5",
        "drawn once more, 5 of each kind",
        "nlos: behind something",
    ):
        assert text in shown
