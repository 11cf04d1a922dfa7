"""One colour map for all pictures, and how another one gets there: by a call, the environment, a plug-in."""

import os
import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import ListedColormap

import millisight as ms
from millisight import viz
from millisight.core import checked_colormap, colormap_in_use, colormap_names, errors, set_colormap

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.03, 0.02, 0.01), 0.01)
CAPTURE = ms.simulate(
    ms.Scene.from_mesh("golf_ball", vertices=100),
    ms.Radar.preset("mito-sim-24ghz"),
    ms.Trajectory.raster(size=(0.02, 0.02), step=0.01),
    model="edge",
)
DUSK = ListedColormap([(0.0, 0.0, 0.1), (0.9, 0.4, 0.3), (1.0, 1.0, 0.8)], name="dusk")


def image():
    return ms.SarImage(grid=GRID, values=np.arange(1, 1 + GRID.size).reshape(GRID.shape).astype(np.complex64))


def one(axes):
    return np.ravel(axes)[0].figure


PICTURES = {
    "image": lambda: viz.plot_image(image()),
    "slices": lambda: viz.plot_slices(image()),
    "sheet": lambda: viz.plot_sheet({"a": image()}),
    "samples": lambda: one(viz.plot_samples({"a": {"77 GHz": image()}})),
    "multispectral": lambda: one(viz.plot_multispectral({"77 GHz": image()}, {})),
    "capture": lambda: viz.plot_capture(CAPTURE),
    "range profiles": lambda: viz.plot_range_profiles(CAPTURE),
    "aperture": lambda: one(viz.plot_aperture_principle(aperture=0.01)),
}


@pytest.fixture
def setting(monkeypatch):
    """The setting as it is without any, and so again afterwards."""
    monkeypatch.delenv("MILLISIGHT_COLORMAP", raising=False)
    set_colormap(None)
    yield set_colormap
    set_colormap(None)


@pytest.fixture
def dusk(monkeypatch):
    """An installed package that adds the colour map "dusk", and a thing that is none."""
    from importlib.metadata import EntryPoint

    group = "millisight.colormaps"
    points = [EntryPoint(name, value, group) for name, value in (("dusk", f"{__name__}:DUSK"), ("pi", "math:pi"))]
    monkeypatch.setitem(sys.modules, __name__, sys.modules[test_a_plugin_adds_maps.__module__])
    monkeypatch.setattr("millisight.core._registry.entry_points", lambda group: points)
    monkeypatch.setattr("millisight.core._colormaps.PLUGIN_COLORMAPS._plugins", None)
    monkeypatch.setattr("millisight.core._colormaps.PLUGIN_COLORMAPS._entries", {})


def colormaps_of(figure):
    pictures = [p for axes in figure.axes for p in (*axes.get_images(), *axes.collections) if p.get_array() is not None]
    return {picture.get_cmap().name for picture in pictures} - {"viridis"}  # that of poses, which are counted


@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_has_the_one_that_is_set(name, setting):
    assert colormaps_of(PICTURES[name]()) == {"inferno"}
    setting("magma")
    assert colormaps_of(PICTURES[name]()) == {"magma"}


def test_the_viewer_and_the_annotator_offer_it_first(setting):
    pytest.importorskip("viser", reason="needs viser: make setup")
    from millisight.viz.viewer import ViewSettings

    assert ViewSettings().colormap == colormap_names()[0] == "inferno"
    setting("magma")
    assert ViewSettings().colormap == colormap_names()[0] == "magma"


def test_a_notebook_shows_it(setting):
    before = image()._repr_html_()
    setting("magma")
    assert image()._repr_html_() != before


def test_what_segmenters_look_at_does_not_change(setting):
    from millisight.perception import project

    before = project(image()).rgb
    setting("magma")
    np.testing.assert_array_equal(project(image()).rgb, before)


@pytest.mark.slow
def test_the_environment_sets_it_for_a_command():
    code = "from millisight.core import checked_colormap; print(checked_colormap().name)"
    settings = {**os.environ, "MILLISIGHT_COLORMAP": "cividis"}
    done = subprocess.run([sys.executable, "-c", code], env=settings, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "cividis"


def test_a_plugin_adds_maps(dusk, setting):
    assert "dusk" in colormap_names()
    setting("dusk")
    assert colormap_in_use() == "dusk"
    np.testing.assert_allclose(checked_colormap()(1.0)[:3], (1.0, 1.0, 0.8))
    assert colormaps_of(viz.plot_image(image())) == {"dusk"}
    with pytest.raises(errors.InputError, match="'pi' is a float; expected a matplotlib"):
        checked_colormap("pi")


def test_an_unknown_name_is_refused_and_changes_nothing(setting):
    with pytest.raises(errors.InputError, match="unknown colour map 'rainbowish'; try one of inferno, viridis"):
        setting("rainbowish")
    assert colormap_in_use() == "inferno"
    assert checked_colormap("jet") is not None
    assert checked_colormap(DUSK) is DUSK
    assert checked_colormap("gray").name == matplotlib.colormaps["gray"].name


def test_a_wrong_name_in_the_environment_is_none_to_try(setting, monkeypatch):
    monkeypatch.setenv("MILLISIGHT_COLORMAP", "n" * 100_000)
    assert colormap_names()[0] == "inferno"
    with pytest.raises(errors.InputError, match=r"unknown colour map 'n{80}'; try one of inferno, viridis"):
        checked_colormap()
