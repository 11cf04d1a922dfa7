"""The virtual camera: pictures, depth, holes, and masks that are exact."""

import time

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.data import Intrinsics
from millisight.io.mito import BASE_ORIGIN
from millisight.rig import Camera
from millisight.rig.virtual import (
    CameraSettings,
    Carton,
    ScanSettings,
    Support,
    World,
    WorldObject,
    build_layout,
    camera_mask,
    footprint,
    image_grid,
    object_pixels,
    render,
    visible_pixels,
)
from millisight.rig.virtual._camera import VirtualCamera
from millisight.rig.virtual._layout import FLOOR

SCAN = ScanSettings(size=(0.3, 0.3), row_spacing=0.01)
ABOVE = np.array([0.15, 0.15, 0.05])
EXACT = CameraSettings(offset=(0, 0, 0), depth_noise=0.0, holes=False)
CUBE = WorldObject(object="rubiks_cube", at=(0.13, 0.18))
K = Intrinsics.published()


def layout_of(*objects, **settings):
    return build_layout(
        World(objects=objects or (CUBE,), scan=SCAN, support=Support(size=(0.3, 0.3), at=(0.15, 0.15)), **settings)
    )


def shot(layout, settings=EXACT, seed=0):
    return render(layout, settings.pose(ABOVE), settings, np.random.default_rng(seed))


def world_points(frame):
    """(480, 640, 3) what each pixel shows, in the radar frame."""
    return frame.points @ frame.pose[:3, :3].T + frame.pose[:3, 3] - BASE_ORIGIN


@pytest.mark.slow
def test_depth_is_where_things_are():
    layout = layout_of()
    points = world_points(shot(layout))
    lower, upper = layout.objects[0].bounds
    mask = visible_pixels(layout, EXACT.pose(ABOVE))
    assert 3000 < mask.sum() < 20_000
    # Within half a millimetre, to which depth is rounded, of the cube's box, and of its top face mostly.
    assert (points[mask] > lower - 1e-3).all()
    assert (points[mask] < upper + 1e-3).all()
    assert (np.abs(points[mask][:, 2] - upper[2]) < 1e-3).mean() > 0.6
    block = (np.abs(points[..., 2] + 0.30) < 1e-3) & ~mask
    assert block.sum() > 50_000
    assert np.abs(points[~mask & ~block][:, 2] - FLOOR).max() < 0.3 + 1e-3


@pytest.mark.slow
def test_depth_beyond_what_a_file_holds_is_not_known():
    """It wrapped round: a wall at 68 m was at 2.4 m."""
    layout = layout_of()
    layout.background = ()
    far = ABOVE[2] + 70.0
    frame = render(layout, EXACT.pose((ABOVE[0], ABOVE[1], far)), EXACT, np.random.default_rng(0))
    assert not frame.depth.any()
    with pytest.raises(InputError, match="depth_noise is 1e[+]09; expected at most 1000"):
        CameraSettings(depth_noise=1e9)


def test_the_camera_looks_down_with_x_right_and_y_up():
    mask = visible_pixels(layout_of(), EXACT.pose(ABOVE))
    rows, columns = np.nonzero(mask)
    depth = ABOVE[2] + 0.30 - 0.0579
    # The cube is left of the middle, and above it in the picture, as y grows upward.
    assert columns.mean() == pytest.approx(K.cx + K.fx * (0.13 - 0.15) / depth, abs=3)
    assert rows.mean() == pytest.approx(K.cy - K.fy * (0.18 - 0.15) / depth, abs=3)


def test_hand_eye_moves_and_tilts_the_camera():
    settings = CameraSettings(offset=(0.01, 0.02, 0.03), tilt_deg=(0, 0, 90))
    pose = settings.pose(np.array([0.1, 0.2, 0.0]))
    assert pose[:3, 3] == pytest.approx([0.11, 0.22, 0.03])
    assert pose[:3, 0] == pytest.approx([0, 1, 0])
    assert pose[:3, 2] == pytest.approx([0, 0, -1])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


@pytest.mark.slow
def test_the_depth_has_the_noise_of_its_pair_and_one_seed_gives_one_picture():
    layout = layout_of()
    pose = EXACT.pose(ABOVE)
    block = (np.abs(world_points(shot(layout))[..., 2] + 0.30) < 1e-3) & ~visible_pixels(layout, pose)
    settings = CameraSettings(offset=(0, 0, 0), holes=False, depth_noise=5.0)
    noisy = [shot(layout, settings, seed) for seed in (1, 1, 2)]
    error = noisy[0].depth[block] * 0.001 - 0.35
    expected = np.hypot(5 * 0.08 * 0.35**2 / (K.fx * 0.055), 0.001 / np.sqrt(12))
    assert error.std() == pytest.approx(expected, rel=0.1)
    assert abs(error.mean()) < 1e-4
    assert np.array_equal(noisy[0].depth, noisy[1].depth)
    assert np.array_equal(noisy[0].rgb, noisy[1].rgb)
    assert not np.array_equal(noisy[0].depth, noisy[2].depth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("material", "least", "most"), [("metal", 0.1, 0.95), ("glass", 0.7, 1.0), ("wood", 0.0, 0.05)]
)
def test_holes_are_where_things_shine_or_are_clear(material, least, most):
    flat = WorldObject(object="cracker_box", at=(0.15, 0.15), material=material)
    layout = layout_of(flat)
    frame = shot(layout, CameraSettings(offset=(0, 0, 0)))
    mask = visible_pixels(layout, EXACT.pose(ABOVE))
    assert mask.sum() > 20_000
    assert least <= (frame.depth[mask] == 0).mean() <= most


@pytest.mark.slow
def test_one_eye_is_covered_beside_a_step():
    layout = layout_of()
    depth = shot(layout, CameraSettings(offset=(0, 0, 0), depth_noise=0)).depth
    rows, columns = np.nonzero(visible_pixels(layout, EXACT.pose(ABOVE)))
    middle = int(rows.mean())
    left, right = columns[rows == middle].min(), columns[rows == middle].max()
    # The second eye is on the right, so the strip behind the cube's left edge is what it misses.
    assert (depth[middle, left - 8 : left - 2] == 0).all()
    assert (depth[middle, right + 3 : right + 9] > 0).all()


@pytest.mark.slow
def test_the_carton_hides_the_object_from_the_camera_alone():
    open_stage, layout = layout_of(), layout_of(carton=Carton(clearance=0.02))
    pose = EXACT.pose(ABOVE)
    amodal = object_pixels(layout, pose)
    assert amodal.sum() > 3000
    assert not visible_pixels(layout, pose).any()
    assert np.array_equal(amodal, object_pixels(open_stage, pose))
    assert np.array_equal(visible_pixels(layout.uncovered(), pose), visible_pixels(open_stage, pose))
    frame = shot(layout)
    lid = layout.objects[0].bounds[1, 2] + 0.02
    assert np.abs(world_points(frame)[amodal][:, 2] - lid).max() < 1e-3
    # And it looks like cardboard: more red than blue.
    shown = frame.rgb[amodal].mean(axis=0)
    assert shown[0] > shown[1] > shown[2]


def test_masks_of_several_objects_are_exact():
    tall = WorldObject(object="wood_block", at=(0.10, 0.15))
    layout = layout_of(tall, WorldObject(object="golf_ball", at=(0.225, 0.15)))
    pose = CameraSettings(offset=(0, 0, 0)).pose(np.array([0.10, 0.15, 0.05]))
    pixels = [visible_pixels(layout, pose, i) for i in range(2)]
    whole = [object_pixels(layout, pose, i) for i in range(2)]
    assert not (pixels[0] & pixels[1]).any()
    assert np.array_equal(pixels[0] | pixels[1], visible_pixels(layout, pose))
    for seen, amodal in zip(pixels, whole, strict=True):
        assert not (seen & ~amodal).any()
    # The block stands before the ball: part of it is hidden.
    assert np.array_equal(pixels[0], whole[0])
    assert 0 < pixels[1].sum() < 0.9 * whole[1].sum()


def test_the_footprint_is_what_lies_over_a_pixel():
    layout = layout_of()
    grid = image_grid(layout.world, "77_ghz").xy
    mask = footprint(layout, grid)
    (x0, y0, _), (x1, y1, _) = layout.objects[0].bounds
    inside = ((grid.x[:, None] > x0) & (grid.x[:, None] < x1)) & ((grid.y > y0) & (grid.y < y1))
    assert inside.sum() > 400
    # A cube's corners are rounded: a pixel at each may miss.
    assert (mask.inside ^ inside).sum() <= 8
    ball = footprint(layout_of(WorldObject(object="golf_ball", at=(0.15, 0.15))), grid)
    assert ball.inside.sum() * 0.0025**2 == pytest.approx(np.pi * 0.0213**2, rel=0.05)
    assert not footprint(build_layout(World(scan=SCAN)), grid).inside.any()


@pytest.mark.slow
def test_the_published_mask_has_points_on_the_object():
    layout = layout_of()
    frame = shot(layout)
    mask = camera_mask(frame, visible_pixels(layout, EXACT.pose(ABOVE)))
    points = mask.points[mask.pixels] @ frame.pose[:3, :3].T + frame.pose[:3, 3] - BASE_ORIGIN
    lower, upper = layout.objects[0].bounds
    assert ((points > lower - 1e-3) & (points < upper + 1e-3)).all()
    assert np.isnan(mask.points[~mask.pixels]).all()
    assert not mask.depth[~mask.pixels].any()


@pytest.mark.slow
def test_it_is_a_camera_and_shoots_in_two_seconds():
    layout = build_layout(World(objects=(WorldObject(object="mug"),), scan=SCAN))
    camera = VirtualCamera(CameraSettings(), layout, lambda: ABOVE + BASE_ORIGIN, np.random.default_rng(0))
    assert isinstance(camera, Camera)
    camera.shoot()
    started = time.process_time()
    frame = camera.shoot()
    assert time.process_time() - started < 2.0
    assert frame.pose[:3, 3] == pytest.approx(ABOVE + BASE_ORIGIN + [0, 0.07, 0.02])
    assert frame.rgb.shape == (480, 640, 3)
    assert frame.depth.dtype == np.uint16
