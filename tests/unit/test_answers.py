"""A delay is heard in the first answers to steps, and what a model says wrongly beside it."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.answers import ANSWER_S, dead_time, dead_time_s, delayed, find_answers
from gfm.diagnosis.cutting import make_problem
from gfm.diagnosis.evidence import answers_plot
from gfm.diagnosis.fitting import fit
from gfm.diagnosis.restating import KEPT, beside_own, with_own, without_own
from gfm.effects import EffectInstance, find_effect
from pendulum import MODEL, PERIOD_S, ROTOR, swung

NOISE = 1e-4
#: The robot: late, and its rotor and damping are a part of what its model says.
DELAY, SAID_ROTOR, SAID_DAMPING, DAMPING = 0.02, 0.05, 0.6, 0.2
SAID = MODEL.replace(
    f'armature="{ROTOR}"', f'armature="{SAID_ROTOR}" damping="{SAID_DAMPING}" frictionloss="0.01"'
)
SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(SAID)}


def steps(seed):
    """Returns targets that step every second, 14 s."""
    levels = np.random.default_rng(seed).uniform(-0.5, 0.5, 14)
    return np.repeat(levels, round(1.0 / PERIOD_S))


def waves(seed):
    time_s = PERIOD_S * np.arange(1400)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    pairs = zip((0.3, 0.8, 1.7), phases, strict=True)
    return sum(0.2 * np.sin(2 * np.pi * hertz * time_s + phase) for hertz, phase in pairs)


def law(_q, v):
    """What no effect of these tests describes, beside the robot's own damping."""
    return -DAMPING * v - 0.15 * v * abs(v)


@cache
def recordings(delay):
    made = [(waves(1), 1), (steps(2), 2), (waves(3), 3), (steps(4), 4)]
    return [  # shared between tests: never changed
        swung(told, seed=seed, noise=NOISE, torque=law, delay=delay, start=told[0])
        for told, seed in made
    ]


def instance(name, value):
    effect = find_effect(name)
    values = {effect.parameters[0].name: value}
    return EffectInstance(effect=effect, joints=("j",), values=values)


def fitted_by_rollouts(runs):
    """Returns the problem of recordings, and the gain that explains them best alone."""
    problem = make_problem(SPECS, runs)
    effects = (instance("actuator_gain", 1.0),)
    return problem, fit(problem.robust(effects), effects)


@pytest.mark.parametrize("dead", [0.0, 0.004, 0.013, 0.05])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_joint_that_is_pulled_from_rest_tells_when(dead, up):
    time_s = 0.01 * np.arange(40.0)
    moved = 0.5 * 30.0 * np.maximum(time_s - 0.1 - dead, 0.0) ** 2
    assert dead_time_s(time_s, 0.3 + up * moved, 0.1, up, 1e-4) == pytest.approx(dead, abs=1e-9)


def test_what_does_not_move_or_moves_the_other_way_answers_nothing():
    time_s = 0.01 * np.arange(40.0)
    moved = np.maximum(time_s - 0.1, 0.0) ** 2
    assert np.isnan(dead_time_s(time_s, np.zeros(40), 0.1, 1.0, 1e-4))
    assert np.isnan(dead_time_s(time_s, -moved, 0.1, 1.0, 1e-4))
    assert np.isnan(dead_time_s(time_s, moved, -1.0, 1.0, 1e-4))


def test_dead_time_is_what_all_joints_share_and_no_chance():
    late = np.array([0.019, 0.021, 0.02, 0.018, 0.022, 0.02])
    assert dead_time(late, [[0, 1, 2], [3, 4, 5]]) == pytest.approx(0.02)
    assert dead_time(np.append(late, -late[:3]), [[0, 1, 2, 3, 4, 5], [6, 7, 8]]) is None
    assert dead_time(1e-3 * np.array([5.0, -4.0, 6.0, -5.0]), [[0, 1, 2, 3]]) is None
    assert dead_time(0.05 * late, [[0, 1, 2, 3, 4, 5]]) is None


def test_answers_are_found_where_commands_step_from_rest_and_nowhere_else():
    runs = recordings(DELAY)
    problem = make_problem(SPECS, runs)
    found = find_answers(problem, runs)
    assert 20 <= len(found.answers) <= 26
    assert {s.recording for s in found.problem.segments} == {1, 3}
    assert np.median([one.after_s for one in found.answers]) == pytest.approx(DELAY, abs=2e-3)
    off = [replace(one, servo_gain={"j": 0.0}) for one in runs]
    assert find_answers(problem, off).answers == ()


def test_a_prediction_without_an_answer_counts_as_a_late_one():
    runs = recordings(DELAY)
    found = find_answers(make_problem(SPECS, runs), runs)
    late = found.late_s([(instance("coulomb_friction", 100.0),)])[0]
    expected = [one.after_s - ANSWER_S for one in found.answers]
    np.testing.assert_allclose(late, expected)


def test_a_delay_that_rollouts_give_to_an_inertia_is_found_by_answers_to_steps():
    runs = recordings(DELAY)
    problem, fitted = fitted_by_rollouts(runs)
    found = delayed(problem.robust(fitted.effects), problem, runs, fitted)
    told = {e.effect.name: next(iter(e.values.values())) for e in found.accepted.effects}
    assert told["command_delay"] == pytest.approx(DELAY, abs=3e-3)
    assert told["armature"] == pytest.approx(ROTOR - SAID_ROTOR, rel=0.25)
    assert found.accepted.cost < fitted.cost
    assert {e.effect.name for e in found.new} == set(told) - {"actuator_gain"}
    before, after = found.late_s
    assert np.median(before) > 0.015
    assert abs(np.median(after)) < 0.003
    assert len(answers_plot(found.late_s).series) == 2


def test_without_dead_time_or_steps_nothing_is_found():
    runs = recordings(0.0)
    problem, fitted = fitted_by_rollouts(runs)
    assert delayed(problem, problem, runs, fitted) is None
    smooth = [one for one in recordings(DELAY) if one.name in ("run 1", "run 3")]
    problem, fitted = fitted_by_rollouts(smooth)
    assert delayed(problem, problem, smooth, fitted) is None


def test_what_a_model_says_is_the_same_where_it_is_taken_out_and_put_beside():
    problem = make_problem(SPECS, recordings(DELAY)[:1])
    bare, own = without_own(problem)
    amounts = {e.effect.name: next(iter(e.values.values())) for e in own}
    said = {"coulomb_friction": 0.01, "viscous_friction": SAID_DAMPING, "armature": SAID_ROTOR}
    assert amounts == pytest.approx({name: (1.0 - KEPT) * value for name, value in said.items()})
    added = (instance("viscous_friction", -0.2), instance("actuator_gain", 0.9))
    whole = with_own(added, own)
    assert beside_own(whole, own)[:2] == added
    sets = problem.residuals([(*added, instance("coulomb_friction", 0.0))])
    np.testing.assert_allclose(bare.residuals([whole]), sets, atol=1e-3)


def test_only_what_is_asked_for_is_taken_out():
    problem = make_problem(SPECS, recordings(DELAY)[:1])
    bare, own = without_own(problem, [("armature", ("j",))])
    assert [e.key for e in own] == [("armature", ("j",))]
    joint = bare.specs[CommandKind.POSITION].joint("j")
    assert float(joint.damping[0]) == SAID_DAMPING
    assert float(joint.armature) == pytest.approx(KEPT * SAID_ROTOR)
    assert float(problem.specs[CommandKind.POSITION].joint("j").armature) == SAID_ROTOR
