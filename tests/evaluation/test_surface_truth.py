"""True surfaces, scores of points, and the task `surface` on a scene of its own."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers import solid_mirrors
from millisight.core.errors import InputError
from millisight.evaluation import SceneSource, SurfaceTask, score_surface, true_surface

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
MESH = ms.TriangleMesh(vertices=BALL.vertices - [0, 0, 0.30], faces=BALL.faces)


@pytest.fixture(scope="module")
def capture():
    return solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.15, step=0.003, noise=0.6)


@pytest.fixture(scope="module")
def truth(capture):
    return true_surface([MESH], capture)


def test_the_truth_is_what_the_antennas_see(truth):
    """From a point at height h over a sphere the cap above r² / h is seen; the far corners see a little more."""
    height = truth.points[:, 2] + 0.30
    assert len(truth.points) > 1000
    assert height.min() > -0.02
    assert height.max() > 0.0499
    assert height.min() < 0.05**2 / 0.30
    assert np.abs(np.linalg.norm(truth.points - np.array([0, 0, -0.30]), axis=1) - 0.05).max() < 1e-3
    # The ray along the normal leaves the ball's middle, 30 cm down: it meets the aperture within 7.5 cm.
    slope = np.abs(truth.normals[truth.shines, :2] / truth.normals[truth.shines, 2:])
    assert 0.20 < slope.max() < 0.26


def test_the_truth_itself_scores_one(truth):
    scores = score_surface(ms.PointCloud(points=truth.points, normals=truth.normals), truth)
    assert scores.f == scores.f_5mm == scores.f_shining == 1
    assert scores.place == 0
    assert scores.normal_deg < 1e-3


def test_points_beside_it_score_as_they_lie(truth):
    moved = ms.PointCloud(points=truth.points + 0.007 * truth.normals, normals=-truth.normals)
    scores = score_surface(moved, truth)
    assert scores.precision == 1
    assert scores.precision_5mm == 0
    assert scores.f_5mm == 0
    assert scores.normal_deg > 170
    some = truth.points[:, 0] > 0
    half = score_surface(ms.PointCloud(points=truth.points[some]), truth)
    assert half.precision == 1
    assert 0.5 < half.recall < 0.75
    assert np.isnan(half.normal_deg)
    assert score_surface(ms.PointCloud(points=np.empty((0, 3))), truth).f == 0


def test_a_mesh_out_of_sight_is_refused(capture):
    with pytest.raises(InputError, match="at least one"):
        true_surface([], capture)


class _Scene(SceneSource):
    """A scene in memory."""

    __slots__ = ("held",)
    bands = ("77 GHz",)
    paths = ()

    def physics(self):
        return "closed form"

    def read(self, **_):
        raise AssertionError("surfaces are evaluated on captures: no image and no mask is read")

    def read_image(self, band, **_):
        raise AssertionError("surfaces are evaluated on captures: no image and no mask is read")

    def shape_paths(self, band):
        return (Path("capture.h5"), Path("world.toml")) if band == "77 GHz" else ()

    def read_capture(self, band):
        return solid_mirrors.capture_of(solid_mirrors.ball(0.05), size=0.15, step=0.003, noise=0.6)

    def read_shape(self, band):
        return (MESH,)

    def metal(self, band):
        return False


class _Data:
    path = Path("balls")

    def __init__(self, *scenes):
        self.scenes = scenes


@pytest.fixture(scope="module")
def scene():
    return _Scene(name="ball/los", object="ball", folder="1_ball", angles=(0, 0, 0), number=1, sight="los")


@pytest.mark.slow
def test_the_task_scores_points_and_baselines(scene, tmp_path):
    task = SurfaceTask(spacing=(0.003, 0.006))
    planned = task.plan(_Data(scene))
    (item,) = planned.items
    results = json.loads(json.dumps(task.run(item)))
    rows = task.rows(planned, results)
    scores = {one.method: one.scores for one in rows}
    assert list(scores) == ["surface_points", "and guessed", "thresholded voxels", "maximum along z"]
    assert scores["surface_points"].place < 2e-3
    assert scores["surface_points"].normal_deg < 8
    assert scores["surface_points"].f_shining > 0.8
    assert scores["surface_points"].f > scores["maximum along z"].f
    # The ball goes on beyond what shines of it.
    assert scores["and guessed"].recall > scores["surface_points"].recall + 0.2
    assert scores["and guessed"].f > scores["surface_points"].f + 0.1
    tables = task.tables(planned, rows)
    assert list(tables) == ["los", "los-by-material", "scenes"]
    assert [row[0] for row in tables["los-by-material"].rows] == 4 * ["plastics and other"]
    assert {row[1] for row in tables["scenes"].rows} == {"no"}
    assert "mmNorm" in tables["los"].markdown()
    assert "real data of others" in tables["los"].markdown()
    figures = list(task.figures(planned, rows))
    assert len(figures) == 1
    figures[0].draw().savefig(tmp_path / "worst.png")


def test_a_dataset_without_shapes_is_refused():
    with pytest.raises(InputError, match="no 77 GHz capture of an object of known shape"):
        SurfaceTask().plan(_Data())
