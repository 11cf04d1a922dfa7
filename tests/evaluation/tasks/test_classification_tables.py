"""Tables of classifiers: what they count, and that the paper's rows are the paper's."""

import csv
import dataclasses
import io

import pytest

from helpers.some_answers import BOTH, EDGE, answer, several
from millisight.evaluation import PAPER, PREDICTED, TRUE, SplitPlan, chosen, training_of
from millisight.evaluation._answers import CLOSED, DISJOINT
from millisight.evaluation._leaks import SAME_POSE
from millisight.evaluation.tasks._classification_tables import (
    PAPER_IMAGES,
    accuracy_table,
    all_tables,
    answer_table,
    bin_table,
    calibration_table,
    classifier_table,
    confusion_table,
    mistake_table,
    object_table,
    pair_table,
    shape_table,
    time_table,
    worst,
)

ANSWERS = several()
DATA = "tests (virtual rig; simulated, not real data)"


def column(table, name):
    return [row[table.columns.index(name)] for row in table.rows]


def share(cell):
    return float(cell.split(" ")[0])


class TestAccuracy:
    def test_rows_are_variants_and_below_them_the_papers(self):
        table = accuracy_table(ANSWERS, DISJOINT, PREDICTED, data=DATA)
        assert column(table, "classifier") == ["shipped", "edges", *["paper: its real data"] * 3]
        assert [share(cell) for cell in column(table, "LOS [%]")] == [100, 50, 61.1, 77.7, 88.8]
        assert [share(cell) for cell in column(table, "NLOS [%]")] == [75, 50, 75, 75, 81.2]
        assert [share(cell) for cell in column(table, "overall [%]")] == [87.5, 50, 67.6, 76.4, 85.2]
        assert column(table, "overall images") == [24, 24, 34, 34, 34]
        assert column(table, "objects") == [4, 4, None, None, None]
        assert column(table, "NLOS [%]")[0] == "75.0 (46.8 to 91.1) [25.0 to 100.0]"
        assert column(table, "overall [%]")[-1] == "85.2 (69.9 to 93.6)"
        assert DATA in table.title
        assert "none of these objects was used in training" in table.notes[0]

    def test_of_other_classes_the_paper_has_no_rows(self):
        fruit = dataclasses.replace(chosen(ANSWERS, split=DISJOINT)[0], truth="fruit", prediction=None, failure="none")
        table = accuracy_table([*ANSWERS, fruit], fruit.split, PREDICTED, data=DATA)
        assert len(table.rows) >= 1
        assert "paper: its real data" not in column(table, "classifier")
        assert not any("paper" in note for note in table.notes)

    def test_true_masks_are_ours_alone(self):
        table = accuracy_table(ANSWERS, CLOSED, TRUE, data=DATA)
        assert column(table, "classifier") == ["shipped", "edges"]
        assert [share(cell) for cell in column(table, "overall [%]")] == [100, 75]
        assert "true masks" in table.title

    def test_where_there_are_no_images_nothing_is_said(self):
        table = accuracy_table(chosen(ANSWERS, sight="los"), CLOSED, TRUE, data=DATA)
        assert column(table, "NLOS [%]") == [None, None]
        assert column(table, "NLOS images") == [0, 0]

    @pytest.mark.parametrize("parts", PAPER)
    def test_the_papers_percents_are_of_whole_images(self, parts):
        for sight, (printed, right) in PAPER[parts].items():
            assert abs(100 * right / PAPER_IMAGES[sight] - printed) < 0.1  # it cuts digits, and does not round
        assert PAPER[parts]["overall"][1] == PAPER[parts]["los"][1] + PAPER[parts]["nlos"][1]


@pytest.mark.slow
def test_known_and_new_objects_are_never_in_one_table():
    tables = all_tables(ANSWERS, data=DATA)
    kinds = ("", "-true-masks", "-pairs", "-shapes", "-objects", "-mistakes", "-calibration")
    assert list(tables) == [*(f"{split}{kind}" for split in (CLOSED, DISJOINT) for kind in kinds)]
    assert all(DATA in table.title for table in tables.values())
    assert list(all_tables(chosen(ANSWERS, split=CLOSED, variant=BOTH), data=DATA)) == [
        f"{CLOSED}{kind}" for kind in kinds if kind != "-pairs"
    ]  # fmt: skip
    assert all_tables([], data=DATA) == {}


def test_shapes_and_classes_apart():
    table = shape_table(ANSWERS, DISJOINT, data=DATA)
    rows = {row[:3]: row for row in table.rows}
    assert [row[1] for row in table.rows[::2]] == ["built", "scan", "box", "can", "handle", "sphere"]
    assert rows["shape", "scan", "edges"][5] == "100.0 (61.0 to 100.0)"  # of one object
    assert [share(cell) for cell in rows["shape", "built", "shipped"][3:6]] == [100, 66.7, 83.3]
    assert rows["shape", "built", "shipped"][6:] == (18, 3)


def test_objects_say_what_they_were_taken_for():
    rows = {(row[0], row[3]): row[4:] for row in object_table(ANSWERS, CLOSED, data=DATA).rows}
    assert len(rows) == 8
    assert rows["fork", "edges"] == ("0 of 3", "0 of 3", "0 of 6", "can 6")
    assert rows["peach", "edges"] == ("0 of 3", "0 of 3", "0 of 6", "can 3, no mask 3")
    assert rows["dice", "shipped"] == ("3 of 3", "3 of 3", "6 of 6", "")


def test_mistakes_are_the_masks_or_the_classifiers():
    table = mistake_table(ANSWERS, DISJOINT, data=DATA)
    rows = {row[:2]: row[2:] for row in table.rows}
    # images, wrong, no mask, right in the true mask, wrong there too, spoilt by it, and overlaps
    assert rows["shipped", "line of sight"] == (12, 0, 0, 0, 0, 0, 0.8, None)
    assert rows["shipped", "out of sight"] == (12, 3, 3, 0, 0, 0, 0.8, 0.8)
    assert rows["edges", "overall"] == (24, 12, 3, 3, 6, 0, 0.8, 0.8)
    lost = [answer("box"), answer("can", masks=TRUE)]
    assert mistake_table(lost, DISJOINT, data=DATA).rows[0][7] == 1


def test_calibration_is_of_what_was_masked():
    rows = {row[:2]: row[2:] for row in calibration_table(ANSWERS, DISJOINT, data=DATA).rows}
    images, confidence, right, error, brier, threshold, unsure, among = rows["shipped", "out of sight"]
    assert (images, confidence, right, threshold, unsure) == (9, "90.0", "100.0", 0.5, "0.0")
    assert (error, brier) == (pytest.approx(0.1), pytest.approx(0.01 + 3 * (0.1 / 3) ** 2))
    assert share(among) == 100
    assert rows["edges", "overall"][6:] == ("100.0", None)


def test_pairs_are_counted_in_both_masks_and_sights():
    table = pair_table(ANSWERS, CLOSED, data=DATA)
    assert len(table.rows) == 6
    rows = {row[:2]: row[2:] for row in table.rows}
    assert rows["predicted", "line of sight"] == ("shipped", "edges", "+50.0", 6, 0, 12, 4, 2 / 64, 0.5)
    assert rows["true", "overall"] == ("shipped", "edges", "+25.0", 6, 0, 24, 4, 2 / 64, 1.0)


def test_times_are_medians_of_what_was_asked():
    table = time_table({BOTH: [(0.004, 0.03), (0.006, 0.02), (0.1, 0.5)], EDGE: []}, data=DATA)
    assert table.rows == (("shipped", "small", "6.0", "34.0", 3),)


def test_classifiers_say_what_they_learned_from():
    told = {"objects": {"training": ["dice", "b_cups"], "validation": ["fork"]},
            "poses": {"dice": [], "b_cups": [], "fork": []}, "seed": 5, "physics": "paper's simulator"}  # fmt: skip
    places = SplitPlan({"a": (CLOSED, "box"), "b": (DISJOINT, "can"), "c": (DISJOINT, "can")}, {SAME_POSE: ["d"]})
    objects = {"a": "dice", "b": "c_cups", "c": "chips_can"}
    evaluated = [(EDGE, training_of("edges", told), places)]
    table = classifier_table(evaluated, objects, data=DATA, notes=["All of it is made up."])
    assert table.rows == (("edges", "small", "edge only", "paper's simulator", "5", 2, 1, 1, 2, 0, 1, 0),)
    assert table.notes == ("All of it is made up.", "edges was trained on siblings of c_cups: b_cups.")


def test_other_programs_get_every_answer_every_confusion_and_every_bin():
    answers = list(csv.DictReader(io.StringIO(answer_table(ANSWERS, data=DATA).csv())))
    assert len(answers) == len(ANSWERS)
    lost = [row for row in answers if row["answer"] == "no mask"]
    assert len(lost) == 12
    assert {row["confidence"] + row["p(box)"] + row["sure"] for row in lost} == {""}
    assert all(sum(float(row[f"p({name})"]) for name in ("can", "handle", "box", "sphere")) == pytest.approx(1)
               for row in answers if row["confidence"])  # fmt: skip
    assert sum(int(row["right"]) for row in answers) == sum(one.right for one in ANSWERS)
    confusions = list(csv.DictReader(io.StringIO(confusion_table(ANSWERS, data=DATA).csv())))
    overall = [row for row in confusions if row["sight"] == "overall"]
    assert sum(int(row["images"]) for row in overall) == len(ANSWERS)
    bins = list(csv.DictReader(io.StringIO(bin_table(ANSWERS, data=DATA).csv())))
    assert [(row["split"], row["classifier"], float(row["up to"]), int(row["images"])) for row in bins] == [
        (split, name, upto, 21) for split in (CLOSED, DISJOINT) for name, upto in (("shipped", 0.9), ("edges", 0.4))
    ]


def test_the_surest_mistakes_come_first_and_no_mask_last():
    some = [answer("can", 0.5), answer(None, pose=1), answer("can", 0.9, pose=2), answer("box", pose=3),
            answer("can", 0.95, pose=4, masks=TRUE), answer("can", 0.99, pose=5, variant=EDGE)]  # fmt: skip
    assert worst(some, DISJOINT, BOTH, 9) == [some[2], some[0], some[1]]
    assert worst(some, DISJOINT, BOTH, 1) == [some[2]]
    assert worst(some, CLOSED, BOTH, 9) == []
