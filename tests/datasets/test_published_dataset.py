"""Every command on the published dataset in every variation, as downloaded and converted: no failure, equal results."""

import csv
import json
import re
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager, nullcontext
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
from typer.testing import CliRunner

import millisight as ms
from helpers.processes import made_once
from helpers.published_mock import CRACKERS, LEFT_OUT, MUG, PEACH, SUGAR, TUNA, WRENCH
from helpers.undrawn import undrawn
from helpers.whole_scenes import PLAIN
from millisight import datasets
from millisight.cli.annotate import mask_in_dataset
from millisight.cli.app import app
from millisight.core.errors import FileError, InputError
from millisight.data import grid_difference
from millisight.datasets import find_scenes, released_examples
from millisight.evaluation import HIGH, LOW
from millisight.evaluation.tasks import classification
from millisight.io.mito import experiment_folder, read_experiment, read_published
from millisight.perception.classification import CLASSIFIER_WEIGHTS, RELEASED_CLASSES
from millisight.perception.segmentation import Candidates
from millisight.viz.annotator import Annotation, AnnotatorServer, open_picture, segmenters_for

FORMS = ("published", "converted")


@pytest.fixture(scope="module")
def roots(tmp_path_factory, published_root):
    """The dataset as published, and converted; for reading only."""

    def convert(folder):
        assert datasets.convert(published_root, folder / "mito", workers=1).failures == ()

    return {"published": published_root, "converted": made_once(tmp_path_factory, "converted-mock", convert) / "mito"}


def run(*words, fails=False):
    """What a command prints; it must succeed."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert (result.exit_code != 0) == fails, result.output
    return result.output


def numbers_of(folder):
    """Every table that an evaluation wrote, less the times that it took and the dataset's name."""
    tables = {path.name: path.read_text() for path in sorted(folder.glob("*.csv")) if path.name != "times.csv"}
    return {name: re.sub("MITO_Dataset|mito", "DATASET", text) for name, text in tables.items()}


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_nothing_of_the_layout_is_called_stray(form, roots):
    dataset = datasets.open(roots[form])
    assert (dataset.stray, [path for one in dataset.objects for path in one.stray]) == ((), [])
    kinds = {item.kind for item in dataset.items}
    assert kinds == {
        "image", "radar mask", "camera frame", "camera picture", "camera mask", "raw", "raw simulation", "robot log",
        "info",
    }  # fmt: skip
    assert len(dataset.experiments) == 19
    # One of each kind; `dataset verify` reads all of them in the next test.
    one_each = {item.kind: item for item in dataset.items if item.kind != "raw"}
    assert all(item.read() is not None for item in one_each.values())


def test_a_conversion_keeps_every_item(roots):
    def items(form):
        return sorted(
            (item.path.relative_to(roots[form]).with_suffix("").as_posix(), item.kind, item.radar, item.ext)
            for item in datasets.open(roots[form]).items
            if item.kind not in ("raw", "robot log")
        )

    assert len(items("published")) > 200
    assert items("published") == items("converted")


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_list_verify_and_info(form, roots):
    listed = run("dataset", "list", roots[form])
    assert "not part of the layout" not in listed
    (row,) = [line for line in listed.splitlines() if "tuna_fish_can" in line]
    assert "exp2 los" in row
    assert "0 with problems" in run("dataset", "verify", roots[form], "--workers", 1)
    told = run("dataset", "info", roots[form] / CRACKERS)
    assert "failed" not in told
    tree = json.loads(run("dataset", "list", roots[form], "--json"))
    out = [part["folder"] for one in tree["objects"] for part in one["experiments"] if part["left_out"]]
    assert out == [f"{TUNA}/robot_collected/0_0_0/exp2/los"]


@pytest.mark.slow
def test_evaluations_agree_before_and_after_conversion(roots, tmp_path, monkeypatch):
    """Segmentation reads every form of image; the other tasks, by the same function, one form each."""
    commands = {
        "segmentation": ("--method", "wave", "--seeds", 1, "--failures", 0),
        "classification": ("--method", "classical", "--mistakes", 0),
        "simulator": ("--pictures", 0),
    }
    names = {"segmentation": (CRACKERS, PEACH), "classification": (PEACH,), "simulator": (CRACKERS,)}
    monkeypatch.setattr(classification, "_TIMED", 1)  # scene; what it takes is not compared
    for task, options in commands.items():
        written = {}
        for form, root in roots.items():
            data = ("--measured", root, "--simulated", root) if task == "simulator" else (root,)
            data += tuple(word for name in (*names[task], TUNA) for word in ("--object", name))
            with nullcontext() if form == "published" else undrawn():  # the tables are equal: one page is enough
                told = run("evaluate", task, *data, "-o", tmp_path / task / form, "--workers", 1, *options)
            assert f"note: the authors of the dataset leave out {LEFT_OUT[0]}" in told
            written[form] = numbers_of(tmp_path / task / form)
        assert len(written["published"]) > 3
        assert written["published"] == written["converted"]
        assert (tmp_path / task / "published" / "index.html").exists()
    with open(tmp_path / "segmentation" / "published" / "trials.csv", encoding="utf-8") as file:
        trials = [row for row in csv.DictReader(file) if row["input"] == HIGH and "blind" not in row["segmenter"]]
    assert len(trials) == 6
    assert np.median([float(row["iou"]) for row in trials]) > 0.5  # truth and image show one disc


@pytest.mark.slow
def test_an_experiment_is_chosen_by_its_number(roots, tmp_path):
    run("evaluate", "segmentation", roots["published"], "-o", tmp_path, "--experiment", 2, "--method", "wave",
        "--seeds", 1, "--failures", 0, "--workers", 1, "--object", MUG)  # fmt: skip
    scenes = {row["scene"] for row in csv.DictReader((tmp_path / "trials.csv").read_text().splitlines())}
    assert scenes == {f"{MUG}/0_0_90/exp2/los", f"{MUG}/0_0_90/exp2/nlos"}


def test_what_the_authors_leave_out_alone_is_an_error(roots, tmp_path):
    with pytest.raises(InputError, match="nothing to evaluate: the authors of the dataset leave out"):
        ms.evaluate("segmentation", roots["published"], objects=[TUNA])


@pytest.mark.parametrize("form", FORMS)
def test_images_are_cropped_and_freed_of_the_empty_scene_as_published(form, roots):
    dataset = datasets.open(roots[form])
    by_name = {scene.name: scene for scene in find_scenes(dataset)}
    first, second = (by_name[f"{CRACKERS}/0_0_0/exp{number}/los"] for number in (1, 2))
    whole = dataset.only([CRACKERS]).experiments[0]
    image = first.read_image(HIGH)[0]
    assert image.grid.z == pytest.approx(whole.image().grid.z[12:-7])
    assert first.read_image(HIGH, crop=(1, 2))[0].grid.z == pytest.approx(whole.image().grid.z[1:-2])
    assert len(second.read_image(HIGH)[0].grid.z) == 26
    low, stored = first.read_image(LOW)[0], whole.image(radar="24_ghz")
    empty = dataset.only(["0228"]).experiments[0].image(radar="24_ghz")
    assert low.values.shape == (22, 24, 19)
    assert low.values == pytest.approx(stored.magnitude[:22, :, :-3] - empty.magnitude[:, :, :-3], abs=1e-6)
    assert low.values.real.min() < 0
    # Nothing is cut from an image of fewer slices than a crop takes.
    assert len(by_name[f"{PEACH}/0_0_0/exp1/los"].read_image(HIGH)[0].grid.z) == 6
    assert by_name[f"{WRENCH}/0_0_0/exp1/los"].object == "adjustable_wrench"


@pytest.mark.parametrize("name", [MUG, CRACKERS, SUGAR, WRENCH, PEACH])
def test_the_truth_of_experiment_1_lies_on_the_object_in_both_forms(name, roots):
    found = {}
    for form, root in roots.items():
        scene = next(one for one in find_scenes(datasets.open(root).only([name]), sight="nlos", experiment=1))
        truth = scene.read(transform="published").truth[HIGH]
        drawn = datasets.open(root).only([name]).experiments[0].mask() if name != MUG else None
        assert truth.inside.any()
        if drawn is not None:
            both = (truth.inside & drawn.inside).sum() / (truth.inside | drawn.inside).sum()
            assert both > 0.7
        found[form] = truth.inside
    assert np.array_equal(found["published"], found["converted"])


@pytest.mark.slow
def test_images_masks_and_classes_are_the_same_before_and_after(roots, tmp_path):
    told = {}
    for form, root in roots.items():
        out = tmp_path / form
        segmented = run("segment", root / SUGAR, "--multispectral", "--method", "classical", "-o", out, "--no-picture")
        assert "there is no simulated 24 GHz image; the 77 GHz image is used alone" in segmented
        assert "segmented 5 of 5 images" in segmented
        first = root / MUG / "robot_collected" / "0_0_90" / "exp1"  # one image of the true shape
        run("segment", first, "--method", "classical", "-o", out, "--no-picture")
        lines = run("classify", root / MUG, "--radar", "77_ghz", "--mask", root, "--json").splitlines()
        answers = [json.loads(line) for line in lines if line.startswith("{")]
        assert len(answers) == 7
        some = root / MUG / "simulation"
        beside = run("classify", some, "--radar", "77_ghz", "--mask", root / MUG, "--json").splitlines()
        assert len([line for line in beside if line.startswith("{")]) == 3
        masks = {path.name: ms.load(path).inside.tobytes() for path in sorted(out.glob("*.mask.h5"))}
        assert len(masks) == 9
        imaged = run("image", root / CRACKERS, "--radar", "24_ghz", "-o", out, "--method", "fast")
        assert "imaged 4 of 4 captures" in imaged
        images = {path.name: ms.load(path).values for path in sorted(out.glob("*.image.h5"))}
        run("view", root / SUGAR / "simulation", "--html", out / "view.html")
        told[form] = ([answer["probabilities"] for answer in answers], masks, images)
    (ours, masks, images), (theirs, their_masks, their_images) = told.values()
    assert ours == theirs
    assert masks == their_masks
    assert sorted(images) == sorted(their_images)
    assert all(np.array_equal(values, their_images[name]) for name, values in images.items())


@pytest.mark.parametrize("form", FORMS)
def test_every_picture_can_be_annotated(form, roots):
    experiment = datasets.open(roots[form]).only([MUG]).experiments[0]
    kinds = ("image", "camera frame", "camera picture")
    paths = [item.path for item in experiment.items if item.kind in kinds]
    assert len(paths) == 5
    assert {open_picture(path).size for path in paths if "camera" in path.parts} == {(640, 480)}
    assert open_picture(experiment.item("image").path).size in {(24, 24), (220, 241)}


@pytest.fixture(scope="module")
def trained(roots, tmp_path_factory):
    """The paper's network after one batch of two, and what the command says."""
    pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    folder = tmp_path_factory.mktemp("weights")
    told = run("train", "released", roots["published"], "-o", folder, "--epochs", 1, "--batch", 2)
    return folder / "final_weights.h5", told


@pytest.fixture(scope="module")
def weights(trained):
    return trained[0]


@pytest.mark.slow
@pytest.mark.parametrize("masks", ["published", "own"])
def test_the_papers_third_table_beside_ours(masks, roots, weights, tmp_path):
    shipped = Path(CLASSIFIER_WEIGHTS)
    words = ("--split", "published", "--weights", weights, "--weights", shipped, "--workers", 1, "--mistakes", 1)
    more = ("--as-published",) if masks == "published" else ("--method", "classical")
    tables = {}
    for form, root in roots.items():
        told = run("evaluate", "classification", root, "-o", tmp_path / form, *words, *more)
        assert told.count("| paper: its real data |") == 3
        assert ("As published: each image is classified in the mask that the dataset has beside it" in told) == (
            masks == "published"
        )
        assert "the split 1729816641 tests 45 images" in told
        tables[form] = numbers_of(tmp_path / form)
    answers = list(csv.DictReader((tmp_path / "published" / "answers.csv").read_text().splitlines()))
    tested = {f"{CRACKERS}/0_0_0/exp1/nlos", f"{WRENCH}/0_0_0/exp1/nlos"}  # of the split's that are in the mock
    assert {row["scene"] for row in answers} == tested
    assert {row["truth"] for row in answers} == {"box", "handle"}
    assert {row["classifier"] for row in answers} == {"final_weights", "classifier"}
    assert {row["masks"] for row in answers} == ({"predicted"} if masks == "published" else {"predicted", "true"})
    assert tables["published"] == tables["converted"]


@pytest.mark.slow
def test_the_released_network_classifies_and_asks_for_its_split(roots, weights, tmp_path):
    images = roots["published"] / WRENCH / "robot_collected"
    line = run("classify", images, "--radar", "77_ghz", "--weights", weights, "--json", "--mask", roots["published"])
    answers = [json.loads(one) for one in line.splitlines() if one.startswith("{")]
    assert [sorted(one["probabilities"]) for one in answers] == [["box", "can", "handle", "sphere"]] * 2
    with pytest.raises(InputError, match="add --split published"):
        ms.evaluate("classification", roots["published"], weights=(weights,), objects=[WRENCH])


@pytest.mark.slow
def test_the_released_network_is_trained_on_the_simulated_images_of_the_split(roots, trained):
    seen = {form: released_examples(datasets.open(root)) for form, root in roots.items()}
    names = [RELEASED_CLASSES[one.label] for one in seen["published"]]
    assert names == ["box", "box", "can", "sphere", "handle"]  # crackers, sugar, tuna, peach, wrench; the mug is a cup
    for ours, theirs in zip(seen["published"], seen["converted"], strict=True):
        assert np.array_equal(ours.specular, theirs.specular)
        assert 0.05 < ours.specular.max() < 1  # in the published scale
        assert np.count_nonzero(ours.specular) < 0.2 * ours.specular.size
    assert "5 examples, 1 batches of 2; loss from" in trained[1]


RECIPE = """
published = "{root}"
meshes = "{root}"
scenes = {scenes}
vertices = 100
positions = 200
examples = 4
batch = 2
schedule = {{ epochs = 1 }}
whole = {{ views = 1, sheets = 0 }}
[classes]
box = ["003_cracker_box"]
other = ["025_mug"]
"""


@pytest.mark.slow
def test_recipes_take_the_datasets_simulated_images_and_meshes(roots, tmp_path, monkeypatch):
    """Beside scenes made of the meshes from the command line; alone, the same before and after conversion."""
    pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    from millisight.perception.training import ClassifierRecipe, SceneSettings, SegmenterRecipe, make_scenes

    names = ("003_cracker_box", "sugar_box", "025_mug", "042_wrench")
    (tmp_path / "recipe.toml").write_text(RECIPE.format(root=roots["published"].as_posix(), scenes=2))
    run("train", "classifier", tmp_path / "recipe.toml", "-o", tmp_path / "out")
    told = json.loads((tmp_path / "out" / "classifier.json").read_text())
    assert told["classes"] == {"box": ["003_cracker_box"], "other": ["025_mug"]}
    assert {path.name.split("-")[0] for path in (tmp_path / "out" / "scenes").glob("[!w]*")} == {
        "003_cracker_box",
        "025_mug",
    }
    assert told["scenes"] == {"training": 2 + 2, "validation": 2}  # made of meshes, and the dataset's
    seen = {}
    for form, root in roots.items():
        classifier = ClassifierRecipe(
            classes={"box": names[:2], "other": names[2:]}, published=str(root), scenes=0, batch=2, examples=4,
            whole=PLAIN,
        )  # fmt: skip
        segmenter = SegmenterRecipe(
            scenes=SceneSettings(published=str(root), poses=0, validation=("mug",)), whole=PLAIN
        )
        seen[form] = [make_scenes(recipe, tmp_path / form) for recipe in (classifier, segmenter)]
    for ours, theirs in zip(seen["published"], seen["converted"], strict=True):
        for side in ("training", "validation"):
            assert [one.name for one in ours[side]] == [one.name for one in theirs[side]] != []
            for one, other in zip(ours[side], theirs[side], strict=True):
                assert np.array_equal(one.whole.objects, other.whole.objects)
                assert np.array_equal(one.whole.levels["77_ghz"], other.whole.levels["77_ghz"])


@pytest.mark.slow
@pytest.mark.parametrize("radar", ["77_ghz", "24_ghz"])
def test_raw_files_are_imaged_as_published_on_the_published_grid(radar, roots, tmp_path):
    """Linear poses, both receivers at 24 GHz, the nearest bin below; the published masks' pixels."""
    told = run("image", roots["published"] / MUG / "robot_collected", "--radar", radar, "--as-published",
               "-o", tmp_path / "i.h5")  # fmt: skip
    assert "as published: the nearest of 4096 range bins below" in told
    image = ms.load(tmp_path / "i.h5")
    steps = {step["step"]: step for step in image.metadata["history"]}
    assert steps["place_frames"]["poses"] == "linear"
    assert steps["form_as_published"]["bins"] == 4096
    scan = read_experiment(experiment_folder(roots["published"], MUG, (0, 0, 90), 1, "los"), radar, every_receiver=True)
    assert len(scan.radar.array.rx_positions) == {"77_ghz": 4, "24_ghz": 2}[radar]
    if radar == "77_ghz":
        mask = datasets.open(roots["published"]).only([MUG]).experiments[0].mask()
        assert grid_difference(image.grid, mask.grid_xy) == ""
    with pytest.raises(InputError, match="a method of its own"):
        run_here("image", roots["published"] / MUG, "--as-published", "--method", "fast")


def run_here(*words):
    """A command, whose error is raised."""
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)


def test_ground_truth_of_ones_own_is_what_evaluations_read(roots, tmp_path):
    """A frame and an image are annotated in the published form; an evaluation then finds a mask where none was."""
    root = tmp_path / "own"
    shutil.copytree(roots["published"] / WRENCH, root / WRENCH)
    folder = root / WRENCH / "robot_collected" / "0_0_0" / "exp1" / "los"
    kept = read_published(folder / "processed" / "camera" / "camera_masks.pkl").record
    shutil.rmtree(folder / "processed" / "camera")
    (folder / "processed" / "radars" / "77_ghz" / "radar_masks.pkl").unlink()
    (scene,) = find_scenes(datasets.open(root), sight="los")
    with pytest.raises(FileError, match="has no camera mask"):
        scene.read(transform="published")
    (frame,) = (folder / "unprocessed" / "camera").glob("*.pkl")
    for path, points in ((frame, [[240, 320]]), (folder / "processed/radars/77_ghz/processed_image.pkl", [[12, 12]])):
        subject = open_picture(path)
        target = mask_in_dataset(subject)
        annotation = Annotation(subject, target, segmenters={"disc": Disc()})
        asked = subject.on_screen(np.array(points)).tolist()
        annotation.save({"method": "disc", "points": asked, "positive": [True]})
        assert mask_in_dataset(subject) == target  # to go on from
        annotation.prompts_path.unlink()
        with pytest.raises(InputError, match="exists, and was not made by"):
            mask_in_dataset(subject)
    mask = read_published(folder / "processed" / "camera" / "camera_masks.pkl").record
    assert (mask.pixels.shape, mask.points.shape, mask.depth.dtype) == ((480, 640), (480, 640, 3), np.float32)
    assert np.array_equal(mask.pixels, kept.pixels)
    assert np.array_equal(mask.pose, kept.pose)
    assert np.nanmax(np.abs(mask.depth - 450)) == 0  # [mm]
    assert np.isnan(mask.depth[~mask.pixels]).all()
    found = scene_truth(root)
    assert datasets.open(root).objects[0].stray == ()
    assert (found & datasets.open(root).experiments[0].mask().inside).sum() > 0.5 * found.sum()


def scene_truth(root):
    (scene,) = find_scenes(datasets.open(root), sight="los")
    return scene.read(transform="published").truth[HIGH].inside


@pytest.mark.slow
def test_the_command_annotates_a_frame_of_the_dataset_in_both_forms(roots, tmp_path):
    """`millisight annotate` in a process of its own, asked as its page asks; of the other form what it serves, here."""
    found = {}
    for form, root in roots.items():
        place = Path(WRENCH) / "robot_collected" / "0_0_0" / "exp1" / "los" / "unprocessed" / "camera"
        (frame,) = [path for path in (root / place).iterdir() if path.suffix in (".pkl", ".h5")]
        here = tmp_path / form / place
        here.mkdir(parents=True)
        shutil.copy(frame, here)
        with (annotating if form == "published" else serving)(here / frame.name) as (address, ended):
            about = json.loads(urlopen(f"{address}about").read())
            assert (about["columns"], about["rows"], about["radar"]) == (640, 480, False)
            # A click on the object and one beside it: of the first the picture shows a disc of one colour.
            points = {"method": "classical", "points": [[320, 240], [20, 20]], "positive": [True, False]}
            post(f"{address}mask", points)
            post(f"{address}save", points)
            process_told = ended()
        masks = tmp_path / form / WRENCH / "robot_collected" / "0_0_0" / "exp1" / "los" / "processed" / "camera"
        (mask,) = [path for path in masks.iterdir() if path.stem == "camera_masks" and path.suffix != ".json"]
        assert mask.name in process_told
        held = read_published(mask).record if mask.suffix == ".pkl" else ms.load(mask)
        rows, columns = np.mgrid[:480, :640]
        disc = (rows - 240) ** 2 + (columns - 320) ** 2 < 60**2
        assert (held.pixels & disc).sum() / (held.pixels | disc).sum() > 0.9
        found[form] = held
    ours, theirs = found.values()
    assert np.array_equal(ours.pixels, theirs.pixels)
    assert np.array_equal(ours.points, theirs.points, equal_nan=True)


def post(address, asked):
    request = Request(address, data=json.dumps(asked).encode(), headers={"Content-Type": "application/json"})
    return json.loads(urlopen(request).read())


@contextmanager
def annotating(path):
    """The address of the command's page, and what ends it and returns what it said."""
    words = [sys.executable, "-m", "millisight.cli.main", "annotate", str(path), "--published", "--no-browser"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        line = process.stdout.readline()
        address = re.search(r"http://127\.0\.0\.1:\d+/\S+/", line)
        assert address, line + process.stdout.read()

        def ended():
            process.send_signal(signal.SIGINT)
            return process.communicate(timeout=60)[0]

        yield address[0], ended
    finally:
        process.kill()
        process.communicate()


@contextmanager
def serving(path):
    """As `annotating`, in this process: what the command serves."""
    subject = open_picture(path)
    annotation = Annotation(subject, mask_in_dataset(subject), segmenters=segmenters_for(subject))
    with AnnotatorServer(annotation, 0) as server:
        yield server.address, lambda: annotation.mask_path.name


class Disc:
    """A disc about the first point: on a photo that of the mock's camera mask."""

    name = "disc"
    needs_prompts = True

    def segment(self, picture, prompts):
        i, j = np.indices(picture.shape)
        radius = 60 if picture.grid_xy is None else 4.5
        inside = (i - prompts.points[0, 0]) ** 2 + (j - prompts.points[0, 1]) ** 2 < radius**2
        return Candidates(masks=inside[None], scores=np.array([0.5]))
