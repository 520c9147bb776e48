"""What becomes of amounts when they are settled in long stretches."""

from types import SimpleNamespace

import numpy as np
import pytest

from gfm.diagnosis import search
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
