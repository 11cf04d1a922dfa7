"""What training and test must not share: each leak is found, and refused by name."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.evaluation import TestImage, classes_of, plan_splits, training_of
from millisight.evaluation._answers import CLOSED, DISJOINT
from millisight.evaluation._leaks import (
    NO_CLASS,
    SAME_POSE,
    VALIDATION,
    check_physics,
    check_seeds,
    nearest_pose_deg,
    siblings,
    side_of,
)
from millisight.meshes import catalogue_name
from millisight.perception.segmentation import WAVE_WEIGHTS

RECIPES = Path(__file__).parents[2] / "examples" / "recipes"
RIG = "virtual rig: physical optics"
CLASSES = {"mug": "can", "lemon": "sphere", "dice": "box"}
TOLD = {
    "objects": {"training": ["mug", "b_cups", "fork"], "validation": ["dice"]},
    "poses": {"mug": [[0, 0, 90], [5, 0, 10.5]], "b_cups": [[0, 0, 0]], "fork": [], "dice": [[0, 0, 0]]},
    "seed": 3,
    "physics": "paper's simulator: point reflectors",
}


def training(**changes):
    return training_of("mine", {**TOLD, **changes})


def image(name="lemon", angles=(0, 0, 30), *, physics=RIG, seeds=(76,)):
    scene = f"{name}/{'_'.join(map(str, angles))}/exp1/los"
    return TestImage(scene, name, angles, physics, frozenset(seeds))


class TestSides:
    @pytest.mark.parametrize(
        ("name", "angles", "side"),
        [
            ("mug", (0, 0, 30), CLOSED),
            ("025_mug", (0, 0, 30), CLOSED),  # by its folder, as a scan is called
            ("025-Mug", (0, 0, 30), CLOSED),  # spelled otherwise
            ("065-B cups", (0, 0, 30), CLOSED),
            ("065b_cups_b", (0, 0, 30), CLOSED),  # its folder in the published dataset
            ("cups_b", (0, 0, 30), CLOSED),
            ("MUG", (0, 0, 30), CLOSED),
            ("025 mug", (0, 0, 30), CLOSED),
            ("scans/025_mug.ply", (0, 0, 30), CLOSED),
            ("025_mug/google_16k/nontextured.stl", (0, 0, 30), CLOSED),
            ("000_025_mug", (0, 0, 30), CLOSED),  # a recipe's own file of that name
            ("mug", (0, 0, 91), SAME_POSE),
            ("mug", (0, 0, 92), CLOSED),
            ("fork", (0, 0, 0), CLOSED),
            ("dice", (0, 0, 45), VALIDATION),
            ("lemon", (0, 0, 0), DISJOINT),
            ("c_cups", (0, 0, 0), DISJOINT),
        ],
    )
    def test_by_what_was_seen(self, name, angles, side):
        assert side_of(training(), name, angles) == side

    def test_what_is_in_training_and_validation_is_known(self):
        both = training(objects={"training": ["mug"], "validation": ["mug"]})
        assert side_of(both, "mug", (0, 0, 30)) == CLOSED

    def test_poses_are_apart_by_the_angle_between_them(self):
        one = training(poses={**TOLD["poses"], "fork": [[30, 20, 10]]})
        assert nearest_pose_deg(one, "fork", (30, 20, 10)) == pytest.approx(0, abs=1e-5)
        assert nearest_pose_deg(one, "fork", (30, 20, 170)) == pytest.approx(160)
        # Tilted by 90° about y, angles about x and z are about one axis, and make up for each other.
        one = training(poses={**TOLD["poses"], "fork": [[0, 90, 0]]})
        assert nearest_pose_deg(one, "fork", (40, 90, 40)) == pytest.approx(0, abs=1e-5)
        assert nearest_pose_deg(one, "fork", (-20, 90, 40)) == pytest.approx(60)
        assert nearest_pose_deg(one, "fork", (0, 90, 360)) == pytest.approx(0, abs=1e-5)
        assert nearest_pose_deg(one, "lemon", (0, 0, 0)) == np.inf


class TestChecks:
    def test_no_seed_is_shared(self):
        check_seeds(training(), [1, 2, 4])
        with pytest.raises(InputError, match="mine was trained with the seed 3"):
            check_seeds(training(), [2, 3])

    def test_the_physics_of_training_is_not_that_of_the_test(self):
        check_physics(training(), [RIG, ""])
        with pytest.raises(
            InputError, match="images of the same physics as the test images, 'virtual rig: physical optics'"
        ):
            check_physics(training(physics="Virtual  rig: of last year"), ["", RIG])
        for same in ("simulator of the paper: point reflectors", "published simulator"):
            with pytest.raises(InputError, match="images of the same physics"):
                check_physics(training(), [same])
        with pytest.raises(InputError, match="does not state the physics"):
            check_physics(training(physics=""), [""])

    @pytest.mark.parametrize("blank", [None, "  ", 3, ["virtual rig"]])
    def test_training_has_to_state_its_physics_in_words(self, blank):
        with pytest.raises(InputError, match="does not state the physics of its images; train it again"):
            training(physics=blank)

    @pytest.mark.parametrize(("learned", "tested"), [("rays: mine", RIG), ("paper's simulator", "simulated")])
    def test_physics_that_is_not_known_is_never_taken_for_another_one(self, learned, tested):
        (note,) = plan_splits(training(physics=learned), [image(physics=tested), image(physics="")], CLASSES).notes
        assert note.startswith("mine: whether the physics of the test images is other than that of training is unknown")
        assert repr(learned) in note
        assert repr(tested) in note
        assert plan_splits(training(), [image(), image(physics="")], CLASSES).notes == ()


class TestPlan:
    def test_every_image_stands_in_one_table_or_in_none_for_a_reason(self):
        images = [
            image("mug"), image("mug", (0, 0, 90)), image("dice"), image(), image("lemon", (0, 0, 40)), image("plate")
        ]  # fmt: skip
        found = plan_splits(training(), images, CLASSES)
        assert found.placed == {
            "mug/0_0_30/exp1/los": (CLOSED, "can"),
            "lemon/0_0_30/exp1/los": (DISJOINT, "sphere"),
            "lemon/0_0_40/exp1/los": (DISJOINT, "sphere"),
        }
        assert found.left_out == {
            SAME_POSE: ["mug/0_0_90/exp1/los"],
            VALIDATION: ["dice/0_0_30/exp1/los"],
            NO_CLASS: ["plate/0_0_30/exp1/los"],
        }

    @pytest.mark.parametrize(
        ("leaking", "said"),
        [({"seeds": (76, 3)}, "seed 3"), ({"physics": "paper's simulator: another"}, "physics as the test images")],
    )
    def test_one_leaking_image_is_enough_to_refuse_all(self, leaking, said):
        with pytest.raises(InputError, match=said):
            plan_splits(training(), [image(), image("banana", **leaking)], CLASSES)

    def test_real_images_have_neither_seeds_nor_physics(self):
        assert plan_splits(training(), [image(physics="", seeds=())], CLASSES).placed.values()


class TestDescriptions:
    @pytest.mark.parametrize(
        "changes",
        [
            {"objects": {"training": ["mug"]}}, {"objects": None}, {"poses": None}, {"poses": ["mug"]}, {"seed": None},
            {"poses": {"mug": 3}},
        ],
    )  # fmt: skip
    def test_who_does_not_tell_of_training_is_not_judged(self, changes):
        with pytest.raises(InputError, match="does not state the objects, poses, seed and physics of its training"):
            training(**changes)

    @pytest.mark.parametrize("key", TOLD)
    def test_every_part_is_needed(self, key):
        with pytest.raises(InputError, match="train it again"):
            training_of("mine", {name: value for name, value in TOLD.items() if name != key})

    def test_poses_are_those_of_all_objects_and_three_angles_each(self):
        with pytest.raises(InputError, match="states no poses of dice, fork"):
            training(poses={"mug": [[0, 0, 0]], "b_cups": []})
        with pytest.raises(InputError, match="poses of mug of mine has shape"):
            training(poses={**TOLD["poses"], "mug": [[0, 0]]})

    def test_classes_are_the_catalogues_or_its_own(self):
        known = classes_of({}, ("can", "box"))
        assert known["cracker_box"] == "box"
        assert set(known.values()) == {"can", "box"}
        told = {"can": ["003_cracker_box"], "box": ["gear"], "other": ["fork"]}
        assert classes_of({"classes": told}, ("can", "box")) == {**known, "cracker_box": "can", "gear": "box"}
        stated = {"000_My gear": "can", "gear": "can", "vase": "ball", "lemon": "box"}
        found = classes_of({"classes": told}, ("can", "box"), stated)  # the classifier's own classes come first
        assert found == {**known, "cracker_box": "can", "gear": "box", "my_gear": "can", "lemon": "box"}
        for wrong in (3, {"can": "gear"}):
            with pytest.raises(InputError, match="expected lists of objects' names by class"):
                classes_of({"classes": wrong}, ("can",))

    def test_siblings_are_told(self):
        assert siblings(training(), ["c_cups", "lemon", "a_lego_duplo"]) == {"c_cups": ["b_cups"]}


def test_no_shipped_segmenter_saw_an_object_of_the_test_images():
    recipe = tomllib.loads((RECIPES / "unseen.toml").read_text())
    tested = {catalogue_name(name) for name in recipe["objects"]["names"]}
    assert len(tested) == 38
    shipped = sorted(WAVE_WEIGHTS.parent.glob("*.json"))
    assert shipped
    for path in shipped:
        told = json.loads(path.read_text())
        seen = {name for side in told["objects"].values() for name in side}
        assert len(seen) >= 24
        assert not seen & tested, path.name
        assert told.get("seed") != recipe["seed"]
