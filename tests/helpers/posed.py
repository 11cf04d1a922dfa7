"""Oriented points of a mesh in a pose, as a radar above would see them, by ray and by angle, one by one."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import millisight as ms
from millisight.meshes import RayCaster

ANTENNAS = np.stack([*(axis.ravel() for axis in np.meshgrid(*(np.linspace(-0.15, 0.15, 16),) * 2)), np.zeros(256)], 1)
DEPTH = -0.25
"""Where objects lie under the antennas [m]."""


def block(lower, upper):
    """A cuboid [m]."""
    box = trimesh.creation.box(bounds=[lower, upper])
    return ms.TriangleMesh(vertices=box.vertices, faces=box.faces)


def bracket():
    """A bracket without symmetry: three blocks, 0.2 mm apart, of 10, 7 and 4 cm."""
    parts = [
        block([0.0, 0.0, 0.0], [0.10, 0.03, 0.02]),
        block([0.0, 0.0302, 0.0], [0.025, 0.07, 0.02]),
        block([0.075, 0.0, 0.0202], [0.10, 0.02, 0.06]),
    ]
    return together(*parts)


def together(*meshes):
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return ms.TriangleMesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )


def turn(seed):
    return Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix()


def points_of(mesh, count=900, within_deg=12.0, noise=0.0005, rng=0):
    """Points where the normal meets an antenna within an angle and nothing is in the way; noise along it [m]."""
    generator = np.random.default_rng(rng)
    areas = np.linalg.norm(mesh.face_crosses, axis=1)
    face = generator.choice(len(areas), 12 * count, p=areas / areas.sum())
    u, v = np.sqrt(generator.random(len(face))), generator.random(len(face))
    shares = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    places, normals = np.einsum("ni,nij->nj", shares, mesh.vertices[mesh.faces][face]), mesh.face_normals[face]
    ways = ANTENNAS[None] - places[:, None]
    cosines = np.einsum("nai,ni->na", ways, normals) / np.linalg.norm(ways, axis=2)
    best = cosines.argmax(axis=1)
    shines = cosines.max(axis=1) > np.cos(np.radians(within_deg))
    shines &= ~RayCaster.of([mesh]).crosses(places + 1e-4 * normals, ANTENNAS[best])
    chosen = np.flatnonzero(shines)[:count]
    turned = normals[chosen] + 0.03 * generator.normal(size=(len(chosen), 3))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return ms.PointCloud(
        points=places[chosen] + noise * generator.normal(size=(len(chosen), 1)) * normals[chosen], normals=turned,
        place_sigma=np.full(len(chosen), noise), normal_sigma_deg=np.full(len(chosen), 2.0),
    )  # fmt: skip


def merged(*clouds):
    return ms.PointCloud(
        points=np.concatenate([one.points for one in clouds]), normals=np.concatenate([one.normals for one in clouds]),
        place_sigma=np.concatenate([one.place_sigma for one in clouds]),
    )  # fmt: skip


def edge_points_of(mesh, spacing=0.0015, noise=0.0005, rng=0):
    """Points of edges across which an antenna lies, between both faces' normals, with nothing in the way."""
    generator = np.random.default_rng(rng)
    ends, one, other = mesh.edge_faces
    made = []
    for (start, stop), first, second in zip(mesh.vertices[ends], *mesh.face_normals[[one, other]], strict=True):
        if first @ second > 0.99:
            continue
        along = (stop - start) / np.linalg.norm(stop - start)
        places = start + np.arange(spacing, np.linalg.norm(stop - start), spacing)[:, None] * along
        ways = ANTENNAS[None] - places[:, None]
        ways /= np.linalg.norm(ways, axis=2, keepdims=True)
        # Between two normals at right angles both cosines are positive.
        across = (np.abs(ways @ along) < 0.05) & (ways @ first > 0) & (ways @ second > 0)
        found = np.flatnonzero(across.any(axis=1))
        normals = ways[found, across[found].argmax(axis=1)]
        normals -= (normals @ along)[:, None] * along
        made.append((places[found], normals / np.linalg.norm(normals, axis=1, keepdims=True)))
    places, normals = (np.concatenate(parts) for parts in zip(*made, strict=True))
    return ms.PointCloud(
        points=places + noise * generator.normal(size=(len(places), 1)) * normals, normals=normals,
        place_sigma=np.full(len(places), noise), normal_sigma_deg=np.full(len(places), 2.0),
    )  # fmt: skip
