"""The table, intervals and paired differences, on trials whose figures are known."""

import numpy as np
import pytest

from millisight.core.errors import InputError
from millisight.evaluation import (
    BOTH,
    CAMERA,
    EMPTY,
    HIGH,
    LOW,
    PAPER_MASKS,
    MaskScores,
    MaskTrial,
    SegmentationTask,
    by_scene,
    difference_table,
    empty_table,
    interval_of_median,
    median_table,
    rows_of,
)
from millisight.evaluation.tasks._segmentation_tables import TableRow, difference, trial_table, worst


def trial(scene, method, given, seed, f1, sight="nlos", failure=""):
    scores = MaskScores(precision=0.5, recall=f1 / 2, f1=f1, iou=f1 / 3, accuracy=0.9)
    return MaskTrial(
        scene=scene, object="o", sight=sight, method=method, input=given, seed=seed, scores=scores, failure=failure
    )


def many(gain=0.1):
    """20 scenes of two segmenters; BOTH is better than HIGH by `gain`, whatever the scene and the seed."""
    rng = np.random.default_rng(0)
    made = []
    for number in range(20):
        hard = rng.uniform(0.2, 0.7)
        for seed in range(3):
            luck = rng.uniform(0, 0.1)
            for method, better in (("b", 0.05), ("a", 0.0)):
                made.append(trial(f"s{number:02d}", method, HIGH, seed, hard + luck + better))
                made.append(trial(f"s{number:02d}", method, BOTH, seed, hard + luck + better + gain))
    return made


def test_rows_stand_as_the_segmenters_came_and_as_in_the_paper():
    trials = [trial("s", "z", BOTH, 0, 0.5), trial("s", "z", CAMERA, 0, 0.5), trial("s", "a", LOW, 0, 0.5)]
    assert rows_of(trials) == [("z", CAMERA), ("z", BOTH), ("a", LOW)]


def test_values_by_scene_are_in_the_order_of_seeds():
    trials = [trial("t", "a", HIGH, 1, 0.2), trial("s", "a", HIGH, 0, 0.3), trial("t", "a", HIGH, 0, 0.1)]
    assert by_scene(trials, TableRow("a", HIGH), "nlos", "f1") == {"s": [0.3], "t": [0.1, 0.2]}
    assert by_scene(trials, TableRow("a", HIGH), "los", "f1") == {}
    with pytest.raises(InputError, match="expected equal numbers"):
        interval_of_median(by_scene(trials, TableRow("a", HIGH), "nlos", "f1"))


def test_a_constant_gain_is_found_with_an_interval_of_no_width():
    found = difference(many(), TableRow("a", BOTH), TableRow("a", HIGH), "nlos", "f1")
    assert (found.scenes, found.better, found.worse) == (20, 20, 0)
    assert found[1:5] == pytest.approx([0.1] * 4)
    # Unpaired, it would be lost in what differs from scene to scene.
    low, high = interval_of_median(by_scene(many(), TableRow("a", HIGH), "nlos", "f1"))
    assert high - low > 0.1
    assert difference(many(), TableRow("a", CAMERA), TableRow("a", HIGH), "nlos", "f1") is None


def test_the_interval_of_a_difference_covers_what_is_by_chance():
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(40):
        trials = []
        for number in range(24):
            trials.append(trial(f"{number}", "a", HIGH, 0, 0.5))
            trials.append(trial(f"{number}", "a", BOTH, 0, float(np.clip(0.55 + 0.1 * rng.standard_normal(), 0, 1))))
        found = difference(trials, TableRow("a", BOTH), TableRow("a", HIGH), "nlos", "f1")
        covered += found.low <= 0.05 <= found.high
    assert 33 <= covered <= 40


def test_the_table_has_medians_and_the_papers_figures_beside():
    trials = [
        *(trial("s", "a", HIGH, seed, f1) for seed, f1 in enumerate((0.2, 0.4, 0.9))),
        *(trial("t", "a", HIGH, seed, 0.5, failure="no mask") for seed in range(3)),
    ]
    table = median_table(trials, "nlos", data="by hand", notes=("said below",))
    assert "out of sight: by hand" in table.title
    assert table.rows[0][:2] == ("a", HIGH)
    assert table.rows[0][4].startswith("50.0 (")
    assert table.rows[0][-2:] == (2, 3)
    paper = {row[1]: row[2:7] for row in table.rows[1:]}
    assert paper[CAMERA] == ("3.6", "100.0", "7.0", "3.6", "14.0")
    assert len(paper) == 4
    assert all(row[0] == "paper: SAM, real data" for row in table.rows[1:])
    assert table.notes[-1] == "said below"
    assert "| said" not in table.markdown()


def test_the_papers_figures_hang_together():
    for rows in PAPER_MASKS.values():
        for given, paper in rows.items():
            precision, recall, f1, iou, _ = paper.values()
            # Medians of each, so only nearly.
            if given in (HIGH, BOTH):
                assert f1 == pytest.approx(2 * precision * recall / (precision + recall), abs=6)
                assert iou == pytest.approx(100 * f1 / (200 - f1), abs=1)


def test_differences_are_of_bands_and_of_segmenters():
    table = difference_table(many(), data="by hand")
    compared = {row[2:4] for row in table.rows}
    assert compared == {
        (f"b, {BOTH}", f"b, {HIGH}"), (f"a, {BOTH}", f"a, {HIGH}"), (f"b, {HIGH}", f"a, {HIGH}"),
        (f"b, {BOTH}", f"a, {BOTH}"),
    }  # fmt: skip
    gains = {row[2:4]: row[4] for row in table.rows if row[0] == "F1"}
    assert gains[f"a, {BOTH}", f"a, {HIGH}"] == "+10.0 (+10.0 to +10.0)"
    assert gains[f"b, {HIGH}", f"a, {HIGH}"] == "+5.0 (+5.0 to +5.0)"


def test_empty_scenes_count_where_nothing_is_found():
    trials = [
        trial(f"e{number}", method, HIGH, 0, float(number < right), sight=EMPTY)
        for method, right in (("a", 9), ("b", 2))
        for number in range(10)
    ]
    table = empty_table([*trials, trial("s", "a", HIGH, 0, 0.5)], data="by hand")
    assert [row[:4] for row in table.rows] == [("a", HIGH, 9, 10), ("b", HIGH, 2, 10)]
    assert table.rows[0][4] == "90 (60 to 98)"
    assert worst(trials, 3) == []


def test_the_cameras_precision_is_marked_where_the_truth_is_of_the_same_photo():
    trials = [trial("s", "z", given, 0, 0.6, sight=sight) for given in (CAMERA, HIGH) for sight in ("los", "nlos")]

    def cells(sight, **truth):
        table = median_table(trials, sight, data="by hand", **truth)
        column = table.columns.index("precision [%]")
        return [row[column] for row in table.rows if row[0] == "z"], "\n".join(table.notes)

    told = "50.0 (50.0 to 50.0)"
    found, notes = cells("los", from_photo=True)
    assert found == [f"{told} †", told]
    assert "has a precision of 100 % by construction" in notes
    for sight, truth in (("los", {}), ("nlos", {"from_photo": True})):
        found, notes = cells(sight, **truth)
        assert found == [told, told]
        assert "†" not in notes


def test_every_trial_is_a_row_for_other_programs():
    trials = [trial("s", "a", HIGH, 2, 0.5, failure="nothing, at all")]
    table = trial_table(trials, {"s": "box"}, data="by hand")
    (row,) = table.rows
    named = dict(zip(table.columns, row, strict=True))
    assert (named["class"], named["seed"], named["f1"]) == ("box", 2, 0.5)
    assert '"nothing, at all"' in table.csv()


def test_the_worst_are_of_radar_images_and_of_each_scene_one():
    trials = [
        trial("s", "a", HIGH, 0, 0.3), trial("s", "a", BOTH, 0, 0.1), trial("t", "a", HIGH, 0, 0.2),
        trial("u", "a", HIGH, 0, 0.9), trial("v", "a", CAMERA, 0, 0.0), trial("s", "b", HIGH, 0, 0.4),
    ]  # fmt: skip
    found = worst(trials, 2)
    assert [(one.scene, one.method, one.scores.f1) for one in found] == [
        ("s", "a", 0.1),
        ("t", "a", 0.2),
        ("s", "b", 0.4),
    ]


def test_a_billion_seeds_are_refused():
    with pytest.raises(InputError, match="seeds is 1000000000; expected 1000 at most"):
        SegmentationTask(seeds=10**9)
