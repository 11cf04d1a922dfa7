"""Pictures of what networks are trained on: every augmentation leaves its trace in one."""

import numpy as np
import pytest

from helpers.whole_scenes import object_parts
from millisight.core.errors import InputError
from millisight.meshes import PUBLISHED_CLASSES, RANDOM_SHAPES
from millisight.perception.classification import CLASSIFIER_CHANNELS as CHANNELS
from millisight.viz import plot_augmentations, plot_examples, plot_random_shapes


def pictures(figure):
    return {axes.get_title(): axes.images[0].get_array() for axes in figure.axes if axes.images}


@pytest.mark.slow
def test_each_augmentation_is_seen():
    scene = object_parts("dice")
    figure = plot_augmentations(scene, seed=1)
    found = pictures(figure)
    assert {"specular", "edge", "none", "echo", "clutter", "noise", "speckle", "masked", "moved", "blurred",
            "uneven light", "erased", "several", "true mask", "a mask with errors"} <= set(found)  # fmt: skip
    for title in ("echo", "clutter", "noise", "speckle"):
        assert abs(found[title] - found["none"]).max() > 0.02, title
    changed = {title: np.asarray(abs(found[title] - found["none"])) for title in ("echo", "noise", "speckle")}
    # Where the object is dark, noise has one level, that of its strength, and speckle none; an echo lies somewhere.
    dark = np.asarray(found["none"] < 0.3)
    assert dark.sum() > 30
    assert 0.4 < np.median(changed["noise"][dark]) < 0.6
    assert np.ptp(np.quantile(changed["noise"][dark], (0.1, 0.9))) < 0.15
    assert np.median(changed["speckle"][dark]) < 0.05
    assert np.median(changed["echo"]) < 0.05 < 0.2 < changed["echo"].max()
    for title in ("moved", "blurred", "uneven light", "erased", "several"):
        assert abs(found[title] - found["masked"]).max() > 0.02, title
    again = pictures(plot_augmentations(scene, seed=1))
    np.testing.assert_array_equal(found["several"], again["several"])
    with pytest.raises(InputError, match="band is '60_ghz'"):
        plot_augmentations(scene, band="60_ghz")


@pytest.mark.slow
def test_random_shapes_are_shown_class_by_class():
    figure = plot_random_shapes(count=3, seed=2)
    assert len(figure.axes) == 3 * len(RANDOM_SHAPES)
    assert tuple(text.get_text() for axes in figure.axes for text in axes.texts) == tuple(RANDOM_SHAPES)
    things = plot_random_shapes(count=1, seed=2, household=True)
    assert tuple(text.get_text() for axes in things.axes for text in axes.texts) == PUBLISHED_CLASSES
    drawn = [axes.collections[0].get_paths() for axes in figure.axes]
    assert min(map(len, drawn)) >= 2
    with pytest.raises(InputError, match="count is 0"):
        plot_random_shapes(count=0)


@pytest.mark.slow
def test_examples_are_shown_channel_by_channel():
    examples = np.random.default_rng(0).random((2, len(CHANNELS), 80, 80))
    figure = plot_examples(examples, ["one", "two"], channels=("mask", "level"))
    assert [axes.get_title() for axes in figure.axes] == ["mask", "level", "", ""]
    np.testing.assert_array_equal(figure.axes[1].images[0].get_array(), examples[0, 2].T)
    with pytest.raises(InputError, match="2 examples and 1 titles"):
        plot_examples(examples, ["one"])
    with pytest.raises(InputError, match="'colour'"):
        plot_examples(examples, ["one", "two"], channels=("colour",))
