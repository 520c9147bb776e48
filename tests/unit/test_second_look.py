"""What is asked of effects once all are found: do they hold elsewhere, is a lookalike better."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.diagnosis.former import cross_validation
from gfm.diagnosis.former import lookalikes as lookalikes_module
from gfm.diagnosis.former.lookalikes import exchanges, lookalikes
from gfm.diagnosis.search.candidates import TorqueView, places
from gfm.effects import effect_library
from gfm.effects.plugins import USUAL_SCALES
from one_joint import TIME_S, fitted, instance, problem


def recorded(recordings):
    """Returns a problem with one stretch of each of so many recordings."""
    one = problem(np.zeros((len(TIME_S), 1)))
    (stretch,) = one.segments
    return replace(one, segments=tuple(replace(stretch, recording=i) for i in range(recordings)))


@pytest.fixture
def left(monkeypatch):
    """What is left of each recording, by the names of the effects that are in the model."""
    sums = {}
    monkeypatch.setattr(cross_validation, "fit", lambda _p, effects, **_: fitted(1.0, *effects))
    monkeypatch.setattr(
        cross_validation,
        "without_each",
        lambda _p, f: [tuple(e for e in f.effects if e is not one) for one in f.effects],
    )

    def summed(here, candidates):
        row = sums[here.segments[0].recording]
        return np.array([[row["+".join(sorted(e.effect.name for e in c))]] for c in candidates])

    monkeypatch.setattr(cross_validation, "_sums", summed)
    return sums


def test_an_effect_must_help_more_recordings_than_it_harms(left):
    """One recording gains much, two others lose a little: something else happened in the one."""
    offset = instance("torque_offset", torque=0.1)
    left |= {0: {"": 9.0, "torque_offset": 1.0}}
    left |= {i: {"": 1.0, "torque_offset": 1.2} for i in (1, 2)}
    assert not cross_validation.holds_elsewhere(recorded(3), (), (offset,))
    left[2]["torque_offset"] = 0.5
    assert cross_validation.holds_elsewhere(recorded(3), (), (offset,))


def test_one_recording_says_nothing_of_others():
    both = (instance("torque_offset", torque=0.1), instance("armature", inertia=0.1))
    assert cross_validation.holds_elsewhere(recorded(1), (), both[:1])
    assert cross_validation.what_holds(recorded(1), both) == both


def test_what_explains_nothing_elsewhere_is_taken_out(left):
    offset, armature = instance("torque_offset", torque=0.1), instance("armature", inertia=0.1)
    row = {"armature+torque_offset": 2.0, "torque_offset": 1.9, "armature": 8.0, "": 9.0}
    left |= {0: row, 1: row}
    assert cross_validation.what_holds(recorded(2), (offset, armature)) == (offset,)
    assert cross_validation.what_holds(recorded(2), (offset, armature), [armature.key]) == (
        offset,
        armature,
    )
    needed = row | {"torque_offset": 2.5}
    left |= {0: needed, 1: needed}
    assert cross_validation.what_holds(recorded(2), (offset, armature)) == (offset, armature)


def test_what_was_needed_beside_another_is_asked_again_without_it(left, monkeypatch):
    """To first order the offset is superfluous; refitted, it is so only without the armature."""
    offset, armature = instance("torque_offset", torque=0.1), instance("armature", inertia=0.1)
    viscous, little = (
        instance("viscous_friction", coefficient=0.1),
        instance("quadratic_drag", coefficient=0.1),
    )
    row = {
        "armature+torque_offset+viscous_friction": 2.0,
        "armature+viscous_friction": 2.1,
        "torque_offset+viscous_friction": 2.04,
        "armature+torque_offset": 9.0,
        "viscous_friction": 2.05,
        "torque_offset": 9.0,
        "quadratic_drag": 1.0,
    }
    left |= {0: row, 1: row}
    exact = cross_validation.without_each
    monkeypatch.setattr(
        cross_validation,
        "without_each",
        lambda p, f: [
            (little,) if one is offset else rest
            for one, rest in zip(f.effects, exact(p, f), strict=True)
        ],
    )
    assert cross_validation.what_holds(recorded(2), (viscous, offset, armature)) == (viscous,)


def test_the_last_effect_stays():
    offset = instance("torque_offset", torque=0.1)
    assert cross_validation.what_holds(recorded(2), (offset,)) == (offset,)


def view():
    """Returns a motion of one joint: a sine of 0.5 rad."""
    position = 0.5 * np.sin(6.0 * np.linspace(0.0, 5.0, 500))[:, None]
    return TorqueView(
        position=position,
        velocity=np.gradient(position, 0.01, axis=0),
        drive=np.zeros_like(position),
        missing=np.zeros_like(position),
    )


def somewhere(*names):
    return [place for name in names for place in places(effect_library()[name], ["joint"])]


def test_a_spring_whose_rest_is_far_away_looks_like_a_constant_torque():
    spring = instance("joint_spring", stiffness=0.006, rest_angle=-13.0)
    candidates = somewhere("torque_offset", "viscous_friction", "armature")
    (alike,) = lookalikes(spring, recorded(1), candidates, [USUAL_SCALES], [view()])
    assert alike.effect.name == "torque_offset"
    assert alike.values["torque"] == pytest.approx(-0.006 * 13.0, rel=0.01)


def test_a_spring_that_rests_in_the_middle_looks_like_nothing_else():
    spring = instance("joint_spring", stiffness=0.006, rest_angle=0.0)
    assert not lookalikes(spring, recorded(1), somewhere("torque_offset"), [USUAL_SCALES], [view()])


def test_what_is_no_torque_looks_like_nothing():
    delay = instance("command_delay", delay=0.01)
    assert not lookalikes(delay, recorded(1), somewhere("torque_offset"), [USUAL_SCALES], [view()])


def test_an_effect_makes_way_for_a_lookalike_that_explains_more(monkeypatch):
    spring = instance("joint_spring", stiffness=0.006, rest_angle=-13.0)
    friction = instance("coulomb_friction", torque=0.1)
    costs = {"joint_spring": 12.0, "torque_offset": 1.1}

    def fit(_problem, effects):
        return fitted(min(costs.get(e.effect.name, np.inf) for e in effects), *effects)

    monkeypatch.setattr(lookalikes_module, "fit", fit)
    found, offsets = fitted(12.0, spring, friction), somewhere("torque_offset")
    (this,) = exchanges(recorded(1), found, offsets, [USUAL_SCALES], [view()])
    assert [e.effect.name for e in this.fits[0].effects] == ["coulomb_friction", "torque_offset"]
    assert (this.before, this.accepted) == (12.0, this.fits[0])
    costs["torque_offset"] = 11.9
    assert not exchanges(recorded(1), found, offsets, [USUAL_SCALES], [view()])
    assert not exchanges(recorded(1), fitted(12.0, spring), offsets, [USUAL_SCALES], [view()])
