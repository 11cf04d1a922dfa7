"""What a carton does to an image: at 24 GHz next to nothing, at 77 GHz it shows, and the object too."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.scatter import METAL, mesh_of, radar
from millisight.core import rotation_from_euler_deg
from millisight.data import LAYERED, Layer
from millisight.imaging import form_image
from millisight.rig.virtual import EchoModel, Part, Sheet, box_sheets

TOP, LID = -0.22, -0.14
GRID = ms.VoxelGrid.regular((-0.033, -0.033, TOP - 0.03), (0.033, 0.033, LID + 0.02), (0.003, 0.003, 0.005))
SAMPLES = 12
BANDS = {"24 GHz": (24.025e9, 2e8 / SAMPLES, 0.009), "77 GHz": (77.5e9, 3e9 / SAMPLES, 0.0045)}
BLOCK = Part(mesh=mesh_of(trimesh.creation.box((0.05, 0.03, 0.02))).moved(translation=np.array([0, 0, TOP - 0.01])),
             material=METAL)  # fmt: skip


def carton(thickness):
    """A box around the block without its bottom, of board as thick as that."""
    front, flute, back = LAYERED["carton"]
    layers = (front, Layer(flute.material, thickness - front.thickness - back.thickness), back)
    lower, upper = np.array([-0.045, -0.045, TOP - 0.02]), np.array([0.045, 0.045, LID])
    return box_sheets(lower, upper, layers)[1:]


def image(band, sheets):
    start, step, spacing = BANDS[band]
    device = radar(start, step, SAMPLES)
    path = ms.Trajectory.raster(size=(0.09, 0.09), step=spacing, center=(0, 0, 0))
    model = EchoModel([BLOCK], device, path, edges=False, bounces=1, occluders=sheets)
    return form_image(ms.Capture(radar=device, trajectory=path, frames=model.frames(path)), GRID).values


@pytest.fixture(scope="module")
def images():
    covers = {"open": (), "2.5 mm": carton(2.5e-3), "3 mm": carton(3e-3), "3.5 mm": carton(3.5e-3)}
    return {(band, name): image(band, sheets) for band in BANDS for name, sheets in covers.items()}


def match(images, band, name):
    one, other = images[band, "open"], images[band, name]
    return abs(np.vdot(one, other)) / np.linalg.norm(one) / np.linalg.norm(other)


@pytest.mark.slow
def test_at_24_ghz_the_image_is_that_of_the_open_scene_and_more_so_than_at_77(images):
    assert match(images, "24 GHz", "3 mm") >= 0.95
    for name in ("2.5 mm", "3 mm", "3.5 mm"):
        assert match(images, "24 GHz", name) > match(images, "77 GHz", name)
    # Half a millimetre less, and the liners' reflections cancel less at 24 GHz; half a millimetre more, and better.
    assert match(images, "24 GHz", "2.5 mm") < match(images, "24 GHz", "3 mm") < match(images, "24 GHz", "3.5 mm")


def test_at_77_ghz_both_carton_and_object_show(images):
    profiles = {name: abs(images["77 GHz", name]).max(axis=(0, 1)) for name in ("open", "3 mm")}
    top, lid = (int(np.argmin(abs(GRID.z - z))) for z in (TOP, LID))
    assert profiles["3 mm"][top] > 0.8 * profiles["open"][top]
    assert profiles["3 mm"][lid] > 1.5 * profiles["open"][lid]  # a side lobe of the block's
    assert profiles["3 mm"][lid] > 0.2 * profiles["3 mm"][top]


@pytest.mark.parametrize("tilt_deg", [1, 5])
def test_a_tilted_sheet_is_a_level_one_seen_by_antennas_tilted_as_much(tilt_deg):
    """It does not look through itself: the middles of its clusters lie a little off its plane."""
    start, step, _ = BANDS["77 GHz"]
    device = radar(start, step, SAMPLES)
    turn = rotation_from_euler_deg((tilt_deg, tilt_deg / 2, 0))
    path = ms.Trajectory.raster(size=(0.03, 0.03), step=0.006, center=(0, 0, 0.15))
    tilted = ms.Trajectory(times=path.times, positions=path.positions @ turn.T)
    corner, u, v = np.array([-0.06, -0.05, 0.0]), np.array([0.12, 0, 0]), np.array([0, 0.1, 0])
    frames = [
        EchoModel(
            [], device, way, occluders=[Sheet(corner=by @ corner, u=by @ u, v=by @ v, layers=LAYERED["carton"])]
        ).frames(way)
        for by, way in ((np.eye(3), path), (turn, tilted))
    ]
    assert abs(frames[0]).min() > 0.1
    np.testing.assert_allclose(frames[1], frames[0], atol=2e-3 * abs(frames[0]).max())
