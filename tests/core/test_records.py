"""What arrays of records take."""

from pathlib import Path

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import InputError
from millisight.data import Instances, Picture

GRID = ms.VoxelGrid.regular((0, 0, 0), (0.02, 0.01, 0.01), 0.01)


@pytest.mark.parametrize("value", [300, -1, 256.0, np.nan])
def test_colours_that_do_not_fit_are_refused(value):
    """Integers were cut to 8 bits: 300 became 44."""
    with pytest.raises(InputError, match="rgb cannot be read as an array of uint8"):
        Picture(rgb=np.full((2, 2, 3), value))


def test_labels_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="labels cannot be read as an array of int32: it holds 4294967297"):
        Instances(labels=np.full(GRID.shape[:2], 2**32 + 1), grid_xy=GRID.xy, scores=[1.0])


@pytest.mark.parametrize("inside", [0.4, -1, np.nan, "0", "False", 1 + 0j])
def test_what_is_neither_inside_nor_outside_is_refused(inside):
    """A probability, or NaN for what is not known, was inside."""
    with pytest.raises(InputError, match="inside cannot be read as an array of bool"):
        ms.Mask(grid_xy=GRID.xy, inside=np.full(GRID.shape[:2], inside))


@pytest.mark.parametrize("inside", [True, 1, 255, np.uint8(255), 1.0])
def test_numbers_that_count_are_inside(inside):
    assert ms.Mask(grid_xy=GRID.xy, inside=np.full(GRID.shape[:2], inside)).inside.all()


def test_a_mapped_file_does_not_change_a_record(tmp_path):
    path = tmp_path / "values.npy"
    np.save(path, np.ones(GRID.shape, np.complex64))
    image = ms.SarImage(grid=GRID, values=np.load(path, mmap_mode="r"))
    np.load(path, mmap_mode="r+")[:] = 7
    assert (image.values == 1).all()


@pytest.mark.parametrize("path", ["mug.image.h5", Path("mug.image.h5")])
def test_a_path_in_place_of_a_record_is_refused_with_what_loads_it(path):
    with pytest.raises(
        InputError, match=r"image is of type \w+; expected SarImage; load the file with millisight.load"
    ):
        ms.segment(path)


def test_a_text_in_place_of_a_record_is_refused_without_a_word_of_files():
    with pytest.raises(InputError, match=r"image is of type str; expected SarImage$"):
        ms.segment("mug")
