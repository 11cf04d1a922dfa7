"""Scores of poses by closed forms, and the task `pose` on a scene of its own."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import millisight as ms
from helpers import posed
from millisight.core import rotation_from_euler_deg
from millisight.core.errors import InputError
from millisight.evaluation import PoseTask, SceneSource, score_pose
from millisight.geometry import symmetries

CUBE = posed.block([-0.03] * 3, [0.03] * 3)
AT = np.array([0.1, 0.2, -0.3])
UP = np.array([0, 0, 0.012])
ANGLES = (100, 15, 30)  # shows each of its three blocks


def pose(rotation, translation, sigma=0.01, free=()):
    covariance = np.diag([sigma**2] * 3 + [0.05**2] * 3)
    return ms.Pose(
        name="cube", rotation=rotation, translation=translation, middle=np.zeros(3), covariance=covariance,
        free_axes=np.array(free).reshape(-1, 3), score=1.0, explained=1.0, shown=1.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def cube():
    return symmetries(CUBE)


@pytest.mark.slow
def test_a_shift_and_a_turn_are_scored_as_they_are(cube):
    exact = score_pose(pose(posed.turn(1), AT), CUBE, cube, posed.turn(1), AT)
    assert exact.add < 1e-9
    assert exact.covered
    shifted = score_pose(pose(posed.turn(1), AT + UP), CUBE, cube, posed.turn(1), AT)
    assert shifted.add == pytest.approx(0.012)
    assert shifted.place == pytest.approx(0.012)
    assert shifted.degrees == pytest.approx(0, abs=1e-6)
    assert shifted.covered  # 1.2 standard deviations
    assert not score_pose(pose(posed.turn(1), AT, 0.001), CUBE, cube, posed.turn(1), AT + UP).covered
    turned = Rotation.from_rotvec([0, 0, np.radians(20)]).as_matrix() @ posed.turn(1)
    assert score_pose(pose(turned, AT), CUBE, cube, posed.turn(1), AT).degrees == pytest.approx(20)


@pytest.mark.slow
def test_turns_that_look_alike_are_no_error(cube):
    """A quarter turn of a cube, of which only the corners' names tell."""
    quarter = posed.turn(1) @ rotation_from_euler_deg((0, 0, 90))
    found = score_pose(pose(quarter, AT), CUBE, cube, posed.turn(1), AT)
    assert found.degrees < 3
    assert found.add < 0.003
    assert found.add_s < 1e-9
    none = symmetries(posed.bracket())
    assert score_pose(pose(quarter, AT), posed.bracket(), none, posed.turn(1), AT).degrees == pytest.approx(90)


class _Scene(SceneSource):
    """A bracket in memory, seen from above."""

    __slots__ = ()
    bands = ("77 GHz",)
    paths = ()

    def physics(self):
        return "simulator"

    def read(self, **_):
        raise AssertionError("poses are evaluated on captures: no image and no mask is read")

    def read_image(self, band, **_):
        raise AssertionError("poses are evaluated on captures: no image and no mask is read")

    def shape_paths(self, band):
        return (Path("capture.h5"), Path("world.toml")) if band == "77 GHz" else ()

    def read_capture(self, band):
        scene = ms.Scene.from_mesh(self.read_shape(band)[0], vertices=3000, center=False)
        radar, path = ms.Radar.preset("mito-sim-77ghz"), ms.Trajectory.raster(size=(0.10, 0.10), step=0.003)
        kinds = (ms.simulate(scene, radar, path, model=model) for model in ("specular", "edge"))
        return ms.combine(*kinds, (0.5, 0.5))

    def read_shape(self, band):
        bracket = posed.bracket()
        # Of 6 cm: it has fewer points than a larger one.
        small = ms.TriangleMesh(vertices=0.6 * bracket.vertices, faces=bracket.faces)
        turned = small.moved(rotation=rotation_from_euler_deg(ANGLES))
        return (turned.moved(translation=-turned.bounds.mean(axis=0)),)


class _Numbered(_Scene):
    """With a world of its own."""

    __slots__ = ()

    def shape_paths(self, band):
        return (Path(f"{self.name}.h5"), Path(f"{self.name}.toml")) if band == "77 GHz" else ()


class _Data:
    path = Path("brackets")

    def __init__(self, *scenes):
        self.scenes = scenes


@pytest.mark.slow
def test_the_task_scores_poses_and_a_blind_guess(tmp_path, monkeypatch):
    # A fifth of the rotations: what is asked is whether poses that were found are scored as they are.
    monkeypatch.setattr("millisight.evaluation.tasks.pose.locate", partial(ms.locate, turns=600))
    scene = _Scene(name="bracket/los", object="bracket", folder="1_bracket", angles=ANGLES, number=1, sight="los")
    task = PoseTask(spacing=(0.003, 0.005), which=True)
    planned = task.plan(_Data(scene))
    (item,) = planned.items
    results = json.loads(json.dumps(task.run(item)))
    rows = task.rows(planned, results)
    ours, blind = rows
    assert (ours.method, blind.method) == ("locate", "upright at the brightest place")
    assert ours.scores.add < 0.01
    assert ours.success
    assert (ours.answer, blind.answer) == ("bracket", "bracket")
    assert ours.probability > 0.5
    assert ours.seconds > 0
    assert np.isnan([blind.probability, blind.seconds]).all()
    assert blind.scores.add > 2 * ours.scores.add
    assert blind.scores.degrees > 30
    tables = task.tables(planned, rows)
    assert list(tables) == ["los", "scenes"]
    assert "100" in tables["los"].markdown()
    assert len(tables["scenes"].rows) == 2
    (figure,) = task.figures(planned, rows)
    figure.draw().savefig(tmp_path / "worst.png")


@pytest.mark.parametrize("which", [False, True])
def test_results_follow_from_all_worlds_that_were_read(which):
    """The mesh is that of the object's first scene, and those of all objects where one is chosen among them."""
    scenes = [
        _Numbered(name=name, object=name[0], folder=name[0], angles=ANGLES, number=1, sight="los")
        for name in ("a1", "a2", "b1")
    ]
    paths = [{str(path) for path in item.paths} for item in PoseTask(which=which).plan(_Data(*scenes)).items]
    others = {"a1.toml", "b1.toml"} if which else set()
    assert paths == [
        {"a1.h5", "a1.toml"} | others, {"a2.h5", "a2.toml", "a1.toml"} | others, {"b1.h5", "b1.toml"} | others,
    ]  # fmt: skip


def test_a_dataset_without_shapes_is_refused():
    with pytest.raises(InputError, match="no 77 GHz capture of an object of known shape"):
        PoseTask().plan(_Data())
