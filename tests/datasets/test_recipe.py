"""Recipes: what they mean, what is refused and where, and jobs that depend on nothing but themselves."""

import dataclasses
import json
import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from helpers import oracles, small_recipe
from millisight.core import rotation_from_euler_deg
from millisight.core.errors import FileError, FormatError, InputError, UnknownNameError
from millisight.datasets import prepare_objects
from millisight.datasets._generated_objects import box_of, differ_in_size, lying_like
from millisight.datasets.generation import RigJob, _cost, _generate, plan_dataset, read_recipe, recipe_from_table
from millisight.datasets.generation._jobs import jobs_of, poses_of
from millisight.datasets.generation._recipe import Objects, PoseSettings
from millisight.meshes import CATALOGUE, build_object, find_scans, load_mesh

RIG = small_recipe.table()["rig"]


def jobs(**changes):
    recipe = small_recipe.recipe(**changes)
    return jobs_of(recipe, prepare_objects(recipe))


def test_the_recipes_that_are_shipped_can_be_read():
    paths = sorted((Path(__file__).parents[2] / "examples" / "recipes").glob("*.toml"))
    assert len(paths) >= 4
    for path in paths:
        recipe = read_recipe(path)
        assert recipe.name == path.stem
        assert recipe.about


@pytest.mark.slow
def test_the_longest_object_fits_into_the_recipe_of_the_papers_size(monkeypatch):
    monkeypatch.setattr(_generate, "_slowness", lambda *_: _cost.Slowness())  # which no scan here is tried for
    whole = read_recipe(Path(__file__).parents[2] / "examples" / "recipes" / "paper.toml")
    rig = dataclasses.replace(whole.rig, conditions=("los",))
    made = plan_dataset(dataclasses.replace(whole, objects=Objects(names=("skillet",)), rig=rig), "paper").todo
    assert len(made) == 5
    assert {job.world.objects[0].at for job in made if job.world.objects} == {(0.175, 0.3)}


def test_objects_are_chosen_by_name_category_and_class():
    assert Objects(names=("025_mug", "golf_ball")).chosen == ("mug", "golf_ball")
    assert Objects(all=True).chosen == tuple(CATALOGUE)
    cans = Objects(classes=("can",)).chosen
    assert len(cans) >= 5
    assert {CATALOGUE[name].shape_class for name in cans} == {"can"}
    assert set(Objects(classes=("can",), without=("tuna_fish_can",)).chosen) == set(cans) - {"tuna_fish_can"}
    both = Objects(names=("mug",), categories=("tool",)).chosen
    assert set(both) == {"mug"} | {name for name, entry in CATALOGUE.items() if entry.category == "tool"}


@pytest.mark.parametrize(
    ("changes", "place", "said"),
    [
        ({"objects": {"names": ["mugg"]}}, "recipe: objects", "unknown catalogue object 'mugg'. Did you mean 'mug'"),
        ({"objects": {"categories": ["toys"]}}, "recipe: objects", "unknown category 'toys'"),
        ({"objects": {"names": []}}, "recipe: ", "the recipe has no object"),
        ({"objects": {"names": ["mug"], "without": ["mug"]}}, "recipe: objects", "without removes every object"),
        ({"objects": {"names": "mug"}}, "recipe: objects.names", "expected a list"),
        ({"objects": {"name": ["mug"]}}, "recipe: objects.name", "unknown key 'name'. Did you mean 'names'"),
        ({"colour": 1}, "recipe: colour", "unknown key"),
        ({"rig": RIG | {"covers": {"clearance": [0.04, 0.01]}}}, "recipe: rig.covers", "the smaller first"),
        ({"rig": RIG | {"image": {"beyond": 0.05}}}, "recipe: rig.image", "state a margin, too"),
        ({"folder": "."}, "recipe: folder", "unknown key"),
        ({"seed": 1.5}, "recipe: ", "seed is 1.5; expected a whole number"),
        ({"name": " "}, "recipe: ", "expected a name"),
        ({"name": None}, "recipe: ", "name is missing"),
        ({"rig": None, "simulator": None}, "recipe: ", "nothing to generate"),
        ({"rig": {**RIG, "conditions": []}}, "recipe: rig", "expected the line of sight"),
        ({"rig": {**RIG, "conditions": ["carton"]}}, "recipe: rig", "expected the line of sight"),
        ({"rig": {**RIG, "conditions": ["los", "fog"]}}, "recipe: rig", "unknown condition 'fog'"),
        ({"rig": {**RIG, "conditions": ["los", "carton", "carton"]}}, "recipe: rig", "name each once"),
        ({"rig": {**RIG, "backgrounds": []}}, "recipe: rig", "no background is named"),
        ({"rig": {**RIG, "keep": "all"}}, "recipe: rig", "unknown keep 'all'"),
        ({"rig": {**RIG, "empty": ["60_ghz"]}}, "recipe: rig", "unknown radar '60_ghz'"),
        ({"rig": {**RIG, "image": {"spacing": [0.01, 0.01]}}}, "recipe: rig.image.spacing", "expected 3 entries"),
        ({"rig": {**RIG, "image": {"spacing": [0, 0.01, 0.01]}}}, "recipe: rig.image", "expected at least 1e-05 m"),
        ({"rig": {**RIG, "image": {"spacing": [0.01, 0.01, 5e-324]}}}, "recipe: rig.image", "at least 1e-05 m"),
        ({"name": "x" * 50_000}, "recipe: ", "of 200 characters at most"),
        ({"rig": 3}, "recipe: rig", "expected a table"),
        ({"poses": {"angles_deg": [[0] * 1000]}}, "recipe: poses.angles_deg[0]", "expected 3 entries"),
        ({"poses": {"angles_deg": []}}, "recipe: poses", "expected at least one pose"),
        ({"poses": {"angles_deg": [[0, 0]]}}, "recipe: poses.angles_deg[0]", "expected 3 entries"),
        ({"poses": {"angles_deg": [[0, 0, 0.5]]}}, "recipe: poses: angles_deg[0]", "expected a whole number"),
        ({"poses": {"angles_deg": [[0, 0, 0], [0, 0, 0]]}}, "recipe: poses", "states a pose twice"),
        ({"poses": {"count": 3, "z_deg": [0, 1]}}, "recipe: poses", "only 2 other whole angles"),
        ({"poses": {"count": 1, "z_deg": [9, 1]}}, "recipe: poses", "the smaller first"),
        ({"poses": {"count": True}}, "recipe: poses.count", "expected a whole number"),
        ({"simulator": {"models": ["matte"]}}, "recipe: simulator", "unknown model 'matte'"),
        ({"simulator": {"step": 0}}, "recipe: simulator", "step is 0 wavelengths"),
        ({"splits": {"train": 0.9, "val": 0.2, "test": 0.1}}, "recipe: splits", "expected a sum of 1"),
        ({"scenes": [{"objects": [{"object": "mug"}]}]}, "recipe: scenes[0]", "expected at least two"),
        ({"scenes": [{"objects": [{"object": "mug"}, {"object": "cat"}]}]}, "recipe: scenes[0].objects[1]", "unknown"),
        ({"scenes": [{"objects": [{"offset": [0, 0]}, {}]}]}, "recipe: scenes[0].objects[0]", "object is missing"),
        ({"files": [{"path": "mug.stl"}]}, "recipe: ", "files: two objects would be called 'mug'"),
        ({"files": [{"path": "a.stl", "material": "gold"}]}, "recipe: files[0]", "unknown material 'gold'"),
        ({"files": [{"path": "a.stl", "class": "tin"}]}, "recipe: files[0]", "unknown class 'tin'"),
    ],
)
def test_what_cannot_be_right_is_refused_and_its_place_named(changes, place, said):
    with pytest.raises(FormatError) as refused:
        small_recipe.recipe(**changes)
    assert len(str(refused.value)) < 700
    assert str(refused.value).startswith(place)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("rig", "place", "said"),
    [
        ({"world": {"scan": {"sice": [1, 1]}}}, "recipe: rig.world: scan.sice", "unknown key"),
        ({"world": {"arm": {"speed": -1}}}, "recipe: rig.world: arm", "speed is -1"),
        ({"world": {"seed": 1}}, "recipe: rig.world.seed", "leave it out"),
        ({"scans": [{"objects": []}]}, "recipe: rig.scans[0].objects", "leave it out"),
        ({"scans": [{"radars": [{"preset": "x"}]}]}, "recipe: rig.world with rig.scans[0]: radars[0]", "unknown radar"),
        ({"scans": [{}, {}]}, "recipe: rig.scans", "expected one scan of each radar"),
        (
            {"scans": [{}, {"radars": [{"preset": "iwr1443"}], "scan": {"corner": [0, 0.1]}}]},
            "recipe: rig.scans[1].scan",
            "give both one middle",
        ),
    ],
)
def test_tables_of_a_world_are_checked_in_their_place(rig, place, said):
    with pytest.raises(FormatError) as refused:
        jobs(rig={**RIG, **rig})
    assert str(refused.value).startswith(place)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"objects": {"names": ["hammer"]}, "simulator": None}, ["036", "048_hammer", "cm wide along x, the aperture"]),
        ({"objects": {"names": ["hammer"]}, "rig": None}, ["048_hammer/simulation", "the aperture only 10.0 cm"]),
        (
            {
                "objects": {"names": ["hammer"]}, "poses": {"angles_deg": [[0, 90, 0]]}, "simulator": None,
                "rig": {**RIG, "world": {**RIG["world"], "scan": {"size": [0.4, 0.4]}}},
            },
            ["048_hammer/robot_collected/0_90_0", "the radars move at z = 0"],
        ),
        (
            {"objects": {"names": ["hammer"]}, "poses": {"angles_deg": [[0, 90, 0]]}, "rig": None,
             "simulator": {"size": [0.4, 0.4], "height": 0.1}},
            ["048_hammer/simulation/0_90_0", "raise simulator.height"],
        ),
        (
            {"rig": {**RIG, "world": {**RIG["world"],
                                      "walls": [{"lower": [0, 0, -0.4], "upper": [0.3, 0.5, -0.28]}]}}},
            ["058_golf_ball", "and walls[0] intersect"],
        ),
        (
            {"scenes": [{"objects": [{"object": "golf_ball"}, {"object": "mug", "offset": [0.01, 0]}]}],
             "rig": {**RIG, "world": {**RIG["world"], "scan": {"size": [0.4, 0.4]}}}, "simulator": None},
            ["058_golf_ball+025_mug", "intersect"],
        ),
    ],
)  # fmt: skip
def test_what_is_impossible_is_refused_before_the_work_and_writes_nothing(changes, said, tmp_path):
    with pytest.raises(InputError) as refused:
        plan_dataset(small_recipe.recipe(**changes), tmp_path / "out")
    assert str(refused.value).startswith("recipe: cannot be generated: ")
    for text in said[-2:]:
        assert text in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_experiments_are_numbered_and_sights_paired():
    made = jobs(
        rig={**RIG, "conditions": ["los", "carton", "carton+cloth"], "backgrounds": ["tripod", "styrofoam"]},
        poses={"angles_deg": [[0, 0, 0], [0, 0, 90]]},
        simulator=None,
    )
    folders = [job.folder.removeprefix("058_golf_ball/robot_collected/") for job in made if job.world.objects]
    assert folders == [
        f"0_0_{angle}/exp{first + number}/{sight}"
        for angle, first in ((0, 1), (0, 3), (90, 5), (90, 7))
        for number, sight in ((0, "los"), (0, "nlos"), (1, "nlos"))
    ]
    empty = [job for job in made if not job.world.objects]
    assert [job.folder.split("/")[0] for job in empty] == ["tripod_background", "styrofoam_background"]
    assert [job.image_folder.split("/")[0] for job in empty] == ["tripod_EMPTY", "styrofoam_EMPTY"]
    assert made[: len(empty)] == tuple(empty)
    for job in made[len(empty) :]:
        assert job.empty == {"24_ghz": f"{job.world.support.kind}_background/robot_collected/0_0_0/exp1/los"}
    by_folder = {job.folder: job for job in made}
    for job in made:
        if job.folder.endswith("/nlos") and (pair := by_folder.get(job.folder.replace("nlos", "los"))):
            # The same object, unmoved, and the same scan; other noise.
            assert [dataclasses.asdict(o) for o in job.world.objects] == [
                dataclasses.asdict(o) for o in pair.world.objects
            ]
            assert dataclasses.asdict(job.world.scan) == dataclasses.asdict(pair.world.scan)
            assert job.world.seed != pair.world.seed
            assert job.info == pair.info
    hidden = Counter(
        (job.world.carton is not None, job.world.cloth.layers if job.world.cloth else 0) for job in made[len(empty) :]
    )
    assert hidden == {(False, 0): 4, (True, 0): 4, (True, 4): 4}


def test_one_of_the_jobs_that_share_a_file_tells_of_it():
    made = jobs(rig={**RIG, "conditions": ["los", "carton", "carton+cloth"], "scans": [
        {}, {"radars": [{"preset": "iwr1443"}]}]})  # fmt: skip
    rigs = [job for job in made if isinstance(job, RigJob)]
    assert len(rigs) == 7
    assert Counter(job.folder.rsplit("/", 1)[0] for job in rigs if job.first) == Counter(
        {job.folder.rsplit("/", 1)[0] for job in rigs}
    )


def test_a_job_depends_on_nothing_else_in_the_recipe():
    texts = [
        {job.key: json.dumps(job.description(), sort_keys=True) for job in made}
        for made in (
            jobs(),
            jobs(
                objects={"names": ["a_marbles", "golf_ball", "tuna_fish_can"]},
                rig={**RIG, "conditions": ["los", "carton", "cloth"], "world": {**RIG["world"], "scan": {
                    **RIG["world"]["scan"], "size": [0.1, 0.1]}}},
            ),
        )
    ]  # fmt: skip
    few, many = texts
    assert len(many) > len(few) == 4
    # The empty scene is looked at over the largest aperture of all.
    alone = [key for key in few if "background" not in key]
    assert len(alone) == 3
    conditions = {key: json.loads(text) for key, text in many.items()}
    for key in alone:
        expected, found = json.loads(few[key]), conditions[key]
        assert found == expected
    others = [json.loads(text)["world"]["seed"] for text in many.values() if "world" in json.loads(text)]
    assert len(set(others)) == len(others) == 10


def test_another_seed_gives_other_random_numbers_and_nothing_else():
    one, other = jobs(poses={"count": 2, "shift": 0.005}), jobs(poses={"count": 2, "shift": 0.005}, seed=4)
    assert len(one) == len(other) == 7
    again = jobs(poses={"count": 2, "shift": 0.005})
    assert [job.description() for job in one] == [job.description() for job in again]
    assert all(a.description() != b.description() for a, b in zip(one[1:5], other[1:5], strict=True))


def test_drawn_poses_lie_in_their_ranges_and_are_no_two_alike():
    poses = PoseSettings(angles_deg=((0, 0, 5),), count=59, x_deg=(0, 180), y_deg=(-1, 1), z_deg=(0, 9), shift=0.01)
    drawn = poses_of(poses, np.random.default_rng(0))
    assert len(drawn) == 60
    assert drawn[0].angles_deg == (0, 0, 5)
    angles = np.array([pose.angles_deg for pose in drawn])
    assert len(set(map(tuple, angles.tolist()))) == 60
    assert (angles.min(axis=0) >= [0, -1, 0]).all()
    assert (angles.max(axis=0) <= [180, 1, 9]).all()
    assert np.ptp(angles, axis=0)[1] == 2
    offsets = np.array([pose.offset for pose in drawn])
    assert np.abs(offsets).max() <= 0.01
    assert (np.ptp(offsets, axis=0) > 0.015).all()


def test_apertures_and_images_are_cut_around_the_object_on_one_lattice():
    one, other = (
        next(job for job in jobs(objects={"names": [name]}) if isinstance(job, RigJob) and job.world.objects)
        for name in ("golf_ball", "tuna_fish_can")
    )
    for job, size in ((one, 0.065), (other, 0.1)):
        # 43 mm and 1 cm on every side; the can's 85 mm and that are more than the world's scan.
        assert job.world.scan.size == pytest.approx((size, size))
        assert job.world.scan.middle == pytest.approx([0.17, 0.28])
        assert job.world.objects[0].at == pytest.approx((0.17, 0.28))


def test_covers_are_drawn_for_each_experiment_and_the_same_for_its_radars():
    covers = {"cartons": 3, "clearance": [0.01, 0.04], "thickness": [0.0025, 0.004], "tilt_deg": 2.0, "empty": 2}
    rig = RIG | {"conditions": ["los", "carton"], "covers": covers}
    made = [job for job in jobs(rig=rig) if isinstance(job, RigJob)]
    hidden = [job for job in made if job.world.carton and job.world.objects]
    by_folder = {job.folder: job.world.carton for job in hidden}
    for job in hidden:
        assert asdict(job.world.carton) == asdict(by_folder[job.folder])
    subjects = {Path(folder).parents[1] for folder in by_folder}
    assert len(by_folder) == 3 * len(subjects)
    for name, (low, high) in {"clearance": (0.01, 0.04), "thickness": (0.0025, 0.004)}.items():
        values = [getattr(carton, name) for carton in by_folder.values()]
        assert low <= min(values) < max(values) <= high
    assert max(abs(angle) for carton in by_folder.values() for angle in carton.tilt_deg) <= 2
    # Turned or not, all else is drawn alike.
    more = jobs(rig=rig | {"covers": covers | {"turn_deg": 45.0}})
    turned = {job.folder: job.world.carton for job in more if isinstance(job, RigJob) and job.world.carton}
    assert 20 < max(abs(turned[folder].turn_deg) for folder in by_folder) <= 45
    for folder, carton in by_folder.items():
        assert asdict(turned[folder]) | {"turn_deg": 0.0} == asdict(carton)
    empty = {job.folder for job in made if job.world.carton and not job.world.objects}
    assert len(empty) == 2
    assert all("EMPTY" in folder for folder in empty)
    again = {job.folder: job.world.carton for job in jobs(rig=rig) if isinstance(job, RigJob) and job.world.carton}
    assert all(asdict(again[folder]) == asdict(carton) for folder, carton in by_folder.items())


def test_images_reach_further_on_sides_that_are_drawn():
    near = RIG | {"image": RIG["image"] | {"margin": 0.01}}
    far = RIG | {"image": RIG["image"] | {"margin": 0.01, "beyond": 0.05}}
    reach = {job.key: job.beyond for job in jobs(rig=far) if isinstance(job, RigJob)}
    assert all(0 <= side <= 0.05 for sides in reach.values() for side in sides)
    assert len(set(reach.values())) > 1
    assert {job.beyond for job in jobs(rig=near) if isinstance(job, RigJob)} == {(0.0, 0.0, 0.0, 0.0)}


def test_files_are_taken_from_beside_the_recipe(tmp_path):
    build_mesh = build_object("padlock")
    from trimesh import Trimesh

    Trimesh(build_mesh.vertices * 1000 + 5, build_mesh.faces).export(tmp_path / "lock.ply")
    recipe = recipe_from_table(
        small_recipe.table(files=[{"path": "lock.ply", "unit": "mm", "material": "brass", "class": "other"}]),
        folder=str(tmp_path),
    )
    things = prepare_objects(recipe)
    assert list(things) == ["golf_ball", "lock"]
    lock = things["lock"]
    assert (lock.folder, lock.source, lock.material) == ("000_lock", "file", "brass")
    assert lock.mesh.bounds == pytest.approx(build_mesh.bounds, abs=1e-6)
    scans = [job for job in jobs_of(recipe, things) if isinstance(job, RigJob)]
    stated = {(job.folder.split("/")[0], job.info.get("class")) for job in scans}
    assert stated == {("000_lock", "other"), ("058_golf_ball", None), ("tripod_background", None)}
    killed = tmp_path / lock.folder / ".nontextured.0123abcd.part.stl"  # left by a run
    killed.parent.mkdir()
    killed.touch()
    os.utime(killed, (0, 0))
    lock.write(tmp_path)
    assert [path.name for path in killed.parent.iterdir()] == ["nontextured.stl"]
    (tmp_path / lock.path).write_bytes(b"mine")
    with pytest.raises(FileError, match="was not made here"):
        lock.write(tmp_path)
    lock.write(tmp_path, known={lock.path})
    assert load_mesh(tmp_path / lock.path, unit="m").bounds == pytest.approx(build_mesh.bounds, abs=1e-6)
    (tmp_path / "lock.step").touch()
    with pytest.raises(UnknownNameError, match=r"^files: unknown mesh format 'step'"):
        prepare_objects(recipe_from_table(small_recipe.table(files=[{"path": str(tmp_path / "lock.step")}])))
    with pytest.raises(FileError, match="files: .*gone.ply"):
        prepare_objects(recipe_from_table(small_recipe.table(files=[{"path": "gone.ply"}])))


def spread(mesh):
    """Mean distance of the vertices of one mesh from those of another [m]."""
    return lambda other: KDTree(other.vertices).query(mesh.vertices)[0].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["power_drill", "banana"])
def test_a_scan_is_turned_to_lie_as_the_catalogue_does(name):
    shape = build_object(name)
    stood = shape.moved(rotation=rotation_from_euler_deg((77.0, -31.0, 140.0)), translation=np.array([0.3, 0.1, -2.0]))
    assert spread(stood)(shape) > 0.3
    turned = lying_like(stood, shape)
    assert spread(turned)(shape) < 0.004
    assert np.abs(turned.bounds + turned.bounds[::-1]).max() < 1e-9


def scanned_as(folder, ycb_id, mesh):
    """A folder with a scan of that name."""
    from trimesh import Trimesh

    Trimesh(mesh.vertices, mesh.faces).export(folder / f"{ycb_id}.ply")
    return folder


def bricks(folder):
    return prepare_objects(small_recipe.recipe(objects={"names": ["a_lego_duplo"]}), meshes=folder)["a_lego_duplo"]


def test_a_scan_of_another_size_is_told_and_not_turned_to_fit(tmp_path, caplog):
    other = build_object("b_lego_duplo").moved(translation=np.array([0.1, -0.2, 0.3]))
    found = bricks(scanned_as(tmp_path, "073-a_lego_duplo", other))
    assert found.source == "scan"
    assert found.mesh.extent == pytest.approx(other.extent, abs=1e-6)  # standing, as it stood
    assert np.abs(found.mesh.bounds.sum(axis=0)).max() < 1e-9
    assert "073-a_lego_duplo.ply, taken for 073-a_lego_duplo, measures 31.8 x 31.8 x" in caplog.text
    assert "it may be another object" in caplog.text
    assert found.mesh.extent[2] > found.mesh.extent[0]


def test_a_scan_of_its_own_size_is_turned_without_a_word(tmp_path, caplog):
    shape = build_object("a_lego_duplo")
    stood = shape.moved(rotation=rotation_from_euler_deg((90.0, 0.0, 30.0)))
    found = bricks(scanned_as(tmp_path, "073-a_lego_duplo", stood))
    assert found.mesh.extent == pytest.approx(shape.extent, abs=1e-3)
    assert "another object" not in caplog.text


def test_sizes_are_compared_by_the_longest_edge():
    size = np.array([0.01, 0.05, 0.2])
    assert not differ_in_size(size, size + np.array([0.015, 0.0, 0.019]))
    assert differ_in_size(size, size + np.array([0.025, 0.0, 0.0]))
    assert differ_in_size(size, 1000 * size)
    sizes = {name: box_of(build_object(name))[1] for name in CATALOGUE if name.endswith("lego_duplo")}
    unlike = [(a, b) for a in sizes for b in sizes if a < b and not np.allclose(sizes[a], sizes[b])]
    assert len(unlike) == 19
    assert all(differ_in_size(sizes[a], sizes[b]) for a, b in unlike)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a_toy_airplane", "hammer", "mug"])
def test_real_scans_are_of_the_catalogues_sizes(name):
    scan = load_mesh(find_scans(oracles.shared("ycb"))[name], unit="m")
    assert not differ_in_size(box_of(scan)[1], box_of(build_object(name))[1])


@pytest.mark.slow
def test_real_scans_lie_as_the_catalogue_does():
    scans = find_scans(oracles.shared("ycb"))
    for name in ("cracker_box", "padlock"):
        shape = build_object(name)
        assert lying_like(load_mesh(scans[name], unit="m"), shape).extent == pytest.approx(shape.extent, abs=0.004)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"poses": {"count": 10_001, "x_deg": [0, 359]}}, "10001 poses; expected 10000 at most of an object"),
        ({"scenes": [{"objects": 101 * [{"object": "mug"}]}]}, "objects has 101 entries; expected 100 at most"),
    ],
)
def test_poses_and_objects_are_bounded(changes, said):
    with pytest.raises(FormatError, match=said):
        small_recipe.recipe(**changes)
