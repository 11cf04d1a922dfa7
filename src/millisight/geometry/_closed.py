"""A surface closed downwards: what was seen as a lid on what was not."""

import numpy as np

from millisight.core import checked_number, checked_record, with_step
from millisight.core.errors import InputError
from millisight.data import Surface, TriangleMesh


def closed(seen: Surface, *, base: float | None = None) -> Surface:
    """Close a surface by walls from its edges straight down to a level floor: a watertight mesh.

    Walls and floor were not seen. They bound what may be there: seen from above, nothing of the object lies outside of
    them, as far as its shadow tells. Their standard deviation is their distance from what was seen. A surface that
    overhangs itself is closed, too, and then cuts through its own walls. Faces that touch others in a single corner are
    left out.

    Parameters
    ----------
    seen : Surface, as of `surface`
    base : z of the floor, such as that of a table [m]; None: just below the surface's lowest place

    Returns
    -------
    Surface
        `metadata["seen_vertices"]` counts those that were seen; they come first.

    Raises
    ------
    InputError
        The floor does not lie below the surface.
    """
    mesh = checked_record(seen, Surface, name="seen").mesh
    lowest = float(mesh.vertices[:, 2].min())
    beneath = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0])) / 100
    floor = lowest - beneath if base is None else checked_number(base, name="base", unit="m")
    if floor >= lowest:
        raise InputError(
            f"base is at z = {floor:.4g} m, and the surface reaches down to {lowest:.4g} m; expected a floor below it"
        )
    faces = _without_corners(mesh.faces)
    if not len(faces):
        raise InputError("the faces of the surface touch in single corners; expected a surface of connected faces")
    used, faces = np.unique(faces, return_inverse=True)
    faces, top, sigma = faces.reshape(-1, 3), mesh.vertices[used], seen.sigma[used]
    count = len(top)
    a, b = _border(faces).T
    walls = np.concatenate([np.stack([b, a, a + count], axis=1), np.stack([b, a + count, b + count], axis=1)])
    lid_and_all = np.concatenate([faces, faces[:, ::-1] + count, walls])
    under = top * [1, 1, 0] + [0, 0, floor]
    return Surface(
        mesh=TriangleMesh(vertices=np.concatenate([top, under]), faces=lid_and_all),
        sigma=np.concatenate([sigma, top[:, 2] - floor]),
        metadata=with_step(seen.metadata, "closed", base=floor) | {"seen_vertices": count},
    )


def _border(faces: np.ndarray) -> np.ndarray:
    """(E, 2) the edges of one face alone, in its direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[counts == 1]]


def _without_corners(faces: np.ndarray) -> np.ndarray:
    """The faces without those at vertices where the border passes more than once, and a wall would meet two others."""
    while len(faces):
        passes = np.bincount(_border(faces)[:, 0], minlength=int(faces.max()) + 1)
        twice = np.flatnonzero(passes > 1)
        if not len(twice):
            break
        faces = faces[~np.isin(faces, twice).any(axis=1)]
    return faces
