"""Robots with joints that slide: metres and newtons, by closed form."""

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict

MASS, DAMPING, PERIOD_S, NOISE = 2.0, 1.0, 0.01, 1e-5
AXIS = """
<mujoco><option timestep="0.002"/><worldbody><body><joint name="axis" type="slide" axis="1 0 0"
  damping="{damping}"/><geom type="box" size="0.1 0.1 0.1" mass="2"/></body></worldbody>
  <actuator><motor name="axis" joint="axis"/></actuator></mujoco>
"""


def slid(seed):
    """A recording of m x'' = u - d x', exact from command to command."""
    rng = np.random.default_rng(seed)
    stamps = PERIOD_S * np.arange(400)
    speeds = rng.uniform(2.0, 9.0, 3)
    force = np.sin(np.outer(stamps, speeds) + rng.uniform(0.0, 6.0, 3)).sum(axis=1)
    position, velocity = np.zeros(len(stamps)), 0.0
    left = np.exp(-DAMPING / MASS * PERIOD_S)
    for k, u in enumerate(force[:-1]):
        end = u / DAMPING
        gone = (velocity - end) * (1.0 - left) * MASS / DAMPING
        position[k + 1] = position[k] + end * PERIOD_S + gone
        velocity = end + (velocity - end) * left
    nanoseconds = np.round(1e9 * stamps).astype(np.int64)
    return Trajectory(
        name=f"run{seed}",
        joint_names=("axis",),
        stamp_ns=nanoseconds,
        position=(position + NOISE * rng.standard_normal(len(stamps)))[:, None],
        velocity=None,
        effort=None,
        command_stamp_ns=nanoseconds,
        command=force[:, None],
        command_kind=CommandKind.EFFORT,
    )


def verdict_on(damping):
    specs = {CommandKind.EFFORT: mujoco.MjSpec.from_string(AXIS.format(damping=damping))}
    runs = [slid(seed) for seed in range(3)]
    return diagnose(specs, runs[:2], runs[2:])


def test_a_right_model_of_a_linear_axis_has_no_gap_and_its_units_are_said():
    found = verdict_on(damping=DAMPING)
    assert found.verdict is Verdict.NO_GAP
    assert "axis slides: there read m for rad, N for N m, kg for kg m^2." in found.notes


def test_the_friction_of_a_linear_axis_is_found_in_newton_seconds_per_metre():
    found = verdict_on(damping=0.2)
    (named,) = found.effects
    assert (named.effect, named.joints) == ("viscous_friction", ("axis",))
    np.testing.assert_allclose(named.parameters["coefficient"].value, 0.8, rtol=0.01)
