"""Where an object of known shape lies, and how sure that is."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any, cast

import numpy as np

from millisight.core import (
    Metadata,
    checked_array,
    checked_items,
    checked_metadata,
    checked_number,
    checked_numbers,
    checked_record,
    late,
    put,
    record,
    rotation_vector,
)
from millisight.core.errors import InputError
from millisight.data._mesh import TriangleMesh
from millisight.data._points import PointCloud

NONE_OF_THEM = "none of them"
"""The answer of `Located.probabilities` beside the names of the meshes."""
_ROUND = 1e-6


@record
class Pose:
    """The pose of a mesh in the world: x_world = rotation @ x_mesh + translation.

    Attributes
    ----------
    name : of the mesh
    rotation : (3, 3), mesh to world
    translation : (3,) of the mesh's origin [m]
    middle : (3,) point of the mesh that `covariance` is about [m]
    covariance : (6, 6) of the place of `middle` along the world's axes [m], and of a rotation vector in the world about
        it [rad]; turns about `free_axes` have the variance of any angle
    free_axes : (F, 3) unit axes in the world about which a turn changes nothing that can be seen: none, one, or three
    score : agreement of points and mesh, 0 to 1
    explained : share of the points that the mesh explains
    shown : share of what should shine of the mesh that was found
    weight : of this pose among all poses of the mesh that were found, 0 to 1
    symmetry : rotations that leave the mesh as it is, in words
    agreement : of the measured image with the simulator's of the mesh in this pose, 0 to 1; None: not asked for
    alpha : (a1, a2) weights of the simulator's specular and edge echoes in the measured image, whose sum is 1, or
        (0, 0) where there is no echo; None: not asked for
    alpha_sigma : standard deviation of either weight
    """

    name: str
    rotation: np.ndarray
    translation: np.ndarray
    middle: np.ndarray
    covariance: np.ndarray
    free_axes: np.ndarray
    score: float
    explained: float
    shown: float
    weight: float = 1.0
    symmetry: str = ""
    agreement: float | None = None
    alpha: tuple[float, float] | None = None
    alpha_sigma: float | None = None

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        rotation = checked_array(self.rotation, name="rotation", shape=(3, 3))
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROUND or np.linalg.det(rotation) < 0:
            raise InputError(
                f"rotation is no rotation: its determinant is {np.linalg.det(rotation):.4g}; expected orthogonal rows "
                "and a determinant of 1"
            )
        covariance = checked_array(self.covariance, name="covariance", shape=(6, 6))
        if np.abs(covariance - covariance.T).max() > _ROUND or np.linalg.eigvalsh(covariance).min() < -_ROUND:
            raise InputError("covariance is not symmetric, or has a negative variance; expected that of six errors")
        put(
            self,
            rotation=rotation,
            translation=checked_array(self.translation, name="translation", shape=(3,), unit="m"),
            middle=checked_array(self.middle, name="middle", shape=(3,), unit="m"),
            covariance=covariance,
            free_axes=_axes(self.free_axes),
        )
        for name in ("score", "explained", "shown", "weight", "agreement"):
            if name == "agreement" and self.agreement is None:
                continue
            value = checked_number(getattr(self, name), name=name, minimum=0)
            if value > 1 + _ROUND:
                raise InputError(f"{name} is {value:g}; expected 0 to 1")
            put(self, **{name: min(value, 1.0)})
        if self.alpha is not None:
            put(self, alpha=checked_numbers(self.alpha, name="alpha", count=2, minimum=0))
        if self.alpha_sigma is not None:
            put(self, alpha_sigma=checked_number(self.alpha_sigma, name="alpha_sigma", minimum=0))

    def __repr__(self) -> str:
        at = ", ".join(f"{1e3 * one:.1f}" for one in self.place)
        return (
            f"Pose({self.name} at ({at}) mm, within {1e3 * self.place_sigma:.1f} mm and {self.turn_sigma_deg:.1f} "
            f"degrees, score {self.score:.2f})"
        )

    @property
    def T_world_mesh(self) -> np.ndarray:
        """(4, 4) mesh to world [m]."""
        made = np.eye(4)
        made[:3, :3], made[:3, 3] = self.rotation, self.translation
        return made

    @property
    def place(self) -> np.ndarray:
        """(3,) of the mesh's middle in the world [m]."""
        return self.rotation @ self.middle + self.translation

    @property
    def place_sigma(self) -> float:
        """Standard deviation of the place of the middle, root mean square of the three axes [m]."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3]) / 3))

    @property
    def turn_sigma_deg(self) -> float:
        """Standard deviation of the turn, root mean square of the axes that are not free [degrees]; 0 of a ball."""
        axes = _across(self.free_axes)
        if not len(axes):
            return 0.0
        return float(np.degrees(np.sqrt(np.trace(axes @ self.covariance[3:, 3:] @ axes.T) / len(axes))))

    def distance(self, place: np.ndarray, rotation: np.ndarray) -> float:
        """Mahalanobis distance of another pose of the mesh, less turns about `free_axes`.

        Its square is below the quantile of a chi-squared distribution with 6 - F degrees of freedom for what lies in
        the region of that probability.

        Parameters
        ----------
        place : (3,) of the middle in the world [m]
        rotation : (3, 3), that one of the mesh's symmetric rotations which is nearest
        """
        turn = rotation_vector(rotation @ self.rotation.T)
        known = np.zeros((3 + len(axes := _across(self.free_axes)), 6))
        known[:3, :3], known[3:, 3:] = np.eye(3), axes
        error = known @ np.concatenate([place - self.place, turn])
        return float(np.sqrt(error @ np.linalg.solve(known @ self.covariance @ known.T, error)))

    def placed(self, mesh: TriangleMesh) -> TriangleMesh:
        """The mesh in this pose."""
        return checked_record(mesh, TriangleMesh, name="mesh").moved(
            rotation=self.rotation, translation=self.translation
        )

    def to_dict(self) -> dict[str, Any]:
        """What JSON holds: lengths in metres, turns in radians."""
        return {
            "name": self.name,
            "T_world_mesh": self.T_world_mesh.tolist(),
            "rotation": self.rotation.tolist(),
            "translation": self.translation.tolist(),
            "middle": self.middle.tolist(),
            "covariance": self.covariance.tolist(),
            "free_axes": self.free_axes.tolist(),
            "score": self.score,
            "explained": self.explained,
            "shown": self.shown,
            "weight": self.weight,
            "symmetry": self.symmetry,
            "agreement": self.agreement,
            "alpha": None if self.alpha is None else list(self.alpha),
            "alpha_sigma": self.alpha_sigma,
        }


def _across(axes: np.ndarray) -> np.ndarray:
    """(3 - F, 3) unit vectors across F unit axes."""
    if not len(axes):
        return np.eye(3)
    return np.linalg.svd(axes)[2][len(axes) :]


def _axes(value: Any) -> np.ndarray:
    """(F, 3), of none as well."""
    try:
        count = len(value)
    except TypeError:  # which is refused below
        count = 1
    axes = checked_array(value, name="free_axes", shape=("n", 3)) if count else np.zeros((0, 3))
    axes.flags.writeable = False
    return axes


@record
class Located:
    """Where objects of known shapes lie in what a radar saw, and which of them it is.

    Attributes
    ----------
    poses : Pose, the best of each mesh, the most probable mesh first
    probabilities : by the mesh's name, and of NONE_OF_THEM; their sum is 1. Meshes far larger or smaller than what was
        seen have no pose and the probability 0
    points : oriented points that they were found in
    metadata : provenance; what JSON can hold
    """

    poses: tuple[Pose, ...]
    probabilities: Mapping[str, float]
    points: PointCloud
    metadata: Metadata = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        poses = checked_items(self.poses, Pose, name="a pose")
        expected = {one.name for one in poses} | {NONE_OF_THEM}
        given = cast(Mapping[Any, Any], checked_record(self.probabilities, Mapping, name="probabilities"))
        shares = {
            checked_record(name, str, name="a name"): checked_number(share, name=f"probability of {name}", minimum=0)
            for name, share in given.items()
        }
        if not poses or not expected <= set(shares) or abs(sum(shares.values()) - 1) > _ROUND:
            raise InputError(
                f"probabilities are of {', '.join(shares)} with a sum of {sum(shares.values()):.4g}; expected one of "
                f"each of {len(poses)} poses, at least one, and of {NONE_OF_THEM!r}, with a sum of 1"
            )
        checked_record(self.points, PointCloud, name="points")
        put(self, poses=poses, probabilities=shares, metadata=checked_metadata(self.metadata))

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {share:.0%}" for name, share in self.ranking[:3])
        return f"Located({told}; {self.poses[0]!r})"

    @property
    def ranking(self) -> list[tuple[str, float]]:
        """Names and probabilities, the most probable first."""
        return sorted(self.probabilities.items(), key=lambda one: -one[1])

    @property
    def best(self) -> Pose | None:
        """The pose of the most probable mesh; None if it is more probable that it is none of them."""
        name = self.ranking[0][0]
        return next((one for one in self.poses if one.name == name), None)

    def plot(self, mesh: TriangleMesh, **settings: Any) -> Any:
        """Plot a mesh in its pose with the points around it, seen along z, y and x.

        Parameters
        ----------
        mesh : of the first of `poses`
        settings : of `millisight.viz.plot_located`: `most_points` that are drawn, `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_located")(self, mesh, **settings)

    def to_dict(self) -> dict[str, Any]:
        """What JSON holds."""
        return {
            "poses": [one.to_dict() for one in self.poses],
            "probabilities": dict(self.ranking),
            "points": len(self.points),
        }
