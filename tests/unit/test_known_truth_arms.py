"""Arms in published numbers: the suite's dynamics are MuJoCo's, and every effect has its case."""

from collections import Counter

import mujoco
import numpy as np
import pytest
from known_truth import dynamics
from known_truth.arms import arm_plans, arms
from known_truth.draft import draft
from known_truth.mjcf import mjcf
from known_truth.plans import VOCABULARY
from known_truth.robots import UPRIGHT


@pytest.mark.parametrize("name", list(arms()))
def test_the_dynamics_are_those_of_the_model_that_is_written(name):
    arm = arms()[name]
    model = mujoco.MjModel.from_xml_string(mjcf(arm, "position"))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    q, v = arm.rest + rng.uniform(-1.0, 1.0, model.nq), rng.uniform(-1.0, 1.0, model.nv)
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(model, data)
    theirs = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, theirs)
    chains = dynamics.chains([arm])
    here = dynamics.pose(chains, q[None])
    ours = dynamics.mass_matrix(chains, here)[0] + np.diag(arm.armature)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)
    bias = dynamics.bias(chains, here, v[None], UPRIGHT[None])[0]
    np.testing.assert_allclose(bias, data.qfrc_bias, atol=1e-8)


def test_every_arm_stands_on_a_vertical_axis_and_moves_in_space():
    for arm in arms().values():
        assert arm.upright
        assert not arm.planar


def test_every_effect_is_hidden_alone_once_on_another_arm_with_another_seed():
    plans = {seed: arm_plans(seed) for seed in (0, 1)}
    where = {}
    for seed, listed in plans.items():
        singles = [plan for plan in listed if plan.category == "single"]
        assert Counter(plan.effects[0] for plan in singles) == Counter(VOCABULARY)
        where[seed] = {plan.effects[0]: plan.setup.name for plan in singles}
    assert all(where[0][name] != where[1][name] for name in VOCABULARY)
    assert len({plan.seed for listed in plans.values() for plan in listed}) == sum(
        map(len, plans.values())
    )


def test_an_arm_is_not_drawn_anew():
    plan = next(plan for plan in arm_plans() if plan.category == "none")
    robot = draft(plan).robot
    np.testing.assert_array_equal(robot.mass, plan.setup.robot.mass)
    np.testing.assert_array_equal(robot.stiffness, plan.setup.robot.stiffness)
