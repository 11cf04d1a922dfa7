"""What the viewer hides and finds: limits, cut outlines, the voxel under the pointer, lids, the view in the address."""

import dataclasses

import numpy as np
import pytest

import millisight as ms
from helpers.lids import covered_image
from millisight.core.errors import InputError, UnknownNameError
from millisight.viz.viewer import ViewSettings, first_settings, gather
from millisight.viz.viewer._address import from_address, to_address
from millisight.viz.viewer._clip import clipped_segments, cut_mesh, cut_outline, inside, kept_voxels
from millisight.viz.viewer._cover import cover_of
from millisight.viz.viewer._keys import KEYS, VIEW_KEYS, changes_of, limits_text, note_on, under_the_lid
from millisight.viz.viewer._levels import levels_of
from millisight.viz.viewer._pick import pick

GRID = ms.VoxelGrid.regular((-0.05, -0.04, -0.03), (0.05, 0.04, 0.03), 0.01)
NOWHERE = np.array([[-np.inf] * 3, [np.inf] * 3])


def box_limits(low, high):
    return np.array([low, high], dtype=float)


def ball(radius=0.03):
    import trimesh

    solid = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return ms.TriangleMesh(vertices=solid.vertices, faces=solid.faces)


# Limits --------------------------------------------------------------------------------------------------------------


def test_voxels_within_limits_are_those_whose_centres_are():
    limits = box_limits((-0.02, -1, 0.0), (0.031, 1, 0.0))
    whole = GRID.points.reshape(-1, 3)
    kept = kept_voxels(GRID, limits)
    assert inside(whole, limits).sum() == np.prod([part.stop - part.start for part in kept]) == 6 * 9 * 1
    assert np.allclose(GRID.x[kept[0]], [-0.02, -0.01, 0, 0.01, 0.02, 0.03])
    assert all(part.stop - part.start == 0 for part in kept_voxels(GRID, box_limits((1, 1, 1), (2, 2, 2))))


def test_the_strongest_are_looked_for_within_the_limits():
    rng = np.random.default_rng(0)
    levels = levels_of(GRID, rng.normal(size=GRID.shape) + 0j)
    limits = box_limits((-0.021, -0.011, -1), (0.001, 0.031, 0.001))
    cloud = levels.strongest(-20, 1000, limits)
    whole = levels.strongest(-20, 1000)
    within = inside(whole.points.astype(float), np.add(limits, [[-1e-6], [1e-6]]))
    assert 10 < len(cloud.db) == cloud.above == within.sum() < len(whole.db)
    assert np.array_equal(np.sort(cloud.db), np.sort(whole.db[within]))
    assert {*map(tuple, cloud.points)} == {*map(tuple, whole.points[within])}


def test_segments_are_cut_where_they_leave_the_box():
    limits = box_limits((0, 0, 0), (1, 1, 1))
    segments = np.array([
        [[-1, 0.5, 0.5], [2, 0.5, 0.5]],  # through
        [[0.2, 0.2, 0.2], [0.4, 0.4, 0.4]],  # within
        [[0.5, 0.5, 0.5], [0.5, 0.5, 3]],  # out of it
        [[2, 2, 2], [3, 2, 2]],  # beside
        [[-1, 2, 0.5], [2, 2, 0.5]],  # beside, along an axis
    ])  # fmt: skip
    cut = clipped_segments(segments, limits)
    expected = [[[0, 0.5, 0.5], [1, 0.5, 0.5]], segments[1], [[0.5, 0.5, 0.5], [0.5, 0.5, 1]]]
    assert np.allclose(cut, expected)
    assert np.allclose(clipped_segments(segments, NOWHERE), segments)


@pytest.mark.parametrize("axis", range(3))
def test_the_outline_of_a_ball_in_a_plane_is_a_circle(axis):
    at = 0.012
    lines = cut_outline(ball(), axis, at)
    assert len(lines) > 50
    assert (lines[..., axis] == at).all()
    others = [i for i in range(3) if i != axis]
    radius = np.sqrt(0.03**2 - at**2)
    assert np.hypot(*np.moveaxis(lines[..., others], -1, 0)) == pytest.approx(radius, rel=5e-3)
    assert np.linalg.norm(np.diff(lines, axis=1), axis=-1).sum() == pytest.approx(2 * np.pi * radius, rel=5e-3)
    ends = np.round(lines.reshape(-1, 3), 9)
    assert (np.unique(ends, axis=0, return_counts=True)[1] == 2).all()  # closed
    assert len(cut_outline(ball(), axis, 0.031)) == 0


def test_a_cut_mesh_is_within_the_limits_and_as_large_as_a_cap():
    top = 0.01
    vertices, faces = cut_mesh(ball(), box_limits((-np.inf, -np.inf, -np.inf), (np.inf, np.inf, top)))
    rest = ms.TriangleMesh(vertices=vertices, faces=faces)
    assert rest.bounds[1, 2] <= top + 1e-9
    assert rest.area == pytest.approx(2 * np.pi * 0.03 * (0.03 + top), rel=5e-3)
    assert len(cut_mesh(ball(), box_limits((1, 1, 1), (2, 2, 2)))[1]) == 0
    assert cut_mesh(ball(), NOWHERE)[1] is not None


# Under the pointer ---------------------------------------------------------------------------------------------------


def picture_of(spots):
    values = np.full(GRID.shape, 1e-2, dtype=np.complex64)
    for index, strength in spots.items():
        values[index] = strength
    return levels_of(GRID, values)


def test_a_ray_meets_the_nearest_shown_voxel():
    levels = picture_of({(5, 4, 3): 2.0, (5, 4, 5): 1.0})
    down = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
    met = pick(levels, ViewSettings(), -15, *down)
    assert met.place == pytest.approx([0, 0, 0.02])
    assert (met.db, met.magnitude) == pytest.approx((-6.02, 1.0), abs=0.01)
    assert met.distance == pytest.approx(1 - 0.025, abs=6e-3)
    assert pick(levels, ViewSettings(), -3, *down).place == pytest.approx([0, 0, 0])
    clipped = pick(levels, ViewSettings(clip_z=(-np.inf, 0.01)), -15, *down)
    assert clipped.place == pytest.approx([0, 0, 0])
    assert clipped.magnitude == pytest.approx(2.0)
    assert pick(levels, ViewSettings(clip_z=(-np.inf, -0.01)), -15, *down) is None
    aslant = pick(levels, ViewSettings(), -15, np.array([1.0, 0, 1.02]), np.array([-1.0, 0, -1.0]))
    assert aslant.place == pytest.approx([0, 0, 0.02])
    assert pick(levels, ViewSettings(), -15, np.array([1.0, 1, 1]), np.array([1.0, 1, 1])) is None


def test_a_ray_meets_a_slice_even_where_it_is_too_weak():
    levels = picture_of({(5, 4, 3): 2.0})
    slices = ViewSettings(points=False, slices=True, at=(0.05, 0.04, -0.02))
    met = pick(levels, slices, -15, np.array([0.0, 0.011, 1]), np.array([0.0, 0, -1]))
    assert met.place == pytest.approx([0, 0.01, -0.02])
    assert met.magnitude == pytest.approx(1e-2, rel=0.01)
    assert pick(levels, ViewSettings(points=False), -15, np.array([0.0, 0, 1]), np.array([0.0, 0, -1])) is None


# The address ---------------------------------------------------------------------------------------------------------


def test_settings_go_through_the_address():
    rng = np.random.default_rng(1)
    names = {field.name for field in dataclasses.fields(ViewSettings)}
    for number in range(20):
        low, high = np.sort(np.round(rng.normal(size=2), 4))
        settings = ViewSettings(
            points=number % 2 == 0, slices=number % 3 == 0, volume=number % 5 == 0, threshold_db=-number / 2,
            range_db=10.0 + number, colormap=("inferno", "jet")[number % 2], at=tuple(np.round(rng.normal(size=3), 4)),
            clip_x=(low, high), clip_y=(-np.inf, high), clip_z=(low, np.inf), top_db=-float(number),
            opacity=number / 20, clutter=number % 2 == 1, share=number / 20, normals=True, path=False, common=True,
        )  # fmt: skip
        text = to_address(settings)
        back = from_address(text)
        assert {name: getattr(back, name) for name in names} == {name: getattr(settings, name) for name in names}
        assert to_address(back) == text
    assert to_address(ViewSettings()) == ""


@pytest.mark.parametrize(
    "text",
    ["nothing=1", "points=2", "points=1&points=0", "at=1", "clip_z=1", "clip_z=2..1", "threshold_db=x", "opacity=nan"],
)
def test_an_address_that_is_not_understood_is_refused(text):
    with pytest.raises(InputError):
        from_address(text)


@pytest.mark.parametrize("wrong", [{"clip_z": (1, 0)}, {"clip_x": 1}, {"opacity": 2}, {"top_db": 1}, {"at": (1, 2)}])
def test_limits_that_cannot_be_right_are_refused(wrong):
    with pytest.raises(InputError):
        ViewSettings(**wrong)


# Keys ----------------------------------------------------------------------------------------------------------------


def test_every_key_changes_something_and_comes_back():
    (exhibit,) = gather([covered_image()]).exhibits
    exhibits, start = (exhibit,), ViewSettings(at=(0.0, 0.0, 0.0), clip_z=(-np.inf, 0.02))
    tried = 0
    for key in KEYS:
        if key in VIEW_KEYS:
            continue
        changes = changes_of(key, start, exhibits)
        assert any(getattr(start, name) != value for name, value in changes.items()), key
        tried += 1
    assert tried == len(KEYS) - 4
    there = dataclasses.replace(start, **changes_of("l", start, exhibits))
    assert dataclasses.replace(there, **changes_of("l", there, exhibits)).clip_z == (-np.inf, np.inf)
    assert changes_of("+", ViewSettings(threshold_db=0), exhibits) == {"threshold_db": 0}
    assert changes_of("]", ViewSettings(), exhibits) == {"clip_z": (-np.inf, np.inf)}


# Lids ----------------------------------------------------------------------------------------------------------------


def test_a_covered_image_opens_under_its_lid():
    image = covered_image()
    contents = gather([image])
    cover = contents.exhibits[0].cover
    assert cover.lid == pytest.approx(0.03, abs=2e-3)
    assert -0.01 < cover.ceiling < 0.03 - 4e-3
    settings = first_settings(contents)
    assert (settings.clip_z, settings.clutter) == ((-np.inf, cover.ceiling), False)
    assert settings.at == pytest.approx([0.0, 0.0, -0.02], abs=6e-3)  # through the object
    spot = cover.levels.strongest(-10, 1000, settings.limits).points
    assert 0 < len(spot) < 60
    assert np.abs(spot[:, :2]).max() < 0.02
    note = note_on(settings, contents.exhibits)
    assert note["note"] == (
        f"There is a lid at z = {100 * cover.lid:.1f} cm, its echo taken off. "
        f"Shown: z under {100 * cover.ceiling:.1f} cm."
    )
    assert (note["action"], note["key"]) == ("Show everything", "0")
    everything = dataclasses.replace(settings, **changes_of("0", settings, contents.exhibits))
    assert not everything.clipped
    assert everything.clutter
    assert note_on(everything, contents.exhibits)["action"] == "Look under the lid"
    assert first_settings(contents, clip_z=(-0.05, 0.05)).clip_z == (-0.05, 0.05)
    assert under_the_lid(gather([image], clutter="none").exhibits) == {}
    with pytest.raises(UnknownNameError):
        gather([image], clutter="some")


def test_a_lid_that_was_taken_off_is_known_by_the_images_history():
    from millisight.imaging import remove_sheets

    image = covered_image()
    cleaned = remove_sheets(image, frequency=79e9).result
    cover = cover_of(cleaned, "auto")
    assert cover.levels is None
    assert cover.lid == pytest.approx(cover_of(image, "auto").lid)
    assert first_settings(gather([cleaned])).clutter
    damaged = {**cleaned.metadata, "history": [{"step": "remove_sheets", "sheets": [{"height": "high"}]}]}
    assert cover_of(ms.SarImage(grid=cleaned.grid, values=cleaned.values, metadata=damaged), "auto") is None


def test_a_table_under_the_object_is_no_lid():
    assert cover_of(covered_image(lid=-0.035), "auto") is None


def test_an_image_without_a_lid_is_shown_as_it_is():
    rng = np.random.default_rng(3)
    values = rng.normal(size=GRID.shape) + 1j * rng.normal(size=GRID.shape)
    contents = gather([ms.SarImage(grid=GRID, values=values)])
    assert contents.exhibits[0].cover is None
    assert not first_settings(contents).clipped
    assert note_on(ViewSettings(), contents.exhibits)["note"] == ""


def test_limits_are_said_in_words():
    assert limits_text(ViewSettings()) == ""
    settings = ViewSettings(clip_x=(-0.1, 0.2), clip_y=(0.01, np.inf), clip_z=(-np.inf, -0.025))
    assert limits_text(settings) == "x from \u221210.0 cm to 20.0 cm, y over 1.0 cm, z under \u22122.5 cm"
