"""What is given in the end: effects that are named, without suspects, on a pendulum of SciPy's."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.found import Found
from gfm.diagnosis.inference.fitting import measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.output.claims import suspects_of
from gfm.diagnosis.output.errors import rollout_errors
from gfm.diagnosis.output.sentences import note_on_suspects
from gfm.diagnosis.search.trace import Evidence, SearchResult
from gfm.effects import EffectInstance, find_effect
from pendulum import MODEL, PERIOD_S, swung

FRICTION, NOISE = 0.3, 3e-4
CLEAR = Difference(200.0, 20.0)


def instance(name, **values):
    return EffectInstance(effect=find_effect(name), joints=("j",), values=values)


RIGHT = instance("coulomb_friction", torque=FRICTION)
#: A servo that is so late swings by itself, unless a joint is damped by as much as this.
LATE = instance("servo_delay", delay=0.1)
DAMPED = instance("viscous_friction", coefficient=10.0)


@pytest.fixture(scope="module")
def rubbing():
    time_s = np.arange(0.0, 4.0, PERIOD_S)
    told = 0.3 * np.minimum(time_s, 1.0) * (np.sin(1.7 * time_s) + np.sin(4.1 * time_s + 1.0))
    dry = [
        swung(told, seed=seed, noise=NOISE, torque=lambda _q, v: -FRICTION * np.tanh(v / 1e-3))
        for seed in range(2)
    ]
    return dry, prepared(
        all_segments({CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}, dry)
    )


def ended(rubbing, *effects):
    """A search that ended with effects of which damping is a suspect."""
    recordings, problem = rubbing
    evidence = {
        e.key: Evidence(without=CLEAR, rival=CLEAR, by=None, apart=0.0, bends=0.9 * (e is DAMPED))
        for e in effects
    }
    fit = measured(problem.robust(()), effects)
    result = SearchResult(problem=problem, fit=fit, room=CLEAR, evidence=evidence)
    return Found(recordings=recordings, short=problem, long=problem, results=(result,))


def names(found, *, keep_suspects=False):
    return [one.effect for one in found.named(keep_suspects=keep_suspects)]


def test_amounts_are_fitted_without_suspects(rubbing):
    (one,) = ended(rubbing, RIGHT, DAMPED).named(keep_suspects=False)
    assert one.instance().values["torque"] == pytest.approx(FRICTION, rel=0.01)


def test_what_ruins_the_model_without_a_suspect_beside_it_is_not_given(rubbing):
    found = ended(rubbing, RIGHT, LATE, DAMPED)
    assert names(found) == ["coulomb_friction"]
    named = [one.instance() for one in found.named(keep_suspects=False)]
    reasons = {one.effect: one.reason for one in suspects_of(found.result, named)}
    assert "predicts worse with it than without it" in reasons["servo_delay"]
    assert "more likely wrong than right" in reasons["viscous_friction"]


def test_suspects_that_are_asked_for_are_all_kept(rubbing):
    kept = names(ended(rubbing, RIGHT, LATE, DAMPED), keep_suspects=True)
    assert sorted(kept) == ["coulomb_friction", "servo_delay", "viscous_friction"]


def test_a_report_says_how_near_the_model_comes_with_suspects_in_it(rubbing):
    _, problem = rubbing
    both = ended(rubbing, RIGHT, instance("armature", inertia=1e-4)).every
    without = rollout_errors(problem, ()).summary
    (told,) = note_on_suspects(problem, (), both, without)
    kept = rollout_errors(problem, both).summary.after
    assert kept < 0.1 * without.after
    assert f"{kept:.3g} rad" in told
    assert "--keep-suspects" in told


def test_a_report_says_nothing_of_suspects_that_come_no_nearer(rubbing):
    _, problem = rubbing
    right = rollout_errors(problem, (RIGHT,)).summary
    assert note_on_suspects(problem, (RIGHT,), (RIGHT, DAMPED), right) == []
    assert note_on_suspects(problem, (RIGHT,), (RIGHT,), right) == []
