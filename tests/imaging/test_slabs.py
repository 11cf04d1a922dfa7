"""Images in slabs: the same voxels as at once, resumed where they stopped, within the memory that was asked for."""

import dataclasses
import os

import numpy as np
import pytest

import millisight as ms
from helpers.commands import refused, run_here
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Layers
from millisight.imaging import _slabs, form_image_to, image_slabs, memory_needed

GRID = ms.VoxelGrid.regular((-0.05, -0.04, -0.03), (0.05, 0.04, 0.03), 0.005)


@pytest.fixture(scope="module")
def capture():
    return ms.simulate(
        ms.Scene.from_mesh("golf_ball", vertices=300),
        ms.Radar.preset("mito-sim-24ghz"),
        ms.Trajectory.raster(size=(0.1, 0.1), step=0.01),
    )


def memory_for(capture, share):
    fixed = memory_needed(capture, GRID) - _slabs.VOXEL_BYTES * GRID.size
    return fixed + share * _slabs.VOXEL_BYTES * GRID.size


def test_slabs_cover_the_image_once_and_fit(capture):
    for share in (1, 0.5, 0.34, 0.1):
        slabs = image_slabs(capture, GRID, memory=memory_for(capture, share))
        assert [i for slab in slabs for i in range(slab.start, slab.stop)] == list(range(len(GRID.x)))
        assert max(slab.stop - slab.start for slab in slabs) <= share * len(GRID.x)
    assert len(image_slabs(capture, GRID, memory=memory_for(capture, 1))) == 1


def test_files_of_others_beside_the_slabs_are_kept(capture, tmp_path):
    folder = tmp_path / "large.h5.slabs"
    folder.mkdir()
    for name in ("notes.txt", "7.h5"):  # a slab of a run that cut them otherwise
        (folder / name).write_text("mine")
    form_image_to(tmp_path / "large.h5", capture, GRID, memory=memory_for(capture, 0.5))
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


def test_too_little_memory_for_one_layer_is_refused(capture):
    with pytest.raises(InputError, match=r"memory is .* GB; expected at least .* for one layer of 17 x 13 voxels"):
        image_slabs(capture, GRID, memory=memory_for(capture, 0.01))
    with pytest.raises(InputError, match="memory is -1"):
        image_slabs(capture, GRID, memory=-1)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_the_image_in_slabs_is_the_image_at_once(capture, tmp_path, method):
    path, reports = tmp_path / "large.h5", []
    peak, place = form_image_to(
        path, capture, GRID, memory=memory_for(capture, 0.3), method=method, asked={"grid": "5mm"},
        progress=lambda *done: reports.append(done),
    )  # fmt: skip
    image, whole = ms.load(path, ms.SarImage), ms.form_image(capture, GRID, method=method)
    largest = whole.magnitude.max()
    np.testing.assert_allclose(image.values, whole.values, atol=(0.01 if method == "fast" else 1e-6) * largest)
    assert (peak, list(place)) == (pytest.approx(largest, rel=0.01), list(whole.peak))
    assert image.metadata["asked"] == {"grid": "5mm"}
    assert image.metadata["history"][-1]["slabs"] == 4
    assert image.frequency == whole.frequency
    done = [a / b for a, b in reports]
    assert (done == sorted(done), done[-1]) == (True, 1)
    assert os.listdir(tmp_path) == ["large.h5"]


@pytest.mark.slow
def test_an_interrupted_image_goes_on_with_the_slabs_that_are_done(capture, tmp_path, monkeypatch):
    path, memory, formed = tmp_path / "large.h5", memory_for(capture, 0.3), []

    def form(capture, grid, **settings):
        formed.append(grid.x[0])
        if len(formed) == 3:
            raise KeyboardInterrupt
        return ms.form_image(capture, grid, **settings)

    monkeypatch.setattr(_slabs, "form_image", form)
    with pytest.raises(KeyboardInterrupt):
        form_image_to(path, capture, GRID, memory=memory)
    kept = tmp_path / "large.h5.slabs"
    assert not path.exists()
    assert sorted(os.listdir(kept)) == ["0.h5", "1.h5"]
    (kept / "1.h5").write_bytes((kept / "1.h5").read_bytes()[:-20])  # a damaged slab is made again
    form_image_to(path, capture, GRID, memory=memory)
    assert [round(float(x), 3) for x in formed[3:]] == [-0.025, 0.0, 0.03]
    whole = ms.form_image(capture, GRID).values
    np.testing.assert_allclose(ms.load(path).values, whole, atol=0.01 * abs(whole).max())
    # Of other frames nothing is kept, though they differ in one pose alone.
    formed.clear()
    frames = capture.frames.copy()
    frames[7] = 0
    with pytest.raises(KeyboardInterrupt):
        form_image_to(path, dataclasses.replace(capture, frames=frames), GRID, memory=memory)
    assert len(formed) == 3
    formed.clear()
    with pytest.raises(KeyboardInterrupt):
        form_image_to(path, capture, GRID, memory=memory)
    formed.clear()
    other = ms.simulate(
        ms.Scene.from_mesh("dice", vertices=300), capture.radar, ms.Trajectory.raster(size=(0.1, 0.1), step=0.01)
    )
    with pytest.raises(KeyboardInterrupt):
        form_image_to(path, other, GRID, memory=memory)
    assert len(formed) == 3
    # Nor of the same frames through other layers.
    for index in (1.3, 1.7):
        formed.clear()
        layers = Layers(thicknesses=[0.02], indices=[index], normal=[0, 0, -1], moved=0.0, offset=0.0, error=0.0)
        with pytest.raises(KeyboardInterrupt):
            form_image_to(path, dataclasses.replace(other, layers=layers), GRID, memory=memory)
        assert len(formed) == 3


def test_names_of_other_formats_are_refused_before_anything_is_made(capture, tmp_path):
    with pytest.raises(UnknownNameError, match="png"):
        form_image_to(tmp_path / "large.png", capture, GRID, memory=1e9)
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_the_command_forms_slabs_where_the_memory_does_not_suffice(capture, tmp_path):
    source = tmp_path / "ball.capture.h5"
    ms.save(source, capture)

    grid = ("--grid", "-40cm:40cm:4mm,-4cm:4cm:4mm,-3cm:3cm:4mm")
    code, out, err, _ = run_here("image", source, *grid, "--memory", "604MB", "-o", tmp_path / "a.h5")
    assert code == 0, err
    assert "is formed in 3 slabs of at most 0.6 GB" in out + err
    code, out, err, _ = run_here("image", source, *grid, "--memory", "8GB", "-o", tmp_path / "b.h5")
    assert code == 0, err
    assert "is formed in" not in out + err
    a, b = (ms.load(tmp_path / name).values for name in ("a.h5", "b.h5"))
    np.testing.assert_allclose(a, b, atol=0.01 * abs(b).max())
    for wrong in ("8", "lots", "-1GB", "0GB", "nanGB"):
        assert "expected a size with its unit" in refused("image", source, "--memory", wrong)
