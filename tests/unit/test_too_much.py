"""What a model has too much of is found where no effect explains what is left."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.evidence.plots import answers_plot
from gfm.diagnosis.former.too_much import too_much
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.search.nominal_parameters import KEPT, beside_own, with_own, without_own
from late_pendulum import (
    DAMPING,
    DELAY,
    SAID_DAMPING,
    SAID_ROTOR,
    SPECS,
    fitted_by_rollouts,
    instance,
    recordings,
)
from pendulum import ROTOR


def told(found):
    return {e.effect.name: next(iter(e.values.values())) for e in found.accepted.effects}


def test_a_delay_that_rollouts_give_to_an_inertia_is_found_by_answers_to_steps():
    runs = recordings(DELAY)
    problem, fitted = fitted_by_rollouts(runs)
    found = too_much(problem.robust(fitted.effects), problem, problem, runs, fitted)
    amounts = told(found)
    assert amounts["command_delay"] == pytest.approx(DELAY, abs=4e-3)
    assert amounts["armature"] == pytest.approx(ROTOR - SAID_ROTOR, rel=0.25)
    assert found.accepted.cost < fitted.cost
    assert {e.effect.name for e in found.new} == set(amounts) - {"actuator_gain"}
    before, after = found.late_s
    assert np.median(before) > 0.015
    assert abs(np.median(after)) < 0.003
    assert len(answers_plot(found.late_s).series) == 2


def test_without_dead_time_what_the_model_has_too_much_of_is_found_alone():
    runs = recordings(0.0)
    problem = make_problem(SPECS, runs)
    drag = instance("quadratic_drag", 0.1)
    fitted = fit(problem.robust(()), (drag, instance("torque_saturation", 40.0)))
    found = too_much(problem.robust(fitted.effects), problem, problem, runs, fitted)
    amounts = told(found)
    assert "command_delay" not in amounts
    assert found.late_s is None
    assert amounts["quadratic_drag"] == pytest.approx(0.15, rel=0.05)
    assert amounts["viscous_friction"] == pytest.approx(DAMPING - SAID_DAMPING, rel=0.02)
    assert amounts["armature"] == pytest.approx(ROTOR - SAID_ROTOR, rel=0.02)
    assert found.accepted.cost < 1e-3 * fitted.cost
    assert "torque_saturation" not in amounts  # nothing ever reached it


def test_a_model_that_says_nothing_has_nothing_too_much():
    runs = recordings(0.0)
    problem, fitted = fitted_by_rollouts(runs)
    bare = replace(problem, specs=without_own(problem)[0].specs)
    for spec in bare.specs.values():
        spec.joint("j").armature = 0.0
    assert too_much(bare, bare, bare, runs, fitted) is None


def test_what_a_model_says_is_the_same_where_it_is_taken_out_and_put_beside():
    problem = make_problem(SPECS, recordings(DELAY)[:1])
    bare, own = without_own(problem)
    amounts = {e.effect.name: next(iter(e.values.values())) for e in own}
    said = {"coulomb_friction": 0.01, "viscous_friction": SAID_DAMPING}
    assert amounts == pytest.approx({**said, "armature": (1.0 - KEPT) * SAID_ROTOR})
    added = (instance("viscous_friction", -0.2), instance("actuator_gain", 0.9))
    whole = with_own(added, own)
    values = [e.values for e in beside_own(whole, own)[:2]]
    assert values == [pytest.approx(e.values) for e in added]
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
