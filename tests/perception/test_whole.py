"""Whole scenes to train on: what lies where, what covers it, and what is taken off."""

import numpy as np
import pytest

from helpers.whole_scenes import drawn_sheet, object_parts, whole_scene
from millisight.core.errors import DamagedFileError, InputError, UnknownNameError
from millisight.data import SarImage, VoxelGrid
from millisight.imaging import remove_sheets
from millisight.perception import SPACING
from millisight.perception.training import BANDS, DEPTH, WholeSettings, _scenes, _whole
from millisight.perception.training._bands import write_parts
from millisight.perception.training._segmenter import example_of
from millisight.perception.training._sheets import cached_sheet
from millisight.perception.training._whole import cached_whole_scene


@pytest.fixture(scope="module")
def dice():
    return object_parts("dice")


@pytest.mark.slow
def test_an_object_lies_somewhere_in_a_larger_scene_and_shines_there(dice):
    places, contrasts = [], []
    for seed in range(6):
        scene = whole_scene(dice, seed=seed, sheets=0)
        assert set(np.unique(scene.objects)) <= {0, 1}
        assert scene.objects.sum() == dice.inside.sum()
        assert min(scene.objects.shape) >= 0.2 / SPACING - 1
        power = scene.power("77_ghz")
        assert power.shape[:2] == scene.objects.shape
        assert power.max() == 1
        inside = scene.objects > 0
        contrasts.append(10 * np.log10(power.max(axis=2)[inside].mean() / power.max(axis=2)[~inside].mean()))
        places.append(np.argwhere(inside).mean(axis=0) / scene.objects.shape)
        assert not scene.covered
    assert np.median(contrasts) > 6
    assert np.std(places, axis=0).min() > 0.1


@pytest.mark.slow
def test_one_seed_makes_one_scene(dice):
    first, again, other = (whole_scene(dice, seed=seed) for seed in (3, 3, 4))
    for band in BANDS:
        np.testing.assert_array_equal(first.levels[band], again.levels[band])
    assert (
        first.levels["77_ghz"].shape != other.levels["77_ghz"].shape
        or (first.levels["77_ghz"] != other.levels["77_ghz"]).any()
    )


def test_several_objects_have_numbers_of_their_own(dice):
    scene = whole_scene(dice, object_parts("golf_ball"), seed=2)
    assert set(np.unique(scene.objects)) == {0, 1, 2}


def test_an_empty_scene_has_no_object_and_an_image_all_the_same(dice):
    scene = whole_scene(dice, empty=1.0)
    assert not scene.objects.any()
    assert scene.power("24_ghz").max() == 1


@pytest.mark.slow
def test_a_bright_lid_is_taken_off(dice):
    taken = [
        scene.taken_db["77_ghz"] for scene in (whole_scene(dice, seed=seed, covered=1.0, sheets=2) for seed in range(7))
    ]
    assert max(taken) <= 3
    assert np.median(taken) < -1.5  # dB: the lid is brighter than the object in about half of the scenes


def test_without_one_band_the_other_is_there_still(dice):
    single = dice._replace(images={"77_ghz": dice.images["77_ghz"]}, scales={"77_ghz": dice.scales["77_ghz"]})
    scene = whole_scene(single)
    assert set(scene.levels) == {"77_ghz"}


@pytest.mark.slow
def test_scenes_are_kept_in_files(dice, tmp_path):
    asked = []

    def parts(rng):
        asked.append(rng)
        return [dice], [drawn_sheet] * 2

    settings = WholeSettings(covered=1.0)
    first, again = (cached_whole_scene("a", settings, parts, seed=[1], folder=tmp_path, among="o") for _ in range(2))
    assert len(asked) == 1
    for band in BANDS:
        np.testing.assert_array_equal(first.levels[band], again.levels[band])
    assert first.taken_db == pytest.approx(again.taken_db)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(DamagedFileError, match="is not a scene of this training"):
        cached_whole_scene("a", settings, parts, seed=[1], folder=tmp_path, among="o")
    cached_whole_scene("b", settings, parts, seed=[1], folder=tmp_path, among="o")
    assert len(asked) == 2
    cached_whole_scene("b", settings, parts, seed=[1], folder=tmp_path, among="o;p")  # of other partners: another one
    assert len(asked) == 3


@pytest.mark.parametrize(
    ("wrong", "kind", "told"),
    [
        ({"views": 0}, InputError, "views is 0"),
        ({"sheets": -1}, InputError, "sheets is -1"),
        ({"several": -0.1}, InputError, "several is -0.1"),
        ({"parts": "diffuse"}, UnknownNameError, "diffuse"),
    ],
)
def test_settings_that_cannot_be(wrong, kind, told):
    with pytest.raises(kind, match=told):
        WholeSettings(**wrong)


@pytest.mark.slow
def test_a_simulated_sheet_is_one_that_is_found(tmp_path):
    sheet = cached_sheet(1, seed=18, folder=tmp_path)
    again = cached_sheet(1, seed=18, folder=tmp_path)
    np.testing.assert_array_equal(sheet.images["77_ghz"], again.images["77_ghz"])
    values = sheet.images["77_ghz"]
    x, y, z = (step * np.arange(size) for step, size in zip((SPACING, SPACING, DEPTH), values.shape, strict=True))
    found = remove_sheets(SarImage(grid=VoxelGrid(x=x, y=y, z=z), values=values), frequency=79e9, clutter="lid")
    (one,) = found.sheets
    # It lies where it says it does, to a fraction of the range resolution of 3.7 cm.
    assert one.height == pytest.approx(z[sheet.level], abs=0.012)
    assert np.linalg.norm(found.result.values) < 0.35 * np.linalg.norm(values)


@pytest.mark.slow
def test_a_stand_is_small_and_level(tmp_path):
    stand = cached_sheet(1, seed=18, folder=tmp_path, kind="stand")
    assert (abs(stand.reach) < 0.0176).all()
    seen = abs(stand.images["77_ghz"]).max(axis=2)
    x = SPACING * (np.arange(len(seen)) - len(seen) // 2)
    lit = np.flatnonzero(seen.max(axis=1) > 0.5)
    assert abs(x[lit[-1]] - x[lit[0]] - 2 * stand.reach[1]) < 0.008


ODD = (np.array([1, 2]), np.array(np.nan), np.array([]), np.array(1.5), np.ones((2, 2)), np.array(-1), np.array(10**9))


def _stored(tmp_path, what, dice):
    """A file of a reader's, and the reader."""
    path = tmp_path / "a.npz"
    if what == "scene":
        _scenes._write(path, dice)
        return path, lambda: _scenes._read(path)
    if what == "whole":
        _whole._write(path, whole_scene(dice))
        return path, lambda: _whole._read(path)
    path, sheet = tmp_path / "sheet-1-2.npz", drawn_sheet()
    write_parts(path, sheet.images, level=np.array(sheet.level), reach=sheet.reach)
    return path, lambda: cached_sheet(1, seed=2, folder=tmp_path)


@pytest.mark.parametrize(("what", "arrays"), [("scene", 9), ("whole", 7), ("sheet", 4)])
def test_whole_files_of_odd_arrays_are_damaged(what, arrays, tmp_path, dice):
    path, read = _stored(tmp_path, what, dice)
    read()
    with np.load(path) as file:
        held = dict(file)
    assert len(held) == arrays
    refused = 0
    for name, array in held.items():
        for odd in (*ODD, array[None], array.astype(complex)):
            with open(path, "wb") as file:
                np.savez(file, **{**held, name: odd})
            if what == "whole" and name.startswith("24_ghz_raw") and not odd.size:
                assert list(read().levels) == ["77_ghz"]  # as a scene of one radar is stored
                continue
            with pytest.raises(DamagedFileError, match="delete it"):
                read()
            refused += 1
    assert refused >= 9 * arrays - 1


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_no_number_makes_a_stored_image_damaged(value, tmp_path, dice):
    path, read = _stored(tmp_path, "sheet", dice)
    with np.load(path) as file:
        held = dict(file)
    held["77_ghz"][3, 4, 5] = value
    with open(path, "wb") as file:
        np.savez(file, **held)
    with pytest.raises(DamagedFileError, match="77_ghz is no image; delete it"):
        read()


@pytest.mark.slow
def test_examples_that_show_little_around_an_object_show_all_of_it(dice):
    scene = whole_scene(dice, seed=1, sheets=0)
    assert scene.objects.shape > (40, 40)
    for seed in range(8):
        near = example_of(scene, np.random.default_rng(seed), close=1.0)
        shown = np.argwhere(near.weight > 0)
        lit = np.argwhere(near.inside > 0)
        assert len(lit) == (scene.objects > 0).sum()
        beside = np.concatenate([lit.min(axis=0) - shown.min(axis=0), shown.max(axis=0) - lit.max(axis=0)])
        assert (beside >= 0).all()
        assert (beside <= round(0.04 / SPACING)).all()
    empty = whole_scene(dice, seed=1, sheets=0, empty=1.0)
    assert example_of(empty, np.random.default_rng(0), close=1.0).weight.sum() > 1600


def test_objects_are_bright_and_dim_in_places_where_asked(dice):
    plain, uneven = whole_scene(dice, seed=5), whole_scene(dice, seed=5, uneven=8.0)
    assert plain.levels["77_ghz"].shape == uneven.levels["77_ghz"].shape
    inside = plain.objects > 0
    ratio = uneven.power("77_ghz").max(axis=2)[inside] / plain.power("77_ghz").max(axis=2)[inside]
    assert 1 < np.std(10 * np.log10(ratio)) < 16


def test_what_is_round_has_hardly_any_echo_of_edges_where_asked(dice, monkeypatch):
    seen = []
    object_image = _whole.augmentation.object_image
    monkeypatch.setattr(
        _whole.augmentation, "object_image",
        lambda one, band, gains: seen.append(gains["edge"]) or object_image(one, band, gains),
    )  # fmt: skip
    for share in (0.0, 1.0):
        whole_scene(dice, seed=5, round=share)
    plain, rounded = seen[: len(BANDS)], seen[len(BANDS) :]
    assert 10**-1.5 <= rounded[0] / plain[0] <= 10**-0.3
