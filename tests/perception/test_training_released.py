"""Training of the released network: its augmentation, one seed for one result, weights that are read again."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.perception.training import ReleasedExample, ReleasedRecipe, released_example, train_released

RECIPE = Path(__file__).parents[2] / "examples" / "training" / "released.toml"
PLAIN = {"noisy": 0.0, "erased": 0.0, "shift": (0.0, 0.0), "scale": (1.0, 1.0), "blur": (1e-3, 1e-3)}


def example(label=0, size=40):
    """A square of specular and a frame of edge reflections in the middle of 220 x 241 pixels."""
    specular, edges = np.zeros((2, 220, 241))
    specular[90 : 90 + size, 100 : 100 + size] = 0.5
    edges[90 : 90 + size, [100, 99 + size]] = 1.0
    return ReleasedExample(specular, edges, label)


def test_the_shipped_recipe_is_the_authors():
    held = tomllib.loads(RECIPE.read_text())
    default = ReleasedRecipe()
    assert set(held) == set(ReleasedRecipe.__slots__)
    for name, value in held.items():
        assert (tuple(value) if isinstance(value, list) else value) == getattr(default, name)


def test_a_drawing_is_from_half_below_to_half_above_and_follows_from_the_seed():
    one, recipe = example(), ReleasedRecipe()
    drawn = [released_example(one, recipe, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert all(seen.shape == (224, 224) and seen.dtype == np.float32 for seen in drawn)
    assert all((seen.min(), seen.max()) == (-0.5, 0.5) for seen in drawn)
    assert np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])


def test_turns_alone_keep_the_area_and_weights_mix_the_two_parts():
    one = example()
    for seed in range(5):
        seen = released_example(one, ReleasedRecipe(**PLAIN), np.random.default_rng(seed)) + 0.5
        assert np.count_nonzero(seen) == pytest.approx(40 * 40, rel=0.06)
    only = ReleasedRecipe(**PLAIN, weights=(0.0, 0.5))
    seen = released_example(one, only, np.random.default_rng(0)) + 0.5
    assert np.count_nonzero(seen) == pytest.approx(2 * 40, rel=0.3)


def test_scales_and_shifts_reach_as_far_as_the_recipe_says():
    one = example()
    recipe = ReleasedRecipe(**PLAIN | {"shift": (0.1, 0.1), "scale": (0.85, 1.15)})
    areas, places = [], []
    for seed in range(60):
        seen = released_example(one, recipe, np.random.default_rng(seed)) > -0.5
        areas.append(seen.sum() / 40**2)
        places.append(np.abs(np.argwhere(seen).mean(axis=0) - 111.5).max())
    assert 0.85**2 * 0.95 < min(areas) < 0.85
    assert 1.15 < max(areas) < 1.15**2 * 1.05
    assert 10 < max(places) < 0.1 * 224 + 20  # the object itself lies off the middle


def test_what_is_lost_however_it_is_drawn_is_an_error():
    nothing = ReleasedExample(np.full((220, 241), 1e-4), np.zeros((220, 241)), 2)  # below a step
    with pytest.raises(InputError, match="an example of box is 0 however it is drawn"):
        released_example(nothing, ReleasedRecipe(), np.random.default_rng(0))


def test_a_class_without_examples_is_named(tmp_path):
    pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    with pytest.raises(InputError, match="the class 'sphere' has no example"):
        train_released([example(0), example(1), example(2)], tmp_path)


def test_one_seed_gives_the_same_weights_and_the_network_learns_a_batch(tmp_path):
    torch = pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    from millisight.perception.classification import ReleasedClassifier

    examples = [example(label, size) for label, size in enumerate((10, 30, 60, 90))]
    recipe = ReleasedRecipe(**PLAIN, epochs=3, batch=4, learning_rate=1e-4, weights=(1.0, 0.0))
    runs = [train_released(examples, tmp_path / name, recipe) for name in ("a", "b")]
    states = [torch.load(path, weights_only=True) for path, _ in runs]
    assert runs[0][1] == runs[1][1]
    assert len(runs[0][1]) == 3
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    assert ReleasedClassifier(runs[0][0]).class_names == ("can", "handle", "box", "sphere")
    other = train_released(examples, tmp_path / "c", ReleasedRecipe(**PLAIN, epochs=1, batch=4, seed=1))
    assert other[1][0] != runs[0][1][0]
