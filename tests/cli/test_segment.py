"""`millisight segment` as a user meets it: one image, a dataset, prompts, and what cannot be."""

import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here, run_inside
from helpers.form_images import ball, cylinder, flat
from helpers.small_images import GRID, image, publish
from millisight.cli.image_sources import image_sources
from millisight.io import load_extras


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The command in `tmp_path` and within this process, as `run_here`."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: run_here("segment", *arguments)


def found(path):
    mask = ms.load(path)
    assert isinstance(mask, ms.Mask)
    assert mask.inside[9:15, 11:23].mean() > 0.95
    assert mask.inside.mean() < 0.15
    return mask, load_extras(path)["segmentation"]


@pytest.mark.slow
def test_one_image_gives_a_mask_and_a_picture(tmp_path, here):
    ms.save(tmp_path / "mug.image.h5", image())
    ms.save(tmp_path / "mug24.h5", image(1))
    asked = ("mug.image.h5", "--other-band", "mug24.h5", "--method", "classical", "--seed", "3")
    code, out, err = run_inside("segment", *asked, cwd=tmp_path)
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
    assert here(*asked, "-o", "again.h5", "--no-picture")[0] == 0
    np.testing.assert_array_equal(ms.load(tmp_path / "again.h5").inside, mask.inside)
    assert not (tmp_path / "again.png").exists()


def test_of_prompts_is_spoken_only_where_some_are_asked_for(tmp_path, here):
    pytest.importorskip("onnxruntime")
    ms.save(tmp_path / "mug.image.h5", image())
    out = here("mug.image.h5", "--no-picture")[1]
    first, second = out.splitlines()
    assert re.fullmatch(r"mug: mask of \d+ pixels, \d+\.\d %, by wave; wrote mug\.mask\.h5", first)
    assert second == "  what is round or flat cannot be told of this image: it has magnitudes alone, and no phases"


def test_it_says_how_large_a_ball_is(tmp_path, here):
    pytest.importorskip("onnxruntime")
    ms.save(tmp_path / "ball.h5", ball(0.03, (0.01, -0.02, -0.06)))
    out = here("ball.h5", "--no-picture")[1]
    assert re.search(r"\n  ball of 3\d mm radius around \(0\.01\d, -0\.0[12]\d, -0\.0[56]\d\) m\n", out)
    (told,) = load_extras(tmp_path / "ball.mask.h5")["segmentation"]["round"]
    (said,) = json.loads(here("ball.h5", "--no-picture", "--json")[1])["images"]
    assert said["round"] == [told]
    assert told["radius"] == pytest.approx(0.03, abs=0.005)


def test_it_says_how_a_flat_top_lies(tmp_path, here):
    pytest.importorskip("onnxruntime")
    ms.save(tmp_path / "box.h5", flat((0.08, 0.05), (0.01, -0.02, -0.06), (4, 0), 30))
    out = here("box.h5", "--no-picture")[1]
    assert re.search(
        r"\n  flat rectangle of (79|8[0-2]) x (49|5[0-2]) mm around \(0\.01\d, -0\.0[12]\d, -0\.0[56]\d\) m", out
    )
    assert "4.0 degrees from level\n" in out
    (told,) = load_extras(tmp_path / "box.mask.h5")["segmentation"]["flat"]
    (said,) = json.loads(here("box.h5", "--no-picture", "--json")[1])["images"]
    assert said["flat"] == [told]
    assert said["round"] == []
    assert told["sides"] == pytest.approx([0.08, 0.05], abs=0.0025)


@pytest.fixture
def dataset(tmp_path):
    return publish(tmp_path / "data")


@pytest.mark.slow
def test_a_dataset_is_gone_through_and_what_failed_is_said_at_the_end(dataset, tmp_path):
    code, out, err = run_inside("segment", "data", "--method", "classical", "-o", "masks", cwd=tmp_path)
    assert code == 1
    assert "segmented 3 of 4 images" in out
    assert f"{dataset}.nlos.24_ghz: picture is blank" in err
    assert "failed: 1" in err
    assert "Traceback" not in err
    names = sorted(path.name for path in (tmp_path / "masks").glob("*.h5"))
    assert names == [f"{dataset}.{name}.mask.h5" for name in ("los.24_ghz", "los.77_ghz", "nlos.77_ghz")]
    for name in names:
        _, told = found(tmp_path / "masks" / name)
        assert told["condition"] == name.split(".")[3]
        assert told["image"].startswith("004_sugar_box/robot_collected/")
    assert len(list((tmp_path / "masks").glob("*.png"))) == 3


def test_only_the_published_layouts_empty_scenes_are_passed_over(dataset, tmp_path):
    (tmp_path / "data" / "my_background").mkdir()
    own, empty = tmp_path / "data" / "my_background" / "a.image.h5", tmp_path / "data" / "tripod_EMPTY"
    ms.save(own, image())
    found = [source.path for source in image_sources([tmp_path / "data"])]
    assert len(found) == 5
    assert own in found
    assert not [path for path in found if empty in path.parents]
    assert len(image_sources([empty])) == 1  # who names it, means it


def test_both_bands_of_experiments(dataset, here, tmp_path):
    code, out, err, _ = here("data", "--method", "classical", "--multispectral", "-o", "masks")
    assert code == 1
    assert "segmented 1 of 2 images" in out
    assert "in both bands" in err  # the other one is blank
    _, told = found(tmp_path / "masks" / f"{dataset}.los.77_ghz.mask.h5")
    assert told["other_band"].endswith("los/processed/radars/24_ghz/processed_image.pkl")


def test_prompts_of_a_file(tmp_path, here):
    ms.save(tmp_path / "a.h5", image())
    plain = {"points": [[12, 15], [2, 2]], "positive": [True, False]}
    (tmp_path / "p.json").write_text(json.dumps({**plain, "method": "wave"}))
    asked = ("a.h5", "--method", "classical", "--prompts", "p.json")
    code, _, _, error = here(*asked)
    assert code == 0, error
    _, told = found(tmp_path / "a.mask.h5")
    assert {name: told[name] for name in plain} == plain
    assert told["seed"] is None
    for text, message in (
        ('{"points": [[1, 2]]}', "p.json holds no prompts"),
        ("[1", "p.json is not JSON"),
        ('{"points": [[30, 2]], "positive": [true]}', "30 x 40 pixels"),
        ('{"points": [[1]], "positive": [true]}', "p.json: points has shape"),
    ):
        (tmp_path / "p.json").write_text(text)
        assert message in here(*asked)[3]


def test_a_mask_that_was_marked_by_hand_is_not_written_over(tmp_path, here):
    for name in ("a.image.h5", "b.image.h5"):
        ms.save(tmp_path / name, image())
    (tmp_path / "a.mask.png").write_bytes(b"by hand, of a photograph")
    (tmp_path / "a.prompts.json").write_text("{}")
    message = "a.mask.png was made by `millisight annotate`; choose another name with --output"
    assert message in here("a.image.h5", "--method", "classical")[3]
    assert (tmp_path / "a.mask.png").read_bytes() == b"by hand, of a photograph"
    assert not (tmp_path / "a.mask.h5").exists()
    assert here("a.image.h5", "--method", "classical", "-o", "c.mask.h5")[0] == 0


def test_names_that_are_no_text_are_drawn(tmp_path, here):
    name = "bad\udcff.image.h5"
    ms.save(tmp_path / name, image())
    for option in ((), ("--instances",)):
        assert here(name, "--method", "classical", *option)[0] == 0
    assert len(list(tmp_path.glob("*.png"))) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.h5", "--method", "sem"], "unknown segmenter 'sem'"),
        (["a.h5", "--condition", "carton"], "unknown --condition 'carton'"),
        (["mask.h5", "--method", "classical"], "mask.h5 holds a Mask; expected a SarImage"),
        (["a.h5", "--device", "tpu"], "unknown device 'tpu'"),
        (["a.h5", "--device", "cuda"], "--device cuda is for --method sam, and others run on the CPU"),
        (["a.h5", "--method", "sam", "--model", "nowhere"], "nowhere is not a folder with a model"),
        (["a.h5", "--multispectral", "--method", "classical"], "--other-band"),
        (["a.h5", "--method", "classical", "-o", "a.h5"], "would be overwritten"),
        (["a.h5", "--method", "classical", "--other-band", "b.h5", "-o", "b.h5"], "is an input, too, and would be"),
        (["empty", "--method", "classical"], "empty holds no image"),
        (["a.h5", "mask.h5", "--other-band", "a.h5"], "work with a single image"),
    ],
)
def test_what_cannot_be_is_refused_and_writes_nothing(tmp_path, here, arguments, message):
    (tmp_path / "empty").mkdir()
    for name in ("a.h5", "b.h5"):
        ms.save(tmp_path / name, image())
    ms.save(tmp_path / "mask.h5", ms.Mask(grid_xy=GRID.xy, inside=np.zeros((30, 40), bool)))
    assert message in here(*arguments)[3]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "b.h5", "empty", "mask.h5"]


def test_an_image_that_cannot_be_segmented_is_named_by_its_path(tmp_path, here):
    (tmp_path / "in").mkdir()
    ms.save(tmp_path / "in" / "zero.image.h5", ms.SarImage(grid=GRID, values=np.zeros(GRID.shape)))
    error = here("in/zero.image.h5", "--method", "classical", "--no-picture")[3]
    assert error.startswith("in/zero.image.h5: ")
    assert error.count("zero.image.h5") == 1


def test_of_a_capture_it_says_what_makes_an_image(tmp_path, here):
    radar, path = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.02, 0.02), step=0.02)
    frames = np.zeros((len(path), 1, 1, radar.waveform.samples_per_chirp), np.complex64)
    ms.save(tmp_path / "c.capture.h5", ms.Capture(radar=radar, trajectory=path, frames=frames))
    error = here("c.capture.h5", "--method", "classical")[3]
    assert error == "c.capture.h5 holds a Capture; expected a SarImage: `millisight image` makes one of it"


def test_a_missing_image_does_not_stop_the_others(tmp_path, here):
    ms.save(tmp_path / "a.h5", image())
    code, out, *_ = here("nothing.h5", "a.h5", "--method", "classical", "--json", "--no-picture")
    first, second = json.loads(out)["images"]
    assert (code, first["error"], second["found"]) == (1, "nothing.h5: no such file", True)


def test_images_of_other_names_in_a_folder_are_named(tmp_path, here):
    (tmp_path / "some").mkdir()
    for name in ("a.image.h5", "b.h5", "b.mask.h5"):
        ms.save(tmp_path / "some" / name, image())
    code, out, err, _ = here("some", "--method", "classical", "-o", "out", "--no-picture")
    assert (code, sorted(path.name for path in (tmp_path / "out").iterdir())) == (0, ["a.mask.h5"])
    assert "passed over what is not called *.image.h5: b.h5; pass by name" in out + err
    (tmp_path / "some" / "a.image.h5").unlink()
    assert "or pass by name what is one: b.h5" in here("some", "--method", "classical")[3]


def test_the_help_teaches():
    shown = re.sub(r"\s+", " ", run_here("segment", "--help")[1])
    for text in (
        "Example: millisight segment mug.image.h5",
        "drawn once more: 5 positive ones",
        "nlos: object hidden",
    ):
        assert text in shown


def test_every_object_gets_a_mask_of_its_own(tmp_path, here):
    """Two rectangles, and an image of noise: instances as HDF5 and in colours, one by one and of a folder."""
    rng = np.random.default_rng(0)
    values = np.full(GRID.shape, 0.001) * rng.rayleigh(size=GRID.shape)
    ms.save(tmp_path / "none.image.h5", ms.SarImage(grid=GRID, values=values))
    values[4:10, 6:14], values[18:26, 24:34] = 1.0, 0.5
    pair = ms.SarImage(grid=GRID, values=values)
    ms.save(tmp_path / "pair.image.h5", pair)
    assert "pair: 2 objects of 48, 80 pixels; wrote pair.instances.h5" in here("pair.image.h5", "--instances")[1]
    kept = ms.load(tmp_path / "pair.instances.h5")
    assert np.array_equal(kept.labels, ms.segment_instances(pair).labels)
    assert [mask.inside.sum() for mask in kept] == [48, 80]
    told = load_extras(tmp_path / "pair.instances.h5")["segmentation"]
    objects = told.pop("objects")
    assert told == {"image": "pair.image.h5", "other_band": None, "method": None, "values": "mean"}
    assert [one["pixels"] for one in objects] == [48, 80]
    for one, mask, score in zip(objects, kept, kept.scores, strict=True):
        x, y = (axis[some] for axis, some in zip((GRID.x, GRID.y), np.nonzero(mask.inside), strict=True))
        assert one["centre"] == pytest.approx([x.mean(), y.mean()])
        assert one["score"] == pytest.approx(score)
        half = np.diff(GRID.x).mean() / 2
        assert (one["lower"][0], one["upper"][0]) == pytest.approx((x.min() - half, x.max() + half))
    rgb = plt.imread(tmp_path / "pair.instances.png")[..., :3]
    coloured = (rgb.max(axis=2) - rgb.min(axis=2) > 0.15).mean()
    assert coloured > 0.05  # over an image in grey
    code, out, _err, *_ = here(".", "--instances", "-o", "out", "--no-picture")
    assert (code, out.count("objects")) == (0, 2)
    assert "millisight image --clutter lid" in out  # of the one without any
    assert {path.name: len(ms.load(path)) for path in (tmp_path / "out").iterdir()} == {
        "none.instances.h5": 0, "pair.instances.h5": 2,
    }  # fmt: skip
    restricted = here("pair.image.h5", "--instances", "--method", "classical", "-o", "by.h5", "--no-picture")
    assert restricted[0] == 0
    assert load_extras(tmp_path / "by.h5")["segmentation"]["method"] == "classical"


def test_of_every_object_it_says_what_is_round_or_flat(tmp_path, here):
    top, cylinder_ = flat((0.06, 0.05), (-0.05, 0, -0.06)), cylinder(0.02, -0.06, 0.12)
    beside = np.roll(cylinder_.values, 20, axis=0)
    both = top.values / abs(top.values).max() + beside / abs(beside).max()
    ms.save(tmp_path / "two.image.h5", ms.SarImage(grid=top.grid, values=both))
    told = json.loads(here("two.image.h5", "--instances", "--json")[1])["images"][0]
    kinds = [[one["kind"] for name in ("round", "flat") for one in thing[name]] for thing in told["objects"]]
    assert sorted(kinds) == [["cylinder"], ["rectangle"]]
    assert load_extras(tmp_path / "two.instances.h5")["segmentation"]["objects"] == told["objects"]
    said = here("two.image.h5", "--instances", "-o", "again.h5")[1]
    numbers = [1 + kinds.index([kind]) for kind in ("cylinder", "rectangle")]
    assert re.search(rf"\n  {numbers[0]}: cylinder of (19|2[0-3]) mm radius", said)
    assert re.search(rf"\n  {numbers[1]}: flat rectangle of 6[0-2] x (49|5[0-2]) mm", said)


def test_voxels_with_their_surface_and_three_views(tmp_path, here):
    """One image and a folder; the surface is around the voxels, in metres."""
    from millisight.meshes import load_mesh

    ms.save(tmp_path / "mug.image.h5", image())
    code, out, *_ = here("mug.image.h5", "--volume", "--method", "classical")
    assert code == 0
    kept = ms.load(tmp_path / "mug.volume.h5")
    direct = ms.segment(image(), method="classical", rng=0, volume=True)
    np.testing.assert_array_equal(kept.inside, direct.inside)
    assert (
        f"mug: {kept.inside.sum()} voxels, z 0.000 to 0.010 m, by classical; wrote mug.volume.h5 and mug.volume.ply"
        in out
    )
    assert kept.inside[9:15, 11:23].any(axis=2).mean() > 0.95
    assert load_extras(tmp_path / "mug.volume.h5")["segmentation"]["method"] == "classical"
    surface = load_mesh(tmp_path / "mug.volume.ply", unit="m")
    np.testing.assert_allclose(surface.bounds, direct.surface().bounds, atol=1e-12)
    assert (tmp_path / "mug.volume.png").read_bytes().startswith(b"\x89PNG")
    code, out, *_ = here(".", "--volume", "--method", "classical", "--no-picture", "-o", "out")
    assert (code, sorted(path.name for path in (tmp_path / "out").iterdir())) == (
        0,
        ["mug.volume.h5", "mug.volume.ply"],
    )
    assert "pass one of them" in here("mug.image.h5", "--volume", "--instances")[3]
    refused = here("mug.image.h5", "--volume", "--method", "classical", "-o", "mug.ply")[3]
    assert "unknown format of mug.ply" in refused


class Nothing:
    name, needs_prompts = "nothing", False

    def segment(self, picture, prompts):
        return ms.Candidates(masks=np.zeros((1, *picture.shape), bool), scores=[1.0])


def test_of_nothing_there_is_no_surface(tmp_path, here, monkeypatch):
    monkeypatch.setattr("millisight.cli.segment.named_segmenter", lambda *_, **__: Nothing())
    ms.save(tmp_path / "mug.image.h5", image())
    assert "nothing found, by nothing; wrote an empty mask to mug.volume.h5, and no surface" in here(
        "mug.image.h5", "--volume"
    )[1]  # fmt: skip
    assert not ms.load(tmp_path / "mug.volume.h5").inside.any()
    assert not (tmp_path / "mug.volume.ply").exists()


@pytest.mark.slow
def test_a_flat_top_that_fills_a_simulated_image_is_found(here):
    pytest.importorskip("onnxruntime")
    assert run_here("simulate", "gelatin_box", "-o", "box.capture.h5")[0] == 0
    assert run_here("image", "box.capture.h5", "-o", "box.image.h5")[0] == 0
    code, out, *_ = here("box.image.h5", "--json", "--no-picture")
    (told,) = json.loads(out)["images"]
    assert (code, told["found"]) == (0, True)
    mask = ms.load(told["output"])
    middle = np.ix_(abs(mask.grid_xy.x) < 0.02, abs(mask.grid_xy.y) < 0.02)
    assert mask.inside[middle].mean() > 0.9
