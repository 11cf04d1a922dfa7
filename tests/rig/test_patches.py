"""Patches tile their mesh exactly, none is too large, and clusters are compact."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from millisight.rig.virtual._kernels import form_factor
from millisight.rig.virtual._patches import LANES, cut, gather

coordinates = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


def areas(triangles):
    a, b, c = triangles.transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@settings(max_examples=60, deadline=None)
@given(st.tuples(coordinates, coordinates, coordinates), st.sampled_from([0.3, 0.01, 0.003]))
def test_cutting_keeps_area_plane_and_winding(corners, reach):
    whole = np.array([corners])
    if areas(whole)[0] < 1e-6:
        return
    pieces = cut(whole, reach)
    assert areas(pieces).sum() == pytest.approx(areas(whole)[0], rel=1e-6)
    middle = pieces.mean(axis=1)
    assert np.linalg.norm(pieces - middle[:, None], axis=2).max() <= reach * (1 + 1e-9)
    # The mean of the surface stays where it was, and no piece is turned over.
    assert np.allclose(np.average(middle, axis=0, weights=areas(pieces)), whole[0].mean(axis=0), atol=1e-6)
    normal = np.cross(whole[0, 1] - whole[0, 0], whole[0, 2] - whole[0, 0])
    assert (np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]) @ normal > 0).all()
    # Thin triangles do not give more pieces than their length and their area ask for.
    longest = np.linalg.norm(whole[0] - np.roll(whole[0], 1, axis=0), axis=1).max()
    assert len(pieces) <= 4 + 8 * longest / reach + 5 * areas(whole)[0] / reach**2


def test_a_blunt_sliver_gives_few_pieces():
    """Its shortest side is as long as half of it: slices parallel to that side would be slanted, and many."""
    sliver = np.array([[[0, 0.06640625, 0], [0.0625, 0.0625, 0], [-0.0625, 0.0625, 0]]])
    pieces = cut(sliver, 0.003)
    assert areas(pieces).sum() == pytest.approx(areas(sliver)[0], rel=1e-9)
    assert len(pieces) < 150


def test_faces_without_area_are_left_out():
    faces = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [0.5, 0, 0]]], dtype=float)
    assert len(cut(faces, 10.0)) == 1


def test_clusters_are_compact_and_padded_with_nothing():
    rng = np.random.default_rng(0)
    soups = [corner + rng.uniform(-0.001, 0.001, (2000, 3, 3)) for corner in rng.uniform(-0.05, 0.05, (2, 2000, 1, 3))]
    patches = gather(soups, 0.02)
    assert (np.diff(patches.starts) % LANES == 0).all()
    assert patches.areas.sum() == pytest.approx(sum(areas(soup).sum() for soup in soups))
    assert (patches.areas > 0).sum() == 4000
    away = abs(patches.centroids - patches.centers[patches.cluster])
    assert away.max() <= 0.01 + 1e-12
    for s, soup in enumerate(soups):
        of_it = patches.surface[patches.cluster] == s
        assert patches.areas[of_it].sum() == pytest.approx(areas(soup).sum())
    # Every normal lies within its cluster's cone.
    real = patches.areas > 0
    cones = patches.cones[patches.cluster][real]
    cosines = np.einsum("ni,ni->n", patches.normals[real], cones[:, :3])
    assert (cosines >= np.sqrt(1 - cones[:, 3] ** 2) - 1e-6)[cones[:, 3] < 1].all()


def test_form_factor_is_the_integral_of_a_linear_phase():
    """Against the closed form, a divided difference, at phases as large as a patch may have at grazing angles."""
    rng = np.random.default_rng(0)
    for reach, tolerance in ((1.0, 2e-7), (3.0, 5e-5), (4.3, 2e-3)):
        a, b = rng.normal(size=(2, 300))
        scale = reach / np.max([abs(a), abs(b), abs(a + b)], axis=0)
        a, b = a * scale, b * scale
        corners = 1j * np.array([a, b, -a - b])
        gaps = [corners[i] - corners[j] for i, j in ((0, 1), (0, 2), (1, 2))]
        apart = np.min(np.abs(gaps), axis=0) > 0.05
        assert apart.sum() > 200
        x, y, z = np.exp(corners)
        exact = 2 * (x / (gaps[0] * gaps[1]) - y / (gaps[0] * gaps[2]) + z / (gaps[1] * gaps[2]))
        real, imag = np.transpose(
            [form_factor.py_func(np.float32(p), np.float32(q)) for p, q in zip(a, b, strict=True)]
        )
        assert abs(real + 1j * imag - exact)[apart].max() < tolerance
