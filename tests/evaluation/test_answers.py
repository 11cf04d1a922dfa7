"""Statistics of classifiers: against closed forms, brute force and SciPy."""

import math
from itertools import product

import numpy as np
import pytest
from scipy.stats import binomtest

from helpers.some_answers import BOTH, CLASSES, EDGE, NAMES, answer, several
from millisight.core.errors import InputError, UnknownNameError
from millisight.evaluation import (
    TRUE,
    accuracy,
    chosen,
    confusion,
    expected_calibration_error,
    mcnemar,
    reliability,
    sign_flip,
    wilson_interval,
)
from millisight.evaluation._answers import CLOSED, DISJOINT, NO_MASK, brier_score, compare_classifiers

Z = 1.959963984540054


class TestWilson:
    @pytest.mark.parametrize(("right", "images"), [(0, 10), (1, 10), (5, 10), (29, 34), (10, 10), (180, 224)])
    def test_an_edge_is_just_so_far_from_the_share_as_its_own_spread_allows(self, right, images):
        share = right / images
        low, high = wilson_interval(right, images)
        assert 0 <= low <= share <= high <= 1
        for edge in (low, high):
            assert abs(edge - share) == pytest.approx(Z * math.sqrt(edge * (1 - edge) / images), abs=1e-12)

    @pytest.mark.parametrize("right", range(8))
    def test_as_scipy_has_it(self, right):
        assert wilson_interval(right, 7) == pytest.approx(binomtest(right, 7).proportion_ci(method="wilson"), abs=1e-12)

    def test_the_papers_85_percent_are_70_to_94(self):
        assert [round(100 * edge) for edge in wilson_interval(29, 34)] == [70, 94]

    def test_a_higher_level_is_wider(self):
        low, high = wilson_interval(3, 9, level=0.99)
        assert low < wilson_interval(3, 9)[0] < wilson_interval(3, 9)[1] < high

    @pytest.mark.parametrize(
        ("given", "said"),
        [((1, 0), "at least 1"), ((3, 2), "3 of 2 images"), ((-1, 2), "at least 0"), ((1, 2, 1.0), "level")],
    )
    def test_what_is_no_share_is_refused(self, given, said):
        with pytest.raises(InputError, match=said):
            wilson_interval(*given[:2], **({"level": given[2]} if len(given) > 2 else {}))


class TestPairs:
    @pytest.mark.parametrize(("b", "c"), [(0, 1), (1, 0), (3, 3), (8, 1), (2, 17), (60, 31), (900, 800)])
    def test_mcnemar_is_the_binomial_test(self, b, c):
        assert mcnemar(b, c) == pytest.approx(binomtest(b, b + c).pvalue, rel=1e-9)

    def test_mcnemar_by_hand(self):
        assert mcnemar(8, 1) == 2 * (1 + 9) / 512
        assert mcnemar(5, 0) == 2 / 32
        assert mcnemar(0, 0) == mcnemar(4, 4) == 1

    @pytest.mark.parametrize("differences", [[1], [2, -1, 0], [3, 1, -2, 4], [5, 5, 5, 5, 5, 5], [0, 0]])
    def test_sign_flip_is_the_share_of_all_signs(self, differences):
        sums = [abs(np.dot(signs, differences)) for signs in product((-1, 1), repeat=len(differences))]
        assert sign_flip(differences) == np.mean([one >= abs(sum(differences)) for one in sums])

    @pytest.mark.slow
    def test_sign_flip_of_thousands_of_objects_and_of_odd_ones(self):
        """It took half a minute."""
        from scipy.stats import binom

        differences = [1] * 5100 + [-1] * 4900
        expected = binom.cdf(4900, 10_000, 0.5) * 2
        assert sign_flip(differences) == pytest.approx(expected, rel=1e-9)
        assert sign_flip([2, -1, 3] * 200) == pytest.approx(sign_flip([2, -1, 3] * 166), abs=0.05)
        with pytest.raises(InputError, match="add up to 2000000000; expected at most 1000000"):
            sign_flip([10**9, -(10**9)])
        with pytest.raises(InputError, match=r"a difference is 0\.5"):
            sign_flip([0.5] * 24)
        with pytest.raises(InputError, match="differences is of type NoneType"):
            sign_flip(None)

    def test_sign_flip_is_exact_for_many_objects(self):
        assert sign_flip([1] * 60) == 2 / 2**60
        assert sign_flip([]) == 1

    def test_variants_are_paired_by_scene(self):
        first = [answer("box"), answer("box", pose=1), answer("can", pose=2), answer("sphere", name="peach")]
        second = [answer("can", pose=1), answer("can"), answer("box", pose=2), answer("can", name="fork")]
        found = compare_classifiers(first, [answer_of(EDGE, some) for some in second])
        assert found._asdict() == {
            "first": BOTH, "second": EDGE, "images": 3, "objects": 1, "only_first": 2, "only_second": 1,
            "p": 1.0, "p_by_object": 1.0,
        }  # fmt: skip

    def test_objects_count_once_where_images_count_often(self):
        some = chosen(several(), split=CLOSED, masks=TRUE)
        found = compare_classifiers(chosen(some, variant=BOTH), chosen(some, variant=EDGE))
        # `edges` is wrong of the fork alone: six images, one object.
        assert (found.images, found.objects, found.only_first, found.only_second) == (24, 4, 6, 0)
        assert found.p == 2 / 64
        assert found.p_by_object == 1

    def test_nothing_in_common_is_no_comparison_and_twice_the_same_is_none_either(self):
        assert compare_classifiers([answer()], [answer(pose=1)]) is None
        with pytest.raises(InputError, match="occurs twice"):
            compare_classifiers([answer(), answer(masks=TRUE)], [answer()])


def answer_of(variant, one):
    return answer(one.label, name=one.object, pose=int(one.scene.split("/")[1].split("_")[2]), variant=variant)


class TestAccuracy:
    def test_counts_and_both_intervals(self):
        some = chosen(several(), split=DISJOINT, variant=BOTH, masks="predicted", sight="nlos")
        found = accuracy(some)
        assert (found.right, found.images, found.objects, found.share) == (9, 12, 4, 0.75)
        assert found.wilson == wilson_interval(9, 12)
        # Whole objects are right or wrong, so that what is drawn is one of 0, 1/4, ..., 1.
        assert set(found.by_object) <= {0.25, 0.5, 0.75, 1.0}
        assert found.by_object[0] < found.wilson[0]

    def test_without_answers_there_is_none_and_of_a_perfect_one_nothing_is_uncertain_by_object(self):
        assert accuracy([]) is None
        assert accuracy([answer(), answer(name="peach", label="sphere")]).by_object == (1.0, 1.0)

    def test_of_a_single_object_nothing_can_be_drawn(self):
        found = accuracy([answer(), answer("can", pose=1)])
        assert (found.share, found.objects, found.by_object) == (0.5, 1, None)

    def test_no_mask_is_wrong(self):
        assert not answer(None).right
        assert answer(None).label == NO_MASK
        assert accuracy([answer(None), answer()]).right == 1

    def test_an_answer_that_cannot_be_is_refused(self):
        with pytest.raises(UnknownNameError, match="split"):
            answer(split="closed")
        with pytest.raises(UnknownNameError, match="sight"):
            answer(sight="overall")
        with pytest.raises(InputError, match="shows a plate, which shipped does not know"):
            answer(truth="plate")


class TestConfusion:
    def test_rows_are_truths_and_columns_answers(self):
        found = confusion([answer("can"), answer("box"), answer("box", pose=1), answer("sphere", name="peach")])
        assert (found.truths, found.answers) == (("box", "sphere"), NAMES)
        assert found.counts.tolist() == [[1, 0, 2, 0], [0, 0, 0, 1]]

    def test_no_mask_has_a_column_where_it_occurs(self):
        found = confusion([answer("box"), answer(None, pose=1)])
        assert found.answers == (*NAMES, NO_MASK)
        assert found.counts.tolist() == [[0, 0, 1, 0, 1]]
        assert confusion([answer(None)]).counts.tolist() == [[0, 1]]
        assert confusion([]).counts.shape == (0, 0)


class TestCalibration:
    def test_bins_hold_their_upper_edge(self):
        bins = reliability([answer(confidence=one, pose=n) for n, one in enumerate((0.7, 0.71, 0.8, 1.0))])
        assert [(one.low, one.high, one.images, one.right) for one in bins] == [
            (0.6, 0.7, 1, 1), (0.7, 0.8, 2, 2), (0.9, 1.0, 1, 1)
        ]  # fmt: skip
        assert bins[1].confidence == pytest.approx(0.755)

    def test_right_as_often_as_sure_has_no_error(self):
        answers = [answer("box" if n < 8 else "can", 0.8, pose=n) for n in range(10)]
        assert expected_calibration_error(reliability(answers)) == pytest.approx(0, abs=1e-12)

    def test_always_right_and_less_sure_is_wrong_by_the_rest(self):
        answers = [answer(confidence=0.6, pose=n) for n in range(5)]
        assert expected_calibration_error(reliability(answers)) == pytest.approx(0.4)

    def test_the_error_weighs_bins_by_their_images(self):
        answers = [answer(confidence=0.95), *(answer("can", 0.55, pose=n) for n in (1, 2, 3))]
        assert expected_calibration_error(reliability(answers)) == pytest.approx((0.05 + 3 * 0.55) / 4)

    @pytest.mark.parametrize(
        ("label", "confidence", "score"),
        [("box", 1.0, 0.0), ("can", 1.0, 2.0), ("box", 0.25, 0.75), ("box", 0.7, 0.09 + 3 * 0.01)],
    )
    def test_brier_scores_of_single_answers(self, label, confidence, score):
        assert brier_score([answer(label, confidence)]) == pytest.approx(score)

    def test_what_was_not_predicted_is_neither_sure_nor_unsure(self):
        assert reliability([answer(None)]) == []
        assert expected_calibration_error([]) is None
        assert brier_score([answer(None)]) is None
        assert brier_score([answer(None), answer(confidence=1.0, pose=1)]) == 0


def test_what_is_made_up_holds_what_it_says():
    some = several()
    assert len(some) == 2 * 2 * 4 * 3 * 2 * 2
    assert {one.object: one.truth for one in some} == CLASSES
