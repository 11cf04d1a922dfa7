"""`millisight classify` as a user meets it: one image, a dataset, masks from elsewhere, and what cannot be."""

import hashlib
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here
from helpers.small_images import BRIGHT, GRID, image, publish
from millisight.cli.classify import answer_words
from millisight.core.errors import FileError, InputError
from millisight.data import Prediction
from millisight.io.mito import experiment_folder, radar_folder, write_published
from millisight.perception.classification import CLASSIFIER_CHANNELS, CLASSIFIERS, NetworkClassifier
from millisight.perception.classification import _classification as classification

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "classify.md"
SHA256 = "ab" * 32


def mask(inside=BRIGHT):
    pixels = np.zeros(GRID.xy.shape, bool)
    pixels[inside] = True
    return ms.Mask(grid_xy=GRID.xy, inside=pixels)


class Sizes:
    """Instead of the network: an object of more than 100 pixels is a box, and with the other band surely."""

    name, bands, class_names = "sizes", ("77_ghz", "24_ghz"), ("can", "box", "sphere")

    def __init__(self, weights=None, *, prior=None):
        self.description = {"sha256": SHA256}

    def classify(self, image, mask, *, other_band=None):
        if mask.inside.shape != image.grid.xy.shape:
            raise InputError("the mask is on another grid")
        box = mask.inside.sum() > 100
        shares = {(False, True): [0.3, 0.5, 0.2], (True, True): [0.04, 0.95, 0.01]}.get((other_band is not None, box))
        shares = np.array(shares or [0.8, 0.1, 0.1])
        return Prediction(probabilities=shares, class_names=self.class_names, threshold=0.6)


def network(monkeypatch, made):
    """What goes by the name "network" now."""
    monkeypatch.setitem(CLASSIFIERS._entries, "network", CLASSIFIERS["network"] and made)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """The command in `tmp_path` and within this process, as `run_here`."""
    network(monkeypatch, Sizes)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments, command="classify": run_here(command, *arguments)


@pytest.fixture
def mug(tmp_path):
    ms.save(tmp_path / "mug.image.h5", image())
    ms.save(tmp_path / "mug24.h5", image(1))


@pytest.fixture
def dataset(tmp_path):
    return publish(tmp_path / "MITO_Dataset")


def test_one_image_is_named_and_every_class_has_its_line(mug, run, tmp_path):
    code, out, err, _ = run("mug.image.h5", "--other-band", "mug24.h5", "--method", "classical")
    assert code == 0
    assert all(line.startswith("load ") for line in err.splitlines())  # how long that took
    assert out.splitlines() == [
        "mug: box 0.95 (mask: classical)",
        "  box     0.95  " + 38 * "#",
        "  can     0.04  ##",
        "  sphere  0.01",
        "  threshold: 0.60",
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mug.image.h5", "mug24.h5"]


def test_each_of_several_objects_is_classified(mug, run, tmp_path):
    labels = np.zeros(GRID.xy.shape, int)
    labels[9:15, 11:23], labels[20:24, 30:36] = 1, 2
    ms.save(tmp_path / "two.instances.h5", ms.Instances(grid_xy=GRID.xy, labels=labels, scores=[2.0, 1.0]))
    asked = ("mug.image.h5", "--other-band", "mug24.h5", "--mask", "two.instances.h5")
    code, out, *_ = run(*asked, "-o", "two.json")
    assert code == 0
    assert [line.split(":")[0] for line in out.splitlines()] == ["mug, object 1", "mug, object 2"]
    told = json.loads((tmp_path / "two.json").read_text())["objects"]
    assert [one["mask"]["object"] for one in told] == [1, 2]
    assert [one["mask"]["pixels"] for one in told] == [72, 24]
    assert [(tmp_path / f"two.{number}.png").exists() for number in (1, 2, 3)] == [True, True, False]
    assert [json.loads(line) for line in run(*asked, "--json")[1].splitlines()] == told
    none = ms.Instances(grid_xy=GRID.xy, labels=0 * labels, scores=[])
    ms.save(tmp_path / "none.instances.h5", none)
    assert "holds no object" in run("mug.image.h5", "--mask", "none.instances.h5")[3]


def test_why_no_probability_is_enough_is_said():
    told = {"probabilities": [0.99, 0.01], "class_names": ("box", "can"), "threshold": 1.0}
    said = answer_words(Prediction(**told, unproven="the network alone is not sure"))
    assert said == "not sure, the network alone is not sure: box 0.99, can 0.01"


def test_an_unsure_answer_says_what_it_may_be_and_one_band_that_there_are_two(mug, run):
    code, out, err, _ = run("mug.image.h5", "--method", "classical")
    assert code == 0
    assert out.splitlines()[0] == "mug: not sure: box 0.50, can 0.30 (mask: classical)"
    assert "uses 77_ghz and 24_ghz, but got one band; pass the other with --other-band" in err


def test_what_is_known_is_written_beside_a_picture(mug, run, tmp_path):
    asked = ("mug.image.h5", "--other-band", "mug24.h5", "--method", "classical", "--seed", "3")
    assert run(*asked, "-o", "mug.json")[0] == 0
    told = json.loads((tmp_path / "mug.json").read_text())
    pixels, score = told["mask"].pop("pixels"), told["mask"].pop("score")
    assert pixels == ms.segment(image(), other_band=image(1), method="classical", rng=3).inside.sum()
    assert 0 < score <= 1
    assert re.fullmatch(r"millisight classify [0-9.]+", told.pop("made_by"))
    assert told == {
        "name": "mug",
        "answer": "box",
        "label": "box",
        "confidence": 0.95,
        "sure": True,
        "threshold": 0.6,
        "novelty": 0.0,
        "novelty_limit": 1.0,
        "reasons": [],
        "unproven": "",
        "probabilities": {"can": 0.04, "box": 0.95, "sphere": 0.01},
        "image": "mug.image.h5",
        "other_band": "mug24.h5",
        "mask": {"file": None, "method": "classical", "condition": "los", "seed": 3},
        "classifier": {"name": "sizes", "sha256": SHA256, "bands": ["77_ghz", "24_ghz"]},
    }
    assert (tmp_path / "mug.png").read_bytes().startswith(b"\x89PNG")
    assert run(*asked, "-o", "again.json", "--no-picture")[0] == 0
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "mug.json").read_bytes()
    assert not (tmp_path / "again.png").exists()


class Refuses(Sizes):
    """Instead of the network: everything is novel, with a reason or without."""

    reasons: tuple[str, ...] = ("the scan is too sparse: steps of 1.9 wavelengths", "unlike anything it was trained on")

    def classify(self, image, mask, *, other_band=None):
        answer = super().classify(image, mask, other_band=other_band)
        return replace(answer, novelty=0.8, novelty_limit=0.4, reasons=self.reasons)


def test_why_an_image_is_novel_is_said(mug, run, tmp_path, monkeypatch):
    network(monkeypatch, Refuses)
    code, out, _, _ = run("mug.image.h5", "--method", "classical", "-o", "mug.json")
    assert code == 0
    assert out.splitlines()[0] == (
        "mug: not sure, the scan is too sparse: steps of 1.9 wavelengths; unlike anything it was trained on "
        "(novelty 0.80): box 0.50, can 0.30 (mask: classical)"
    )
    assert out.splitlines()[-1] == "  novelty: 0.80, at most 0.40 to be sure"
    told = json.loads((tmp_path / "mug.json").read_text())
    assert (told["novelty"], told["reasons"], told["sure"]) == (0.8, list(Refuses.reasons), False)
    network(monkeypatch, type("Silent", (Refuses,), {"reasons": ()}))
    out = run("mug.image.h5", "--method", "classical")[1]
    assert out.startswith("mug: not sure, unlike the training images (novelty 0.80): box 0.50")


def test_json_is_all_that_is_said(mug, run, tmp_path):
    asked = ("mug.image.h5", "--method", "classical", "--json", "-o", "mug.json", "--no-picture")
    code, out, _, _ = run(*asked)
    assert code == 0
    (line,) = out.splitlines()
    assert json.loads(line) == json.loads((tmp_path / "mug.json").read_text())
    code, out, err, _ = run("mug.image.h5", "mug24.h5", "--method", "classical", "--json")
    assert [json.loads(line)["name"] for line in out.splitlines()] == ["mug", "mug24"]
    assert err.count("got one band") == 1
    assert "classified 2 of 2 images" in err


def test_a_mask_beside_the_image_is_taken_unless_another_or_a_segmenter_is_named(mug, run, tmp_path):
    assert run("mug.image.h5", "--method", "classical", "--no-picture", command="segment")[0] == 0
    (tmp_path / "masks").mkdir()
    ms.save(tmp_path / "masks" / "mug.mask.h5", mask((slice(8, 10), slice(10, 12))))
    code, out, _, _ = run("mug.image.h5", "--json")
    told = json.loads(out)["mask"]
    assert (told["file"], told["method"], told["condition"]) == ("mug.mask.h5", "classical", "los")
    assert told["pixels"] == ms.load("mug.mask.h5").inside.sum()
    for given in ("masks", "masks/mug.mask.h5"):
        code, out, _, _ = run("mug.image.h5", "--mask", given)
        assert code == 0
        assert out.splitlines()[0] == f"mug: can 0.80 (mask: {Path('masks/mug.mask.h5')})"
    assert json.loads(run("mug.image.h5", "--method", "classical", "--json")[1])["mask"]["file"] is None


@pytest.mark.slow
def test_a_mask_of_another_image_is_not_taken_unless_it_is_named(mug, run, tmp_path, monkeypatch):
    monkeypatch.setattr("millisight.cli.classify._DEFAULT_METHOD", "classical")  # which is quick
    assert run("mug.image.h5", "--method", "classical", "--no-picture", command="segment")[0] == 0
    kept, first = (tmp_path / "mug.mask.h5").read_bytes(), ms.load("mug.image.h5")
    small = ms.VoxelGrid(x=GRID.x[:-1], y=GRID.y, z=GRID.z)
    for other, why in (
        (replace(first, values=first.values[::-1]), "is of another image"),
        (ms.SarImage(grid=small, values=first.values[:-1]), "has other pixels than the image"),
    ):
        ms.save("mug.image.h5", other)
        code, out, _, _ = run("mug.image.h5")
        assert code == 0
        assert f"mug.mask.h5 {why}; segmenting anew" in out
        assert "(mask: classical)" in out
    ms.save("mug.image.h5", replace(first, values=first.values[::-1]))
    assert "(mask: mug.mask.h5)" in run("mug.image.h5", "--mask", "mug.mask.h5")[1]
    assert (tmp_path / "mug.mask.h5").read_bytes() == kept


@pytest.mark.slow
def test_a_dataset_is_gone_through_and_what_failed_is_said_at_the_end(dataset, run, tmp_path):
    code, out, err, _ = run("MITO_Dataset", "--method", "classical", "-o", "named")
    assert code == 1
    assert [line for line in out.splitlines() if "not sure: box 0.50" in line and line.startswith(dataset)] != []
    assert "classified 3 of 4 images" in out
    assert f"{dataset}.nlos.24_ghz: picture is blank" in err
    assert "failed: 1" in err
    names = [f"{dataset}.{name}.prediction" for name in ("los.24_ghz", "los.77_ghz", "nlos.77_ghz")]
    for suffix in (".json", ".png"):
        written = sorted(path.name for path in (tmp_path / "named").glob(f"*{suffix}"))
        assert written == [name + suffix for name in names]
    for name in names:
        told = json.loads((tmp_path / "named" / f"{name}.json").read_text())
        assert told["image"].startswith("004_sugar_box/robot_collected/")
        assert told["mask"]["condition"] == name.split(".")[3]


def test_masks_of_a_dataset_lie_where_segment_wrote_them(dataset, run):
    assert run("MITO_Dataset", "--method", "classical", "-o", "masks", "--no-picture", command="segment")[0] == 1
    code, out, err, _ = run("MITO_Dataset", "--multispectral", "--mask", "masks", "--json")
    assert code == 0, err
    told = [json.loads(line) for line in out.splitlines()]
    assert [one["name"] for one in told] == [f"{dataset}.los.77_ghz", f"{dataset}.nlos.77_ghz"]
    assert [one["answer"] for one in told] == ["box", "box"]
    assert all(one["other_band"].endswith("24_ghz/processed_image.pkl") for one in told)
    assert all(one["mask"]["file"] == f"{one['name']}.mask.h5" for one in told)


def test_a_published_radar_mask_is_a_mask_too(dataset, run, tmp_path):
    folder = radar_folder(
        experiment_folder(tmp_path / "MITO_Dataset", "004_sugar_box", (0, 0, 0), 1, "los"), "77_ghz", processed=True
    )
    write_published(folder / "radar_masks.pkl", mask())
    code, out, _, _ = run(
        str(folder / "processed_image.pkl"), "--mask", str(folder / "radar_masks.pkl"), "--json", "-o", "a.json"
    )
    assert code == 0
    told = json.loads(out)
    assert told["mask"]["pixels"] == mask().inside.sum()
    assert (
        told["mask"]["file"] == "004_sugar_box/robot_collected/0_0_0/exp1/los/processed/radars/77_ghz/radar_masks.pkl"
    )
    assert told["mask"]["method"] is None


def test_the_network_is_run(mug, run, tmp_path, monkeypatch):
    """A network that answers by the mask's size alone, by ONNX Runtime."""
    onnx = pytest.importorskip("onnx")
    network(monkeypatch, NetworkClassifier)
    weights = np.zeros((len(CLASSIFIER_CHANNELS), 3), np.float32)
    weights[CLASSIFIER_CHANNELS.index("mask"), 1] = 500
    own = write_network(tmp_path / "own.onnx", weights, onnx)
    ms.save(tmp_path / "tiny.mask.h5", mask((slice(8, 9), slice(10, 11))))
    asked = ("mug.image.h5", "--weights", own.name, "--json")
    for more, answer in (((), "box"), (("--mask", "tiny.mask.h5"), "not sure")):
        code, out, _, error = run(*asked, *more)
        assert code == 0, error
        told = json.loads(out)
        assert told["answer"] == answer
        assert told["classifier"]["sha256"] == hashlib.sha256(own.read_bytes()).hexdigest()
        assert sum(told["probabilities"].values()) == pytest.approx(1)
    own.write_bytes(own.read_bytes()[:-1])
    assert "own.onnx is not the file that own.json describes" in run(*asked)[3]
    own.with_suffix(".json").unlink()
    assert run(*asked)[3] == "own.json: no such file; it describes own.onnx, and must lie beside it"
    own.unlink()
    assert run(*asked)[3] == "own.onnx: no such file"


def test_weights_that_are_written_anew_are_read_anew(tmp_path):
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    seen, own = image(), tmp_path / "own.onnx"
    mask = ms.segment(seen, method="classical", rng=0)
    answers = []
    for best in (0, 2):
        write_network(own, 9 * np.eye(3, dtype=np.float32)[[best] * len(CLASSIFIER_CHANNELS)], onnx)
        answers.append(ms.classify(seen, mask, weights=own).label)
    assert answers[0] != answers[1]
    own.unlink()
    with pytest.raises(FileError, match=r"own.onnx: no such file"):
        ms.classify(seen, mask, weights=own)


def write_network(path, weights, onnx):
    """Logits that are the channels' means times `weights` (channels, classes), and their description."""
    one, node = onnx.helper.make_tensor_value_info, onnx.helper.make_node
    graph = onnx.helper.make_graph(
        [node("GlobalAveragePool", ["x"], ["means"]), node("Flatten", ["means"], ["flat"]),
         node("MatMul", ["flat", "w"], ["y"])],
        "sizes",
        [one("x", onnx.TensorProto.FLOAT, ["n", len(weights), "a", "b"])],
        [one("y", onnx.TensorProto.FLOAT, ["n", weights.shape[1]])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )  # fmt: skip
    model = onnx.helper.make_model(graph, ir_version=8, opset_imports=[onnx.helper.make_opsetid("", 17)])
    path.write_bytes(model.SerializeToString())
    told = {
        "name": "sizes", "sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "bands": ["77_ghz"],
        "class_names": ["can", "box", "sphere"], "channels": list(CLASSIFIER_CHANNELS), "temperature": 1.0,
        "threshold": 0.6,
    }  # fmt: skip
    path.with_suffix(".json").write_text(json.dumps(told))
    return path


def test_weights_of_ones_own_are_asked(mug, run, monkeypatch):
    asked = []
    network(monkeypatch, lambda weights: asked.append(weights) or Sizes(weights))
    assert run("mug.image.h5", "--method", "classical", "--weights", "own.onnx")[0] == 0
    assert asked == [Path("own.onnx")]


def test_without_onnx_runtime_it_says_what_to_install(mug, run, monkeypatch):
    def missing(weights):
        raise ImportError('the classifier runs by ONNX Runtime: pip install "millisight[perception]"')

    network(monkeypatch, missing)
    error = run("mug.image.h5", "--method", "classical")[3]
    assert error.startswith("cannot classify: the classifier runs by ONNX Runtime: pip install")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.h5", "--mask", "a.mask.h5", "--method", "wave"], "--mask and --method cannot be combined"),
        (["a.h5", "--method", "sem"], "unknown segmenter 'sem'"),
        (["a.h5", "--mask", "a.h5"], "a.h5 holds a record of SarImage; expected a mask or instances"),
        (["a.mask.h5", "--mask", "a.mask.h5"], "a.mask.h5 holds a Mask; expected a SarImage"),
        (["a.h5", "--mask", "empty"], "empty holds no mask of a; expected a.mask.h5 there: `millisight segment` may"),
        (["a.h5", "--mask", "other.mask.h5"], "with the mask of other.mask.h5: the mask is on another grid"),
        (["a.h5", "--method", "classical", "-o", "a.mask.h5"], "ends in .json"),
        (["a.h5", "a.mask.h5", "--mask", "a.mask.h5"], "work with a single image"),
        (["a.h5", "a.h5"], "have the same name a"),
        (["empty"], "empty holds no image"),
        (["none.h5"], "none.h5: no such file"),
        (
            ["a.h5", "--weights", "a.mask.h5"],
            "a.mask.h5 is an HDF5 file, such as an image or a mask, and holds no weights",
        ),
        (["a.h5", "--weights", "a.txt"], "unknown kind of weights 'a.txt'"),
    ],
)
def test_what_cannot_be_is_refused_and_writes_nothing(tmp_path, run, arguments, message):
    (tmp_path / "empty").mkdir()
    ms.save(tmp_path / "a.h5", image())
    ms.save(tmp_path / "a.mask.h5", mask())
    smaller = ms.PixelGrid(x=GRID.x[1:], y=GRID.y)
    ms.save(tmp_path / "other.mask.h5", ms.Mask(grid_xy=smaller, inside=mask().inside[1:]))
    _, _, err, error = run(*arguments)
    assert message in error
    assert "got one band" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "a.mask.h5", "empty", "other.mask.h5"]


def test_the_help_teaches():
    shown = re.sub(r"\s+", " ", run_here("classify", "--help")[1])
    for text in ("Example: millisight classify mug.image.h5", "calibrated", 'the answer is "not sure"'):
        assert text in shown


@pytest.mark.slow
def test_what_the_page_about_it_shows_is_run(mug, dataset, run, tmp_path):
    """On files of these names; the training apart, which is tested where it is."""
    ms.save(tmp_path / "mug_77.h5", image())
    ms.save(tmp_path / "mug_24.h5", image(1))
    classification._by_name.cache_clear()
    variables, ran = {}, []
    for language, block in re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE):
        if language == "python":
            exec(block, variables)
        for line in block.splitlines() if language == "sh" else ():
            _, command, *arguments = shlex.split(line)
            if command != "train":
                code, _, err, error = run(*arguments, command=command)
                assert code == 0 or "failed: 1" in err, (line, err, error)
                ran.append(command)
    classification._by_name.cache_clear()
    assert (ran.count("classify"), ran.count("segment")) == (8, 2)
    assert variables["prediction"].answer in variables["prediction"].class_names
    told = json.loads((tmp_path / "mug.prediction.json").read_text())
    keys = {
        key for row in re.findall(r"^\| (`.*?) \|", PAGE.read_text("utf-8"), re.MULTILINE) for key in row.split(", ")
    }
    assert {key.strip("`") for key in keys} == told.keys() - {"made_by"}
