"""Constants of the confidence: planted ones are recovered, and what is missing is counted."""

import ast

import calibrate
import numpy as np
import pytest
from known_truth.told import Told

from gfm.diagnosis.inference.constants import CONFIDENCE
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.output import claims
from gfm.diagnosis.search.trace import Evidence

PLANTED = np.array([1.2, -0.7, 4.0, -5.0, -3.0])


def evidence(rng):
    """Returns figures as reports carry them."""
    return {
        "z_without": float(rng.uniform(-2.0, 30.0)),
        "z_rival": float(rng.uniform(-2.0, 10.0)),
        "apart": float(rng.exponential(2.0)),
        "bends": float(rng.uniform(0.0, 1.0)),
        "disagrees": float(rng.exponential(0.5)),
    }


def told(case, right, figures, confidence=0.5):
    return Told(
        case=case,
        effect="armature",
        confidence=confidence,
        right=bool(right),
        suspect=False,
        evidence=figures,
    )


def planted(count):
    """Returns names that are right as often as the planted constants say."""
    rng = np.random.default_rng(1)
    figures = [evidence(rng) for _ in range(count)]
    X = np.stack([calibrate.features(each) for each in figures])
    right = (rng.random(count) < calibrate.confidence(X, PLANTED)).astype(float)
    return X, right, figures


def test_planted_constants_are_recovered():
    X, right, _ = planted(20000)
    assert calibrate.fit(X, right) == pytest.approx(PLANTED, abs=0.35)


def test_a_new_figure_is_fitted_beside_the_others_as_they_are():
    X, right, _ = planted(5000)
    amounts = calibrate.fit(X, right, held=PLANTED[:-1])
    assert amounts[:-1].tolist() == PLANTED[:-1].tolist()
    assert amounts[-1] == pytest.approx(PLANTED[-1], abs=0.35)


def test_a_confidence_is_that_of_the_report():
    """A law that does not bend, one that bends as much as may be, a tie."""
    figures = {"z_without": 9.0, "z_rival": 5.0, "apart": 0.1, "bends": 0.3, "disagrees": 0.2}
    for more in (
        {},
        {"disagrees": 1.0},
        {"bends": 0.0},
        {"bends": 1.0},
        {"z_rival": 0.0},
        {"apart": 2.0},
    ):
        told = figures | more
        evidence = Evidence(
            without=Difference(45.0, 5.0),
            rival=Difference(5.0 * told["z_rival"], 5.0),
            by=None,
            apart=told["apart"],
            bends=told["bends"],
            disagrees=told["disagrees"],
        )
        (row,) = calibrate.confidence(calibrate.features(told)[None], np.array(CONFIDENCE))
        assert row == pytest.approx(claims.confidence(evidence))


def test_no_other_amounts_are_likelier():
    X, right, _ = planted(500)
    amounts = calibrate.fit(X, right)

    def lost(those):
        told = calibrate.confidence(X, those)
        return 500 * calibrate.log_loss(told, right) + 0.5 * calibrate._RIDGE @ those**2

    for step in 0.05 * np.eye(5):
        assert lost(amounts) < min(lost(amounts + step), lost(amounts - step))


def test_names_that_can_be_parted_without_error_give_finite_constants():
    bends = np.linspace(0.0, 2.0, 20)
    X = np.stack([np.full(20, 2.0), np.zeros(20), bends, np.zeros(20)], axis=1)
    predicts, differs, holds, bent, unlike = calibrate.fit(X, (bends < 1.0).astype(float))
    assert 0.0 < predicts < 20.0
    assert differs == pytest.approx(0.0, abs=1e-3)
    assert 1.0 < holds < 50.0
    assert -50.0 < bent < -1.0
    assert unlike == pytest.approx(0.0, abs=1e-3)


def test_features_stay_within_their_limits():
    figures = {
        "z_without": -3.0,
        "z_rival": np.e - 1.0,
        "bends": 0.0,
        "apart": 0.3,
        "disagrees": 0.1,
    }
    assert calibrate.features(figures) == pytest.approx([1.0, np.log(4.0), 0.0, 0.1])
    assert calibrate.features(figures | {"bends": 0.25})[2] == pytest.approx(np.arctanh(0.5))
    assert np.isfinite(calibrate.features(figures | {"bends": 1.0})[2])
    del figures["z_rival"]  # nothing rivals it: so much better than without it
    assert calibrate.features(figures)[0] == 0.0


@pytest.mark.parametrize("value", [None, float("nan"), float("inf")])
def test_evidence_that_lacks_a_figure_is_none(value):
    assert calibrate.features(evidence(np.random.default_rng(1)) | {"apart": value}) is None
    assert calibrate.features(None) is None
    assert calibrate.features({"bends": 0.1}) is None


def test_guessing_costs_ln_2_and_certain_errors_much_but_not_infinitely():
    right = np.array([1.0, 0.0])
    assert calibrate.log_loss(np.full(2, 0.5), right) == pytest.approx(np.log(2.0))
    assert calibrate.log_loss(1.0 - right, right) == pytest.approx(-np.log(1e-3))


def test_a_case_that_is_left_out_does_not_judge_itself():
    X = np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))
    right, cases = np.array([1.0, 1.0, 0.0, 1.0]), ["a", "a", "b", "c"]
    told = calibrate.left_out(X, right, cases)
    # Without a, one of two others is right; without b all are, and without c two of three.
    assert told[0] == told[1] < told[3] < told[2]
    for case, place in (("a", 0), ("b", 2), ("c", 3)):
        others = np.array(cases) != case
        (alone,) = calibrate.confidence(X[:1], calibrate.fit(X[others], right[others]))
        assert told[place] == pytest.approx(alone)


def test_the_summary_counts_what_is_skipped_and_gives_a_line_to_paste():
    _, right, figures = planted(60)
    names = [told(f"case_{i // 3}", r, figures[i]) for i, r in enumerate(right)]
    text = calibrate.summary([*names, told("bare", True, None)])
    assert "1 of 61 names carry no evidence" in text
    assert "60 names of 20 cases" in text
    assert "log loss, of what reports say     0.6931" in text
    amounts = ast.literal_eval(text.splitlines()[-1].removeprefix("CONFIDENCE = "))
    assert len(amounts) == len(CONFIDENCE)


def test_laws_that_the_library_lacks_count_as_often_as_in_a_whole_suite():
    cases = ["a", "b", "c-outside-x", "d-beside-x+y", "d-beside-x+y"]
    known, *lacking = calibrate.weights_of(cases)[[0, 2, 3]]
    assert known > 1.0 > lacking[0] == lacking[1]
    # 30 of 175 cases of a suite, here two of four.
    assert lacking[0] / known == pytest.approx(30.0 / 145.0)
    assert calibrate.weights_of(["a", "b"]).tolist() == [1.0, 1.0]


def test_an_unweighed_rival_is_taken_for_what_three_quarters_of_rivals_are_worse_than():
    figures = [{"z_without": 10.0, "z_rival": z} for z in (1.0, 2.0, 3.0, 4.0, 5.0)]
    names = [told("a", True, one) for one in (*figures, {"z_without": 0.5, "z_rival": 0.4}, None)]
    assert calibrate.unweighed(names) == "UNWEIGHED = 0.20  # of 5 names"
    assert "no name" in calibrate.unweighed([told("a", True, None)])


def test_what_counts_twice_is_as_good_as_there_twice():
    X, right, _ = planted(40)
    twice = calibrate.fit(np.vstack([X, X[:9]]), np.concatenate([right, right[:9]]))
    weighed = calibrate.fit(X, right, np.where(np.arange(40) < 9, 2.0, 1.0))
    assert weighed == pytest.approx(twice, abs=1e-4)


def test_where_all_names_are_right_nothing_is_fitted():
    figures = evidence(np.random.default_rng(2))
    assert "nothing to fit" in calibrate.summary([told("a", True, figures)] * 3)
    assert "nothing to fit" in calibrate.summary([])
