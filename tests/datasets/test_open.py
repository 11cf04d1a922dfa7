"""`ms.datasets.open`: a dataset as a sequence, its filters, what its parts read, and the view for torch."""

import subprocess
import sys

import numpy as np
import pytest

import millisight as ms
from millisight.datasets import Experiment, Simulation


@pytest.fixture(scope="module")
def dataset(miniature):
    return ms.datasets.open(miniature.healthy)


def test_a_dataset_is_a_sequence_of_its_experiments_and_simulations(dataset):
    parts = list(dataset)
    assert len(parts) == len(dataset) > 4
    assert {type(part) for part in parts} == {Experiment, Simulation}
    assert dataset[0] is parts[0]
    assert dataset[-1] is parts[-1]
    with pytest.raises(IndexError):
        dataset[len(dataset)]
    assert f"{len(dataset.experiments)} experiments" in repr(dataset)


def test_filters_keep_what_fits(dataset):
    nlos = dataset.filter(sight="nlos")
    assert len(nlos) > 0
    assert all(part.sight == "nlos" for part in nlos)
    simulated = dataset.filter(simulated=True, objects="mug")
    assert len(simulated) > 0
    assert {type(part) for part in simulated} == {Simulation}
    assert {part.object for part in simulated} == {"025_mug"}
    assert len(dataset.filter(experiment=1)) + len(dataset.filter(experiment=2)) == len(dataset.experiments)
    named = dataset.filter(keep=lambda part: "sugar" in part.object)
    assert {part.object for part in named} == {"004_sugar_box"}
    assert len(dataset.filter(sight="los", simulated=True)) == 0


def test_unknown_names_are_refused(dataset):
    with pytest.raises(ms.errors.UnknownNameError, match="sight 'line'.*los, nlos"):
        dataset.filter(sight="line")
    with pytest.raises(ms.errors.UnknownNameError, match="object 'jug'"):
        dataset.filter(objects="jug")


def test_parts_read_their_items(dataset):
    measured = next(part for part in dataset.filter(sight="los") if any(i.kind == "image" for i in part.items))
    image = measured.image()
    assert isinstance(image, ms.SarImage)
    assert measured.mask().inside.shape == image.grid.shape[:2]
    simulated = next(iter(dataset.filter(simulated=True)))
    assert isinstance(simulated.image(ext="_specular"), ms.SarImage)
    with pytest.raises(ms.errors.FileError, match="has no 77_ghz image _nothing; it has"):
        simulated.image(ext="_nothing")


def test_raw_files_become_captures(dataset):
    recorded = next(part for part in dataset.experiments if any(item.kind == "raw" for item in part.items))
    radar = next(item.radar for item in recorded.items if item.kind == "raw")
    capture = recorded.capture(radar=radar)
    assert isinstance(capture, ms.Capture)
    assert len(capture.trajectory) > 1


@pytest.mark.slow
def test_nothing_is_imported_from_torch_without_being_asked():
    code = "import sys, millisight as ms; ms.datasets.open; ms.datasets.Dataset; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_torch_loads_images_and_masks(dataset):
    torch = pytest.importorskip("torch", reason="torch is not installed: make setup-train")
    view = dataset.torch(mask=True)
    assert isinstance(view, torch.utils.data.Dataset)
    assert 0 < len(view) < len(dataset)
    item = view[0]
    part = next(part for part in dataset if part.name == item["name"])
    np.testing.assert_array_equal(item["image"].numpy(), part.image().values)
    np.testing.assert_array_equal(item["mask"].numpy(), part.mask().inside)
    np.testing.assert_array_equal(item["x"].numpy(), part.image().grid.x)
    sums = dataset.torch(ext="_specular", transform=lambda one: one["image"].abs().sum())
    loaded = torch.cat(list(torch.utils.data.DataLoader(sums, batch_size=2)))
    assert len(loaded) == len(sums) > 0
    assert (loaded > 0).all()
