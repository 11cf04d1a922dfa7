"""Figures of evaluations, segmentations and worlds: what they show is read back from their own artists."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.contour import QuadContourSet
from matplotlib.patches import Rectangle

import millisight as ms
from millisight import viz
from millisight.core.errors import InputError
from millisight.data import CameraFrame, Intrinsics, Picture, Prompts
from millisight.evaluation import (
    BOTH,
    DISTANCES,
    HIGH,
    PAPER_MASKS,
    THRESHOLDS,
    CloudSettings,
    FScore,
    ImagePair,
    MaskAttempt,
    MaskScores,
    MaskTrial,
    score_mask,
)
from millisight.evaluation._simulator import SimulatorComparison, WeightTrial
from millisight.perception import project
from millisight.perception.segmentation import Flat, Round, Segmented
from millisight.rig.virtual import Carton, RadarSettings, ScanSettings, World, WorldObject, build_layout

GRID = ms.VoxelGrid.regular((0.0, 0.1, -0.2), (0.10, 0.16, -0.18), 0.01)


def image(seed=0):
    values = np.random.default_rng(seed).rayleigh(size=GRID.shape)
    return ms.SarImage(grid=GRID, values=values)


def mask(*where):
    inside = np.zeros(GRID.xy.shape, bool)
    inside[where] = True
    return ms.Mask(grid_xy=GRID.xy, inside=inside)


def dots(axes):
    """(N, 2) places of each scatter, by its colour."""
    return {to_hex(c.get_facecolor()[0]): np.asarray(c.get_offsets()) for c in axes.collections}


class TestPair:
    def test_images_and_clouds_stand_in_their_own_panels(self):
        there = np.array([[0.01, 0.11, -0.19], [0.05, 0.14, -0.18]])
        moved = there + 0.002
        figure = viz.plot_pair(image(), image(1), measured_points=there, simulated_points=moved, title="mug: F 94 %")
        measured, simulated, above, front = figure.axes
        for axes, seed in ((measured, 0), (simulated, 1)):
            mean = image(seed).project("z")
            np.testing.assert_allclose(axes.get_images()[0].get_array(), (mean / mean.max()).T, rtol=1e-6)
            assert axes.get_images()[0].get_extent() == pytest.approx([-0.005, 0.105, 0.095, 0.165])
        for axes, columns in ((above, [0, 1]), (front, [0, 2])):
            found = dots(axes)
            np.testing.assert_allclose(found["#0072b2"], there[:, columns])
            np.testing.assert_allclose(found["#d55e00"], moved[:, columns])
        assert (above.get_ylabel(), front.get_ylabel()) == ("y [m]", "z [m]")
        assert [text.get_text() for text in front.get_legend().get_texts()] == ["measured", "simulated, moved"]
        assert figure.get_suptitle() == "mug: F 94 %"

    def test_of_large_clouds_some_points_are_drawn_from_all_of_them(self):
        many = np.random.default_rng(0).uniform(size=(20_000, 3))
        figure = viz.plot_pair(image(), image(), measured_points=many, simulated_points=many[:10], title="")
        (drawn, few) = (c.get_offsets() for c in figure.axes[2].collections)
        assert len(drawn) == 4000
        assert len(few) == 10
        np.testing.assert_allclose(drawn[-1], many[19_995, :2])


def pair(number, f, *, sight="los", level=0.5):
    """A pair whose combination scores f, specular f - 0.1 and edge f - 0.2; its sensitivity is `level` everywhere."""
    trials = tuple(
        WeightTrial(weights, FScore(score, score), 50, True, (0.0, 0.0, 0.0), "")
        for weights, score in (((0.5, 0.5), f), ((1.0, 0.0), f - 0.1), ((0.0, 1.0), f - 0.2))
    )
    surface = np.full((len(THRESHOLDS), len(DISTANCES)), level) + 0.01 * np.arange(len(DISTANCES))
    return ImagePair(
        object="025_mug", pose="0_0_0", number=number, sight=sight, comparison=SimulatorComparison(50, trials),
        sensitivity=surface, measured_by="", simulated_by="the simulator",
    )  # fmt: skip


PAIRS = [pair(0, 0.9), pair(1, 0.5, level=0.3), pair(2, 0.7, level=0.4), pair(3, 0.6, sight="nlos", level=0.2)]


class TestSimulator:
    def test_maps_hold_the_medians_of_each_sight_and_frame_the_tables_values(self):
        settings = CloudSettings(threshold=THRESHOLDS[2], within=DISTANCES[1])
        figure = viz.plot_sensitivity(PAIRS, settings=settings, title="measured: x")
        for axes, median, title in zip(figure.axes, (0.4, 0.2), ("3 pairs", "1 pairs"), strict=True):
            (shown,) = axes.get_images()
            expected = 100 * (median + 0.01 * np.arange(len(DISTANCES)))
            np.testing.assert_allclose(shown.get_array(), np.tile(expected, (len(THRESHOLDS), 1)))
            assert shown.get_clim() == (0, 100)
            written = [text.get_text() for text in axes.texts]
            assert written == [f"{value:.0f}" for value in np.tile(expected, len(THRESHOLDS))]
            assert axes.get_title().endswith(title)
            assert [tick.get_text() for tick in axes.get_yticklabels()] == [f"{t:g}" for t in THRESHOLDS]
            (frame,) = axes.lines
            np.testing.assert_allclose(frame.get_xydata(), [[1, 2]])

    def test_scores_are_sorted_and_each_part_has_its_curve(self):
        sight, hidden = viz.plot_scores(PAIRS).axes
        for axes, best in ((sight, [50, 70, 90]), (hidden, [60])):
            curves = {line.get_label(): line for line in axes.lines}
            assert list(curves) == ["combined", "specular", "edge"]
            for name, less in (("combined", 0), ("specular", 10), ("edge", 20)):
                np.testing.assert_allclose(curves[name].get_xdata(), np.array(best) - less)
                np.testing.assert_allclose(curves[name].get_ydata(), (np.arange(len(best)) + 0.5) / len(best))
            assert axes.get_xlim() == (0, 100)
        assert sight.get_title() != hidden.get_title()


PROMPTS = Prompts(points=np.array([[4, 3], [3, 2], [9, 6]]), positive=np.array([True, True, False]))


def segmented(inside, prompts=PROMPTS):
    return Segmented(picture=project(image()), inside=inside, prompts=prompts, score=0.9)


class TestMasks:
    @pytest.mark.slow
    def test_what_is_found_missed_and_too_much_has_its_colour(self):
        truth, found = mask(slice(3, 7), slice(2, 5)), mask(slice(4, 8), slice(2, 5))
        attempt = MaskAttempt(score_mask(found, truth), found, segmented(found.inside), "")
        figure = viz.plot_attempt(attempt, picture=project(image()), truth=truth, title="mug")
        saw, outlines, right = figure.axes
        np.testing.assert_array_equal(saw.get_images()[0].get_array(), project(image()).rgb.transpose(1, 0, 2))
        assert {len(c.get_offsets()) for c in saw.collections} == {1, 2}
        white = next(c for c in saw.collections if len(c.get_offsets()) == 2)
        np.testing.assert_allclose(white.get_offsets(), [[0.04, 0.13], [0.03, 0.12]])
        assert len([c for c in outlines.get_children() if isinstance(c, QuadContourSet)]) == 2
        colours = right.get_images()[0].get_array().transpose(1, 0, 2)
        legend = {
            text.get_text(): np.round(255 * np.array(patch.get_facecolor()[:3])).astype(int).tolist()
            for patch, text in zip(right.get_legend().get_patches(), right.get_legend().get_texts(), strict=True)
        }
        for name, where in {
            "found": found.inside & truth.inside,
            "missed": truth.inside & ~found.inside,
            "too much": found.inside & ~truth.inside,
        }.items():
            assert where.sum() in (9, 3)
            assert (colours[where] == legend[name]).all(), name
        assert (colours[~found.inside & ~truth.inside] == 255).all()

    def test_no_mask_has_no_outline_and_no_prompts(self):
        truth, nothing = mask(slice(3, 7), slice(2, 5)), mask(slice(0), slice(0))
        attempt = MaskAttempt(score_mask(nothing, truth), nothing, None, "nothing is bright")
        saw, outlines, right = viz.plot_attempt(attempt, picture=project(image()), truth=truth, title="").axes
        assert not saw.collections
        assert len([c for c in outlines.get_children() if isinstance(c, QuadContourSet)]) == 1
        coloured = (right.get_images()[0].get_array().transpose(1, 0, 2) != 255).any(axis=2)
        np.testing.assert_array_equal(coloured, truth.inside)

    def test_medians_stand_with_their_intervals_beside_the_papers(self):
        def trial(scene, given, f1, sight):
            scores = MaskScores(precision=0.5, recall=f1 / 2, f1=f1, iou=f1 / 3, accuracy=0.9)
            return MaskTrial(scene=scene, object="o", sight=sight, method="wave", input=given, seed=0, scores=scores)

        values = {HIGH: (0.2, 0.4, 0.9), BOTH: (0.6, 0.8, 0.7)}
        trials = [trial(f"s{i}", given, f, "los") for given, found in values.items() for i, f in enumerate(found)]
        figure = viz.plot_medians(trials, data="simulated: mine")
        f1, recall = figure.axes
        assert len(f1.get_yticklabels()) == 2
        assert figure.get_suptitle() == "simulated: mine"
        for axes, share, metric in ((f1, 1, "f1"), (recall, 0.5, "recall")):
            marks = {line.get_marker(): [] for line in axes.lines}
            for line in axes.lines:
                marks[line.get_marker()].append(line.get_xydata())
            # Rows from below: the paper's order is turned over.
            np.testing.assert_allclose(np.concatenate(marks["o"])[:, 0], share * np.array([70, 40]))
            intervals = np.array(marks["None"])[:, :, 0]
            assert (intervals[:, 0] <= share * np.array([70, 40])).all()
            assert (intervals[:, 1] >= share * np.array([70, 40])).all()
            assert (share * np.array([60, 20]) <= intervals[:, 0] + 1e-9).all()
            assert (intervals[:, 1] <= share * np.array([80, 90]) + 1e-9).all()
            paper = sorted(np.concatenate(marks["|"])[:, 0])
            np.testing.assert_allclose(
                paper, sorted(PAPER_MASKS[s][given][metric] for s in ("los", "nlos") for given in (HIGH, BOTH))
            )

    def test_a_segmentation_shows_power_prompts_and_the_masks_rim(self):
        found = segmented(mask(slice(3, 7), slice(2, 5)).inside)
        figure = viz.plot_segmentation(found, title="mine")
        left, right = figure.axes[:2]
        power = found.picture.power
        np.testing.assert_allclose(left.get_images()[0].get_array(), power.T, rtol=1e-6)
        decibels = np.maximum(20 * np.log10(np.maximum(power.T, 1e-9)), -30)
        np.testing.assert_allclose(right.get_images()[0].get_array(), decibels, atol=1e-4)
        scattered = [c for c in left.collections if isinstance(c, PathCollection)]
        assert [len(c.get_offsets()) for c in scattered] == [2, 1]
        np.testing.assert_allclose(scattered[1].get_offsets(), [[0.09, 0.16]])
        assert left.get_title().startswith("the picture and prompts:\n2 on the object")
        bars = {axes.get_ylabel(): axes for axes in figure.axes[2:]}
        assert bars["mean |I| / max"].get_position().x1 < right.get_position().x0
        assert bars["mean |I|  [dB re max]"].get_position().x0 > right.get_position().x1
        assert left.get_images()[0].get_cmap().name == "jet"  # which the paper's segmenters see
        assert right.get_title() == f"mask: {100 * 12 / 77:.1f} % of the picture"
        (rim,) = [c for c in right.collections if isinstance(c, LineCollection) and len(c.get_segments()) == 14]
        corners = np.concatenate(rim.get_segments())
        np.testing.assert_allclose(corners.min(axis=0), [0.025, 0.115])
        np.testing.assert_allclose(corners.max(axis=0), [0.065, 0.145])

    def test_a_segmentation_without_prompts_has_one_colour_map(self):
        left, right = viz.plot_segmentation(segmented(mask(slice(3, 7), slice(2, 5)).inside, None)).axes[:2]
        assert left.get_title() == "the picture"
        assert left.get_images()[0].get_cmap() == right.get_images()[0].get_cmap()

    def test_round_and_flat_things_are_drawn_with_their_sizes(self):
        centre, nothing = np.array([0.05, 0.13, -0.1]), np.zeros((1, 1), bool)
        ball = Round(
            kind="ball", radius=0.02, centre=centre, axis=None, length=0.04, cut=False, inside=nothing, around=nothing
        )
        top = Flat(
            kind="rectangle", centre=centre, normal=[0, 0, 1.0], axis=[1.0, 0, 0], sides=[0.06, 0.04],
            curvatures=np.zeros((2, 2)), share=1.0, cut=False, inside=nothing,
        )  # fmt: skip
        found = segmented(mask(slice(3, 7), slice(2, 5)).inside)
        right = viz.plot_segmentation(found, forms=(ball, top)).axes[1]
        round_line, flat_line = (line.get_xydata() for line in right.get_lines())
        np.testing.assert_allclose(np.hypot(*(round_line - centre[:2]).T), 0.02)
        np.testing.assert_allclose(np.ptp(flat_line, axis=0), [0.06, 0.04])
        assert [text.get_text() for text in right.texts] == ["r 20 mm", "60 x 40 mm"]
        assert not viz.plot_segmentation(found).axes[1].texts
        alone = ms.Instances(grid_xy=found.mask.grid_xy, labels=found.inside.astype(int), scores=[1.0])
        (axes,) = viz.plot_instances(alone, forms=(top,)).axes
        assert "60 x 40 mm" in [text.get_text() for text in axes.texts]

    def test_a_photo_is_refused(self):
        photo = Picture(rgb=np.zeros((4, 5, 3), np.uint8))
        found = Segmented(picture=photo, inside=np.zeros((4, 5), bool), prompts=None, score=0.5)
        with pytest.raises(InputError, match="on a photo"):
            viz.plot_segmentation(found)


@pytest.fixture(scope="module")
def world():
    """A cube in a carton, drawn; its layout; and what the camera saw."""
    made = World(
        objects=(WorldObject(object="rubiks_cube", at=(0.13, 0.18)),),
        scan=ScanSettings(size=(0.3, 0.3), row_spacing=0.01),
        radars=(RadarSettings(preset="iwr1443"),),
        carton=Carton(),
    )
    depth = np.zeros((480, 640), np.uint16)
    depth[100:200, 300:400] = 600
    rgb = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
    frame = CameraFrame(rgb=rgb, depth=depth, pose=np.eye(4), intrinsics=Intrinsics.published(), depth_unit=0.001)
    layout = build_layout(made)
    return viz.plot_world(layout, frame, [depth > 0]), layout, frame


class TestWorld:
    def test_aperture_and_objects_stand_in_both_views(self, world):
        shown, layout, _ = world
        above, side = shown.axes[:2]
        rectangles = [patch for patch in above.patches if isinstance(patch, Rectangle)]
        scan = layout.world.scan
        (aperture,) = [patch for patch in rectangles if to_hex(patch.get_edgecolor()) == "#1f5fa8"]
        assert aperture.get_bbox().bounds == pytest.approx(
            (scan.corner[0], scan.corner[1], np.ptp(scan.row_places), scan.size[1])
        )
        assert [text.get_text() for text in above.texts] == ["rubiks cube"]
        (lower, upper) = layout.objects[0].bounds
        for axes, columns in ((above, [0, 1]), (side, [1, 2])):
            drawn = np.concatenate([path.vertices for c in axes.collections for path in c.get_paths()])
            for corner in (lower, upper):
                assert np.abs(drawn - corner[columns]).max(axis=1).min() < 1e-9
        legend = " ".join(text.get_text() for text in above.get_legend().get_texts())
        assert f"aperture, {len(scan.row_places)} rows" in legend
        assert layout.panels[0].stack in legend

    def test_the_cameras_picture_and_its_depth_in_metres(self, world):
        shown, _, frame = world
        rgb, depth = shown.axes[2:4]
        np.testing.assert_array_equal(rgb.get_images()[0].get_array(), frame.rgb)
        (outline,) = [c for c in rgb.get_children() if isinstance(c, QuadContourSet)]
        around = np.concatenate([path.vertices for path in outline.get_paths()])
        np.testing.assert_allclose([around.min(axis=0), around.max(axis=0)], [[299.5, 99.5], [399.5, 199.5]])
        metres = depth.get_images()[0].get_array()
        np.testing.assert_allclose(metres[frame.depth > 0], 0.6, rtol=1e-6)
        assert np.isnan(np.ma.filled(metres, np.nan)[frame.depth == 0]).all()
