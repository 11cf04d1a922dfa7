"""Radius, centre and axis of balls and cylinders, by the phases of an image."""

import numpy as np
import pytest

import millisight as ms
from helpers.form_images import GRID, RESOLUTION, WAVENUMBER, ball, cylinder, lit
from millisight.core.errors import InputError
from millisight.perception import project
from millisight.perception.segmentation import WaveSegmenter, find_mask, find_round


@pytest.mark.parametrize("radius", [0.015, 0.03, 0.06])
def test_a_ball_is_as_large_as_its_phases_say(radius):
    (found,) = find_round(lit(ball(radius, (0.01, -0.02, -0.06))), ball(radius, (0.01, -0.02, -0.06)))
    assert found.kind == "ball"
    assert found.axis is None
    assert found.radius == pytest.approx(radius, abs=0.005)
    assert found.centre == pytest.approx([0.01, -0.02, -0.06], abs=0.004)
    area = found.inside.sum() * 0.0025**2
    assert area == pytest.approx(np.pi * found.radius**2, rel=0.05)
    assert (found.around & found.inside).sum() == found.inside.sum() < found.around.sum()
    assert found.plain["kind"] == "ball"
    assert f"{1e3 * found.radius:.0f} mm radius" in str(found)


@pytest.mark.parametrize(("radius", "tilt_deg"), [(0.02, 0.0), (0.03, 5.0), (0.045, -8.0)])
def test_a_cylinder_is_as_thick_long_and_tilted_as_it_is(radius, tilt_deg):
    image = cylinder(radius, -0.06, 0.12, tilt_deg)
    (found,) = find_round(lit(image), image)
    assert found.kind == "cylinder"
    assert found.radius == pytest.approx(radius, abs=0.006)
    assert found.length == pytest.approx(0.12 / np.cos(np.radians(tilt_deg)), abs=0.006)
    along, up = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    assert found.centre == pytest.approx(
        [0, radius * up, -0.06 + radius * (1 - along)], abs=0.003
    )  # square to the crest
    assert found.axis == pytest.approx([0, along, up], abs=0.01)
    assert f"{1e3 * found.length:.0f} mm long" in str(found)


def test_outlines_lie_around_their_pixels():
    for image in (ball(0.03, (0.01, -0.02, -0.06)), cylinder(0.025, -0.06, 0.1)):
        (found,) = find_round(lit(image), image)
        places = np.stack(np.meshgrid(image.grid.x, image.grid.y, indexing="ij"), axis=-1)[found.inside]
        for angle in np.radians(range(0, 360, 15)):
            way = np.array([np.cos(angle), np.sin(angle)])
            assert (found.outline @ way).max() == pytest.approx((places @ way).max(), abs=0.004)
        assert found.short == f"r {1e3 * found.radius:.0f} mm"


def test_phases_of_either_sign_tell_the_same():
    image = ball(0.03, (0, 0, -0.06))
    turned = ms.SarImage(grid=image.grid, values=np.conj(image.values))
    (one,), (other,) = find_round(lit(image), image), find_round(lit(turned), turned)
    assert one.kind == other.kind == "ball"
    assert [one.radius, *one.centre] == pytest.approx([other.radius, *other.centre])


def test_a_bowl_is_no_ball():
    """Its echoes come together above it."""
    image = ball(0.03, (0, 0, -0.06))
    hollow = ms.SarImage(grid=image.grid, values=np.conj(image.values[:, :, ::-1]))
    assert find_round(lit(hollow), hollow) == ()


def test_flat_and_small_things_and_noise_are_not_round():
    x, y, z = GRID.x, GRID.y, GRID.z
    wave = np.exp(-1j * WAVENUMBER * z) * np.exp(-((z / RESOLUTION) ** 2))
    plate = (abs(x) < 0.03)[:, None, None] & (abs(y) < 0.02)[None, :, None]
    point = (abs(x) < 0.002)[:, None, None] & (abs(y) < 0.002)[None, :, None]
    noise = np.random.default_rng(0).standard_normal((*GRID.shape, 2)) @ [1, 1j]
    for values in (plate * wave, point * wave, noise):
        image = ms.SarImage(grid=GRID, values=values)
        assert find_round(lit(image), image) == ()


def test_where_phases_tell_nothing_nothing_is_round():
    image = ball(0.03, (0, 0, -0.06))
    assert find_round(lit(image), ms.SarImage(grid=image.grid, values=image.magnitude)) == ()
    long = ms.SarImage(grid=image.grid, values=image.values / abs(image.values).max(axis=(0, 1)))  # as at 24 GHz
    assert find_round(lit(image), long) == ()
    coarse = ms.VoxelGrid.regular((-0.1, -0.12, -0.1), (0.1, 0.12, 0.06), (0.004, 0.004, 0.01))
    assert find_round(lit(ball(0.03, (0, 0, -0.06), coarse)), ball(0.03, (0, 0, -0.06), coarse)) == ()
    empty = ms.Mask(grid_xy=image.grid.xy, inside=np.zeros(image.grid.shape[:2], bool))
    assert find_round(empty, image) == ()
    assert find_round(lit(image), ms.SarImage(grid=image.grid, values=0 * image.values)) == ()
    with pytest.raises(InputError, match="differ along"):
        find_round(lit(image), ball(0.03, (0, 0, -0.06), coarse))


def test_a_part_at_the_pictures_edge_and_a_single_slice():
    image = ball(0.03, (0.095, 0, -0.06))
    for one in find_round(lit(image), image):
        assert one.inside.shape == image.grid.shape[:2]
    row = ms.VoxelGrid.regular((-0.1, -0.12, -0.03), (0.1, 0.12, -0.03), (0.0025, 0.0025, 0.01))
    assert find_round(lit(ball(0.03, (0, 0, -0.06), row)), ball(0.03, (0, 0, -0.06), row)) == ()


def test_two_parts_are_judged_each_by_itself():
    left, right = ball(0.02, (-0.05, 0, -0.05)), ball(0.035, (0.045, 0, -0.06))
    both = ms.SarImage(grid=GRID, values=left.values / abs(left.values).max() + right.values / abs(right.values).max())
    assert sorted(one.radius for one in find_round(lit(both, -14), both)) == pytest.approx([0.02, 0.035], abs=0.006)


@pytest.mark.slow
def test_wave_marks_a_simulated_ball_to_its_outline(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=6, radius=0.04).export(mesh)
    scene = ms.Scene.from_mesh(mesh)
    capture = ms.simulate(
        scene, ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.2, 0.2), step=0.0025), model="specular"
    )
    grid = ms.VoxelGrid.regular((-0.1, -0.1, -0.06), (0.1, 0.1, 0.1), (0.0025, 0.0025, 0.01))
    image = ms.form_image(capture, grid)
    found = find_mask(WaveSegmenter(), project(image), rng=0)
    (one,) = find_round(found.mask, image)
    assert one.kind == "ball"
    assert one.radius == pytest.approx(0.04, abs=0.008)
    assert one.centre == pytest.approx([0, 0, 0], abs=0.006)
    truth = np.hypot(grid.x[:, None], grid.y) <= 0.04
    assert 2 * (found.inside & truth).sum() / (found.inside.sum() + truth.sum()) > 0.85
