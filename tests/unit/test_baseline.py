"""The baseline finds gains and dampings that another simulation had."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.experiments.slsqp import identify

JOINTS = ("shoulder", "elbow")
DAMPING = (0.5, 0.5)
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="RK4"/>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0" damping="{damping[0]}" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
      <body pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" damping="{damping[1]}" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="{kp[0]}" kv="{kv[0]}"/>
    <position name="elbow" joint="elbow" kp="{kp[1]}" kv="{kv[1]}"/>
  </actuator>
</mujoco>
"""


def arm(gain: tuple[float, float], damping: tuple[float, float], step: float) -> str:
    return ARM.format(
        step=step,
        damping=damping,
        kp=[g * 30.0 for g in gain],
        kv=[g * 1.0 for g in gain],
    )


def recording(
    gain: tuple[float, float], damping: tuple[float, float], *, seed: int = 0, noise: float = 1e-5
) -> Trajectory:
    """Returns five seconds of the arm that MuJoCo simulates with a step of 0.5 ms."""
    model = mujoco.MjModel.from_xml_string(arm(gain, damping, 0.0005))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2 * np.pi, (3, 2))
    ticks = np.arange(500)
    command = sum(
        0.25 * np.sin(2 * np.pi * hertz * 0.01 * ticks[:, None] + phase[i])
        for i, hertz in enumerate((0.3, 0.8, 1.7))
    )
    data.qpos[:] = command[0]
    position = []
    for setpoint in command:
        position.append(data.qpos.copy())
        data.ctrl[:] = setpoint
        mujoco.mj_step(model, data, nstep=20)
    stamp_ns = ticks * 10_000_000
    return Trajectory(
        name=f"arm_{seed}",
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=np.array(position) + rng.normal(0.0, noise, (500, 2)),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=np.asarray(command),
    )


def nominal() -> dict[CommandKind, mujoco.MjSpec]:
    return {CommandKind.POSITION: mujoco.MjSpec.from_string(arm((1.0, 1.0), DAMPING, 0.002))}


def test_a_known_gain_and_damping_are_recovered():
    found = identify(nominal(), [recording((0.7, 1.3), (0.9, 0.65))], max_iterations=30)
    np.testing.assert_allclose(found.gain, (0.7, 1.3), rtol=0.01)
    np.testing.assert_allclose(found.damping, (0.9, 0.65), atol=0.02)
    assert found.after < 0.02 * found.before


def test_a_model_that_is_right_stays_as_it_is():
    found = identify(nominal(), [recording((1.0, 1.0), DAMPING)])
    np.testing.assert_allclose(found.gain, 1.0, rtol=2e-3)
    np.testing.assert_allclose(found.damping, DAMPING, atol=5e-3)


def test_the_damping_never_becomes_negative():
    found = identify(nominal(), [recording((1.0, 1.0), (0.0, 0.5))])
    assert 0.0 <= found.damping[0] < 0.02
    assert all(e.values["coefficient"] >= -DAMPING[0] for e in found.effects[2:])


def test_the_error_never_grows():
    found = identify(nominal(), [recording((0.8, 1.0), DAMPING)], max_iterations=2)
    assert found.after <= found.before


def test_effects_name_every_joint_once():
    found = identify(nominal(), [recording((0.9, 1.0), DAMPING)], max_iterations=1)
    assert [(e.effect.name, e.joints) for e in found.effects] == [
        ("actuator_gain", ("shoulder",)),
        ("actuator_gain", ("elbow",)),
        ("viscous_friction", ("shoulder",)),
        ("viscous_friction", ("elbow",)),
    ]


def test_recordings_are_used_until_the_time_is_reached():
    recordings = [recording((0.9, 1.0), DAMPING, seed=seed) for seed in range(3)]
    found = identify(nominal(), recordings, most_s=6.0, max_iterations=1)
    assert found.recordings == ("arm_0", "arm_1")


def test_recordings_of_another_kind_are_refused():
    other = replace(recording((1.0, 1.0), DAMPING), command_kind=CommandKind.VELOCITY)
    with pytest.raises(ConfigError, match="commands are of kind velocity"):
        identify(nominal(), [other])
