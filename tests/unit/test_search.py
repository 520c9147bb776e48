"""What becomes of amounts in long stretches, and of rounds when something is taken out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gfm.diagnosis.former import search
from gfm.diagnosis.former.attribution import Round
from gfm.diagnosis.output.claims import clearness
from one_joint import fitted, instance


def leaving(costs):
    """A problem in which the first set of effects leaves the first cost, and so on."""
    return SimpleNamespace(residuals=lambda _: np.sqrt(np.array(costs))[:, None])


@pytest.mark.parametrize(
    ("costs", "other", "expected"),
    [
        ([0.8, 6.5], "coulomb_friction", 0.70),  # another valley
        ([0.8, 1.0], "coulomb_friction", 0.73),
        ([0.8, 6.5], "torque_offset", 0.73),  # other effects: nothing to compare with
    ],
)
def test_amounts_of_short_stretches_stay_where_those_of_long_ones_miss_them(
    monkeypatch, costs, other, expected
):
    short = fitted(0.8, instance("coulomb_friction", torque=0.70))
    final = fitted(3.9, instance(other, torque=0.73))
    monkeypatch.setattr(search, "measured", lambda _, effects: fitted(7.9, *effects))
    said = search._not_astray(leaving(costs), short, leaving([]), final)
    assert said.effects[0].values["torque"] == expected


@pytest.mark.parametrize(("left", "again"), [(1.0, True), (30.0, False)])
def test_rivals_are_weighed_again_without_what_they_stood_beside(monkeypatch, left, again):
    """Beside friction between joints that there is not, a rotor explained as much as this."""
    coupled, friction = instance("viscous_friction"), instance("coulomb_friction", torque=0.9)
    rotor, drag = instance("armature", inertia=0.1), instance("quadratic_drag", coefficient=0.2)
    first = Round(before=99.0, screened=(), fits=(), accepted=fitted(40.0, coupled))
    first = replace(first, fits=(first.accepted,))
    won = fitted(20.0, coupled, friction)
    rivals = (fitted(20.1, coupled, rotor), fitted(25.0, coupled, drag))
    second = Round(before=40.0, screened=(), fits=(won, *rivals), accepted=won)
    end = fitted(left, friction)
    asked = []
    monkeypatch.setattr(search, "is_enough", lambda _, final: final.cost < 2.0)
    monkeypatch.setattr(search, "fit", lambda _, e, **_how: asked.append(e) or fitted(30.0, *e))
    played = search._played_again(leaving([90.0]), (first, second), end)
    if not again:
        assert (played, asked) == ((), [])
        return
    (this,) = played
    assert asked == [(rotor,), (drag,)]
    assert this.new == (friction,)
    assert this.before == pytest.approx(90.0)
    assert clearness(second.fits, second.before, adequate=True) < 0.6
    assert clearness(this.fits, this.before, adequate=True) == pytest.approx(0.99)
