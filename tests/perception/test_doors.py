"""What is added from outside: a segmenter, a classifier and a trained network, each by one class or one file."""

import dataclasses
import json
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here
from millisight.core.errors import InputError, UnknownNameError
from millisight.perception.classification import CLASSIFIERS
from millisight.perception.segmentation import SEGMENTERS
from millisight.perception.training import (
    RECIPES,
    SceneRequest,
    SceneSettings,
    Schedule,
    WholeSettings,
    make_scenes,
    train,
)

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.1975, 0.1975, 0.01), 0.0025)


# A segmenter and a classifier as another package has them: nothing but `millisight` is imported.


class Brightest:
    """The pixels of at least half the maximum."""

    name, needs_prompts = "brightest", False

    def __init__(self, share=0.5):
        self.share = share

    def segment(self, picture, prompts):
        return ms.Candidates(masks=[picture.power >= self.share], scores=[1.0])


class Widths:
    """A box where the mask is wider than the options' limit."""

    name, class_names, bands, description = "widths", ("ball", "box"), ("77_ghz",), {}

    def __init__(self, limit=0.05):
        self.limit = limit

    def classify(self, image, mask, *, other_band=None):
        box = np.ptp(mask.grid_xy.x[mask.inside.any(axis=1)]) > self.limit
        return ms.Prediction(probabilities=[1 - box, box], class_names=self.class_names)


class Neither:
    name = "neither"


def image():
    values = np.full(GRID.shape, 0.01)
    values[30:50, 35:45] = 1
    return ms.SarImage(grid=GRID, values=values)


def test_without_a_mask_what_is_found_is_classified(monkeypatch):
    pytest.importorskip("onnxruntime")
    shown, by = image(), Widths()
    found = ms.segment(shown)
    alone, with_mask = ms.classify(shown, method=by), ms.classify(shown, found, method=by)
    np.testing.assert_array_equal(alone.probabilities, with_mask.probabilities)
    nothing = ms.Mask(grid_xy=found.grid_xy, inside=np.zeros_like(found.inside))
    monkeypatch.setattr("millisight.perception.segmentation.segment", lambda image, **options: nothing)
    with pytest.raises(InputError, match="nothing was found in the image"):
        ms.classify(shown, method=by)


@pytest.fixture
def plugin(monkeypatch):
    """Installs an entry point: (registry, name, name of a class of this module)."""

    def install(registry, name, thing):
        known = registry.names()
        point = EntryPoint(name, f"{__name__}:{thing}", registry.group)
        monkeypatch.setattr(registry, "_entries", dict(registry._entries))
        monkeypatch.setattr(registry, "_plugins", {name: point})
        assert set(registry.names()) == {*known, name}
        return point

    return install


def test_a_segmenter_of_another_package_is_one_class():
    assert isinstance(Brightest(), ms.Segmenter)
    mask = ms.segment(image(), method=Brightest())
    assert np.argwhere(mask.inside).min(axis=0).tolist() == [30, 35]
    assert mask.inside.sum() == 200
    for wrong in (Neither(), Brightest, None):
        with pytest.raises(InputError, match="expected a segmenter's name, or an object with name, needs_prompts"):
            ms.segment(image(), method=wrong)


def test_a_segmenter_of_a_plug_in_has_a_name(plugin, tmp_path, monkeypatch):
    plugin(SEGMENTERS, "brightest", "Brightest")
    assert ms.segment(image(), method="brightest").inside.sum() == 200
    assert ms.segmenter("brightest", share=0.001).share == 0.001
    monkeypatch.chdir(tmp_path)
    ms.save("a.h5", image())
    code, out, _, error = run_here("segment", "a.h5", "--method", "brightest", "--no-picture")
    assert (code, error) == (0, "")
    assert out.startswith("a: mask of 200 pixels, 3.1 %, by brightest; wrote")
    with pytest.raises(UnknownNameError, match="Did you mean 'brightest'"):
        ms.segment(image(), method="brightes")
    plugin(SEGMENTERS, "bad", "Neither")
    with pytest.raises(InputError, match="of type Neither"):
        ms.segmenter("bad")


def test_a_classifier_of_another_package_is_one_class(plugin):
    mask = ms.segment(image(), method=Brightest())
    assert isinstance(Widths(), ms.Classifier)
    assert ms.classify(image(), mask, method=Widths()).answer == "ball"
    plugin(CLASSIFIERS, "widths", "Widths")
    assert ms.classify(image(), mask, method="widths").answer == "ball"
    assert ms.classifier("widths", limit=0.04).classify(image(), mask).answer == "box"
    with pytest.raises(InputError, match="expected a classifier's name"):
        ms.classify(image(), mask, method=Neither())
    with pytest.raises(InputError, match="weights go with a method's name"):
        ms.classify(image(), mask, method=Widths(), weights="w.onnx")
    with pytest.raises(UnknownNameError, match="unknown classifier 'width'"):
        ms.classify(image(), mask, method="width")


def test_what_is_built_in():
    assert {"classical", "sam", "wave"} <= set(SEGMENTERS.names())
    assert set(CLASSIFIERS.names()) >= {"network"}
    assert {"classifier", "segmenter"} <= set(RECIPES.names())


# A third network to train: which share of the image the object covers, from three numbers of its power.


@dataclasses.dataclass(frozen=True, kw_only=True)
class CoverRecipe:
    stem = "cover"

    name: str = "cover"
    about: str = ""
    scenes: SceneSettings = dataclasses.field(default_factory=SceneSettings)
    schedule: Schedule = dataclasses.field(default_factory=Schedule)
    whole: WholeSettings = dataclasses.field(
        default_factory=lambda: WholeSettings(views=1, sheets=0, empty=0, several=0)
    )

    def scene_requests(self):
        sides = {"training": "dice", "validation": "golf_ball"}
        return [SceneRequest(side, name, 0, 0, self.scenes) for side, name in sides.items()]

    def lesson(self, scenes):
        return CoverLesson(scenes)

    def summary(self, description):
        return f"off by {description['error']:.3f}"


class CoverLesson:
    input_shape, free_axes, free_output_axes = (3,), {}, {}

    def __init__(self, scenes):
        import torch

        self.torch, self.data = torch, {}
        for side, some in scenes.items():
            power = [scene.whole.power("77_ghz") for scene in some]
            inputs = np.array([[p.mean(), p.max(), p.std()] for p in power], np.float32)
            covers = np.array([[(scene.whole.objects > 0).mean()] for scene in some], np.float32)
            self.data[side] = torch.from_numpy(inputs), torch.from_numpy(covers)

    def network(self):
        return self.torch.nn.Linear(3, 1)

    def batches(self, epoch):
        yield self.data["training"]

    def loss(self, network, batch):
        return ((network(batch[0]) - batch[1]) ** 2).mean()

    def score(self, network):
        inputs, covers = self.data["validation"]
        return -float(abs(network(inputs) - covers).mean())

    def describe(self, network):
        return {"error": -self.score(network)}


@pytest.mark.slow
def test_a_third_network_is_trained_by_a_recipe_and_a_lesson(tmp_path):
    pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    from millisight.perception import open_network

    coarse = SceneSettings(vertices=200, positions=100)
    recipe = CoverRecipe(scenes=coarse, schedule=Schedule(epochs=3, seed=4, learning_rate=0.01))
    scenes = make_scenes(recipe, tmp_path / "scenes")
    first, second = (train(recipe, scenes, tmp_path / name) for name in "ab")
    assert first.weights.name == "cover.onnx"
    for suffix in (".onnx", ".json", ".safetensors"):
        kept = [one.weights.with_suffix(suffix).read_bytes() for one in (first, second)]
        assert kept[0] == kept[1]
    held = json.loads(first.weights.with_suffix(".json").read_text())
    assert (held["name"], held["epochs"], len(held["history"])) == ("cover", 3, 3)
    assert held["recipe"]["scenes"]["vertices"] == 200
    session = open_network(first.weights, held["sha256"], needed_by="this")
    inputs, covers = (tensor.numpy() for tensor in CoverLesson(scenes).data["validation"])
    (outputs,) = session.run(None, {"channels": inputs})
    assert abs(outputs - covers).mean() == pytest.approx(held["error"], abs=1e-6)


@pytest.mark.slow
def test_the_command_trains_what_a_plug_in_adds(plugin, tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from millisight.cli import train as command

    point = plugin(RECIPES, "cover", "CoverRecipe")
    monkeypatch.setattr(command, "entry_points", lambda group: [point] if group == RECIPES.group else [])
    monkeypatch.chdir(tmp_path)
    text = "[scenes]\nvertices = 200\npositions = 100\n[schedule]\nepochs = 1\n"
    (tmp_path / "own.toml").write_text(text)
    assert "cover" in run_here("train", "--help")[1]
    code, out, _, error = run_here("train", "cover", "own.toml", "-o", "mine")
    assert (code, error) == (0, "")
    assert out.splitlines()[-1] == "weights: mine/cover.onnx"
    assert sorted(path.name for path in (tmp_path / "mine").glob("cover.*")) == [
        "cover.json", "cover.onnx", "cover.safetensors"
    ]  # fmt: skip
