"""A delay is found where efforts are measured beside the commands of their stamps."""

import mujoco
import numpy as np
import pytest

from disc import DISC, followed
from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.inference.fitting import fit, measured
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis
from gfm.diagnosis.search.moves.add import add
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, find_effect
from gfm.effects.plugins import USUAL_SCALES

#: A wrist of an arm with stiff servos, commanded and measured at 125 Hz; the delay is more than one
#: command and less than two.
INERTIA, KP, KV = 0.0724, 500.0, 45.0
PERIOD_S, DELAY_S = 0.008, 0.011
TIME_S = PERIOD_S * np.arange(1000.0)
POSITION_NOISE, EFFORT_NOISE = 5e-5, 0.01
TEXT = DISC.format(step=0.002, integrator="RK4", inertia=INERTIA, kp=KP, kv=KV)
SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(TEXT)}


def recorded(seed):
    """Returns what is recorded of it, with noise."""
    rng = np.random.default_rng(seed)
    hertz, phases = rng.uniform(0.2, 1.2, 2), rng.uniform(0.0, 6.0, 2)
    waves = np.sin(2.0 * np.pi * np.outer(TIME_S, hertz) + phases)
    command = np.minimum(TIME_S, 1.0) * (waves @ [0.5, 0.2])
    servo = {"period_s": PERIOD_S, "inertia": INERTIA, "kp": KP, "kv": KV}
    position, effort = followed(command, late_s=DELAY_S, **servo)
    stamp_ns = np.round(1e9 * TIME_S).astype(np.int64)
    return Trajectory(
        name=f"run {seed}",
        joint_names=("j",),
        stamp_ns=stamp_ns,
        position=position + POSITION_NOISE * rng.standard_normal(position.shape),
        velocity=None,
        effort=effort + EFFORT_NOISE * rng.standard_normal(effort.shape),
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=command[:, None],
    )


@pytest.fixture(scope="module")
def problem():
    return prepared(all_segments(SPECS, [recorded(seed) for seed in range(2)]))


def delay(by_s):
    effect = find_effect("command_delay")
    return EffectInstance(effect=effect, joints=("j",), values={"delay": by_s})


def test_a_delay_past_the_command_of_a_stamp_is_reached_from_a_small_one(problem):
    problem, begun = problem.robust(()), delay(0.004)
    stuck = fit(problem, (begun,))
    assert stuck.effects[0].values["delay"] < 0.008
    here = Hypothesis(problem=problem, fit=measured(problem, ()), nominal=np.full(1, 1e4))
    place = Place(effect=begun.effect, joints=("j",), scales=USUAL_SCALES)
    step = add(here, Search(candidates=[place], report=lambda _: None))
    assert step.chosen.new[0].values["delay"] == pytest.approx(DELAY_S, abs=5e-4)


def test_positions_alone_are_the_same_positions(problem):
    alone = problem.positions_alone()
    assert problem.has_efforts
    assert not alone.has_efforts
    late = (delay(0.008),)
    whole, part = problem.as_measured(), alone.as_measured()
    assert part.position_errors(late)[0] == pytest.approx(whole.position_errors(late)[0])
    for basis in alone.state_basis:
        assert basis.shape[1] == 2
        assert basis.T @ basis == pytest.approx(np.eye(2), abs=1e-9)
