"""Training of the released network: its augmentation, one seed for one result, weights that are read again."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from millisight.core.errors import DamagedFileError, InputError
from millisight.perception.training import (
    RELEASED_WEIGHTS,
    ReleasedExample,
    ReleasedRecipe,
    released_example,
    train_released,
)

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


class Killed(Exception):
    """What ends a run before its time."""


def test_an_interrupted_run_ends_with_the_same_bytes(tmp_path, monkeypatch):
    """Of a small network in place of that of 68 million weights, whose every checkpoint is 0.8 GB."""
    torch = pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    from torch import nn

    from millisight.perception.training import networks

    def small(classes):
        return nn.Sequential(nn.AvgPool2d(16), nn.Flatten(), nn.Linear(14 * 14, classes), nn.LogSoftmax(dim=1))

    monkeypatch.setattr(networks, "ReleasedNetwork", small)
    examples = [example(label, size) for label, size in enumerate((10, 30, 60, 90))]
    recipe = ReleasedRecipe(**PLAIN, epochs=2, batch=2, learning_rate=1e-4, weights=(1.0, 0.0))

    def kill(done, _):
        if done == 1:
            raise Killed

    with pytest.raises(Killed):
        train_released(examples, tmp_path / "killed", recipe, every=1, progress=kill)
    assert not (tmp_path / "killed" / RELEASED_WEIGHTS).exists()
    more = [*examples[:3], example(3, 80)]
    for other, given in ((replace(recipe, seed=1), examples), (recipe, more)):
        with pytest.raises(InputError, match="belongs to another recipe"):
            train_released(given, tmp_path / "killed", other)
    done = []
    path, losses = train_released(examples, tmp_path / "killed", recipe, progress=lambda n, _: done.append(n))
    assert done == [2]  # the first epoch was not repeated
    whole, told = train_released(examples, tmp_path / "whole", recipe)
    assert losses == told
    assert len(set(losses)) == 2
    assert path.read_bytes() == whole.read_bytes()
    assert set(torch.load(path, weights_only=True)) == {"2.weight", "2.bias"}
    (tmp_path / "killed" / "checkpoint.safetensors").write_bytes(b"none")
    with pytest.raises(DamagedFileError, match="not a complete checkpoint"):
        train_released(examples, tmp_path / "killed", recipe)
