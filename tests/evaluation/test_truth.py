"""Camera truth on the radar's grid, against the virtual rig, which knows better."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from millisight.core.errors import InputError
from millisight.data import Intrinsics, PixelGrid
from millisight.evaluation import camera_truth, published_radar_from_camera, radar_from_camera, score_mask
from millisight.evaluation._truth import pixels_on_grid
from millisight.io.mito import BASE_ORIGIN
from millisight.rig.virtual import (
    CameraSettings,
    ScanSettings,
    World,
    WorldObject,
    build_layout,
    camera_mask,
    footprint,
    image_grid,
    render,
    visible_pixels,
)
from millisight.rig.virtual._camera import _view as view

K = Intrinsics.published()
HALF_VOXEL = np.array([0.00125, 0.00125, 0.005])  # of the published images
TILTED = CameraSettings(at=(0.15, 0.15, 0.05), offset=(0.02, 0.05, 0.02), tilt_deg=(4.0, -6.0, 30.0))
STRAIGHT_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def layout_of(name, at=(0.14, 0.17), material=None):
    placed = WorldObject(object=name, at=at, rotate_deg=(0, 0, 20), **({"material": material} if material else {}))
    return build_layout(World(objects=(placed,), scan=ScanSettings(size=(0.3, 0.3), row_spacing=0.01)))


def seen(layout, settings=TILTED, seed=0):
    """(mask in the picture, T_radar_camera from its pose, true T_radar_camera)"""
    true = settings.pose(np.array(settings.at))
    frame = render(layout, true, settings, np.random.default_rng(seed))
    return camera_mask(frame, visible_pixels(layout, true)), radar_from_camera(frame.pose, BASE_ORIGIN), true


@pytest.mark.slow
def test_the_transform_is_right_to_half_a_voxel():
    # The tilted camera's pixels, by way of depth in millimetres and pose, against where its rays met the object.
    layout = layout_of("mug")
    mask, transform, true = seen(layout)
    there = view(layout, true, K).points.reshape(480, 640, 3)
    known = mask.pixels & (mask.depth > 0)
    assert known.sum() > 4000
    error = mask.points[known] @ transform[:3, :3].T + transform[:3, 3] - there[known]
    # Noise of the depth averages out, and what is left is the transform's: a hundredth of half a voxel.
    assert (np.abs(error.mean(axis=0)) < 0.02 * HALF_VOXEL).all()
    # And no single point is off by more, but for the noise of the depth: rms 0.4 mm, to the nearest millimetre.
    assert (np.sqrt((error**2).mean(axis=0)) < [2e-4, 2e-4, 7e-4]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "material", "least"), [("rubiks_cube", None, 0.97), ("mug", None, 0.94), ("spoon", "metal", 0.90)]
)
def test_the_mask_is_that_of_the_object_on_the_grid(name, material, least):
    layout = layout_of(name, material=material)
    mask, transform, _ = seen(layout, CameraSettings(at=(0.14, 0.10, 0.10)))
    truth = footprint(layout, image_grid(layout.world, "77_ghz").xy)
    found = camera_truth(mask, truth.grid_xy, transform)
    assert truth.inside.sum() > 400
    assert score_mask(found, truth).iou > least
    centres = [np.argwhere(m.inside).mean(axis=0) for m in (found, truth)]
    assert np.abs(np.subtract(*centres)).max() < 0.5  # voxels


def test_a_level_plate_in_closed_form():
    # A square of 200 pixels a side at 0.4 m, seen straight down from (0.1, 0.2).
    pose = STRAIGHT_DOWN.copy()
    pose[:2, 3] = 0.1, 0.2
    pixels = np.zeros((480, 640), bool)
    pixels[141:342, 222:423] = True
    grid = PixelGrid(x=np.arange(-0.05, 0.25, 0.0025), y=np.arange(0.05, 0.35, 0.0025))
    found = pixels_on_grid(pixels, np.full(pixels.shape, 0.4), grid, pose)
    half = np.array([100.5 * 0.4 / K.fx, 100.5 * 0.4 / K.fy])
    centre = np.array([0.1 + (322 - K.cx) * 0.4 / K.fx, 0.2 - (241 - K.cy) * 0.4 / K.fy])
    far = np.stack(
        [np.abs(a - c) - h for a, c, h in zip(np.meshgrid(grid.x, grid.y, indexing="ij"), centre, half, strict=True)]
    )
    assert (found.inside == (far.max(axis=0) < 0)).mean() > 0.995
    assert not found.inside[far.max(axis=0) > 0.0007].any()
    assert found.inside[far.max(axis=0) < 0].all()


def test_holes_in_the_depth_are_filled_and_none_in_the_mask():
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:480, :640]
    around = np.hypot(rows - 240, columns - 320)
    ring = (around < 100) & (around > 40)
    depth = np.where(ring, 0.35, 0.6)
    holed = depth.copy()
    holed[(rows // 16 + columns // 16) % 2 == 0] = 0
    holed[rng.random(depth.shape) < 0.2] = np.nan
    grid = PixelGrid(x=np.arange(-0.08, 0.08, 0.0025), y=np.arange(-0.08, 0.08, 0.0025))
    whole = pixels_on_grid(ring, depth, grid, STRAIGHT_DOWN)
    assert np.array_equal(pixels_on_grid(ring, holed, grid, STRAIGHT_DOWN).inside, whole.inside)
    middle = np.argmin(np.abs(grid.x))
    assert whole.inside.sum() > 600
    assert not whole.inside[middle, middle]


def test_masks_without_a_place_are_refused():
    grid = PixelGrid(x=np.arange(0, 0.1, 0.01), y=np.arange(0, 0.1, 0.01))
    pixels = np.zeros((480, 640), bool)
    depth = np.full(pixels.shape, 0.4)
    with pytest.raises(InputError, match="it is empty"):
        pixels_on_grid(pixels, depth, grid, np.eye(4))
    pixels[200:210, 200:210] = True
    with pytest.raises(InputError, match="none of its pixels has a depth"):
        pixels_on_grid(pixels, 0 * depth, grid, np.eye(4))
    away = STRAIGHT_DOWN.copy()
    away[0, 3] = 1.0
    with pytest.raises(InputError, match=r"outside the grid: it covers x 0\.92.* the grid over x 0 to 0\.09"):
        pixels_on_grid(pixels, depth, grid, away)
    with pytest.raises(InputError, match="depth has shape"):
        pixels_on_grid(pixels, depth[1:], grid, np.eye(4))


def test_the_published_transform_of_experiment_2_stands_for_all_pictures():
    transform = published_radar_from_camera(2, np.eye(4), BASE_ORIGIN)
    assert transform[:3, 3] == pytest.approx([0.58516503 - 0.005 - 0.42, -0.00280226 + 0.01 + 0.23, 0.4604748 - 0.23])
    # It looks down, a little askew: 0.4 m before it lies the tripod's height.
    assert transform[:3, 2] == pytest.approx([-0.0322, 0.0034, -0.9995], abs=1e-4)
    assert (transform @ [0, 0, 0.5, 1])[2] == pytest.approx(-0.27, abs=0.005)


def test_the_published_transform_of_experiment_1_step_by_step():
    # The steps of the public evaluation, one after the other, as its arrays go through them.
    rng = np.random.default_rng(0)
    tool, radar = np.eye(4), Rotation.random(random_state=1)
    tool[:3, :3] = Rotation.random(random_state=2).as_matrix()
    tool[:3, 3] = 0.5, -0.1, 0.4
    points = rng.normal(size=(10, 3))
    camera = tool[:3, 3] + tool[:3, :3] @ [0.017, 0.086, -0.054]
    place = np.array(BASE_ORIGIN) + radar.apply([-0.186, -0.068, 0.046])
    swapped = -points[:, [1, 0, 2]]
    expected = Rotation.from_euler("xyz", [0, 0, -3], degrees=True).apply(swapped)
    expected = expected - (place - (camera - np.array([0.06, 0.015, 0.0])))
    transform = published_radar_from_camera(1, tool, BASE_ORIGIN, radar.as_matrix())
    assert points @ transform[:3, :3].T + transform[:3, 3] == pytest.approx(expected)
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1)
    held_alike = published_radar_from_camera(1, tool, BASE_ORIGIN, tool[:3, :3])
    assert np.array_equal(published_radar_from_camera(1, tool, BASE_ORIGIN), held_alike)
    with pytest.raises(InputError, match="experiments 1 and 2"):
        published_radar_from_camera(3, tool, BASE_ORIGIN)
