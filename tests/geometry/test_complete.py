"""What was not seen of round things is guessed, told from what was seen, and left open where nothing fits."""

import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers import posed
from millisight.core.errors import InputError
from millisight.geometry import complete
from millisight.meshes import build_object

AT = np.array([0.01, -0.02, posed.DEPTH])


def completed(mesh, **settings):
    """(mesh in its place, points, surface and guess)."""
    placed = mesh.moved(translation=AT)
    cloud = posed.points_of(placed, within_deg=4.0, **settings)
    assert len(cloud) > 100
    return placed, cloud, complete(ms.surface(cloud), cloud, posed.ANTENNAS)


def guess_of(made):
    return made.mesh.vertices[made.metadata["seen_vertices"] :]


@pytest.mark.slow
def test_a_ball_is_carried_on_to_where_no_antenna_sees_it():
    radius = 0.04
    ball = trimesh.creation.icosphere(4, radius)
    _, cloud, made = completed(ms.TriangleMesh(vertices=ball.vertices, faces=ball.faces))
    (told,) = made.metadata["shapes"]
    assert told["shape"] == "ball"
    assert told["radius"] == pytest.approx(radius, abs=1e-3)
    seen, guess = ms.surface(cloud), guess_of(made)
    np.testing.assert_array_equal(made.mesh.vertices[: len(seen.mesh.vertices)], seen.mesh.vertices)
    np.testing.assert_array_equal(made.sigma[: len(seen.sigma)], seen.sigma)
    normals = (guess - AT) / np.linalg.norm(guess - AT, axis=1, keepdims=True)
    assert np.abs(np.linalg.norm(guess - AT, axis=1) - radius).max() < 2e-3
    # From the end of what shines to the horizon of the antenna that sees most.
    ways = posed.ANTENNAS[None] - guess[:, None]
    best = np.einsum("nai,ni->na", ways / np.linalg.norm(ways, axis=2, keepdims=True), normals).max(axis=1)
    assert np.degrees(np.arccos(best.max())) < 12
    assert np.degrees(np.arccos(best.min())) > 80
    assert (best > -0.05).all()
    # What is farther from what was seen is less sure; faces look outward.
    assert made.sigma[len(seen.sigma) :].min() > 0.004
    faces = made.mesh.faces >= len(seen.sigma)
    assert (faces.all(axis=1) == faces.any(axis=1)).all()
    middles = made.mesh.vertices[made.mesh.faces[faces.all(axis=1)]].mean(axis=1) - AT
    assert ((made.mesh.face_normals[faces.all(axis=1)] * middles).sum(axis=1) > 0).all()


def test_a_can_is_carried_on_around_not_beyond_its_ends():
    can = build_object("tomato_soup_can")  # lies along x
    placed, _, made = completed(can)
    (told,) = made.metadata["shapes"]
    assert told["shape"] == "cylinder"
    assert abs(told["axis"][0]) > 0.995
    assert told["radius"] == pytest.approx(can.extent[1] / 2, rel=0.06)
    guess = guess_of(made)
    assert guess[:, 0].min() > placed.bounds[0, 0] - 2e-3
    assert guess[:, 0].max() < placed.bounds[1, 0] + 2e-3
    assert guess[:, 2].min() < placed.bounds[:, 2].mean() + 5e-3  # as far as its widest place
    middle = placed.bounds.mean(axis=0)
    assert np.abs(np.linalg.norm((guess - middle)[:, 1:], axis=1) - can.extent[1] / 2).max() < 3e-3


@pytest.mark.parametrize("what", ["flat", "hollow", "cut off"])
def test_what_does_not_go_on_is_left_open(what):
    if what == "flat":
        points = posed.points_of(posed.block([-0.04, -0.03, -0.27], [0.04, 0.03, -0.25]))
    else:
        ball = trimesh.creation.icosphere(4, 0.05)
        ball.apply_translation([0, 0, posed.DEPTH])
        cloud = posed.points_of(ms.TriangleMesh(vertices=ball.vertices, faces=ball.faces), within_deg=3.0)
        if what == "hollow":  # the inside of a bowl: the same normals on the other side of its middle
            there, outward = 2 * np.array([0, 0, posed.DEPTH]) - cloud.points, cloud.normals
        else:  # of what should shine, a third is there
            kept = cloud.points[:, 0] > np.quantile(cloud.points[:, 0], 0.67)
            there, outward = cloud.points[kept], cloud.normals[kept]
        points = ms.PointCloud(points=there, normals=outward, place_sigma=np.full(len(there), 5e-4))
    seen = ms.surface(points)
    made = complete(seen, points, posed.ANTENNAS)
    assert list(made.metadata["shapes"]) == []
    np.testing.assert_array_equal(made.mesh.faces, seen.mesh.faces)


def test_points_without_normals_are_refused():
    cloud = posed.points_of(posed.block([-0.04, -0.03, -0.27], [0.04, 0.03, -0.25]))
    with pytest.raises(InputError, match="have no normals"):
        complete(ms.surface(cloud), ms.PointCloud(points=cloud.points), posed.ANTENNAS)
