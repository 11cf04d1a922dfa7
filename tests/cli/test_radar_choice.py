"""`--radar` for files that are named alone: what they hold must be of that radar, and the radar must be known."""

import dataclasses

import pytest

import millisight as ms
from helpers.commands import run_here
from helpers.mirrors import DEVICES, capture_of, points, raster
from helpers.small_images import image
from millisight.cli.image_sources import image_sources
from millisight.cli.sources import sources
from millisight.core.errors import InputError, UnknownNameError

OF_79 = r"x\.image\.h5 is of 79 GHz, and --radar asks for 24_ghz; leave --radar out, or pass a file of that radar"


def of_band(frequency):
    """An image that tells its band, or not."""
    history = [] if frequency is None else [{"step": "form_image", "frequency": frequency}]
    return dataclasses.replace(image(), metadata={"history": history})


@pytest.fixture
def captures(tmp_path):
    """A capture of 24 GHz by the name of a radar that only this folder knows."""
    path = raster(step=0.05)
    radar = DEVICES["24 GHz"]
    ms.save(tmp_path / "mine.capture.h5", capture_of(radar, path, points(radar, path)))
    return tmp_path


def opened(path, radar):
    (source,) = sources([path], radar)
    with source.opened(None):
        return source.name


@pytest.mark.parametrize(("frequency", "radar"), [(79e9, "77_ghz"), (24.1e9, "24_ghz"), (None, "24_ghz")])
def test_an_image_of_the_radar_or_of_an_unknown_band_passes(tmp_path, frequency, radar):
    ms.save(tmp_path / "x.image.h5", of_band(frequency))
    (found,) = image_sources([tmp_path / "x.image.h5"], radar=radar)
    assert found.images()[0].frequency == frequency


@pytest.mark.parametrize("command", [("segment", "--method", "classical"), ("surface",)])
def test_an_image_of_another_radar_is_refused(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    ms.save(tmp_path / "x.image.h5", of_band(79e9))
    name, *options = command
    code, _, _, error = run_here(name, "x.image.h5", "--radar", "24_ghz", *options)
    assert code == 1
    assert error == OF_79.replace("\\", "")
    assert [path.name for path in tmp_path.iterdir()] == ["x.image.h5"]


def test_the_folder_of_the_layout_tells_the_radar_where_the_file_does_not(tmp_path):
    folder = tmp_path / "los" / "processed" / "radars" / "77_ghz"
    folder.mkdir(parents=True)
    ms.save(folder / "processed_image.h5", image())
    with pytest.raises(InputError, match=r"processed_image\.h5 is of 77_ghz, and --radar asks for 24_ghz"):
        image_sources([folder / "processed_image.h5"], radar="24_ghz")


@pytest.mark.parametrize("place", ["x.image.h5", "."])
def test_an_unknown_radar_of_images_is_refused(tmp_path, place):
    ms.save(tmp_path / "x.image.h5", of_band(79e9))
    with pytest.raises(UnknownNameError, match=r"unknown radar '60_ghz'\. .*Known: 24_ghz, 77_ghz\."):
        image_sources([tmp_path / place], radar="60_ghz")


def test_a_capture_of_another_radar_is_refused(captures):
    assert opened(captures / "mine.capture.h5", "24_ghz") == "mine"
    with pytest.raises(InputError, match=r"mine\.capture\.h5 is of 24\.1 GHz, and --radar asks for 77_ghz"):
        opened(captures / "mine.capture.h5", "77_ghz")


def test_radars_of_other_names_are_known_by_their_files(captures):
    assert opened(captures, "mine") == opened(captures / "mine.capture.h5", "mine") == "mine"
    with pytest.raises(UnknownNameError, match=r"Known: 24_ghz, 77_ghz\."):
        sources([captures / "mine.capture.h5"], "60_ghz")
    with pytest.raises(UnknownNameError, match=r"Known: 24_ghz, 77_ghz, mine\."):
        sources([captures], "60_ghz")
