"""From a recipe to its jobs: what is made of which object, lying how, hidden by what, and with which seed.

A job's random numbers depend on the recipe's seed and the job's own name, so that it makes the same files whatever
else the recipe holds, whoever runs it, and in whatever order.
"""

import dataclasses
import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from millisight.core import rotation_from_euler_deg
from millisight.core.errors import FormatError
from millisight.datasets import DatasetObject
from millisight.datasets.generation._recipe import PoseSettings, Recipe, Rig
from millisight.datasets.generation._rig_job import PHYSICS, RigJob
from millisight.datasets.generation._simulator_job import Seen, SimulatorJob, cover
from millisight.io.mito import angles_folder, experiment_folder
from millisight.meshes import catalogue_name
from millisight.rig.virtual import Carton, Cloth, ScanSettings, World, WorldObject, experiment_info

Job = RigJob | SimulatorJob

EMPTY_FOLDERS = "{}_background", "{}_EMPTY"
"""Of the empty scenes' raw files and of their images, by background."""

_EMPTY_CARTON = "{}-carton_EMPTY"
_EMPTY_SIZES = (0.09, 0.09, 0.05), (0.24, 0.24, 0.14)  # of empty cartons, from and to [m]
_CLOTHS = 4
_MOST_JOBS = 200_000
_UPRIGHT = (0, 0, 0)


class Pose(NamedTuple):
    """How one object lies: angles about the fixed axes [degrees], and how far it is from the aperture's middle [m]."""

    angles_deg: tuple[int, int, int]
    offset: tuple[float, float]


class RecipeObject(NamedTuple):
    """What one experiment looks at."""

    folder: str  # `<id>_<name>` in the dataset; of several things their names, one after the other
    number: int  # of the pose among the object's
    things: tuple[DatasetObject, ...]  # one, or several
    poses: tuple[Pose, ...]  # of each

    @property
    def stated(self) -> dict[str, str]:
        """What `experiment_info.json` states of a single mesh file; the catalogue has the classes of its objects."""
        (thing, *others) = self.things
        return {"class": thing.shape_class} if thing.source == "file" and not others else {}

    @property
    def sources(self) -> dict[str, str]:
        """Checksums of the mesh files that are looked at, by path."""
        return {thing.path: thing.sha256 for thing in self.things if thing.source != "built"}

    def bounds(self) -> np.ndarray:
        """(2, 2) of all things along x and y, from the aperture's middle [m]."""
        boxes = []
        for thing, pose in zip(self.things, self.poses, strict=True):
            half = np.ptp(thing.mesh.vertices @ rotation_from_euler_deg(pose.angles_deg).T, axis=0)[:2] / 2
            boxes += [pose.offset - half, pose.offset + half]
        return np.array([np.min(boxes, axis=0), np.max(boxes, axis=0)])


def jobs_of(recipe: Recipe, things: Mapping[str, DatasetObject]) -> tuple[Job, ...]:
    """All jobs of a recipe: those of empty scenes first, since others subtract what they make.

    `things` are the recipe's objects by name, as `prepare` gives them.
    """
    _check_number(recipe)
    subjects = tuple(_subjects(recipe, things))
    jobs: list[Job] = []
    if recipe.rig is not None:
        jobs += _Scans(recipe, recipe.rig, subjects).jobs()
    if recipe.simulator is not None:
        jobs += _simulations(recipe, subjects)
    for job, count in Counter(job.key for job in jobs).items():
        if count > 1:
            raise FormatError(
                f"{recipe.source}: scenes: {job} would be made {count} times; use different angles for scenes of the "
                "same objects"
            )
    return tuple(jobs)


def _check_number(recipe: Recipe) -> None:
    """Refuse a recipe of too many jobs before they are made."""
    things = len(recipe.objects.chosen) + len(recipe.files)
    subjects = things * (len(recipe.poses.stated) + recipe.poses.count) + len(recipe.scenes)
    each, empty = 0, 0
    if (rig := recipe.rig) is not None:
        scans = max(1, len(rig.scans))
        each += scans * len(rig.backgrounds) * (1 + rig.hidden_count)
        empty = scans * len(rig.backgrounds) * (1 + (0 if rig.covers is None else rig.covers.empty))
    if recipe.simulator is not None:
        each += len(recipe.simulator.radars)
    if subjects * each + empty > _MOST_JOBS:
        raise FormatError(
            f"{recipe.source}: it has {subjects * each + empty} jobs; expected {_MOST_JOBS} at most: divide it into "
            "several, with names and seeds of their own"
        )


def seed_of(recipe: Recipe, *name: object) -> int:
    """A seed that follows from the recipe's and a name alone."""
    text = "/".join(map(str, (recipe.seed, *name)))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:6])


def _subjects(recipe: Recipe, things: Mapping[str, DatasetObject]) -> Iterator[RecipeObject]:
    own = [file.name for file in recipe.files]
    for name in (*recipe.objects.chosen, *own):
        thing = things[name]
        for number, pose in enumerate(poses_of(recipe.poses, np.random.default_rng(seed_of(recipe, "poses", name)))):
            yield RecipeObject(thing.folder, number, (thing,), (pose,))
    counts: Counter[str] = Counter()
    for scene in recipe.scenes:
        several = tuple(things[p.object if p.object in own else catalogue_name(p.object)] for p in scene.objects)
        folder = "+".join(thing.folder for thing in several)
        poses = tuple(Pose(placed.angles_deg, placed.offset) for placed in scene.objects)
        yield RecipeObject(folder, counts[folder], several, poses)
        counts[folder] += 1


def poses_of(poses: PoseSettings, rng: np.random.Generator) -> list[Pose]:
    """The stated poses of an object, then the drawn ones, no two with the same angles."""
    angles = dict.fromkeys(poses.stated)  # in the order in which they came
    while len(angles) < len(poses.stated) + poses.count:
        x, y, z = (int(rng.integers(low, high + 1)) for low, high in (poses.x_deg, poses.y_deg, poses.z_deg))
        angles[x, y, z] = None
    shifts = np.round(rng.uniform(-poses.shift, poses.shift, (len(angles), 2)), 4)
    return [Pose(turned, (float(x), float(y))) for turned, (x, y) in zip(angles, shifts, strict=True)]


class _Scans:
    """The rig's jobs."""

    def __init__(self, recipe: Recipe, rig: Rig, subjects: Sequence[RecipeObject]):
        self._recipe, self._rig, self._subjects = recipe, rig, subjects
        for name, table in {"rig.world": rig.world, **{f"rig.scans[{i}]": t for i, t in enumerate(rig.scans)}}.items():
            for key in ("seed", "objects"):
                if key in table:
                    raise FormatError(f"{recipe.source}: {name}.{key}: the recipe sets it itself; leave it out here")
        self._worlds = [
            {background: self._world(i, background) for background in rig.backgrounds}
            for i in range(max(1, len(rig.scans)))
        ]
        self._radars = [settings for worlds in self._worlds for settings in worlds[rig.backgrounds[0]].radars]
        folders = [settings.name for settings in self._radars]
        if len(set(folders)) < len(folders):
            raise FormatError(
                f"{recipe.source}: rig.scans: their radars' files go to {folders}; expected one scan of each radar"
            )
        middles = [worlds[rig.backgrounds[0]].scan.middle for worlds in self._worlds]
        for i, middle in enumerate(middles):
            if not np.allclose(middle, middles[0], rtol=0, atol=1e-6):
                raise FormatError(
                    f"{recipe.source}: rig.scans[{i}].scan: the aperture's middle is at {middle.tolist()} m, that of "
                    f"rig.scans[0] at {middles[0].tolist()} m; an object lies in the middle, and at one place in all "
                    "scans: give both one middle"
                )

    def jobs(self) -> list[Job]:
        empty = [job for background in self._rig.backgrounds for job in self._empty(background)]
        empty += [job for background in self._rig.backgrounds for job in self._empty_cartons(background)]
        return [*empty, *(job for subject in self._subjects for job in self._experiments(subject))]

    def _world(self, number: int, background: str) -> World:
        """The world of a scan on a background, as yet without objects and with whatever may hide them."""
        fragment = self._rig.scans[number] if self._rig.scans else {}
        table = _merged(self._rig.world, fragment)
        table = _merged(table, {"support": {"kind": background}})
        place = f"rig.world with rig.scans[{number}]" if self._rig.scans else "rig.world"
        return World.from_table(table, source=f"{self._recipe.source}: {place}")

    def _experiments(self, subject: RecipeObject) -> Iterator[Job]:
        """The scans of a subject in every condition on every background; experiments are numbered through."""
        hidden = self._rig.hidden
        for b, background in enumerate(self._rig.backgrounds):
            first = 1 + (subject.number * len(self._rig.backgrounds) + b) * max(1, len(hidden))
            for condition, number in (("los", first), *((c, first + i) for i, c in enumerate(hidden))):
                # What one experiment's two sights have in common.
                conditions = {"nlos": hidden[number - first]} if hidden else {}
                conditions |= {"los": "los"} if number == first else {}
                yield from self._scanned(subject, background, condition, number, conditions)

    def _scanned(
        self, subject: RecipeObject, background: str, condition: str, number: int, conditions: dict[str, str]
    ) -> Iterator[Job]:
        sight = "los" if condition == "los" else "nlos"
        folder = experiment_folder(".", subject.folder, subject.poses[0].angles_deg, number, sight).as_posix()
        for i, worlds in enumerate(self._worlds):
            world = self._around(worlds[background], subject)
            middle = world.scan.middle
            objects = tuple(_placed(t, p, middle) for t, p in zip(subject.things, subject.poses, strict=True))
            yield self._job(
                folder, world, background, conditions, condition=condition, objects=objects, camera=i == 0,
                first=i == 0 and (sight == "los" or "los" not in conditions), sources=subject.sources,
                stated=subject.stated,
                empty={radar: _empty_folder(0, background) for radar in self._subtracted if radar in _folders(world)},
            )  # fmt: skip

    @property
    def _subtracted(self) -> tuple[str, ...]:
        return tuple(radar for radar in self._rig.empty if radar == "24_ghz")

    def _empty(self, background: str) -> Iterator[Job]:
        """The empty scene, over an aperture as large as the largest of the others."""
        first = True
        for worlds in self._worlds:
            world = worlds[background]
            radars = tuple(settings for settings in world.radars if settings.name in self._rig.empty)
            if not radars:
                continue
            scans = [self._around(world, subject).scan for subject in self._subjects]
            world = _with_aperture(world, np.max([scan.size for scan in scans], axis=0))
            world = dataclasses.replace(world, radars=radars)
            folder = _empty_folder(0, background)
            yield self._job(
                folder, world, background, {"los": "los"}, condition="los", objects=(), camera=False, first=first,
                sources={}, empty={}, image_folder=_empty_folder(1, background), keep="raw",
            )  # fmt: skip
            first = False

    def _job(
        self, folder: str, world: World, background: str, conditions: dict[str, str], *,
        condition: str, objects: tuple[WorldObject, ...], camera: bool, first: bool, sources: Mapping[str, str],
        empty: Mapping[str, str], image_folder: str | None = None, keep: str | None = None,
        stated: Mapping[str, str] = MappingProxyType({}),
    ) -> RigJob:  # fmt: skip
        hiding = condition.split("+")
        carton, cloth = self._covers(world, folder, alone=not objects)
        world = dataclasses.replace(
            world,
            seed=seed_of(self._recipe, folder, *_folders(world)),
            objects=objects,
            carton=carton if "carton" in hiding else None,
            cloth=cloth if "cloth" in hiding else None,
        )
        # One for all scans of an experiment, whose radars it speaks of.
        info = experiment_info(dataclasses.replace(self._worlds[0][background], radars=tuple(self._radars)))
        info |= {"simulated": True, "physics": PHYSICS, "conditions": conditions, **stated}
        return RigJob(
            folder=folder, world=world, info=info, voxels=self._rig.image, keep=keep or self._rig.keep, camera=camera,
            first=first, sources=sources, empty=empty, image_folder=image_folder, beyond=self._beyond(folder),
        )  # fmt: skip

    def _beyond(self, folder: str) -> tuple[float, float, float, float]:
        """Of the images of an experiment, the same for both radars."""
        rng = np.random.default_rng(seed_of(self._recipe, folder, "beyond"))
        a, b, c, d = np.round(rng.uniform(0, self._rig.image.beyond, 4), 4).tolist()
        return a, b, c, d

    def _covers(self, world: World, folder: str, *, alone: bool) -> tuple[Carton, Cloth]:
        """The carton and the cloth of an experiment, the same for all its scans; `alone` with nothing in the carton."""
        carton, cloth = world.carton or Carton(), world.cloth or Cloth(layers=_CLOTHS)
        drawn = self._rig.covers
        if drawn is None:
            return carton, cloth
        rng = np.random.default_rng(seed_of(self._recipe, folder, "covers"))
        tilt = np.round(rng.uniform(-drawn.tilt_deg, drawn.tilt_deg, 2), 2).tolist()
        carton = dataclasses.replace(
            carton,
            clearance=_drawn(drawn.clearance, rng),
            thickness=carton.thickness if drawn.thickness is None else _drawn(drawn.thickness, rng),
            tilt_deg=tuple(tilt),
        )
        cloth = dataclasses.replace(cloth, gap=_drawn(drawn.gap, rng))
        if alone:
            size = np.round(rng.uniform(_EMPTY_SIZES[0], _EMPTY_SIZES[1]), 3).tolist()
            carton = dataclasses.replace(carton, size=tuple(size), clearance=0.0)
        if drawn.turn_deg:  # last, so that what was drawn before there were turns stays
            turn = round(float(rng.uniform(-drawn.turn_deg, drawn.turn_deg)), 1)
            carton = dataclasses.replace(carton, turn_deg=turn)
        return carton, cloth

    def _empty_cartons(self, background: str) -> Iterator[Job]:
        """Cartons with nothing in them, as large as those around objects; they test what finds objects."""
        for number in range(1, 1 + (0 if self._rig.covers is None else self._rig.covers.empty)):
            folder = experiment_folder(".", _EMPTY_CARTON.format(background), _UPRIGHT, number, "nlos").as_posix()
            for i, worlds in enumerate(self._worlds):
                world = worlds[background]
                carton, _ = self._covers(world, folder, alone=True)
                if self._rig.margin is not None and carton.size is not None:
                    turn = rotation_from_euler_deg((0, 0, carton.turn_deg))
                    half = (abs(turn) @ carton.size)[:2] / 2
                    size = cover(np.array([-half, half]), np.zeros(2), self._rig.margin)
                    world = _with_aperture(world, np.minimum(size, world.scan.size))
                empty = {radar: _empty_folder(0, background) for radar in self._subtracted if radar in _folders(world)}
                yield self._job(
                    folder, world, background, {"nlos": "carton"}, condition="carton", objects=(), camera=False,
                    first=i == 0, sources={}, empty=empty,
                )  # fmt: skip

    def _around(self, world: World, subject: RecipeObject) -> World:
        """The world with its aperture cut to what the subject needs."""
        if self._rig.margin is None:
            return world
        size = cover(subject.bounds(), np.zeros(2), self._rig.margin)
        return _with_aperture(world, np.minimum(size, world.scan.size))


def _drawn(ends: tuple[float, float], rng: np.random.Generator) -> float:
    """A length between two ends, to a tenth of a millimetre [m]."""
    return round(float(rng.uniform(*ends)), 4)


def _with_aperture(world: World, size: np.ndarray) -> World:
    """The world with a smaller aperture about the same middle."""
    x, y = np.round(world.scan.middle - size / 2, 6).tolist()
    scan: ScanSettings = dataclasses.replace(world.scan, size=tuple(size.tolist()), corner=(x, y))
    return dataclasses.replace(world, scan=scan)


def _placed(thing: DatasetObject, pose: Pose, middle: np.ndarray) -> WorldObject:
    x, y = np.round(middle + pose.offset, 6).tolist()
    if thing.source == "built":
        return WorldObject(object=thing.name, at=(x, y), rotate_deg=pose.angles_deg)
    return WorldObject(mesh=thing.path, unit="m", material=thing.material, at=(x, y), rotate_deg=pose.angles_deg)


def _folders(world: World) -> tuple[str, ...]:
    return tuple(settings.name for settings in world.radars)


def _empty_folder(which: int, background: str) -> str:
    return experiment_folder(".", EMPTY_FOLDERS[which].format(background), _UPRIGHT, 1, "los").as_posix()


def _merged(table: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """`table` with the values of `other` in the place of its own, table by table."""
    both = {key: _merged(table[key], value) for key, value in other.items()
            if isinstance(value, Mapping) and isinstance(table.get(key), Mapping)}  # fmt: skip
    return {**table, **other, **both}


def _simulations(recipe: Recipe, subjects: Sequence[RecipeObject]) -> Iterator[Job]:
    """The simulator's jobs: whatever shift an object has, it is the aperture's that follows."""
    settings = recipe.simulator
    if settings is None:
        return
    for subject in subjects:
        folder = angles_folder(".", subject.folder, subject.poses[0].angles_deg, simulated=True).as_posix()
        alone = len(subject.things) == 1
        objects = tuple(
            Seen(
                thing.name, "" if thing.source == "built" else thing.path, thing.material, pose.angles_deg,
                (0.0, 0.0) if alone else pose.offset,
            )
            for thing, pose in zip(subject.things, subject.poses, strict=True)
        )  # fmt: skip
        for radar in settings.radars:
            yield SimulatorJob(folder=folder, radar=radar, objects=objects, settings=settings, sources=subject.sources)
