"""The viewer without a browser: levels, the layout of the panes, what belongs to what, the port, the scene."""

import asyncio
import dataclasses
import re
import socket
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import millisight as ms
from helpers.miniature import MUG
from helpers.processes import files_to_open
from millisight.cli.app import app
from millisight.core.errors import DamagedFileError, DeviceError, FileError, FormatError, InputError, UnknownNameError
from millisight.meshes import write_mesh
from millisight.viz import grid_box
from millisight.viz._panels import mask_borders
from millisight.viz.viewer import PaneGrid, Viewer, ViewSettings, first_settings, gather, start
from millisight.viz.viewer import _contents as contents_module
from millisight.viz.viewer import _server as server_module
from millisight.viz.viewer._layout import FOV, placed, rows_and_columns, start_camera
from millisight.viz.viewer._levels import FLOOR_DB, levels_of, mixed_levels
from millisight.viz.viewer._pane import path_lines
from millisight.viz.viewer._server import url_of
from millisight.viz.viewer._settings import colour_bar, palette

GRID = ms.VoxelGrid(x=np.linspace(-0.03, 0.03, 7), y=np.linspace(0, 0.04, 5), z=np.linspace(-0.2, -0.1, 3))


def image(seed=0, grid=GRID, **metadata):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=grid.shape) + 1j * rng.normal(size=grid.shape)
    return ms.SarImage(grid=grid, values=values.astype(np.complex64), metadata=metadata)


# Levels --------------------------------------------------------------------------------------------------------------


def test_levels_are_db_under_the_maximum():
    shown = image()
    levels = levels_of(shown.grid, shown.values)
    expected = 20 * np.log10(shown.magnitude / shown.magnitude.max())
    assert np.abs(levels.db - np.maximum(expected, FLOOR_DB)).max() < 1e-4
    assert levels.peak == pytest.approx(float(shown.magnitude.max()))
    assert levels.block == (1, 1, 1)


def test_slabs_and_blocks_give_each_block_its_strongest_voxel(monkeypatch):
    shown = image()
    whole = levels_of(shown.grid, shown.values)
    monkeypatch.setattr("millisight.viz.viewer._levels._SLAB_VOXELS", 1)
    levels = levels_of(shown.grid, shown.values, most=40)
    assert levels.block == (2, 2, 1)
    assert levels.db.shape == (4, 3, 3)
    assert levels.peak == whole.peak
    for i, j, k in np.ndindex(levels.db.shape):
        assert levels.db[i, j, k] == whole.db[2 * i : 2 * i + 2, 2 * j : 2 * j + 2, k].max()
    assert levels.grid.x == pytest.approx([-0.025, -0.005, 0.015, 0.03])


def test_the_strongest_come_first_and_no_more_than_asked_for():
    levels = levels_of(GRID, image().values)
    cloud = levels.strongest(-10, 1000)
    assert cloud.above == len(cloud.db) == (levels.db >= -10).sum() > 10
    assert (np.diff(cloud.db) <= 0).all()
    some = levels.strongest(-10, 7)
    assert some.above == cloud.above
    assert np.array_equal(some.db, cloud.db[:7])
    for point, db in zip(some.points, some.db, strict=True):
        index = tuple(int(np.abs(a - p).argmin()) for a, p in zip((GRID.x, GRID.y, GRID.z), point, strict=True))
        assert levels.db[index] == db


def test_many_voxels_of_one_level_do_not_go_over_the_limit():
    cloud = levels_of(GRID, np.ones(GRID.shape, np.complex64)).strongest(-10, 11)
    assert (len(cloud.db), cloud.above) == (11, GRID.size)


def test_an_empty_image_has_nothing_above_any_threshold():
    levels = levels_of(GRID, np.zeros(GRID.shape, np.complex64))
    assert len(levels.strongest(FLOOR_DB, 100).db) == 0
    assert (levels.db == FLOOR_DB).all()


def test_values_that_are_not_finite_are_refused():
    values = image().values.copy()
    values[3, 1, 2] = np.nan
    with pytest.raises(InputError, match="NaN or infinite"):
        levels_of(GRID, values)


@pytest.mark.parametrize("axis", range(3))
def test_a_slice_shows_the_plane_nearest_to_its_place(axis):
    levels = levels_of(GRID, image().values)
    coordinates = (GRID.x, GRID.y, GRID.z)[axis]
    picture, place = levels.slice(axis, coordinates[1] + 0.1 * (coordinates[2] - coordinates[1]))
    assert place == coordinates[1]
    assert np.array_equal(picture, levels.db.take(1, axis=axis).T)


def test_pixels_are_of_one_size_where_spacings_differ():
    grid = ms.VoxelGrid(x=[0.0, 0.01, 0.02, 0.05], y=[0.0, 0.01], z=[0.0])
    levels = levels_of(grid, (1 + np.arange(8)).reshape(grid.shape).astype(np.complex64))
    picture, _ = levels.slice(2, 0.0)
    assert picture.shape == (2, 4)
    assert np.array_equal(picture, levels.db[[0, 2, 3, 3], :, 0].T)


def test_slabs_hold_every_slice_once():
    levels = levels_of(GRID, image().values)
    slabs = levels.slabs(0, 3)
    assert len(slabs) == 3
    assert np.max([picture.max() for picture, _ in slabs]) == 0
    assert np.array_equal(slabs[0][0], levels.db[:3].max(axis=0).T)


def test_weighed_levels_are_those_of_the_combined_image():
    specular, edge = image(1), image(2)
    both = ms.combine(specular, edge, (0.3, 0.7))
    assert np.abs(mixed_levels(specular, edge, 0.7).db - levels_of(GRID, both.values).db).max() < 1e-4
    assert np.array_equal(mixed_levels(specular, edge, 0.0).db, levels_of(GRID, specular.values).db)


# Layout --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_all_panes_are_seen_from_the_same_direction(count):
    rng = np.random.default_rng(count)
    for camera in (*rng.normal(size=(20, 3)) * 3, np.array([0.0, 0.0, 2.0])):
        seen = []
        for place in placed(count, 0.2, camera, np.array([0.0, 0.0, 1.0])):
            line = _rotation(*place.wxyz).T @ (place.position - camera)
            seen.append(line / np.linalg.norm(line))
        assert len(seen) == count
        assert np.abs(np.array(seen) + camera / np.linalg.norm(camera)).max() < 1e-12


def _rotation(w, *v):
    cross = np.cross(np.eye(3), -np.array(v)).T
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def test_panes_do_not_overlap_and_fit_the_view():
    radius = 0.3
    for count in range(1, 10):
        distance = start_camera(count, radius, aspect=1.5)
        camera = np.array([0.0, -distance, 0.0])
        places = np.array([p.position for p in placed(count, radius, camera, np.array([0.0, 0.0, 1.0]))])
        apart = np.linalg.norm(places[:, None] - places, axis=-1)[np.triu_indices(count, 1)]
        assert (apart >= 2 * radius - 1e-12).all()
        rows, columns = rows_and_columns(count)
        assert rows * columns >= count
        reach = np.tan(FOV / 2) * distance
        assert np.abs(places[:, 2]).max() + radius <= reach
        assert np.abs(places[:, 0]).max() + radius <= 1.5 * reach


# Settings ------------------------------------------------------------------------------------------------------------


def test_colours_run_from_the_end_of_the_range_to_the_maximum():
    settings = ViewSettings(range_db=20, colormap="viridis")
    colours = settings.colours(np.float32([-40, -20, 0]))
    assert np.array_equal(colours, palette("viridis")[[0, 0, 255]])


def test_the_colour_bar_dims_what_is_hidden():
    assert "width:50.0%" in colour_bar(ViewSettings(range_db=30, threshold_db=-15))


@pytest.mark.parametrize(
    "wrong", [{"threshold_db": 1}, {"range_db": 0}, {"range_db": 1e-320}, {"share": 1.5}, {"colormap": "none"}]
)
def test_settings_that_cannot_be_right_are_refused(wrong):
    with pytest.raises(InputError):
        ViewSettings(**wrong)


# Contents ------------------------------------------------------------------------------------------------------------


def saved(folder, name, record):
    ms.save(folder / name, record)
    return folder / name


def simulated(seed, model):
    return image(seed, scene_bounds=[[0, 0, 0], [1, 1, 1]], history=[{"step": "simulate", "model": model}])


def test_specular_and_edge_image_of_one_simulation_become_one_exhibit(tmp_path):
    files = [
        saved(tmp_path, "mug.edge.image.h5", simulated(1, "edge")),
        saved(tmp_path, "other.image.h5", image(3)),
        saved(tmp_path, "mug.specular.image.h5", simulated(2, "specular")),
    ]
    exhibits = gather(files, alpha=(3, 1)).exhibits
    assert [e.title for e in exhibits] == ["mug, specular + edge", "other"]
    assert exhibits[0].share == 0.25
    expected = ms.combine(simulated(2, "specular"), simulated(1, "edge"), (3, 1))
    assert np.abs(exhibits[0].levels.db - levels_of(GRID, expected.values).db).max() < 1e-4
    assert len(gather(files, combine=False).exhibits) == 3


def test_images_of_two_scenes_are_not_weighed_together(tmp_path):
    elsewhere = image(2, scene_bounds=[[0, 0, 0], [2, 1, 1]], history=[{"step": "simulate", "model": "specular"}])
    files = [saved(tmp_path, "a.h5", simulated(1, "edge")), saved(tmp_path, "b.h5", elsewhere)]
    assert [e.pair for e in gather(files).exhibits] == [None, None]


def test_what_is_around_goes_where_it_belongs(tmp_path):
    radar, path = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.02, 0.02), step=0.01)
    frames = np.zeros((len(path), 1, 1, 256), np.complex64)
    capture = ms.Capture(radar=radar, trajectory=path, frames=frames, metadata={"history": [{"step": "simulate"}]})
    made = image(1, history=[{"step": "simulate"}, {"step": "form_image"}])
    near, far = tmp_path / "near", tmp_path / "far"
    near.mkdir()
    far.mkdir()
    mask = ms.Mask(grid_xy=GRID.xy, inside=np.eye(7, 5) > 0)
    odd = ms.Mask(grid_xy=ms.PixelGrid(x=[0.0, 1.0], y=[0.0]), inside=[[True], [False]])
    files = [
        saved(near, "a.image.h5", made),
        saved(far, "b.image.h5", image(2)),
        saved(near, "a.capture.h5", capture),
        saved(near, "a.mask.h5", mask),
        saved(near, "odd.mask.h5", odd),
        saved(far, "scene.h5", ms.Scene.from_mesh("golf_ball", vertices=100)),
        saved(near, "a.volume.h5", ms.VolumeMask(grid=GRID, inside=np.ones(GRID.shape, bool))),
    ]
    found = gather(files)
    a, b = found.exhibits
    assert (len(a.paths), len(b.paths)) == (1, 0)
    assert (len(a.masks), len(b.masks)) == (1, 0)
    assert (len(a.meshes), len(b.meshes)) == (2, 2)  # the scene and the voxels' surface
    assert [note for note in found.notes if "odd.mask.h5" in note]


def test_the_published_layout_is_read(miniature):
    folder = miniature.healthy / MUG / "robot_collected" / "0_0_90" / "exp2"
    files = sorted(p for sight in ("los", "nlos") for p in (folder / sight / "processed/radars/77_ghz").iterdir())
    assert len(files) == 4
    exhibits = gather(files).exhibits
    assert [e.title for e in exhibits] == [f"mug, 0/0/90°, exp2, {sight}, 77 GHz" for sight in ("LOS", "NLOS")]
    assert [len(e.masks) for e in exhibits] == [1, 1]
    assert [path.shape[1] for e in exhibits for path in e.paths] == [3, 3]
    simulation = miniature.healthy / MUG / "simulation" / "0_0_0" / "processed" / "radars" / "77_ghz"
    (weighed,) = gather(sorted(simulation.iterdir())).exhibits
    assert weighed.title == "mug, simulated, 77 GHz"
    assert weighed.pair is not None


def test_an_image_that_is_0_everywhere_is_said_to_be_so(tmp_path):
    grid = ms.VoxelGrid.regular((0, 0, 0), (0.01, 0.01, 0.01), 0.005)
    ms.save(tmp_path / "dark.h5", ms.SarImage(grid=grid, values=np.zeros(grid.shape)))
    assert [note.split(":")[0] for note in gather([tmp_path / "dark.h5"]).notes] == ["dark is 0 everywhere"]


def test_a_mesh_alone_can_be_looked_at(tmp_path):
    mesh = ms.Scene.from_mesh("golf_ball", vertices=100).mesh
    (exhibit,) = gather([saved(tmp_path, "ball.h5", mesh)]).exhibits
    assert exhibit.levels is None
    assert np.array_equal(exhibit.bounds, mesh.bounds)


def test_a_mesh_file_stands_where_it_was_simulated(tmp_path):
    import trimesh

    trimesh.creation.box((40, 20, 10)).export(tmp_path / "box.stl")
    turned = image(placed={"unit": "mm", "rotate_deg": [0, 0, 90]})
    (exhibit,) = gather([saved(tmp_path, "a.h5", turned), tmp_path / "box.stl"]).exhibits
    assert exhibit.meshes[0].bounds == pytest.approx(np.array([[-0.01, -0.02, -0.005], [0.01, 0.02, 0.005]]))


def test_a_surface_and_a_mesh_that_were_placed_stay_there(tmp_path):
    """What was seen of an object is not its whole, so its middle is another; a pose is not applied twice."""
    import trimesh

    trimesh.creation.box((40, 20, 10)).export(tmp_path / "box.stl")
    scene = ms.Scene.from_mesh(tmp_path / "box.stl", unit="mm", vertices=None, rotate_deg=(0, 0, 30)).mesh
    seen = ms.TriangleMesh(vertices=scene.vertices + np.array([0, 0, 0.02]), faces=scene.faces[:4])
    write_mesh(tmp_path / "seen.ply", seen, sigma=np.zeros(len(seen.vertices)))
    write_mesh(tmp_path / "placed.ply", scene)
    turned = image(placed={"unit": "mm", "rotate_deg": [0, 0, 30]}, scene_bounds=scene.bounds.tolist())
    files = [tmp_path / name for name in ("seen.ply", "placed.ply", "box.stl")]
    (exhibit,) = gather([saved(tmp_path, "a.h5", turned), *files]).exhibits
    for mesh, expected in zip(exhibit.meshes, (seen, scene, scene), strict=True):
        assert mesh.bounds == pytest.approx(expected.bounds, abs=1e-6)


def test_a_large_image_is_read_in_slabs_and_said_to_be(tmp_path, monkeypatch):
    path = saved(tmp_path, "large.image.h5", image())
    monkeypatch.setattr("millisight.io._hdf5.load", None)  # not to be asked: it reads the whole
    monkeypatch.setattr(contents_module, "MOST_VOXELS", 30)
    found = gather([path])
    assert found.exhibits[0].levels.peak == pytest.approx(float(image().magnitude.max()))
    assert "7 x 5 x 3 voxels: read in slabs" in found.notes[0]


def test_a_large_damaged_image_is_said_to_be_so(tmp_path, monkeypatch):
    path = saved(tmp_path, "large.image.h5", image())
    with h5py.File(path) as file:
        place = file["values"].id.get_chunk_info(0).byte_offset
    with open(path, "r+b") as file:
        file.seek(place + 5)
        file.write(b"\xff\xff")
    monkeypatch.setattr(contents_module, "MOST_VOXELS", 30)
    with pytest.raises(DamagedFileError, match=r"large\.image\.h5 is damaged"):
        gather([path])


def test_an_image_without_values_is_damaged(tmp_path):
    path = saved(tmp_path, "empty.image.h5", image())
    with h5py.File(path, "r+") as file:
        del file["values"]
    with pytest.raises(DamagedFileError, match=r"empty\.image\.h5"):
        contents_module._hdf5_image(path)


def test_what_is_not_ours_is_refused(tmp_path, monkeypatch, miniature):
    text = tmp_path / "notes.txt"
    text.write_text("nothing")
    with pytest.raises(FormatError, match=r"notes\.txt cannot be shown"):
        gather([text])
    with pytest.raises(FormatError, match="holds a Radar"):
        gather([saved(tmp_path, "radar.h5", ms.Radar.preset("iwr1443"))])
    with pytest.raises(InputError, match="only masks"):
        gather([saved(tmp_path, "mask.h5", ms.Mask(grid_xy=GRID.xy, inside=np.ones((7, 5), bool)))])
    with pytest.raises(InputError, match="nothing to show"):
        gather([])
    with pytest.raises(InputError, match="alpha"):
        gather([text], alpha=(0, 0))
    large = next(miniature.healthy.rglob("processed_image.pkl"))
    monkeypatch.setattr(contents_module, "_LARGEST_PICKLE", 1000)
    with pytest.raises(FileError, match="millisight dataset convert"):
        gather([large])


# From Python --------------------------------------------------------------------------------------------------------


def test_records_are_gathered_as_their_files_are(tmp_path):
    radar, path = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.02, 0.02), step=0.01)
    capture = ms.Capture(radar=radar, trajectory=path, frames=np.zeros((9, 1, 1, 256), np.complex64))
    inside = np.zeros((7, 5), bool)
    inside[2:4, 1:3] = True
    mask, scene = ms.Mask(grid_xy=GRID.xy, inside=inside), ms.Scene.from_mesh("golf_ball", vertices=100)
    voxels = ms.VolumeMask(grid=GRID, inside=np.repeat(inside[..., None], 3, axis=2))
    records = [image(), mask, capture, scene, voxels, path]
    (exhibit,) = gather(records).exhibits
    files = [saved(tmp_path, f"{i}.h5", record) for i, record in enumerate(records)]
    (other,) = gather(files).exhibits
    assert exhibit.title == "SarImage 1"
    assert np.array_equal(exhibit.levels.db, other.levels.db)
    assert len(exhibit.masks) == len(other.masks) == 1
    assert len(exhibit.meshes) == len(other.meshes) == 2
    assert len(exhibit.paths) == len(other.paths) == 2
    (mixed,) = gather([files[0], mask, scene.objects[0]]).exhibits
    assert (mixed.title, len(mixed.masks), len(mixed.meshes)) == ("0", 1, 1)
    assert [e.title for e in gather([image(1), image(2)]).exhibits] == ["SarImage 1", "SarImage 2"]
    (pair,) = gather([simulated(1, "specular"), simulated(2, "edge")], alpha=(1, 3)).exhibits
    assert pair.share == 0.75
    (alone,) = gather([scene]).exhibits
    assert (alone.title, alone.levels) == ("Scene", None)


@pytest.mark.parametrize("wrong", [np.zeros((2, 2)), None, ms.Radar.preset("iwr1443"), GRID])
def test_what_has_no_place_in_the_viewer_is_refused(wrong):
    with pytest.raises(InputError, match=f"the viewer got {type(wrong).__name__}; expected SarImage, Mask"):
        gather([image(), wrong])


def test_view_serves_until_it_is_closed():
    pytest.importorskip("viser", reason="needs viser: make setup")
    viewer = ms.view(image(), browser=False, threshold_db=-3, slices=True)
    try:
        assert repr(viewer) == f"Viewer({viewer.url}, SarImage 1)"
        assert (viewer.settings.threshold_db, viewer.settings.slices) == (-3, True)
        assert urllib.request.urlopen(viewer.url, timeout=10).status == 200
    finally:
        url = viewer.url
        viewer.close()
    viewer.close()  # as often as one likes
    assert repr(viewer) == "Viewer(closed, SarImage 1)"
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(url, timeout=10)


def test_a_path_of_a_single_place_is_viewed():
    """The ticks of a box without extent were a division by zero."""
    path = ms.Trajectory(times=[0, 1, 2], positions=np.zeros((3, 3)))
    frames = np.ones((3, 1, 1, 256), np.complex64)
    capture = ms.Capture(radar=ms.Radar.preset("mito-sim-24ghz"), trajectory=path, frames=frames)
    with ms.view(capture, browser=False) as viewer:
        assert urllib.request.urlopen(viewer.url, timeout=10).status == 200


def test_a_view_that_blocks_waits_until_it_is_closed(monkeypatch, capsys):
    pytest.importorskip("viser", reason="needs viser: make setup")
    waited = []

    def interrupted(viewer):
        waited.append(urllib.request.urlopen(viewer.url, timeout=10).status)
        monkeypatch.setattr(viewer._wanted, "wait_for", _interrupt)
        return whole(viewer)

    def _interrupt(*_):
        raise KeyboardInterrupt

    whole = Viewer.wait
    monkeypatch.setattr(Viewer, "wait", interrupted)
    viewer = ms.view(image(), browser=False, block=True)
    assert waited == [200]
    assert repr(viewer).startswith("Viewer(closed")
    assert re.search(r"viewer: http://127\.0\.0\.1:\d+/[\w-]{22}, press Ctrl-C to stop", capsys.readouterr().err)


def test_another_thread_can_end_the_wait():
    pytest.importorskip("viser", reason="needs viser: make setup")
    with ms.view(image(), browser=False) as viewer:
        closing = threading.Timer(0.2, viewer.close)
        closing.start()
        viewer.wait()
        closing.join()
        assert "closed" in repr(viewer)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"treshold_db": -3}, "'treshold_db'"), ({"threshold_db": 3}, "above the maximum"), ({"alpha": (0, 0)}, "alpha")],
)
def test_a_view_refuses_what_it_cannot_set(settings, message):
    with pytest.raises((InputError, UnknownNameError), match=message):
        ms.view(image(), browser=False, **settings)


# What is drawn -------------------------------------------------------------------------------------------------------


def test_a_masks_outline_is_as_long_as_its_border():
    inside = np.zeros((7, 5), bool)
    inside[2:4, 1:4] = True
    outline = mask_borders(ms.Mask(grid_xy=GRID.xy, inside=inside))
    assert len(outline) == 2 * (2 + 3)
    assert np.linalg.norm(outline[:, 1] - outline[:, 0], axis=1) == pytest.approx(0.01)
    assert outline.reshape(-1, 2).min(axis=0) == pytest.approx([-0.015, 0.005])


def test_of_a_long_path_the_turns_are_kept():
    path = ms.Trajectory.raster(size=(0.1, 1.0), step=(0.01, 2e-5), serpentine=True).positions
    assert len(path) > 500_000
    lines = path_lines(path)
    assert len(lines) < 10_000
    assert np.abs(lines[:, :, 1]).max() == np.abs(path[:, 1]).max()
    flat = lines[np.abs(np.diff(lines[:, :, 0], axis=1)[:, 0]) > 1e-9]  # from row to row, along x alone
    assert len(flat) == 10
    assert np.abs(np.diff(flat[:, :, 1], axis=1)).max() < 1e-9


def test_the_box_reaches_to_the_voxels_ends():
    assert grid_box(GRID) == pytest.approx(np.array([[-0.035, -0.005, -0.225], [0.035, 0.045, -0.075]]))


# The server ----------------------------------------------------------------------------------------------------------


def test_a_taken_port_and_a_strange_host_are_said_to_be_so():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"cannot bind port {port} of 127.0.0.1"):
            start(port=port)
    with pytest.raises(InputError, match="expected an address of this machine"):
        start("no.such.host.invalid")


def test_only_its_own_page_is_answered():
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    server = start()
    try:
        port = server.get_port()

        own = url_of(server).replace("http:", "ws:")

        def told(address=own, **headers):
            """The first bytes that a page of that origin is sent."""
            with connect(address, subprotocols=[f"viser-v{viser.__version__}"], open_timeout=10, **headers) as socket:
                return socket.recv(timeout=10)

        assert told(origin=f"http://127.0.0.1:{port}")
        assert told()
        for origin in ("https://evil.example", "http://127.0.0.1:1", "null"):
            with pytest.raises(InvalidStatus, match="403"):
                told(origin=origin)
        for address in (f"ws://127.0.0.1:{port}/", f"{own}x", own[:-1], f"ws://127.0.0.1:{port}/x/{server.secret}"):
            with pytest.raises(InvalidStatus, match="403"):
                told(address)
        page = url_of(server)
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(f"{page}/{'x' * 3000}", timeout=10)
        named = urllib.request.Request(page, headers={"Host": f"evil.example:{port}"})
        for asked in (named, f"http://127.0.0.1:{port}/", f"http://127.0.0.1:{port}/{'x' * len(server.secret)}/"):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(asked, timeout=10)
        for asked in (page, f"{page}?threshold_db=-3"):
            with urllib.request.urlopen(asked, timeout=10) as answer:  # to the same with a slash
                assert answer.url == asked.replace(page, f"{page}/")
                assert b"Viser" in answer.read()
                assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
                assert answer.headers["Referrer-Policy"] == "no-referrer"
    finally:
        server.stop()


def test_a_message_that_no_page_sends_is_not_read_to_its_end(capfd, caplog):
    import viser
    from websockets.exceptions import ConnectionClosedError
    from websockets.sync.client import connect

    server = start()
    try:
        own = url_of(server).replace("http:", "ws:")

        def page():
            return connect(own, subprotocols=[f"viser-v{viser.__version__}"], open_timeout=10, max_size=None)

        with page() as socket:
            socket.recv(timeout=10)

            def told():
                socket.send(b"\xc1" * (51 << 20))
                return list(socket)

            with pytest.raises(ConnectionClosedError, match="1009"):
                told()
        with page() as socket:
            assert socket.recv(timeout=10)
            socket.send(b"\xc1")
            with pytest.raises(ConnectionClosedError, match="1011"):
                list(socket)
    finally:
        server.stop()
    assert "Traceback" not in "".join(capfd.readouterr()) + caplog.text


def test_other_servers_of_the_process_are_left_alone():
    """Those of websockets that start while the viewer runs, and their module."""
    from websockets.asyncio import server as sockets
    from websockets.sync.client import connect

    plain, viewer = sockets.serve, start()
    try:
        assert sockets.serve is plain

        async def greet(connection):
            await connection.send("hello")

        async def ask_elsewhere():
            async with sockets.serve(greet, "127.0.0.1", 0) as other:
                port = other.sockets[0].getsockname()[1]
                return await asyncio.to_thread(lambda: _first(f"ws://127.0.0.1:{port}/"))

        def _first(url):
            with connect(url, origin="https://evil.example") as socket:
                return socket.recv(timeout=10)

        assert asyncio.run(ask_elsewhere()) == "hello"
    finally:
        viewer.stop()


def answered(server, *pieces):
    """The first line of what the server answers to a request that comes in pieces; empty if it hangs up."""
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) as connection:
        for piece in pieces:
            connection.sendall(piece)
            time.sleep(0.05)
        try:
            return connection.makefile("rb").readline().decode().strip()
        except ConnectionResetError:
            return ""


def test_a_request_is_judged_by_its_whole_head(monkeypatch):
    monkeypatch.setattr(server_module, "_HEAD_SECONDS", 0.5)
    server = start()
    try:
        own = b"Host: 127.0.0.1:%d\r\n" % server.get_port()
        get = b"GET /%b/ HTTP/1.1\r\n" % server.secret.encode()
        assert answered(server, get[:7], get[7:] + own + b"\r", b"\n") == "HTTP/1.1 200 OK"
        evil = b"Origin: https://evil.example\r\n"
        assert answered(server, get + own, evil + b"\r\n") == "HTTP/1.1 403 Forbidden"
        twice = get + own + own + b"\r\n"
        assert answered(server, twice) == "HTTP/1.1 403 Forbidden"
        for target in (b"http://[/x", b"//[/x", b"*", b"", b"/", b"/../%b/" % server.secret.encode()):
            assert answered(server, b"GET " + target + b" HTTP/1.1\r\n" + own + b"\r\n") == "HTTP/1.1 403 Forbidden"
        assert answered(server, get + b"\r\n") == "HTTP/1.1 403 Forbidden"
        assert answered(server, get + b"X: " + (1 << 17) * b"x") in ("HTTP/1.1 403 Forbidden", "")
        assert answered(server, get) == ""  # it waits no longer
    finally:
        server.stop()


def test_a_viser_that_opens_its_own_port_is_refused(monkeypatch):
    import viser

    monkeypatch.setattr(server_module, "_guarded", lambda listener, host, secret: viser.ViserServer)
    with pytest.raises(DeviceError, match="is not known here"):
        start()


def test_where_no_files_may_be_opened_it_is_said_at_once():
    start().stop()  # so that all is imported
    for spare in (2, 6, 12):
        match = r"the viewer cannot start: .*; allow more open files"
        with files_to_open(spare), pytest.raises(DeviceError, match=match):
            start()


def test_connections_that_ask_nothing_are_not_held(monkeypatch):
    """The oldest of too many ends; the page's own is answered."""
    monkeypatch.setattr(server_module, "MOST_WAITING", 5)
    server = start()
    held = []
    try:
        held = [socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) for _ in range(9)]
        for one in held[:4]:
            with suppress(ConnectionResetError):
                assert one.recv(1) == b""
        own = b"GET /%b/ HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % (server.secret.encode(), server.get_port())
        assert answered(server, own) == "HTTP/1.1 200 OK"
        held[-1].settimeout(0.2)
        with pytest.raises(TimeoutError):
            held[-1].recv(1)
    finally:
        for one in held:
            one.close()
        server.stop()


def test_without_viser_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(DeviceError, match=r"pip install \"millisight\[viewer\]\""):
        start()


def test_a_change_draws_what_it_changes_and_nothing_else(tmp_path):
    found = gather([saved(tmp_path, "a.h5", simulated(1, "edge")), saved(tmp_path, "b.h5", simulated(2, "specular"))])
    server = start()
    try:
        settings = first_settings(found)
        grid = PaneGrid(server, found, settings)
        (pane,) = grid.panes
        before = dict(pane._nodes)
        grid.show(settings)
        assert all(pane._nodes[name] is nodes for name, nodes in before.items())
        grid.show(dataclasses.replace(settings, threshold_db=-3.0))
        changed = {name for name, nodes in before.items() if pane._nodes[name] is not nodes}
        assert changed == {"points"}
        assert pane.cloud.db.min() >= -3
        grid.show(dataclasses.replace(settings, slices=True, share=1.0))
        assert np.array_equal(pane.levels.db, levels_of(GRID, simulated(1, "edge").values).db)
        assert {node.name for node in pane._nodes["slices"]} >= {f"/pane0/slice_{axis}" for axis in "xyz"}
        grid.show(dataclasses.replace(settings, box=False))
        assert not any(node.visible for node in pane._nodes["box"])
    finally:
        server.stop()


@pytest.mark.slow
def test_the_page_about_it_is_right(tmp_path, monkeypatch, capsys):
    text = (Path(__file__).parents[2] / "docs" / "how-to" / "view.md").read_text(encoding="utf-8")
    known = set(re.findall(r"--[a-z-]+", CliRunner().invoke(app, ["view", "--help"]).output))
    named = set(re.findall(r"--[a-z-]+", " ".join(re.findall(r"millisight view.*|`--.*?`", text))))
    assert len(named) >= 6
    assert named <= known
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 2
    radar, path = ms.Radar.preset("mito-sim-24ghz"), ms.Trajectory.raster(size=(0.02, 0.02), step=0.01)
    saved(tmp_path, "mug.image.h5", image())
    frames = np.zeros((len(path), 1, 1, 256), np.complex64)
    saved(tmp_path, "mug.capture.h5", ms.Capture(radar=radar, trajectory=path, frames=frames))
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        exec(block, {})
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")
    assert (tmp_path / "mug.html").stat().st_size > 500_000
