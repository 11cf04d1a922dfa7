"""The paper's figures: what they show is read back from their own artists."""

import io

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

import millisight as ms
from millisight import viz
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import Picture, Prompts
from millisight.evaluation import Table
from millisight.perception import project

GRID = ms.VoxelGrid.regular((0.0, 0.1, -0.2), (0.10, 0.16, -0.18), 0.01)
HEIGHT, WIDTH = 48, 64


def image(seed=0, grid=GRID):
    values = np.random.default_rng(seed).normal(size=(*grid.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    return ms.SarImage(grid=grid, values=values)


def photo(seed=0):
    return np.random.default_rng(seed).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def tetrahedron():
    vertices = np.array([[0.02, 0.11, -0.2], [0.08, 0.11, -0.2], [0.05, 0.15, -0.2], [0.05, 0.12, -0.18]])
    return ms.TriangleMesh(vertices=vertices, faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))


def shown(axes) -> np.ndarray:
    """What a panel's one picture shows."""
    (picture,) = (artist for artist in axes.get_images() if isinstance(artist, AxesImage))
    return picture.get_array()


def projected(of) -> np.ndarray:
    return (of.project("z") / of.project("z").max()).T


FIGURES = {
    "samples": (lambda **k: viz.plot_samples({"mug": {"camera": photo(), "77 GHz": image()}}, **k), 2),
    "multispectral": (lambda **k: viz.plot_multispectral({"77": image()}, {"77": image(1)}, **k), 2),
    "simulation": (lambda **k: viz.plot_simulation(tetrahedron(), image(), image(1), **k), 5),
    "hidden": (lambda **k: viz.plot_hidden(photo(), photo(1), image(), **k), 3),
    "segmentation": (lambda **k: viz.plot_segmentation_steps(project(image()), PROMPTS, inside(), **k), 3),
    "depth holes": (lambda **k: viz.plot_depth_holes(frame(), image(), inside(), **k), 4),
    "reflections": (lambda **k: viz.plot_reflection_principle(**k), 3),
}


class TestEveryFigure:
    @pytest.mark.parametrize("name", FIGURES)
    def test_draws_into_the_axes_that_it_is_given_and_returns_them(self, name):
        plot, count = FIGURES[name]
        mine = Figure().subplots(1, count)
        returned = plot(axes=mine)
        assert list(np.ravel(returned)) == list(mine)
        assert all(axes.has_data() for axes in mine)
        with pytest.raises(InputError, match=f"expected {count} Matplotlib Axes"):
            plot(axes=mine[:-1])
        with pytest.raises(InputError, match="Matplotlib Axes"):
            plot(axes=["no axes"] * count)

    @pytest.mark.parametrize("name", FIGURES)
    def test_makes_a_figure_of_its_own_that_is_written_as_vectors_with_letters_as_text_or_paths(self, name, tmp_path):
        plot, count = FIGURES[name]
        figure = np.ravel(plot())[0].figure
        assert len(figure.axes) == count
        viz.save_figure(figure, tmp_path / "figure.svg")
        assert "<path" in (tmp_path / "figure.svg").read_text()

    @pytest.mark.parametrize("name", FIGURES)
    def test_nothing_leaves_the_figure(self, name):
        figure = np.ravel(FIGURES[name][0]())[0].figure
        figure.draw_without_rendering()
        boxes = [axes.get_tightbbox() for axes in figure.axes]
        assert len(boxes) >= 2
        for box in boxes:
            assert box.x0 >= -1
            assert box.y0 >= -1
            assert box.x1 <= figure.bbox.width + 1
            assert box.y1 <= figure.bbox.height + 1


class TestSamples:
    def test_a_row_an_object_a_column_a_kind_and_an_empty_place_for_what_is_not_there(self):
        samples = {"mug": {"camera": photo(), "LOS": image()}, "adjustable_wrench": {"LOS": image(1), "NLOS": None}}
        axes = viz.plot_samples(samples)
        assert axes.shape == (2, 3)
        assert [a.get_title() for a in axes[0]] == ["camera", "LOS", "NLOS"]
        np.testing.assert_array_equal(shown(axes[0, 0]), photo())
        np.testing.assert_array_equal(shown(axes[0, 1]), projected(image()))
        np.testing.assert_array_equal(shown(axes[1, 1]), projected(image(1)))
        assert [a.axison for a in axes.ravel()] == [True, True, False, False, True, False]
        assert [a.texts[0].get_text() for a in axes[:, 0]] == ["mug", "adjustable\nwrench"]

    def test_nothing_to_show_is_refused(self):
        for samples in ({}, {"mug": {}}):
            with pytest.raises(InputError, match="no picture"):
                viz.plot_samples(samples)
        with pytest.raises(InputError, match="photo"):
            viz.plot_samples({"mug": {"camera": photo()[..., 0]}})

    @pytest.mark.parametrize(("width", "label"), [(0.1, "2 cm"), (0.5, "20 cm"), (0.012, "5 mm")])
    def test_the_scale_bar_is_as_long_as_it_says(self, width, label):
        grid = ms.VoxelGrid.regular((0, 0, 0), (width, width, 0), width / 4)
        (axes,) = viz.plot_multispectral({"77 GHz": image(grid=grid)}, {})
        (bar,) = axes.lines
        amount, unit = label.split()
        assert axes.texts[0].get_text() == label
        assert np.ptp(bar.get_xdata()) == pytest.approx(float(amount) * {"cm": 1e-2, "mm": 1e-3}[unit])


class TestMultispectral:
    def test_bands_in_sight_come_before_hidden_ones(self):
        axes = viz.plot_multispectral({"77 GHz": image(0), "24 GHz": image(1)}, {"77 GHz": image(2)}, colormap="jet")
        assert [a.get_title() for a in axes] == ["a) 77 GHz, LOS", "b) 24 GHz, LOS", "c) 77 GHz, NLOS"]
        for seed, panel in enumerate(axes):
            np.testing.assert_array_equal(shown(panel), projected(image(seed)))
            assert panel.get_images()[0].get_cmap().name == "jet"

    def test_decibels_end_at_the_floor(self):
        (axes,) = viz.plot_multispectral({"77 GHz": image()}, {}, scale="db", dynamic_range_db=5)
        np.testing.assert_allclose(shown(axes), np.maximum(20 * np.log10(projected(image())), -5), atol=1e-4)
        with pytest.raises(UnknownNameError, match="scale"):
            viz.plot_multispectral({"77 GHz": image()}, {}, scale="log")

    def test_no_image_is_refused(self):
        with pytest.raises(InputError, match="neither"):
            viz.plot_multispectral({}, {})


class TestSimulation:
    def test_the_sums_are_those_of_combine(self):
        axes = viz.plot_simulation(tetrahedron(), image(0), image(1), alphas=[(1, 3)])
        titles = ["a) mesh", "b) specular", "c) edge", "d) 1 specular, 3 edge"]
        assert [a.get_title() for a in axes] == titles
        for panel, of in zip(axes[1:], (image(0), image(1), ms.combine(image(0), image(1), (1, 3))), strict=True):
            np.testing.assert_array_equal(shown(panel), projected(of))
        assert axes[0].get_xlim() == axes[1].get_xlim()

    def test_images_that_do_not_belong_together_are_refused(self):
        other = image(1, ms.VoxelGrid.regular((0, 0, 0), (0.1, 0.1, 0), 0.01))
        with pytest.raises(InputError, match="grid"):
            viz.plot_simulation(tetrahedron(), image(0), other)


class TestHidden:
    def test_two_photos_and_what_the_radar_sees_with_the_outline_of_what_is_inside(self):
        seen, shut, through = viz.plot_hidden(photo(), photo(1), image(), mesh=tetrahedron())
        for axes, expected in ((seen, photo()), (shut, photo(1)), (through, projected(image()))):
            np.testing.assert_array_equal(shown(axes), expected)
        (outline,) = through.collections
        (curve,) = outline.get_segments()
        np.testing.assert_allclose([curve.min(axis=0), curve.max(axis=0)], [[0.02, 0.11], [0.08, 0.15]], atol=2e-4)


class TestMesh:
    @pytest.mark.parametrize(("axis", "faces"), [("z", 3), ("y", 1), ("x", 1)])
    def test_only_faces_towards_the_viewer_are_drawn(self, axis, faces):
        solid = viz.draw_mesh(Figure().add_subplot(), tetrahedron(), axis)
        assert isinstance(solid, PolyCollection)
        assert len(solid.get_paths()) == faces

    def test_nearer_faces_come_over_farther_ones(self):
        low, high = tetrahedron(), tetrahedron().moved(translation=np.array([0, 0, 0.1]))
        both = ms.TriangleMesh(
            vertices=np.concatenate([high.vertices, low.vertices]), faces=np.concatenate([high.faces, low.faces + 4])
        )
        axes = Figure().add_subplot()
        drawn = viz.draw_mesh(axes, both, "z").get_paths()
        alone = viz.draw_mesh(axes, low, "z").get_paths()
        assert len(drawn) == 6
        for i in range(3):  # seen from above both look alike; the lower one's faces must come first
            np.testing.assert_allclose(drawn[i].vertices, alone[i].vertices)

    def test_unknown_axis(self):
        with pytest.raises(UnknownNameError, match="axis"):
            viz.draw_mesh(Figure().add_subplot(), tetrahedron(), "w")


class TestAperturePrinciple:
    def test_all_positions_focus_at_the_reflectors_and_one_does_not(self):
        sketch, one, every = viz.plot_aperture_principle(aperture=0.12)
        assert sketch.get_title() == "a) distances from four positions"
        assert every.get_title() == "c) image of 125 positions"
        x, z = (np.asarray(values) for values in one.lines[0].get_data())  # the reflectors are marked
        assert len(x) == 3
        contrast = []
        for axes in (one, every):
            picture = axes.get_images()[0]
            left, right, low, high = picture.get_extent()
            values = np.asarray(picture.get_array())
            column = ((x - left) / (right - left) * values.shape[1]).astype(int)
            row = ((z - low) / (high - low) * values.shape[0]).astype(int)
            contrast.append(values[row, column].mean() / np.median(values))
        assert contrast[0] < 3
        assert contrast[1] > 15

    def test_an_aperture_of_no_length_is_refused(self):
        with pytest.raises(InputError, match="aperture"):
            viz.plot_aperture_principle(aperture=0)


class TestReflectionPrinciple:
    def test_light_goes_everywhere_and_waves_are_mirrored(self):
        light, waves, edge = viz.plot_reflection_principle()
        arrows = [[text for text in axes.texts if getattr(text, "arrow_patch", None)] for axes in (light, waves, edge)]
        assert [len(found) for found in arrows] == [10, 2, 10]
        incoming, outgoing = (np.subtract(arrow.xy, arrow.xyann) for arrow in arrows[1])
        np.testing.assert_allclose(outgoing, incoming * [1, -1], atol=0.02)
        assert waves.get_title() == "b) millimetre waves: specular"


PROMPTS = Prompts(points=np.array([[5, 3], [2, 1], [9, 6]]), positive=np.array([True, True, False]))


def inside():
    found = np.zeros(GRID.xy.shape, bool)
    found[3:7, 2:5] = True
    return found


class TestSegmentation:
    def test_pictures_are_drawn_with_x_to_the_right_and_y_up(self):
        picture = project(image())
        axes = viz.plot_segmentation_steps(picture, PROMPTS, ms.Mask(grid_xy=GRID.xy, inside=inside()))
        assert [a.get_title() for a in axes] == ["a) colours", "b) prompts", "c) mask"]
        np.testing.assert_array_equal(axes[0].collections[0].get_array(), picture.rgb.transpose(1, 0, 2))
        darkened = axes[2].collections[0].get_array()
        np.testing.assert_array_equal(darkened[inside().T], picture.rgb.transpose(1, 0, 2)[inside().T])
        assert (darkened[~inside().T] <= 0.36 * picture.rgb.transpose(1, 0, 2)[~inside().T]).all()

    def test_prompts_stand_at_their_pixels(self):
        axes = viz.plot_segmentation_steps(project(image()), PROMPTS, inside())[1]
        lines = {line.get_marker(): np.transpose(line.get_data()) for line in axes.lines if line.get_marker() in "ox"}
        places = np.column_stack([GRID.x[PROMPTS.points[:, 0]], GRID.y[PROMPTS.points[:, 1]]])
        np.testing.assert_allclose(lines["o"], places[:2])
        np.testing.assert_allclose(lines["x"], places[2:])

    def test_of_a_photo_rows_run_down(self):
        found = np.zeros((HEIGHT, WIDTH), bool)
        found[10:20, 30:50] = True
        axes = viz.plot_segmentation_steps(Picture(rgb=photo()), PROMPTS, found, truth=~found)
        np.testing.assert_array_equal(shown(axes[0]), photo())
        np.testing.assert_allclose(np.transpose(axes[1].lines[0].get_data()), PROMPTS.points[:2, ::-1])
        assert axes[0].yaxis_inverted()
        outlines = [c.get_linestyle()[0][1] for c in axes[2].collections]
        assert len(outlines) == 2
        assert outlines[0] is None
        assert outlines[1] is not None

    def test_a_mask_or_prompts_of_another_size_are_refused(self):
        with pytest.raises(InputError, match="mask"):
            viz.plot_segmentation_steps(project(image()), PROMPTS, inside()[:-1])
        beyond = Prompts(points=np.array([[99, 0]]), positive=np.array([True]))
        with pytest.raises(InputError, match="prompts"):
            viz.plot_segmentation_steps(project(image()), beyond, inside())


def frame():
    depth = np.full((HEIGHT, WIDTH), 900, np.uint16)
    depth[20:30, 20:40] = 400
    depth[20:25, 20:40] = 0
    intrinsics = ms.Intrinsics(fx=60, fy=60, cx=32, cy=24, width=WIDTH, height=HEIGHT)
    return ms.CameraFrame(rgb=photo(), depth=depth, pose=np.eye(4), intrinsics=intrinsics)


class TestDepthHoles:
    def test_photo_and_depth_are_cut_to_the_object_and_holes_are_counted(self):
        pixels = np.zeros((HEIGHT, WIDTH), bool)
        pixels[20:30, 20:40] = True
        seen, depth, radar, found = viz.plot_depth_holes(frame(), image(), inside(), pixels=pixels)
        np.testing.assert_array_equal(shown(seen), photo()[8:42, 8:52])
        assert depth.get_title() == "b) depth: 50% missing"
        holes, metres = (picture.get_array() for picture in depth.get_images())
        np.testing.assert_array_equal(holes, frame().depth[8:42, 8:52] == 0)
        assert np.nanmin(metres) == pytest.approx(0.4)
        assert depth.get_images()[1].get_clim() == pytest.approx((0.38, 0.42))
        for panel in (radar, found):
            np.testing.assert_array_equal(shown(panel), projected(image()))
        assert len(found.collections) == 2

    def test_a_frame_without_any_depth(self):
        blank = ms.CameraFrame(
            rgb=photo(), depth=np.zeros((HEIGHT, WIDTH)), pose=np.eye(4), intrinsics=frame().intrinsics
        )
        depth = viz.plot_depth_holes(blank, image(), np.zeros_like(inside()))[1]
        assert depth.get_images()[0].get_array().all()

    def test_shapes_that_do_not_fit_are_refused(self):
        with pytest.raises(InputError, match="pixels"):
            viz.plot_depth_holes(frame(), image(), inside(), pixels=np.ones((3, 3), bool))
        with pytest.raises(InputError, match="mask"):
            viz.plot_depth_holes(frame(), image(), inside().T)


class TestCutOut:
    def test_all_but_the_object_is_white(self):
        pixels = np.zeros((HEIGHT, WIDTH), bool)
        pixels[20:22, 30:32] = True
        cut = viz.cut_out(photo(), pixels)
        assert cut.shape == (26, 26, 3)
        np.testing.assert_array_equal(cut[12:14, 12:14], photo()[20:22, 30:32])
        assert (cut != 255).any(axis=-1).sum() == 4

    def test_no_object_is_refused(self):
        with pytest.raises(InputError, match="all False"):
            viz.cut_out(photo(), np.zeros((HEIGHT, WIDTH), bool))


class TestTable:
    TABLE = Table(
        title="Accuracy", columns=("input", "LOS", "NLOS"), notes=("Median.",),
        rows=(("camera", 99.7, 3.6), ("77 GHz", 98.25, None), ("24 GHz", 57.9, 53.0)),
    )  # fmt: skip

    def test_every_cell_is_written_and_the_largest_of_a_column_is_bold(self):
        axes = viz.plot_table(self.TABLE)
        assert axes.get_title() == "Accuracy"
        texts = {text.get_text(): text for text in axes.texts}
        assert len(axes.texts) == 13
        assert set(texts) == {
            "input", "LOS", "NLOS", "camera", "99.7", "3.6", "77 GHz", "98.25", "–", "24 GHz", "57.9", "53", "Median.",
        }  # fmt: skip
        bold = {name for name, text in texts.items() if text.get_weight() == "bold"}
        assert bold == {"input", "LOS", "NLOS", "99.7", "53"}
        assert {texts[name].get_ha() for name in ("camera", "input")} == {"left"}
        assert {texts[name].get_ha() for name in ("99.7", "–")} == {"right"}

    def test_nothing_is_bold_but_the_columns_names_where_less_is_better(self):
        axes = viz.plot_table(self.TABLE, bold_largest=False)
        assert {t.get_text() for t in axes.texts if t.get_weight() == "bold"} == {"input", "LOS", "NLOS"}

    def test_columns_do_not_run_into_each_other(self):
        axes = viz.plot_table(self.TABLE)
        axes.figure.savefig(io.BytesIO(), format="png")
        boxes = [text.get_window_extent() for text in axes.texts]
        assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])

    def test_into_given_axes(self):
        mine = Figure().add_subplot()
        assert viz.plot_table(self.TABLE, axes=mine) is mine
        assert mine.texts
