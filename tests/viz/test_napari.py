"""napari's reader: layers lie where the records say, and the manifest is one that napari takes."""

from importlib import import_module
from importlib.metadata import entry_points
from importlib.resources import files

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import Instances, VolumeMask
from millisight.viz import napari_layers, napari_reader

GRID = ms.VoxelGrid.regular((-0.02, 0.1, -0.3), (0.04, 0.13, -0.25), (0.002, 0.003, 0.01))


def saved(folder, name, held):
    ms.save(folder / f"{name}.h5", held)
    return str(folder / f"{name}.h5")


@pytest.fixture
def image():
    values = np.zeros(GRID.shape, complex)
    values[4, 7, 2] = 3j
    return ms.SarImage(grid=GRID, values=values)


def test_an_image_is_a_layer_in_millimetres_whose_slider_is_z(image, tmp_path):
    path = saved(tmp_path, "mug.image", image)
    ((values, told, kind),) = napari_reader(path)(path)
    assert (kind, told["name"]) == ("image", "mug.image")
    assert values.shape == GRID.shape[::-1]
    assert values[2, 7, 4] == 3
    place = np.array(told["translate"]) + np.array(told["scale"]) * [2, 7, 4]
    np.testing.assert_allclose(place, 1e3 * image.peak[::-1])
    assert told["units"] == ["mm"] * 3


def test_masks_are_labels(image, tmp_path):
    inside = image.magnitude.max(axis=2) > 1
    objects = Instances(grid_xy=GRID.xy, labels=inside.astype(np.int32), scores=np.ones(1))
    records = [ms.Mask(grid_xy=GRID.xy, inside=inside), objects, VolumeMask(grid=GRID, inside=image.magnitude > 1)]
    paths = [saved(tmp_path, name, one) for name, one in zip("abc", records, strict=True)]
    layers = napari_layers(paths)
    assert [kind for *_, kind in layers] == ["labels"] * 3
    assert [values.shape for values, *_ in layers] == [GRID.shape[1::-1]] * 2 + [GRID.shape[::-1]]
    assert all(values.sum() == 1 for values, *_ in layers)
    assert layers[0][0][7, 4] == 1


def test_what_it_cannot_show_is_said_and_other_files_are_left_to_others(tmp_path):
    assert napari_reader("photo.png") is None
    assert napari_reader(["a.h5", "photo.png"]) is None
    path = saved(tmp_path, "cloud", ms.Trajectory.raster(size=(0.1, 0.1), step=0.01))
    with pytest.raises(InputError, match=r"holds a Trajectory.*millisight view shows the rest"):
        napari_layers(path)


def test_the_manifest_names_a_function_that_is_there():
    """`npe2 validate millisight` checks it as napari does; npe2 is no part of the tests, since it comes into pytest."""
    yaml = pytest.importorskip("yaml")
    (found,) = entry_points(group="napari.manifest", name="millisight")
    package, name = found.value.split(":")
    told = yaml.safe_load((files(package) / name).read_text(encoding="utf-8"))
    assert told["name"] == "millisight"
    (command,), (reader,) = told["contributions"]["commands"], told["contributions"]["readers"]
    assert reader["command"] == command["id"]
    where, function = command["python_name"].split(":")
    assert getattr(import_module(where), function) is napari_reader
    assert reader["filename_patterns"] == ["*.h5", "*.hdf5"]
