"""Figures: what they show is read back from the figures' own artists."""

import itertools
import subprocess
import sys

import h5py
import numpy as np
import pytest
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.figure import Figure

import millisight as ms
from millisight import viz
from millisight.core.errors import FileError, InputError, UnknownNameError
from millisight.viz._outline import cross_section, outline_of

SPACING = 0.005
GRID = ms.VoxelGrid.regular((-0.05, -0.08, 0.0), (0.05, 0.08, 0.03), SPACING)
PLANES = {"z": "xy", "y": "xz", "x": "yz"}
BOX_SIZE = np.array([0.06, 0.10, 0.02])


def box(size=BOX_SIZE, middle=(0.0, 0.0, 0.01)):
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return ms.TriangleMesh(vertices=signs * np.asarray(size) / 2 + middle, faces=np.array(faces))


def image(grid=GRID, *, zero=False):
    values = np.random.default_rng(0).normal(size=(*grid.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
    return ms.SarImage(grid=grid, values=0 * values if zero else values)


def capture(*, path_offset=0.15, poses=30, reflector=(0.0, 0.0, 0.0), amplitude=1.0, receivers=2):
    """A point reflector's answers, by primer (3)."""
    waveform = ms.Waveform(start_frequency=77.5e9, slope=3e9 / 64, sample_rate=1.0, samples_per_chirp=64)
    rx = np.zeros((receivers, 3))
    rx[:, 0] = 0.002 * np.arange(receivers)
    array = ms.AntennaArray(tx_positions=np.zeros((1, 3)), rx_positions=rx)
    radar = ms.Radar(name="test", waveform=waveform, array=array, path_offset=path_offset)
    positions = np.column_stack([np.linspace(-0.05, 0.05, poses), np.zeros(poses), np.full(poses, 0.5)])
    trajectory = ms.Trajectory(times=np.arange(poses), positions=positions)
    tx = np.linalg.norm(trajectory.placed(array.tx_positions) - reflector, axis=-1)
    paths = tx[:, :, None] + np.linalg.norm(trajectory.placed(rx) - reflector, axis=-1)[:, None] + path_offset
    frames = amplitude * np.exp(-2j * np.pi * waveform.frequencies * paths[..., None] / 299_792_458)
    return ms.Capture(radar=radar, trajectory=trajectory, frames=frames.astype(np.complex64))


def panels(figure):
    """The axes that show something in metres."""
    return [axes for axes in figure.axes if axes.get_xlabel().endswith("[m]")]


def bar_labels(figure):
    return [axes.get_ylabel() for axes in figure.axes if not axes.get_xlabel().endswith("[m]") and not axes.lines]


class TestProjections:
    def test_every_panel_shows_the_projection_over_its_maximum(self):
        figure = viz.plot_image(image(), colormap=("jet", None))
        shown = panels(figure)
        assert len(shown) == 6
        for axes, axis in zip(shown, "zyxzyx", strict=True):
            (picture,) = axes.get_images()
            projection = image().project(axis)
            np.testing.assert_array_equal(picture.get_array(), (projection / projection.max()).T)
            assert picture.origin == "lower"
            assert (axes.get_xlabel(), axes.get_ylabel()) == tuple(f"{name} [m]" for name in PLANES[axis])
            assert axes.get_aspect() == 1
            assert f"along {axis}" in axes.get_title()
        assert [axes.get_images()[0].get_cmap().name for axes in shown[::3]] == ["jet", "inferno"]
        assert bar_labels(figure) == ["mean |I| / max"] * 2

    @pytest.mark.parametrize("number", range(3))
    def test_pictures_reach_half_a_voxel_beyond_the_outer_centres(self, number):
        (picture,) = panels(viz.plot_image(image()))[number].get_images()
        names = PLANES["zyx"[number]]
        expected = [edge for n in names for edge in getattr(GRID, n)[[0, -1]] + [-SPACING / 2, SPACING / 2]]
        np.testing.assert_allclose(picture.get_extent(), expected, atol=1e-12)

    def test_decibels_are_relative_to_the_maximum_and_cut_at_the_dynamic_range(self):
        figure = viz.plot_image(image(), scale="db", dynamic_range_db=5)
        projection = image().project("z")
        expected = np.maximum(20 * np.log10(projection / projection.max()), -5)
        (picture,) = panels(figure)[0].get_images()
        np.testing.assert_allclose(picture.get_array(), expected.T, atol=1e-4)
        assert picture.get_clim() == (-5, 0)
        assert bar_labels(figure) == ["mean |I|  [dB re max]"]

    def test_all_panels_share_one_scale_of_length(self):
        figure = viz.plot_image(image())
        figure.draw_without_rendering()
        scales = [axes.bbox.width / np.ptp(axes.get_xlim()) for axes in panels(figure)]
        scales += [axes.bbox.height / np.ptp(axes.get_ylim()) for axes in panels(figure)]
        np.testing.assert_allclose(scales, scales[0], rtol=1e-6)

    def test_nothing_is_clipped_or_overlaps(self):
        figure = viz.plot_image(image(), mesh=box(), title="A title")
        figure.draw_without_rendering()
        boxes = [axes.get_tightbbox() for axes in figure.axes] + [text.get_window_extent() for text in figure.texts]
        assert len(boxes) == 5
        for i, a in enumerate(boxes):
            assert a.x0 >= 0
            assert a.y0 >= 0
            assert a.x1 <= figure.bbox.width
            assert a.y1 <= figure.bbox.height
            assert not any(a.overlaps(b) for b in boxes[:i])

    @pytest.mark.parametrize("scale", ["linear", "db"])
    def test_an_empty_image_is_an_empty_picture(self, scale, tmp_path):
        figure = viz.plot_image(image(zero=True), scale=scale)
        for axes in panels(figure):
            (picture,) = axes.get_images()
            assert (picture.get_array() == picture.get_clim()[0]).all()
        viz.save_figure(figure, tmp_path / "empty.png")

    @pytest.mark.slow
    @pytest.mark.parametrize("single", ["x", "y", "z", "xyz"])
    def test_a_single_voxel_along_an_axis_is_as_wide_as_the_others(self, single, tmp_path):
        grid = ms.VoxelGrid(**{n: getattr(GRID, n)[:1] if n in single else getattr(GRID, n) for n in "xyz"})
        figure = viz.plot_image(image(grid), mesh=box())
        expected = 1e-3 if single == "xyz" else SPACING
        for axes, axis in zip(panels(figure), "zyx", strict=True):
            left, right, low, high = axes.get_images()[0].get_extent()
            for name, size in zip(PLANES[axis], (right - left, high - low), strict=True):
                assert size == pytest.approx(expected * len(getattr(grid, name)))
        viz.save_figure(figure, tmp_path / "thin.png")
        viz.save_figure(viz.plot_slices(image(grid)), tmp_path / "thin.png")

    def test_uneven_spacing_is_drawn_to_scale(self):
        grid = ms.VoxelGrid(x=np.array([0.0, 0.01, 0.03]), y=GRID.y, z=GRID.z)
        axes = panels(viz.plot_image(image(grid)))[0]
        (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
        np.testing.assert_allclose(mesh.get_coordinates()[0, :, 0], [-0.005, 0.005, 0.02, 0.04])

    def test_unknown_names(self):
        with pytest.raises(UnknownNameError, match="scale"):
            viz.plot_image(image(), scale="log")
        with pytest.raises(InputError, match="colour map"):
            viz.plot_image(image(), colormap="rainbowish")
        with pytest.raises(InputError, match="colormap is empty"):
            viz.plot_image(image(), colormap=())
        with pytest.raises(InputError, match="dynamic_range_db"):
            viz.plot_image(image(), scale="db", dynamic_range_db=0)

    def test_the_title_tells_objects_and_band(self):
        history = [{"step": "simulate", "objects": ["mug", "ball"]}, {"step": "form_image", "frequency": 78.997e9}]
        told = ms.SarImage(grid=GRID, values=image().values, metadata={"history": history})
        for draw in (viz.plot_image, viz.plot_slices):
            assert [text.get_text() for text in draw(told).texts] == ["mug, ball, 79 GHz"]
            assert not draw(told, title="").texts
        assert viz.image_title(told, "scan 3") == "scan 3, 79 GHz"
        assert viz.image_title(image()) is None

    def test_labels_of_ticks_do_not_touch(self):
        narrow = ms.VoxelGrid.regular((-0.1, -0.035, -0.02), (0.1, 0.035, 0.02), SPACING)
        figure = viz.plot_image(image(narrow))
        figure.draw_without_rendering()
        for axes in panels(figure):
            labels = [label for label in axes.get_xticklabels() if label.get_text()]
            boxes = sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)
            assert len(boxes) >= 2
            assert all(left.x1 + 4 < right.x0 for left, right in itertools.pairwise(boxes))
            title = axes.title.get_window_extent()
            assert title.width <= axes.bbox.width + 1

    def test_an_unknown_setting_is_told_with_those_there_are(self):
        with pytest.raises(UnknownNameError, match=r'plot_image .db.\. Known: colormap,.* Write scale="db"\.'):
            image().plot(db=True)
        with pytest.raises(UnknownNameError, match="Did you mean 'title'"):
            viz.plot_slices(image(), titel="mine")


class TestSlices:
    def test_slices_go_through_the_peak_relative_to_the_whole_image(self):
        shown = panels(viz.plot_slices(image(), scale="linear"))
        magnitude, peak = image().magnitude, image().peak
        index = np.unravel_index(magnitude.argmax(), magnitude.shape)
        assert len(shown) == 3
        for axes, axis in zip(shown, "zyx", strict=True):
            number = "xyz".index(axis)
            expected = magnitude.take(index[number], axis=number) / magnitude.max()
            np.testing.assert_array_equal(axes.get_images()[0].get_array(), expected.T)
            assert axes.get_images()[0].get_array().max() == 1
            assert axes.get_title() == f"{axis} = {1000 * peak[number]:.4g} mm".replace("-", "−")

    def test_at_is_moved_to_the_nearest_voxel(self):
        shown = panels(viz.plot_slices(image(), at=(0.011, -0.021, 0.0)))
        assert [axes.get_title() for axes in shown] == ["z = 0 mm", "y = −20 mm", "x = 10 mm"]

    def test_places_are_told_as_exactly_as_voxels_are_fine(self):
        grid = ms.VoxelGrid(x=GRID.x + 1.6e-6, y=GRID.y - 2.4e-6, z=GRID.z * 0.02)
        shown = panels(viz.plot_slices(image(grid), at=(0.0, -0.02, 2.3e-4)))
        assert [axes.get_title() for axes in shown] == ["z = 0.2 mm", "y = −20 mm", "x = 0 mm"]

    def test_at_outside_the_grid_is_refused(self):
        with pytest.raises(InputError, match="outside the image"):
            viz.plot_slices(image(), at=(0.2, 0, 0))

    def test_an_empty_image(self, tmp_path):
        figure = viz.plot_slices(image(zero=True), mesh=box())
        for axes, axis in zip(panels(figure), "zyx", strict=True):
            assert (axes.get_images()[0].get_array() == -30).all()
            (low, high), outline = box().bounds, np.concatenate(axes.collections[0].get_segments())
            numbers = ["xyz".index(name) for name in PLANES[axis]]
            np.testing.assert_allclose(
                [outline.min(axis=0), outline.max(axis=0)], [low[numbers], high[numbers]], atol=3e-4
            )
        viz.save_figure(figure, tmp_path / "empty.png")


class TestOutline:
    @pytest.mark.parametrize("axis", "xyz")
    def test_the_outline_of_a_box_is_its_rectangle(self, axis):
        axes = Figure().add_subplot()
        lines = viz.draw_outline(axes, box(), axis)
        assert isinstance(lines, LineCollection)
        assert lines in axes.collections
        (curve,) = lines.get_segments()
        numbers = ["xyz".index(name) for name in PLANES[axis]]
        half, middle = BOX_SIZE[numbers] / 2, np.array([0, 0, 0.01])[numbers]
        np.testing.assert_allclose([curve.min(axis=0), curve.max(axis=0)], [middle - half, middle + half], atol=1e-7)
        # Every point lies on the rectangle, within a pixel of 1/800, and the curve is closed.
        distance = np.abs(np.abs(curve - middle) - half).min(axis=1)
        assert distance.max() < half.max() * 2 / 800
        np.testing.assert_allclose(curve[0], curve[-1])
        # The rectangle's area, by the shoelace formula.
        x, y = curve.T
        area = abs(np.sum(x[1:] * y[:-1] - x[:-1] * y[1:])) / 2
        assert area == pytest.approx(4 * half.prod(), rel=1e-3)

    def test_a_hole_has_an_outline_of_its_own(self):
        parts = [box((0.02, 0.1, 0.02), (x, 0, 0)) for x in (-0.04, 0.04)]
        parts += [box((0.1, 0.02, 0.02), (0, y, 0)) for y in (-0.04, 0.04)]
        frame = ms.TriangleMesh(
            vertices=np.concatenate([p.vertices for p in parts]),
            faces=np.concatenate([p.faces + 8 * i for i, p in enumerate(parts)]),
        )
        widths = sorted(np.ptp(curve[:, 0]) for curve in outline_of(frame, "z").silhouette)
        np.testing.assert_allclose(widths, [0.06, 0.1], atol=1e-4)

    def test_a_part_before_another_is_an_inner_line_and_one_behind_it_is_not(self):
        def tower(z):
            small, large = box((0.04, 0.04, 0.02), (0, 0, z)), box((0.1, 0.1, 0.02), (0, 0, 0))
            return ms.TriangleMesh(
                vertices=np.concatenate([small.vertices, large.vertices]),
                faces=np.concatenate([small.faces, large.faces + 8]),
            )

        seen = outline_of(tower(0.03), "z").inner
        np.testing.assert_allclose([seen.min(axis=(0, 1)), seen.max(axis=(0, 1))], [[-0.02, -0.02], [0.02, 0.02]])
        assert len(outline_of(tower(-0.03), "z").inner) == 0

    def test_a_sheet_seen_edge_on_is_a_line(self):
        sheet = ms.TriangleMesh(
            vertices=np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]),
            faces=np.array([[0, 1, 2], [0, 2, 3]]),
        )
        (curve,) = outline_of(sheet, "y").silhouette
        assert np.ptp(curve[:, 0]) == pytest.approx(0.1, rel=1e-3)
        assert np.ptp(curve[:, 1]) < 3e-4

    def test_a_cross_section_of_a_box(self):
        segments = cross_section(box(), "z", 0.005)
        points = segments.reshape(-1, 2)
        np.testing.assert_allclose(np.abs(points).max(axis=0), BOX_SIZE[:2] / 2)
        lengths = np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1)
        assert lengths.sum() == pytest.approx(2 * BOX_SIZE[:2].sum())
        assert cross_section(box(), "z", 0.05).shape == (0, 2, 2)

    def test_unknown_axis(self):
        with pytest.raises(UnknownNameError, match="axis"):
            viz.draw_outline(Figure().add_subplot(), box(), "w")


class TestRangeProfiles:
    def test_a_reflector_appears_at_its_range_whatever_the_path_offset(self):
        figure = viz.plot_range_profiles(capture(), poses=[15])
        lines = {line.get_label(): line for line in figure.axes[0].lines}
        assert list(lines) == ["pose 15", "RMS of 30 poses"]
        for line in lines.values():
            ranges, level = line.get_data()
            assert ranges[level.argmax()] == pytest.approx(0.5, abs=0.01)
            assert ranges.min() >= 0
            assert ranges.max() < 1
        _, level = lines["pose 15"].get_data()
        assert level.max() == pytest.approx(0, abs=0.2)

    def test_a_unit_reflector_has_a_profile_of_one(self):
        profiles = viz.range_profiles(capture())
        assert profiles.magnitude.max() == pytest.approx(1, rel=0.01)
        assert profiles.magnitude.shape == (30, 8 * 64)

    def test_axes_and_picture(self):
        figure = viz.plot_range_profiles(capture())
        upper, lower, _ = figure.axes
        assert upper.get_ylabel() == "|profile|  [dB re max]"
        assert (lower.get_xlabel(), lower.get_ylabel()) == ("range [m]", "pose")
        assert [line.get_label() for line in upper.lines] == [
            "first pose", "pose nearest the middle", "last pose", "RMS of 30 poses",
        ]  # fmt: skip
        (picture,) = lower.get_images()
        assert picture.get_array().shape[0] == 30
        assert tuple(picture.get_extent()[2:]) == (-0.5, 29.5)
        brightest = np.unravel_index(picture.get_array().argmax(), picture.get_array().shape)[1]
        left, right = picture.get_extent()[:2]
        place = left + (brightest + 0.5) * (right - left) / picture.get_array().shape[1]
        assert place == pytest.approx(0.5, abs=0.01)

    def test_a_capture_on_disk_is_read_in_part(self, tmp_path):
        whole = capture(poses=4000, receivers=1)
        with h5py.File(tmp_path / "frames.h5", "w") as file:
            frames = file.create_dataset("frames", data=whole.frames, chunks=(8, 1, 1, 64))
            on_disk = ms.Capture(radar=whole.radar, trajectory=whole.trajectory, frames=frames)
            assert not on_disk.in_memory
            profiles = viz.range_profiles(on_disk)
            figure = viz.plot_range_profiles(on_disk)
        np.testing.assert_array_equal(profiles.poses, np.arange(0, 4000, 3))
        np.testing.assert_allclose(profiles.magnitude, viz.range_profiles(whole).magnitude)
        assert figure.axes[0].lines[-1].get_label() == "RMS of every 3rd pose"

    def test_an_empty_capture(self, tmp_path):
        figure = viz.plot_range_profiles(capture(amplitude=0))
        upper, lower, _ = figure.axes
        assert all((line.get_ydata() == -80).all() for line in upper.lines)  # under the axes' floor
        assert (lower.get_images()[0].get_array() == -60).all()
        viz.save_figure(figure, tmp_path / "empty.png")

    def test_what_cannot_be_drawn_is_refused(self):
        with pytest.raises(InputError, match="pose 30"):
            viz.plot_range_profiles(capture(), poses=[30])
        one = ms.Waveform.stepped(24e9, 0.0, 1)
        radar = ms.Radar(name="tone", waveform=one, array=ms.AntennaArray.monostatic())
        frames = np.ones((2, 1, 1, 1), np.complex64)
        tone = ms.Capture(radar=radar, trajectory=ms.Trajectory.raster(size=(0.1, 0), step=0.1), frames=frames)
        with pytest.raises(InputError, match="one sample a chirp"):
            viz.plot_range_profiles(tone)


class TestSheet:
    def test_one_panel_an_image_and_one_colour_bar(self):
        images = {name: image() for name in ("mug", "wrench", "box")}
        figure = viz.plot_sheet(images, meshes={"box": box()}, columns=2)
        shown = [axes for axes in figure.axes if axes.get_images()]
        assert [axes.get_title() for axes in shown] == list(images)
        for axes in shown:
            projection = image().project("z")
            np.testing.assert_array_equal(axes.get_images()[0].get_array(), (projection / projection.max()).T)
        assert [axes.get_ylabel() for axes in figure.axes if axes not in shown] == ["mean |I| / max"]
        assert len([c for c in shown[2].collections if isinstance(c, LineCollection)]) >= 1
        assert not shown[0].collections

    def test_grids_of_different_size_keep_one_scale_and_their_own_middles(self):
        small = ms.VoxelGrid.regular((0.1, 0.1, 0), (0.12, 0.12, 0), SPACING)
        figure = viz.plot_sheet({"large": image(), "small": image(small)})
        first, second = (axes for axes in figure.axes if axes.get_images())
        assert np.ptp(first.get_xlim()) == pytest.approx(np.ptp(second.get_xlim()))
        assert np.mean(second.get_xlim()) == pytest.approx(0.11)

    def test_what_does_not_belong_together_is_refused(self):
        with pytest.raises(InputError, match="no images"):
            viz.plot_sheet({})
        with pytest.raises(UnknownNameError, match="mugg"):
            viz.plot_sheet({"mug": image()}, meshes={"mugg": box()})
        with pytest.raises(InputError, match="columns"):
            viz.plot_sheet({"mug": image()}, columns=0)


class TestAperture:
    def test_positions_outline_and_box(self):
        figure = viz.plot_aperture(capture(), box(), grid=GRID)
        above, side = panels(figure)
        assert (above.get_xlabel(), above.get_ylabel()) == ("x [m]", "y [m]")
        assert (side.get_xlabel(), side.get_ylabel()) == ("x [m]", "z [m]")
        positions = capture().trajectory.positions
        np.testing.assert_allclose(above.collections[0].get_offsets(), positions[:, :2])
        np.testing.assert_allclose(side.collections[0].get_offsets(), positions[:, [0, 2]])
        (drawn,) = side.patches
        np.testing.assert_allclose(drawn.get_bbox().extents, [-0.05, 0, 0.05, 0.03])
        for axes in (above, side):
            assert any(isinstance(c, LineCollection) for c in axes.collections)

    def test_a_single_position(self, tmp_path):
        figure = viz.plot_aperture(capture(poses=1))
        for axes, place in zip(panels(figure), ([-0.05, 0.0], [-0.05, 0.5]), strict=True):
            np.testing.assert_allclose(axes.collections[0].get_offsets(), [place])
            assert axes.get_xlim()[0] < place[0] < axes.get_xlim()[1]
            assert axes.get_ylim()[0] < place[1] < axes.get_ylim()[1]
        viz.save_figure(figure, tmp_path / "one.png")


class TestSaving:
    @pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
    def test_names_in_letters_that_there_are_not_are_no_warning(self, suffix, tmp_path):
        figure = viz.plot_image(image())
        figure.suptitle("杯子 컵")
        viz.save_figure(figure, tmp_path / f"cup{suffix}")
        assert (tmp_path / f"cup{suffix}").stat().st_size > 1000

    @pytest.mark.slow
    @pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf", ".PNG"])
    def test_the_same_figure_gives_the_same_bytes(self, suffix, tmp_path):
        for name in ("a", "b"):
            viz.save_figure(viz.plot_image(image(), mesh=box()), tmp_path / (name + suffix))
        first, second = ((tmp_path / (name + suffix)).read_bytes() for name in ("a", "b"))
        assert len(first) > 1000
        assert first == second
        assert sorted(p.name for p in tmp_path.iterdir()) == ["a" + suffix, "b" + suffix]

    def test_unknown_suffix(self, tmp_path):
        for name in ("figure.bmp", "figure"):
            with pytest.raises(UnknownNameError, match="figure format"):
                viz.save_figure(Figure(), tmp_path / name)
        assert not list(tmp_path.iterdir())

    def test_a_missing_folder(self, tmp_path):
        with pytest.raises(FileError):
            viz.save_figure(Figure(), tmp_path / "missing" / "figure.png")

    @pytest.mark.slow
    def test_pyplot_is_never_imported(self):
        names = "plot_capture, plot_image, plot_mesh, plot_samples, write_page"
        code = f"import sys; from millisight.viz import {names}; sys.exit('matplotlib.pyplot' in sys.modules)"
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
