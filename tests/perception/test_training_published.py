"""Recipes that take simulated images of a dataset in the published layout: which, on which side, and what they show."""

import numpy as np
import pytest

from helpers.published_mock import SIMULATED_SCALE, disc, dump, published_image
from helpers.whole_scenes import PLAIN, whole_scene
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.perception import SPACING
from millisight.perception.training import (
    BANDS,
    SCENE_PARTS,
    ClassifierRecipe,
    SceneSettings,
    SegmenterRecipe,
    make_scenes,
    read_simulation,
    simulations_in,
)
from millisight.perception.training._classifier_examples import example_of as classifier_example
from millisight.perception.training._segmenter import example_of as segmenter_example

PLACE = (0.11, 0.27)


def simulate(root, name, *, angles="0_0_0", bands=("77_ghz",), low_at=PLACE):
    """Images and masks of a disc of 4 cm and, of its edges, one a little larger."""
    z = np.arange(-0.37, -0.15, 0.02)
    for band in bands:
        place = root / name / "simulation" / angles / "processed" / "radars" / band
        at = PLACE if band == "77_ghz" else low_at
        for ext, radius, scale in (("_specular", 0.04, 1.0), ("_edges", 0.05, 0.5)):
            held = published_image(PLACE, z=z, scale=scale * SIMULATED_SCALE, columns=48)
            dump(place / f"processed_image{ext}.pkl", held | {"antenna_locs": np.zeros((4, 3))})
            dump(place / f"radar_masks{ext}.pkl", {"radar_mask": disc(at, radius, (held["x_locs"], held["y_locs"]))})


@pytest.fixture
def root(tmp_path):
    for name in ("003_cracker_box", "042_wrench", "023_wine_glass"):
        simulate(tmp_path, name)
    simulate(tmp_path, "004_sugar_box", bands=BANDS)
    simulate(tmp_path, "004_sugar_box", angles="0_0_90", bands=BANDS, low_at=(0.02, 0.27))
    (tmp_path / "025_mug" / "simulation" / "0_0_0" / "processed" / "radars" / "77_ghz").mkdir(parents=True)
    return tmp_path


def test_simulations_go_by_the_catalogues_names(root):
    found = simulations_in(str(root))
    assert {name: len(folders) for name, folders in found.items()} == {
        "cracker_box": 1, "sugar_box": 2, "wine_glass": 1, "adjustable_wrench": 1,
    }  # fmt: skip
    with pytest.raises(FileError, match="holds no simulated images with masks"):
        simulations_in(str(root / "025_mug"))


def test_a_scene_shows_the_images_around_either_mask(root):
    scene = read_simulation(root / "004_sugar_box" / "simulation" / "0_0_0", widest=0.4)
    assert scene.images["77_ghz"].shape == (len(SCENE_PARTS), len(scene.x), len(scene.y), 17)
    i, j = (np.ptp(np.flatnonzero(scene.inside.any(axis=axis))) * SPACING for axis in (1, 0))
    assert (i, j) == pytest.approx((0.1, 0.1), abs=0.021)  # of the edges' mask, the larger one
    assert np.ptp(scene.x) == pytest.approx(0.2, abs=0.021)  # 5 cm around it
    peaks = abs(scene.images["77_ghz"]).max(axis=(1, 2, 3))
    assert peaks == pytest.approx([1, 1, 0])
    assert scene.scales["77_ghz"][1] / scene.scales["77_ghz"][0] == pytest.approx(0.5)
    cut = read_simulation(root / "004_sugar_box" / "simulation" / "0_0_0", widest=0.12)
    assert np.ptp(cut.x) <= 0.12 + 1e-6
    assert cut.inside.any()


def test_24_ghz_is_used_where_it_shows_the_object_at_the_same_place(root):
    bands = {
        folder: tuple(read_simulation(root / folder, widest=0.4).images)
        for folder in (
            "003_cracker_box/simulation/0_0_0", "004_sugar_box/simulation/0_0_0", "004_sugar_box/simulation/0_0_90",
        )
    }  # fmt: skip
    assert list(bands.values()) == [("77_ghz",), ("77_ghz", "24_ghz"), ("77_ghz",)]


@pytest.mark.slow
def test_examples_of_one_band_and_of_two_are_made(root):
    for folder, both in (("003_cracker_box", False), ("004_sugar_box", True)):
        scene = read_simulation(root / folder / "simulation" / "0_0_0", widest=0.3)
        scene = whole_scene(scene)
        seen = [classifier_example(scene, np.random.default_rng(seed)) for seed in range(8)]
        assert all(one[0].max() > 0.5 for one in seen)
        examples = [segmenter_example(scene, np.random.default_rng(seed)) for seed in range(8)]
        assert all(one.inside.sum() > 20 for one in examples)
        assert any(one.channels[10].any() for one in examples) == both


@pytest.mark.slow
def test_a_classifier_recipe_takes_them_beside_made_scenes_or_alone(root, tmp_path):
    classes = {"box": ("003_cracker_box", "sugar_box"), "tool": ("042_wrench", "wine_glass")}
    recipe = ClassifierRecipe(classes=classes, published=str(root), scenes=0, whole=PLAIN)
    requests = recipe.scene_requests()
    assert [(one.name, one.side) for one in requests] == [
        ("003_cracker_box", "training"), ("sugar_box", "validation"), ("sugar_box", "training"),
        ("042_wrench", "training"), ("wine_glass", "validation"),
    ]  # fmt: skip
    scenes = make_scenes(recipe, tmp_path / "scenes")
    assert [one.label for one in scenes["training"]] == [0, 0, 1]
    assert not list((tmp_path / "scenes").glob("[!sw]*"))  # whole scenes alone
    more = ClassifierRecipe(classes=classes, published=str(root), scenes=4, tests=("cracker_box",))
    made = [one.name for one in more.scene_requests() if one.source is None]
    assert set(made) == {"sugar_box"}  # the others' folders are no catalogue names, and there is no mesh
    assert sum(one.source is not None for one in more.scene_requests()) == 4
    with pytest.raises(InputError, match="has 1 simulations of the class 'tool'"):
        ClassifierRecipe(classes=classes, published=str(root), scenes=0, without=("wine_glass",))
    with pytest.raises(UnknownNameError, match="unknown catalogue object 'mugg'"):
        ClassifierRecipe(classes={"a": ("mugg",), "b": ("dice",)}, published=str(root))
    with pytest.raises(InputError, match="scenes is 0"):
        ClassifierRecipe(scenes=0)


@pytest.mark.slow
def test_a_segmenter_recipe_takes_them_and_leaves_out_an_object_by_any_spelling(root, tmp_path):
    settings = SceneSettings(published=str(root), poses=0, validation=("sugar_box",), without=("042_wrench",))
    recipe = SegmenterRecipe(scenes=settings, whole=PLAIN)
    assert settings.objects == {"training": ("cracker_box", "wine_glass"), "validation": ("sugar_box",)}
    scenes = make_scenes(recipe, tmp_path / "scenes")
    assert {side: len(some) for side, some in scenes.items()} == {"training": 2, "validation": 2}
    both = SegmenterRecipe(scenes=SceneSettings(published=str(root), poses=1, validation=("mug",)))
    sources = [one.source is not None for one in both.scene_requests() if one.name == "sugar_box"]
    assert sources == [False, True, True]
    (mesh,) = [one for one in both.scene_requests() if one.name == "mug"]
    assert (mesh.side, mesh.source) == ("validation", None)


@pytest.mark.slow
def test_scenes_composed_of_other_masks_are_not_taken(root, tmp_path):
    """In a folder that is kept: the specular image is the same."""
    scenes = SceneSettings(published=str(root), poses=0, validation=("sugar_box",))
    recipe = SegmenterRecipe(scenes=scenes, whole=PLAIN)

    def marked(folder):
        return [(one.whole.objects > 0).sum() for one in make_scenes(recipe, folder)["training"]]

    before = marked(tmp_path / "kept")
    for path in root.glob("*/simulation/*/processed/radars/*/radar_masks_*.pkl"):
        held = published_image(PLACE, z=np.arange(-0.37, -0.15, 0.02), columns=48)
        dump(path, {"radar_mask": disc(PLACE, 0.015, (held["x_locs"], held["y_locs"]))})
    after = marked(tmp_path / "kept")
    assert sum(after) < 0.7 * sum(before)
    assert after == marked(tmp_path / "new")


def test_images_and_masks_on_different_grids_are_refused(root):
    folder = root / "003_cracker_box" / "simulation" / "0_0_0"
    held = published_image((0.2, 0.27), z=np.arange(-0.37, -0.15, 0.02), columns=48)
    dump(folder / "processed/radars/77_ghz/processed_image_edges.pkl", held | {"antenna_locs": np.zeros((4, 3))})
    with pytest.raises(InputError, match="lie on different grids, along x: 48 from"):
        read_simulation(folder, widest=0.3)
