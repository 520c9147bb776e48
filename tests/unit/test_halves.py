"""Halves of recordings, on a pendulum that SciPy integrates: what both bear out, and agree on."""

import halves
import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.inference.score import Difference
from gfm.effects import EffectInstance, find_effect
from pendulum import MODEL, PERIOD_S, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
FRICTION = ("coulomb_friction", ("j",))
DRAG = ("viscous_friction", ("j",))


def instance(key, **values):
    return EffectInstance(effect=find_effect(key[0]), joints=key[1], values=values)


def half(gain, value, width):
    return halves.Half(
        gains={FRICTION: gain},
        values={(FRICTION, "torque"): value},
        widths={(FRICTION, "torque"): width},
    )


def runs(friction_nm):
    time_s = np.arange(0.0, 8.0, PERIOD_S)
    waves = (np.sin(time_s * (1.0 + seed)) + np.sin(2.3 * time_s + seed) for seed in range(2))
    return [
        swung(
            0.3 * np.minimum(time_s, 1.0) * wave,
            seed=seed,
            noise=3e-4,
            torque=lambda _q, v: -friction_nm * np.tanh(v / 1e-3),
        )
        for seed, wave in enumerate(waves)
    ]


def test_a_half_bears_out_what_acts_and_not_what_does_not():
    asked = [instance(FRICTION, torque=0.2), instance(DRAG, coefficient=0.01)]
    told = halves.told_by(SPECS, runs(0.3), asked)
    assert told.gains[FRICTION].clear
    assert not told.gains[DRAG].clear
    assert told.values[FRICTION, "torque"] == pytest.approx(0.3, rel=0.02)
    assert told.widths[FRICTION, "torque"] < 0.02


def test_both_halves_have_to_bear_an_effect_out():
    clear, unclear = Difference(20.0, 2.0), Difference(3.0, 2.0)
    for second, expected in ((clear, True), (unclear, False)):
        told = halves.borne_out((half(clear, 0.3, 0.01), half(second, 0.3, 0.01)))
        assert told == [{"effect": FRICTION[0], "joints": ("j",), "borne_out": expected}]


@pytest.mark.parametrize(("second", "expected"), [(0.35, "yes"), (0.36, "**no**")])
def test_halves_agree_within_what_both_tell_beside_their_amounts(second, expected):
    """Of 0.03 and 0.04, 0.05 together."""
    clear = Difference(20.0, 2.0)
    both = half(clear, 0.30001, 0.03), half(clear, second, 0.04)
    (row,) = halves.rows_of(both, [instance(FRICTION, torque=0.3)], {FRICTION: 0.9})
    assert row.split("|")[-2].strip() == expected
    assert row.split("|")[-3].strip() == "yes"


def test_suspects_without_amounts_were_not_found():
    found = {"effect": FRICTION[0], "joints": ["j"], "amounts": {"torque": 0.3}}
    seen = {"effect": DRAG[0], "joints": ["j"], "amounts": None}
    assert halves.suspects_in({"suspects": [found, seen]}) == [instance(FRICTION, torque=0.3)]
