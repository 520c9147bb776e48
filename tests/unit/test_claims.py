"""What is claimed of what was found: names, suspects, confidences, verdicts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gfm.diagnosis.inference.amounts import amounts
from gfm.diagnosis.inference.constants import ADEQUATE_RATIO, ADEQUATE_SHARE, LEAST_CONFIDENCE
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.intervals import half_widths
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.output.claims import (
    SPREAD_WIDTH,
    closed_share,
    confidence,
    credible,
    features,
    named_effects,
    suspects_of,
    verdict_on,
    verdict_on_both,
)
from gfm.diagnosis.output.result import ErrorSummary, Verdict
from gfm.diagnosis.output.sentences import effects_in_words, sentence_on
from gfm.diagnosis.search.trace import Evidence, Move, Nameless, SearchResult, Step, Tried
from one_joint import TIME_S, instance, problem

FRICTION, SPRING, DRAG = (
    instance("coulomb_friction", torque=0.2),
    instance("joint_spring", stiffness=0.1, rest_angle=0.0),
    instance("quadratic_drag", coefficient=0.1),
)
PROBLEM = problem(np.zeros((len(TIME_S), 1)))


def speaking(errors=40.0, rival=10.0, by=SPRING, **figures):
    """What speaks for an effect: standard errors over without it and over its rival, and so on."""
    over = None if rival is None else Difference(5.0 * rival, 5.0)
    figures = {"apart": 0.01, "bends": 0.05} | figures
    return Evidence(without=Difference(5.0 * errors, 5.0), rival=over, by=by, **figures)


STRONG, WEAK = speaking(), speaking(errors=2.1, rival=0.0, apart=1.0, bends=1.0)


def found(evidence, *effects, cost=1.0, steps=(), equals=None):
    """A search that ended with effects of one parameter each."""
    end = Fit(
        effects=effects,
        jacobian=np.eye(len(TIME_S))[:, : len(effects)],
        residual=np.full(len(TIME_S), np.sqrt(cost)),
    )
    return SearchResult(
        problem=PROBLEM,
        fit=end,
        room=Difference(0.0, 1.0),
        steps=steps,
        evidence={e.key: told for e, told in zip(effects, evidence, strict=True)},
        equals=equals or {},
    )


def test_laws_that_stand_for_one_without_a_name_are_suspects_and_it_is_said():
    law = Nameless(over=Difference(-46.0, 9.9), state="velocity", joint="j")
    told = replace(STRONG, nameless=law)
    assert told.over_rival == law.over
    assert confidence(told) < LEAST_CONFIDENCE < confidence(STRONG)
    (doubtful,) = (s for s in suspects_of(found((told,), FRICTION), ()) if s.confidence is not None)
    assert "a law of the velocity of j without a name predicts better by 46 ± 10 nats" in (
        doubtful.reason
    )
    assert doubtful.nameless == "velocity of j"
    assert doubtful.evidence["z_rival"] == pytest.approx(-46.0 / 9.9)


@pytest.mark.parametrize(
    ("figure", "better"),
    [
        ("rival", [0.0, 1.0, 3.0, 30.0]),
        ("apart", [3.0, 1.0, 0.1, 0.0]),
        ("bends", [0.9, 0.5, 0.1, 0.0]),
        ("disagrees", [2.0, 0.5, 0.1, 0.0]),
    ],
)
def test_a_name_is_surer_the_more_speaks_for_it(figure, better):
    told = [confidence(speaking(**{figure: value})) for value in better]
    assert told == sorted(told)
    assert len(set(told)) == len(told)
    assert all(0.0 < one < 1.0 for one in told)


def test_a_name_that_nothing_rivals_is_weighed_against_the_model_without_it():
    alone = speaking(errors=8.0, rival=None, by=None)
    assert confidence(alone) == confidence(speaking(errors=8.0, rival=8.0))
    assert features(alone)[0] == pytest.approx(np.log(9.0))


def test_a_rival_that_predicts_better_is_as_bad_as_one_that_predicts_as_well():
    assert confidence(speaking(rival=-5.0)) == confidence(speaking(rival=0.0))


def test_only_what_is_more_likely_right_than_wrong_is_credible():
    assert confidence(WEAK) < LEAST_CONFIDENCE < confidence(STRONG)
    assert credible(found((STRONG, WEAK), FRICTION, DRAG)) == [FRICTION]
    unweighed = replace(found((STRONG,), FRICTION), evidence={})
    assert credible(unweighed) == []


def test_names_have_their_figures_and_the_strongest_stands_first():
    stronger = replace(STRONG, without=Difference(900.0, 30.0))
    result = found((STRONG, stronger), FRICTION, DRAG)
    first, second = named_effects(result, result.fit.effects)
    assert (first.effect, second.effect) == ("quadratic_drag", "coulomb_friction")
    assert second.confidence == pytest.approx(confidence(STRONG), abs=5e-4)
    assert second.evidence == {
        "nats": 200.0,
        "z_without": 40.0,
        "apart": 0.01,
        "bends": 0.05,
        "disagrees": 0.0,
        "z_rival": 10.0,
    }
    assert named_effects(result, ()) == ()


def test_the_spread_of_a_model_that_stays_wrong_is_wider_than_an_interval():
    for cost, holds in ((0.9 * ADEQUATE_RATIO**2, True), (1.1 * ADEQUATE_RATIO**2, False)):
        result = found((STRONG,), FRICTION, cost=cost)
        told = named_effects(result, result.fit.effects)[0].parameters["torque"]
        fit = result.fit
        (width,) = half_widths(amounts(fit.effects), fit.jacobian, fit.residual, PROBLEM.slices())
        expected = (told.value - width, told.value + width) if holds else None
        assert told.ci95 == expected
        assert told.spread == (None if holds else pytest.approx(SPREAD_WIDTH * width))


def test_a_model_that_stays_wrong_may_be_wrong_alike_all_along_a_recording():
    """Of four recordings two ask for more, two for less: blocks within them tell nothing new."""
    one = PROBLEM.segments[0]
    runs = replace(PROBLEM, segments=tuple(replace(one, recording=i) for i in range(4)))
    ask = np.repeat([6.0, 4.0, -4.0, -6.0], len(TIME_S))
    end = Fit(effects=(FRICTION,), jacobian=np.ones((len(ask), 1)), residual=ask)
    result = replace(found((STRONG,), FRICTION), problem=runs, fit=end)
    (spread,) = (e.parameters["torque"].spread for e in named_effects(result, (FRICTION,)))
    (by_block,) = half_widths(np.array([0.2]), end.jacobian, ask, runs.slices())
    assert runs.by_recording() == runs.slices()
    error = np.sqrt(4 / 3 * (2 * 6.0**2 + 2 * 4.0**2)) / 4  # the mean of four, each its own block
    assert spread == pytest.approx(SPREAD_WIDTH * stats.t.ppf(0.975, 59) * error, rel=1e-4)
    assert spread > 3.0 * SPREAD_WIDTH * by_block


def test_a_doubtful_name_is_a_suspect_with_its_confidence():
    result = found((STRONG, WEAK), FRICTION, DRAG)
    suspects = {one.effect: one for one in suspects_of(result, [FRICTION])}
    doubtful = suspects["quadratic_drag"]
    assert doubtful.reason.startswith("more likely wrong than right")
    assert doubtful.confidence == pytest.approx(confidence(WEAK), abs=5e-4)
    assert doubtful.evidence["z_without"] == pytest.approx(2.1)
    assert doubtful.decided_by
    assert doubtful.amounts == DRAG.values
    assert "coulomb_friction" not in suspects


@pytest.mark.parametrize(
    ("rival", "says"),
    [(0.4, "equal to coulomb friction on joint"), (1.6, "close to coulomb friction"), (5.0, "")],
)
def test_what_predicts_as_well_in_the_place_of_a_name_is_a_suspect(rival, says):
    suspects = suspects_of(found((speaking(rival=rival),), FRICTION), [FRICTION])
    assert [one.effect for one in suspects] == (["joint_spring"] if says else [])
    assert all(one.reason.startswith(says) for one in suspects)


def test_what_predicts_as_well_in_the_place_of_a_doubtful_name_is_a_suspect_too():
    result = found((replace(WEAK, rival=Difference(-0.5, 5.0), by=SPRING),), FRICTION)
    doubtful, rival = suspects_of(result, [])
    assert (doubtful.effect, rival.effect) == ("coulomb_friction", "joint_spring")
    assert rival.reason.startswith("equal to coulomb friction on joint")


def test_another_name_of_the_same_law_is_a_suspect_and_never_doubtful():
    offset = instance("torque_offset", torque=0.1)
    twin = instance("asymmetric_friction", difference=-0.2)
    result = found((speaking(by=None, rival=None),), offset, equals={offset.key: (twin,)})
    (suspect,) = suspects_of(result, [offset])
    assert (suspect.effect, suspect.confidence) == ("asymmetric_friction", None)
    assert (
        suspect.reason == "equal to torque offset on joint: the recordings do not tell them apart"
    )


def test_names_that_the_recordings_do_not_tell_apart_are_told_together():
    lag = instance("actuator_lag", time_constant=0.007)
    delay = instance("command_delay", delay=0.007)
    result = found((speaking(),), lag, equals={lag.key: (delay,)})
    (named,) = named_effects(result, [lag])
    assert [other.effect for other in named.equals] == ["command_delay"]
    assert effects_in_words([named]) == [
        "actuator lag on joint (time constant 0.007 s) or command delay"
    ]


def test_what_was_fitted_and_lost_is_listed_with_what_it_would_have_brought():
    """Of what explains next to nothing, nothing is said."""
    ranked = tuple(
        Tried(
            new=(one,),
            fit=replace(found((), cost=cost).fit, effects=(one,)),
            gain=Difference(gain, 4.0),
        )
        for one, cost, gain in ((FRICTION, 1.0, 60.0), (DRAG, 40.0, 30.0), (SPRING, 99.9, 0.1))
    )
    steps = (Step(move=Move.ADD, before=100.0, ranked=ranked, chosen=ranked[0]),)
    alone = speaking(rival=None, by=None)
    (lost,) = suspects_of(found((alone,), FRICTION, steps=steps), [FRICTION])
    assert (lost.effect, lost.gain) == ("quadratic_drag", pytest.approx(0.6))
    assert lost.reason == "predicts better by 30 ± 4 nats; coulomb friction on joint by 60"


def summary(before, after):
    return ErrorSummary(before=before, after=after, noise_floor=1.0)


NAMES = named_effects(found((STRONG,), FRICTION), [FRICTION])


@pytest.mark.parametrize(
    ("before", "after", "named", "verdict"),
    [
        (1.2, 1.2, (), Verdict.NO_GAP),
        (1.05 * ADEQUATE_RATIO, 1.05 * ADEQUATE_RATIO, (), Verdict.UNEXPLAINED),
        (20.0, 1.4, NAMES, Verdict.EXPLAINED),
        (20.0, 5.0, NAMES, Verdict.PARTLY_EXPLAINED),
        # What was named makes it worse, or does nothing: beside noise that is no matter.
        (20.0, 25.0, NAMES, Verdict.UNEXPLAINED),
        (20.0, 20.0, NAMES, Verdict.UNEXPLAINED),
        (1.2, 1.3, NAMES, Verdict.EXPLAINED),
        # As exact as laws are: next to nothing of the gap is left, though more than noise.
        (400.0, 400.0 * 0.9 * np.sqrt(ADEQUATE_SHARE) / 4.0, NAMES, Verdict.EXPLAINED),
        # As small a share, but far from noise.
        (3000.0, 30.0, NAMES, Verdict.PARTLY_EXPLAINED),
    ],
)
def test_the_verdict_follows_what_names_leave_of_the_held_out_error(before, after, named, verdict):
    assert verdict_on(summary(before, after), named) is verdict


def test_what_explains_nothing_of_what_is_held_out_is_said_so():
    told = sentence_on(Verdict.UNEXPLAINED, NAMES, summary(20.0, 25.0), "")
    assert told.startswith(
        "The model misses something, and what explains its training recordings does not explain "
        "those held out: coulomb friction on joint"
    )


def test_the_share_of_a_gap_is_one_where_noise_is_left_and_none_where_nothing_changed():
    assert closed_share(summary(9.0, 1.0)) == pytest.approx(1.0)
    assert closed_share(summary(9.0, 9.0)) == 0.0
    assert closed_share(summary(1.0, 0.5)) == 0.0  # no gap


@pytest.mark.parametrize(
    ("robot", "thing", "both"),
    [
        (Verdict.EXPLAINED, Verdict.NO_GAP, Verdict.EXPLAINED),
        (Verdict.NO_GAP, Verdict.EXPLAINED, Verdict.EXPLAINED),
        (Verdict.EXPLAINED, Verdict.EXPLAINED, Verdict.EXPLAINED),
        (Verdict.EXPLAINED, Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED),
        (Verdict.INSUFFICIENT_DATA, Verdict.EXPLAINED, Verdict.INSUFFICIENT_DATA),
    ],
)
def test_robot_and_object_have_one_verdict(robot, thing, both):
    assert verdict_on_both(robot, thing) is both
