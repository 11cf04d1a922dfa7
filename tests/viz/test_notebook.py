"""What a notebook shows of records: figures by `plot`, cards with a picture and facts."""

import base64
import io
import re

import h5py
import numpy as np
import pytest
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from PIL import Image

import millisight as ms
from millisight import viz
from millisight.core.errors import InputError

GRID = ms.VoxelGrid.regular((-0.04, 0.0, 0.0), (0.04, 0.04, 0.02), 0.01)
RADAR = ms.Radar.preset("mito-sim-24ghz")
TONE = ms.Radar(name="tone", waveform=ms.Waveform.stepped(24e9, 0.0, 1), array=ms.AntennaArray.monostatic())


def image(bright=(7, 1, 1)):
    """One voxel is 1, all others 0."""
    values = np.zeros(GRID.shape, np.complex64)
    values[bright] = 1
    return ms.SarImage(grid=GRID, values=values, metadata={"history": [{"step": "form_image", "method": "<exact>"}]})


def capture(radar=RADAR):
    path = ms.Trajectory.raster(size=(0.04, 0.02), step=0.01)
    rng = np.random.default_rng(0)
    shape = (len(path), 1, 1, radar.waveform.samples_per_chirp)
    return ms.Capture(radar=radar, trajectory=path, frames=rng.normal(size=shape).astype(np.complex64))


def wedge():
    """Highest along its left edge, where x is 0; twice as long along x as along y."""
    vertices = [[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0], [0, 0.1, 0], [0, 0, 0.05], [0, 0.1, 0.05]]
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 5], [1, 5, 4], [2, 3, 5], [0, 4, 5], [0, 5, 3]]
    return ms.TriangleMesh(vertices=np.array(vertices), faces=np.array(faces))


def thumbnail(card):
    """(rows, columns, 3) of the picture in a card."""
    held = base64.b64decode(re.search(r"data:image/png;base64,([^\"]+)", card)[1])
    return np.asarray(Image.open(io.BytesIO(held)))


class TestPlots:
    def test_each_record_draws_itself(self):
        scene = ms.Scene.from_mesh("golf_ball", vertices=100)
        mask = ms.Mask(grid_xy=GRID.xy, inside=np.eye(9, 5) > 0)
        for record in (image(), capture(), wedge(), scene, mask):
            figure = record.plot(title="mine")
            assert isinstance(figure, Figure)
            texts = [*figure.texts, *(axes.title for axes in figure.axes), *filter(None, [figure._suptitle])]
            assert "mine" in [text.get_text() for text in texts]

    def test_a_notebook_shows_figures_whatever_its_backend(self):
        shown = Image.open(io.BytesIO(image().plot()._repr_png_()))
        assert shown.format == "PNG"
        assert np.ptp(np.asarray(shown.convert("L"))) > 200

    def test_a_capture_shows_positions_and_profiles(self):
        where, what, _, order = capture().plot().axes
        (dots,) = where.collections
        np.testing.assert_allclose(dots.get_offsets(), capture().trajectory.positions[:, :2])
        (picture,) = what.get_images()
        assert picture.get_array().shape[0] == len(capture().trajectory)
        assert picture.get_array().max() == 0
        assert (what.get_xlabel(), what.get_ylabel()) == ("range [m]", "pose")
        assert order.get_title() == "pose"

    def test_a_radar_of_one_frequency_shows_amplitudes(self):
        _, what, _ = capture(TONE).plot().axes
        numbers, amplitude = what.lines[0].get_data()
        np.testing.assert_array_equal(numbers, np.arange(15))
        np.testing.assert_allclose(amplitude, np.abs(capture(TONE).frames[:, 0, 0, 0]), rtol=1e-6)

    def test_a_mesh_is_seen_from_three_sides(self):
        figure = wedge().plot()
        assert [axes.get_title()[:7] for axes in figure.axes] == ["along z", "along y", "along x"]
        # From above the slope and no floor; from the front one side; from the right the slope, for the wall is behind.
        assert [len(_solid(axes).get_paths()) for axes in figure.axes] == [2, 1, 2]
        for axes in figure.axes:
            points = np.concatenate([path.vertices for path in _solid(axes).get_paths()])
            low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
            assert (points >= low).all()
            assert (points <= high).all()

    def test_objects_of_a_scene_differ_and_are_named(self):
        ball = ms.Scene.from_mesh("golf_ball", vertices=100)
        figure = (ball + ms.Scene.from_mesh("mug", vertices=200).moved((0.2, 0, 0))).plot()
        legend = figure.axes[0].get_legend()
        assert [text.get_text().partition(",")[0] for text in legend.get_texts()] == ["golf_ball", "mug"]
        solid = _solid(figure.axes[0])
        left = np.array([path.vertices[:, 0].mean() < 0.1 for path in solid.get_paths()])
        hues = solid.get_facecolor()[:, :3] / solid.get_facecolor()[:, :3].max(axis=1, keepdims=True)
        for side, patch in zip((left, ~left), legend.get_patches(), strict=True):
            wanted = np.array(patch.get_facecolor()[:3])
            np.testing.assert_allclose(hues[side], np.broadcast_to(wanted / wanted.max(), hues[side].shape), atol=1e-6)

    def test_a_mask_is_drawn_at_its_place(self):
        inside = np.zeros((9, 5), bool)
        inside[7, 1] = True
        (axes,) = ms.Mask(grid_xy=GRID.xy, inside=inside).plot().axes
        (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
        j, i = np.argwhere(mesh.get_array())[0]
        np.testing.assert_allclose(mesh.get_coordinates()[j : j + 2, i : i + 2].mean(axis=(0, 1)), (0.03, 0.01))
        assert axes.get_title() == "mask: 2.2 % of the picture"

    def test_a_mask_is_outlined_over_its_image(self):
        inside = np.zeros((9, 5), bool)
        inside[6:8, 1:3] = True
        mask = ms.Mask(grid_xy=GRID.xy, inside=inside)
        (axes,) = mask.plot(image=image()).axes
        (line,) = [c for c in axes.collections if isinstance(c, ContourSet)]
        x, y = np.concatenate([path.vertices for path in line.get_paths()]).T
        assert (GRID.x[5] < x).all()
        assert (x < GRID.x[8]).all()
        assert (y < GRID.y[3]).all()
        with pytest.raises(InputError, match="different pixels, along x"):
            mask.plot(image=ms.SarImage.from_array(np.ones((3, 5, 2)), 0.01))


def _solid(axes):
    (solid,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    return solid


class TestCards:
    def test_an_image_has_its_bright_voxel_at_its_place_and_facts(self):
        card = image()._repr_html_()
        picture = thumbnail(card).astype(int).sum(axis=2)
        rows, columns = np.nonzero(picture == picture.max())
        assert picture.shape == (133, 240)
        # Pixel 7 of 9 from the left, 1 of 5 from below.
        assert np.mean(columns) / 240 == pytest.approx(7.5 / 9, abs=0.01)
        assert np.mean(rows) / 133 == pytest.approx(1 - 1.5 / 5, abs=0.01)
        for fact in ("SarImage, 9 x 5 x 3 voxels", "1 at 0.0300, 0.0100, 0.0100 m", "form_image(method=&lt;exact&gt;)"):
            assert fact in card

    def test_an_empty_image_has_a_card(self):
        grid = ms.VoxelGrid.regular((0, 0, 0), (0, 0, 0), 0.01)
        for values in (np.zeros(GRID.shape), np.zeros((1, 1, 1))):
            empty = ms.SarImage(grid=GRID if values.size > 1 else grid, values=values)
            assert np.ptp(thumbnail(empty._repr_html_()).reshape(-1, 3), axis=0).max() == 0

    def test_a_capture_has_profiles_and_facts(self):
        card = capture()._repr_html_()
        assert np.ptp(thumbnail(card)[..., 0]) > 50
        assert "Capture, 15 channels = 15 poses x 1 TX x 1 RX, 256 samples" in card
        assert "mito-sim-24ghz" in card

    def test_without_data_the_facts_are_left(self, tmp_path):
        whole = capture()
        with h5py.File(tmp_path / "c.h5", "w") as file:
            on_disk = ms.Capture(
                radar=whole.radar, trajectory=whole.trajectory, frames=file.create_dataset("frames", data=whole.frames)
            )
            np.testing.assert_array_equal(thumbnail(on_disk._repr_html_()), thumbnail(whole._repr_html_()))
        for record in (on_disk, capture(TONE)):
            card = record._repr_html_()
            assert "<img" not in card
            assert "15 poses" in card
        with pytest.raises(InputError, match="was closed"):
            on_disk.plot()

    def test_a_mesh_is_lit_and_stands_on_white(self):
        card = wedge()._repr_html_()
        picture = thumbnail(card)
        assert picture.shape == (120, 240, 3)
        assert len(np.unique(picture[10:-10, 10:-10])) == 1  # one slope, evenly lit
        assert picture[60, 120, 0] < 255
        assert "TriangleMesh, 6 vertices, 8 faces" in card
        ball = ms.Scene.from_mesh("golf_ball", vertices=2000).mesh
        seen = thumbnail(ball._repr_html_())
        assert (seen[[0, 0, -1, -1], [0, -1, 0, -1]] == 255).all()
        assert seen[60, 60, 0] > seen[-60, -60, 0] + 30  # the light comes from the upper left

    def test_a_mask_is_drawn_at_its_place_with_facts(self):
        inside = np.zeros((9, 5), bool)
        inside[7, 1] = True
        card = ms.Mask(grid_xy=GRID.xy, inside=inside)._repr_html_()
        rows, columns = np.nonzero(thumbnail(card)[..., 0] == 255)
        assert np.mean(columns) / 240 == pytest.approx(7.5 / 9, abs=0.01)
        assert np.mean(rows) / 133 == pytest.approx(1 - 1.5 / 5, abs=0.01)
        for fact in ("Mask, 9 x 5 pixels", "x -0.04 to 0.04 m, y 0 to 0.04 m", "1 pixels, 2.2 %"):
            assert fact in card

    def test_cards_ask_the_network_for_nothing(self):
        mask = ms.Mask(grid_xy=GRID.xy, inside=np.eye(9, 5) > 0)
        for record in (image(), capture(), wedge(), mask):
            card = record._repr_html_()
            assert re.findall(r'src="([^":]*:)', card) == ["data:"]
            assert not re.search(r"https?:|href|url\(|<script|<link", card)

    @pytest.mark.slow
    def test_large_records_are_looked_at_in_part(self):
        """Every second voxel along x and y of 36 million, and no peak."""
        large = ms.VoxelGrid(x=np.arange(300.0), y=np.arange(300.0), z=np.arange(400.0))
        values = np.zeros(large.shape, np.complex64)
        values[:150] = 1
        card = ms.SarImage(grid=large, values=values)._repr_html_()
        assert "peak" not in card
        picture = thumbnail(card).astype(int).sum(axis=2)
        assert (picture[:, :115].min() > picture[:, 125:].max()) or (picture[:, :115].max() < picture[:, 125:].min())


def test_facts_of_other_records_are_their_kind():
    assert viz.facts_of(RADAR) == [("record", "Radar")]


def test_facts_of_what_was_found_tell_how_much():
    labels = np.zeros(GRID.xy.shape, np.int32)
    labels[:3, 0], labels[5:7, 2] = 1, 2
    found = ms.Instances(grid_xy=GRID.xy, labels=labels, scores=[20.0, 10.0])
    assert dict(viz.facts_of(found))["objects"] == "2, of 3, 2 pixels"
    assert dict(viz.facts_of(ms.Instances(grid_xy=GRID.xy, labels=0 * labels, scores=[])))["objects"] == "0"
    voxels = ms.VolumeMask(grid=GRID, inside=np.arange(GRID.size).reshape(GRID.shape) < 27)
    assert dict(viz.facts_of(voxels))["inside"] == "27 voxels, 20.0 %"
    points = np.array([[0.0, 0.0, 0.1], [0.2, 0.0, 0.0]])
    cloud = ms.PointCloud(points=points, normals=[[0, 0, 1]] * 2, place_sigma=[1, 1], normal_sigma_deg=[1, 1])
    assert viz.facts_of(cloud)[0] == ("record", "PointCloud, 2 points")
    assert "z 0 to 0.1 m" in dict(viz.facts_of(cloud))["box"]
    surface = ms.Surface(mesh=wedge(), sigma=np.zeros(6))
    assert viz.facts_of(surface)[0][1].startswith("Surface, 6 vertices, ")
