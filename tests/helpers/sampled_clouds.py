"""Points all over a mesh, and how far points are from it: for tests of alignment."""

import numpy as np
from scipy.spatial import KDTree
from trimesh.triangles import closest_point


def sampled(mesh, count, rng):
    """(count, 3) points, evenly over the surface, and the (count,) faces on which they lie."""
    areas = np.linalg.norm(mesh.face_crosses, axis=1)
    faces = rng.choice(len(areas), count, p=areas / areas.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = mesh.vertices[mesh.faces[faces]].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a), faces


def rms_off_the_surface(points, mesh, rng, *, near=60):
    """Rms distance of `points` from the mesh: to the faces whose middle, or a sample of which, is near."""
    dense, faces = sampled(mesh, 20_000, rng)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    faces = np.concatenate([faces, np.arange(len(middles))])
    close = faces[KDTree(np.concatenate([dense, middles])).query(points, k=near)[1]]
    repeated = np.repeat(points, near, axis=0)
    feet = closest_point(mesh.vertices[mesh.faces[close.ravel()]], repeated)
    far = np.linalg.norm(feet - repeated, axis=1).reshape(-1, near).min(axis=1)
    return float(np.sqrt((far**2).mean()))
