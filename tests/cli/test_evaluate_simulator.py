"""`millisight evaluate simulator`: the table of a small dataset whose truth is known; what is wrong is said."""

import csv
import dataclasses
import tomllib

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from millisight.cli.evaluate import simulator
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import SarImage, VoxelGrid
from millisight.evaluation import SimulatorTask
from millisight.imaging import combine
from millisight.io.mito import angles_folder, write_published
from millisight.io.mito._names import experiment_folder, radar_folder

SIMULATED = {"simulated": True, "physics": "by hand"}
ALPHA = (0.5, 0.5)


def blob(lower, upper, *, shift=(0.0, 0.0, 0.0), strength=1.0):
    """An image of a box of ones, its frame moved by `shift`."""
    grid = VoxelGrid.regular(np.add(shift, (0, 0, 0)), np.add(shift, (0.1, 0.08, 0.05)), (0.0025, 0.0025, 0.01))
    at = (grid.points - shift).round(6)
    inside = ((at >= lower) & (at <= upper)).all(axis=1)
    return SarImage(grid=grid, values=(strength * inside).astype(np.complex64).reshape(grid.shape))


def parts(**where):
    return blob((0.02, 0.02, 0.0), (0.05, 0.05, 0.02), **where), blob((0.051, 0.02, 0.0), (0.08, 0.05, 0.02), **where)


def put(folder, name, image, extras, radar="77_ghz"):
    path = radar_folder(folder, radar, processed=True)
    path.mkdir(parents=True, exist_ok=True)
    write_published(path / name, image, extras)


def make(root, extras=SIMULATED, names=("004_sugar_box", "025_mug")):
    """Of each object the measured image is half specular, half edge, 8 cm from where it is simulated."""
    for name in names:
        simulation = angles_folder(root, name, (0, 0, 0), simulated=True)
        specular, edge = parts()
        put(simulation, "processed_image_specular.pkl", specular, SIMULATED)
        put(simulation, "processed_image_edges.pkl", edge, SIMULATED)
        there = combine(*parts(shift=(0.0, 0.08, -0.06)), ALPHA)
        for sight in ("los", "nlos"):
            put(experiment_folder(root, name, (0, 0, 0), 1, sight), "processed_image.pkl", there, extras)
    return root


@pytest.fixture
def plain(monkeypatch):
    """Without figures, for which other tests ask."""
    monkeypatch.setattr(SimulatorTask, "figures", lambda *_: ())


def run(root, out, *options):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(simulator)
    sides = ["--measured", str(root), "--simulated", str(root), "-o", str(out), "--workers", "1"]
    return CliRunner().invoke(app, [*sides, *options])


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.mark.slow
def test_the_table_finds_what_was_combined(tmp_path):
    out, fit = tmp_path / "out", tmp_path / "fit.toml"
    done = run(make(tmp_path / "data"), out, "--pictures", "1", "--fit", str(fit), "--clouds", "ply")
    assert done.exit_code == 0, done.output
    names = ["best-01.png", "classes-los.csv", "classes-nlos.csv", "clouds", "held-out.csv", "index.html", "pairs",
             "pairs.csv", "quartiles-los.csv", "quartiles-nlos.csv", "scores.png", "sensitivity.png", "simulator.md",
             "worst-02.png"]  # fmt: skip
    assert sorted(path.name for path in out.iterdir()) == names
    assert len(list((out / "clouds").iterdir())) == 8
    pairs = rows(out / "pairs.csv")
    assert len(pairs) == 4
    for pair in pairs:
        assert float(pair["F [%]"]) == 100
        # Without its other half each part still has recall 1, and misses what is farther than 10 mm.
        assert float(pair["F specular [%]"]) < 90
        assert float(pair["F edge [%]"]) < 90
        shift = [float(value) for value in pair["shift [mm]"].split()]
        assert shift == pytest.approx([0, 80, -60], abs=0.1)
        assert pair["notes"] == ""
    weights = tomllib.loads(fit.read_text())
    assert set(weights) == {"004_sugar_box", "025_mug"}
    assert all(min(entry["alpha"]) > 0 for entry in weights.values())
    quartiles = rows(out / "quartiles-los.csv")
    assert [row["simulation"] for row in quartiles] == ["combined", "combined", "specular", "specular", "edge", "edge"]
    assert quartiles[1]["50th [%]"] == "94"
    held_out = {row["part"]: row["50th [%]"] for row in rows(out / "held-out.csv")}
    assert held_out["combined, held out"].startswith("100.0 ")
    gains = [float(told.split()[0]) for part, told in held_out.items() if part.startswith("mean gain over")]
    assert len(gains) == 3
    assert gains[2] == min(gains) > 10
    page = (out / "index.html").read_text()
    assert page.count("<table>") >= len(list(out.glob("*.csv")))
    assert page.index("Weights fitted on one image") < page.index('<section id="picture-1">')


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extras", "said"),
    [(SIMULATED, "The reference is itself simulated"), ({}, "are not marked as simulated, nor")],
)
def test_the_table_says_whether_the_yardstick_is_simulated(tmp_path, plain, extras, said):
    done = run(
        make(tmp_path / "data", extras, names=("025_mug",)), tmp_path / "out", "--pictures", "0", "--sight", "los"
    )
    assert done.exit_code == 0, done.output
    text = (tmp_path / "out" / "simulator.md").read_text()
    assert said in text
    assert ("by hand" in text.split("simulated images")[0]) == bool(extras)
    assert "out of sight" not in text


@pytest.mark.slow
def test_images_without_points_are_named_and_score_nothing(tmp_path, plain):
    root = make(tmp_path / "data", names=("025_mug",))
    nothing = blob((9, 9, 9), (9, 9, 9))
    put(angles_folder(root, "025_mug", (0, 0, 0), simulated=True), "processed_image_edges.pkl", nothing, SIMULATED)
    done = run(root, tmp_path / "out", "--pictures", "0", "--sight", "los")
    assert done.exit_code == 0, done.output
    (pair,) = rows(tmp_path / "out" / "pairs.csv")
    assert pair["notes"] == "edge cloud is empty"
    assert float(pair["F edge [%]"]) == 0
    assert float(pair["F specular [%]"]) > 50


@pytest.mark.slow
def test_what_has_no_counterpart_or_is_damaged_is_said_and_stops_nothing(tmp_path):
    root = make(tmp_path / "data")
    make(tmp_path / "more", names=("036_wood_block",))
    (tmp_path / "more" / "036_wood_block" / "robot_collected").rename(root / "robot_collected")
    (root / "036_wood_block").mkdir()
    (root / "robot_collected").rename(root / "036_wood_block" / "robot_collected")
    experiment = experiment_folder(root, "025_mug", (0, 0, 0), 1, "los")
    (radar_folder(experiment, "77_ghz", processed=True) / "processed_image.pkl").write_bytes(b"\x80\x04.")
    done = run(root, tmp_path / "out", "--pictures", "0")
    assert done.exit_code == 1
    assert len(rows(tmp_path / "out" / "pairs.csv")) == 3
    assert "036_wood_block/0_0_0/exp1/los: no simulated images of this object at the same angles" in done.output
    assert "025_mug/0_0_0/exp1/los" in done.output.split("failed: 1")[1]


def test_a_folder_without_pairs_is_an_error(tmp_path):
    root = make(tmp_path / "data", names=("025_mug",))
    with pytest.raises(InputError, match="no pairs: .* holds no 24_ghz image"):
        raise run(root, tmp_path / "out", "--radar", "24_ghz").exception
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "kind", "said"),
    [
        (("--sight", "side"), UnknownNameError, "--sight 'side'"),
        (("--threshold", "1.5"), InputError, "threshold is 1.5; expected less than 1"),
        (("--within", "0mm"), InputError, "within is 0 m"),
        (("--align", "affine"), UnknownNameError, "mode of alignment 'affine'"),
        (("--crop", "all"), InputError, "--crop is 'all'"),
        (("--fit", "image.pkl"), InputError, "--fit is image.pkl; expected a name that ends in .toml"),
        (("--crop", "12"), InputError, "--crop is '12'; expected two whole numbers such as 12,7"),
        (("--clouds", "xyz"), UnknownNameError, "point cloud format 'xyz'"),
        (("--clutter", "foil"), UnknownNameError, "kind of clutter 'foil'"),
    ],
)
def test_options_that_cannot_be_right_are_refused(tmp_path, options, kind, said):
    with pytest.raises(kind, match=said):
        raise run(make(tmp_path / "data", names=("025_mug",)), tmp_path / "out", *options).exception


@pytest.mark.slow
def test_sheets_are_taken_off_before_images_are_compared(tmp_path, plain, monkeypatch):
    asked = []

    def cut(image, *, frequency):
        asked.append(frequency)
        return dataclasses.replace(image, values=image.values * (image.grid.z < image.grid.z[3]))

    monkeypatch.setattr("millisight.evaluation.tasks.simulator.without_sheets", cut)
    root = make(tmp_path / "data", names=("025_mug",))
    for sight in ("los", "nlos"):
        folder = experiment_folder(root, "025_mug", (0, 0, 0), 1, sight)
        there = combine(*parts(shift=(0.0, 0.08, -0.06)), ALPHA)
        lid = np.zeros_like(there.values)
        lid[..., 4] = 5
        put(folder, "processed_image.pkl", dataclasses.replace(there, values=there.values + lid), SIMULATED)
    found = {}
    for clutter in ("none", "lid"):
        assert run(root, tmp_path / clutter, "--clutter", clutter, "--pictures", "0").exit_code == 0
        found[clutter] = [float(pair["F [%]"]) for pair in rows(tmp_path / clutter / "pairs.csv")]
    assert max(found["none"]) < 90
    assert min(found["lid"]) == 100
    assert set(asked) == {79e9}
