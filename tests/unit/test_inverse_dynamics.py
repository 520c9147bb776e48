"""Inverse dynamics lead where the policy's own model would have gone, as far as actions reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.core.checks import Array, Array32
from gfm.effects.effect import angle
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.inverse_dynamics import ArmState, InverseDynamics
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem, nominal_cell
from gfm.sim.batch import HybridBatch
from gfm.sim.sawyer import READY

POSITION, N = "position_matching", 6
Change = Callable[[mujoco.MjSpec], None]


def arm(change: Change = lambda _: None) -> ArmProblem:
    spec = nominal_cell(POSITION)
    change(spec)
    assets = EnvironmentAssets(models={CommandKind.VELOCITY: spec.compile()})
    return arm_problem(POSITION, EnvironmentSettings(), assets)


def friction(amount_nm: float) -> Change:
    def change(spec: mujoco.MjSpec) -> None:
        for joint in spec.joints:
            if joint.name.startswith("right_j"):
                joint.frictionloss = amount_nm

    return change


def weight(spec: mujoco.MjSpec) -> None:
    """Adds what the robot's gravity compensation does not know of."""
    body = spec.body("right_hand").add_body(pos=[0.0, 0.0, 0.1], mass=0.4, inertia=[1e-4] * 3)
    body.explicitinertial = True


def weaker(spec: mujoco.MjSpec) -> None:
    """Lets the servos take half of what they are told: an action does half of what it did."""
    for actuator in spec.actuators:
        actuator.gainprm[0] *= 0.5


def late(spec: mujoco.MjSpec) -> None:
    """Holds back commands for longer than what is looked ahead."""
    for actuator in spec.actuators:
        actuator.delay = 0.1
        actuator.nsample = 60


def shifted(spec: mujoco.MjSpec) -> None:
    """Lets the encoder of right_j1 read more than there is."""
    spec.joint("right_j1").ref += angle(spec, spec.joint("right_j1"), 0.05)


def moving(nominal: ArmProblem) -> tuple[ArmState, Array32]:
    """Returns states in the middle of a motion, and what the policy does next."""
    rng = np.random.default_rng(0)
    action = rng.uniform(-0.4, 0.4, size=(N, 7)).astype(np.float32)
    batch = HybridBatch(nominal.model, N)
    qpos = np.tile(nominal.nominal.qpos0, (N, 1))
    qpos[:, nominal.model.layout.qpos] = READY + rng.uniform(-0.02, 0.02, size=(N, 7))
    batch.reset(np.arange(N), [nominal.nominal] * N, qpos, np.zeros((N, nominal.nominal.nv)))
    for _ in range(5 * nominal.repeats):
        batch.step(action * nominal.velocity_limit, np.zeros((N, len(nominal.model.force_limit))))
    return ArmState(qpos=batch.qpos.copy(), qvel=batch.qvel.copy(), action=action), action


def ends(arm: ArmProblem, state: ArmState, action: Array32) -> Array:
    """Returns the joint positions a control period later, rad."""
    batch = HybridBatch(arm.model, N)
    limit = arm.velocity_limit
    batch.reset(np.arange(N), [arm.nominal] * N, state.qpos, state.qvel, state.action * limit)
    for _ in range(arm.repeats):
        batch.step(action * limit, np.zeros((N, len(arm.model.force_limit))))
    return batch.qpos[:, arm.model.layout.qpos].copy()


def test_on_its_own_model_an_action_stays_as_it_is() -> None:
    nominal = arm()
    state, action = moving(nominal)
    np.testing.assert_allclose(InverseDynamics(nominal, nominal, N)(state, action), action)


@pytest.mark.parametrize(
    "change", [friction(1.0), weight, weaker], ids=["friction", "payload", "gain"]
)
def test_the_joints_go_where_they_would_have_gone(change: Change) -> None:
    nominal, other = arm(), arm(change)
    state, action = moving(nominal)
    wanted = ends(nominal, state, action)
    found = InverseDynamics(nominal, other, N)(state, action)
    unit = CONTROL_PERIOD_S * nominal.velocity_limit
    before, after = (
        np.sqrt(np.mean(((ends(other, state, one) - wanted) / unit) ** 2))
        for one in (action, found)
    )
    assert before > 0.02
    assert after < 0.1 * before


def test_another_zero_of_the_encoders_changes_no_action() -> None:
    nominal, other = arm(), arm(shifted)
    state, action = moving(nominal)
    qpos = state.qpos.copy()
    qpos[:, other.model.layout.qpos] += other.zero
    assert other.zero[1] == pytest.approx(0.05)
    found = InverseDynamics(nominal, other, N)(replace(state, qpos=qpos), action)
    np.testing.assert_allclose(found, action, atol=1e-5)


def test_an_action_stays_within_its_limits() -> None:
    nominal, other = arm(), arm(friction(50.0))
    state, action = moving(nominal)
    found = InverseDynamics(nominal, other, N)(state, action)
    assert np.abs(found).max() <= 1.0
    assert np.isfinite(found).all()


def test_what_acts_too_late_is_left_alone() -> None:
    nominal, other = arm(), arm(late)
    state, action = moving(nominal)
    np.testing.assert_allclose(InverseDynamics(nominal, other, N)(state, action), action, atol=1e-6)
