"""The ladder of refits that the diagnosis is compared with, on a pendulum that SciPy integrates."""

import mujoco
import numpy as np
import pytest
from peers.case import Case
from peers.ladder import ladder

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from pendulum import MODEL, PERIOD_S, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
NOISE, FRICTION = 3e-4, 0.3


def case(count, **truth):
    """A case of some recordings and a held-out one."""
    time_s = np.arange(0.0, 5.0, PERIOD_S)
    commands = [0.6 * np.sin((1.0 + 0.7 * seed) * time_s) for seed in range(count + 1)]
    *training, held = [
        swung(one, seed=seed, noise=NOISE, **truth) for seed, one in enumerate(commands)
    ]
    problem = prepared(all_segments(SPECS, training))
    return Case(specs=SPECS, training=training, problem=problem, held_out=[held])


@pytest.mark.parametrize("recordings", [1, 2])
def test_a_ladder_takes_the_effect_that_explains_what_no_amount_was_fitted_to(recordings):
    rubbing = case(recordings, torque=lambda _q, v: -FRICTION * np.tanh(v / 1e-3))
    named, after = ladder(rubbing)
    first = named[0]
    assert (first.effect, first.joints) == ("coulomb_friction", ("j",))
    assert first.parameters["torque"] == pytest.approx(FRICTION, rel=0.05)
    assert after < 0.1 * rubbing.held_out_error(SPECS)


def test_a_ladder_takes_nothing_from_a_right_model():
    right = case(2)
    named, after = ladder(right)
    assert named == []
    assert after == pytest.approx(right.held_out_error(SPECS))
