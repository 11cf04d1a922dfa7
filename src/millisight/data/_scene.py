"""Scenes: what the radar looks at."""

from typing import Any

import numpy as np

from millisight.core import box, checked_array, checked_items, checked_record, late, put, record
from millisight.core.errors import InputError
from millisight.data._material import Material
from millisight.data._mesh import TriangleMesh

_NAMED = 3  # objects in the text of a scene


@record
class SceneObject:
    """One object in a scene.

    Attributes
    ----------
    name : str
    mesh : TriangleMesh, in the world frame [m]
    material : Material
    """

    name: str
    mesh: TriangleMesh
    material: Material

    def __post_init__(self) -> None:
        checked_record(self.name, str, name="name")
        checked_record(self.mesh, TriangleMesh, name="mesh")
        checked_record(self.material, Material, name="material")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name}, {self.material.name}, {self.mesh!r})"


@record
class Scene:
    """One or more objects in the world frame; scenes add up with `+`.

    Attributes
    ----------
    objects : tuple of SceneObject

    Examples
    --------
    >>> scene = Scene.from_mesh("rubiks_cube", vertices=500)
    >>> wall = Scene.from_mesh("cracker_box", vertices=None).moved((0.0, 0.0, 0.12))
    >>> [thing.name for thing in (scene + wall).objects]
    ['rubiks_cube', 'cracker_box']
    """

    objects: tuple[SceneObject, ...]

    def __post_init__(self) -> None:
        objects = checked_items(self.objects, SceneObject, name="a scene's object")
        if not objects:
            raise InputError("a scene without objects; expected at least one")
        put(self, objects=objects)

    def __repr__(self) -> str:
        named = [f"{o.name} of {o.material.name}" for o in self.objects[:_NAMED]]
        if len(self.objects) > _NAMED:
            named.append(f"{len(self.objects) - _NAMED} more")
        lower, upper = np.transpose([o.mesh.bounds for o in self.objects], (1, 0, 2))
        return f"Scene({', '.join(named)}; {box(lower.min(axis=0), upper.max(axis=0))})"

    @classmethod
    def from_mesh(
        cls,
        source: Any,
        *,
        unit: str | None = None,
        vertices: int | None = 10_000,
        center: bool = True,
        rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
        material: "str | Material | None" = None,
    ) -> "Scene":
        """A scene of one object.

        Parameters
        ----------
        source : a mesh file (STL, OBJ, PLY, OFF, GLB), a name of the catalogue, a trimesh or a TriangleMesh
        unit : "m", "cm", "mm" or "in"; None assumes metres, and refuses what is then no everyday size
        vertices : number of evenly spaced vertices to resample to; None keeps those of the mesh
        center : move the centre of the bounding box to the origin (after rotation)
        rotate_deg : rotation about the fixed x, then y, then z axis [degrees]
        material : a name of `MATERIALS` or a Material; None: that of the catalogue with fitted weights, else metal

        Raises
        ------
        MeshError, UnknownNameError, InputError, FileError
        """
        scene_from_mesh = late("millisight.meshes", "scene_from_mesh")
        return scene_from_mesh(
            source, unit=unit, vertices=vertices, center=center, rotate_deg=rotate_deg, material=material
        )

    def plot(self, **settings: Any) -> Any:
        """Plot the objects as shaded solids, seen along z, y and x.

        Parameters
        ----------
        settings : of `millisight.viz.plot_scene`: `title`

        Returns
        -------
        matplotlib.figure.Figure
        """
        return late("millisight.viz", "plot_scene")(self, **settings)

    def __add__(self, other: "Scene") -> "Scene":
        return Scene(objects=self.objects + checked_record(other, Scene, name="what is added to a scene").objects)

    def moved(self, translation: Any) -> "Scene":
        """The scene shifted by (3,) metres."""
        shift = checked_array(translation, name="translation", shape=(3,), unit="m")
        return Scene(
            objects=tuple(
                SceneObject(name=o.name, mesh=o.mesh.moved(translation=shift), material=o.material)
                for o in self.objects
            )
        )

    @property
    def mesh(self) -> TriangleMesh:
        """All objects as one mesh: their vertices and faces one after the other."""
        if len(self.objects) == 1:
            return self.objects[0].mesh
        starts = np.cumsum([0] + [len(o.mesh.vertices) for o in self.objects[:-1]])
        return TriangleMesh(
            vertices=np.concatenate([o.mesh.vertices for o in self.objects]),
            faces=np.concatenate([o.mesh.faces + s for o, s in zip(self.objects, starts, strict=True)]),
        )

    @property
    def reflections(self) -> np.ndarray:
        """(V,) complex128 reflection amplitude of every vertex of `mesh`."""
        return np.concatenate([np.full(len(o.mesh.vertices), o.material.reflection) for o in self.objects])

    @property
    def alpha(self) -> tuple[float, float]:
        """The first object's default weights for specular and edge image."""
        return self.objects[0].material.alpha
