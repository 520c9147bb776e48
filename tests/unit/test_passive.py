"""Joints that nothing drives: a pendulum on a cart, and a gripper that the model leaves out."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.api.recordings import without_strangers
from gfm.core import CommandKind, Trajectory
from gfm.core.trajectory import UNCOMMANDED
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.sim.passive import passive_joints, with_idle_drives

#: kg, m, N s/m; the pendulum is a point mass on a light rod.
CART, BOB, LENGTH, DRAG = 1.2, 0.3, 0.4, 2.0
CART_POLE = f"""
<mujoco><option timestep="0.002"/><worldbody>
  <body name="cart"><joint name="cart" type="slide" axis="1 0 0" damping="{DRAG}"/>
    <inertial pos="0 0 0" mass="{CART}" diaginertia="1e-3 1e-3 1e-3"/>
    <body name="rod"><joint name="pole" axis="0 -1 0"/>
      <inertial pos="0 0 {-LENGTH}" mass="{BOB}" diaginertia="1e-7 1e-7 1e-7"/></body></body>
</worldbody><actuator><motor name="cart" joint="cart"/></actuator></mujoco>
"""
SPECS = {CommandKind.EFFORT: mujoco.MjSpec.from_string(CART_POLE)}
STEP_S, EVERY = 1e-3, 10
NOISE = 1e-4
#: N m s/rad, what the model does not know.
HIDDEN = 0.01


def slope(state, force, friction):
    """Returns the derivative of x, theta, their speeds: Newton's laws of cart and bob."""
    _, angle, speed, turning = state
    mass = np.array(
        [
            [CART + BOB, BOB * LENGTH * np.cos(angle)],
            [BOB * LENGTH * np.cos(angle), BOB * LENGTH**2 + 1e-7],
        ]
    )
    right = [
        force - DRAG * speed + BOB * LENGTH * turning**2 * np.sin(angle),
        -BOB * 9.81 * LENGTH * np.sin(angle) - friction * turning,
    ]
    return np.concatenate([[speed, turning], np.linalg.solve(mass, right)])


def swung(seed, friction):
    """Returns 8 s under a force of three sines, by Runge-Kutta steps of a millisecond."""
    random = np.random.default_rng(seed)
    hz, phase = random.uniform(0.3, 1.4, 3), random.uniform(0.0, 6.3, 3)
    state, states, forces = np.zeros(4), [], []
    for step in range(8 * round(1.0 / STEP_S)):
        if step % EVERY == 0:
            time_s = step * STEP_S
            force = 2.0 * np.sin(2.0 * np.pi * hz * time_s + phase).sum() - 3.0 * state[0]
            states.append(state[:2])
            forces.append(force)
        k1 = slope(state, force, friction)
        k2 = slope(state + 0.5 * STEP_S * k1, force, friction)
        k3 = slope(state + 0.5 * STEP_S * k2, force, friction)
        k4 = slope(state + STEP_S * k3, force, friction)
        state = state + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    stamps = 10**18 + 10_000_000 * np.arange(len(states))
    position = np.stack(states)
    return Trajectory(
        name=f"swung {seed}",
        joint_names=("cart", "pole"),
        stamp_ns=stamps,
        position=position + NOISE * random.standard_normal(position.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.EFFORT,
        command_stamp_ns=stamps,
        command=np.stack([forces, np.zeros(len(forces))], axis=1),
        metadata={UNCOMMANDED: "pole"},
    )


def test_a_joint_without_drive_is_one_whose_drive_is_off():
    recording = swung(0, 0.0)
    specs, (told,) = with_idle_drives(SPECS, [recording])
    assert passive_joints(SPECS[CommandKind.EFFORT], recording) == ("pole",)
    assert told.servo_gain == {"pole": 0.0}
    assert {a.name for a in specs[CommandKind.EFFORT].actuators} == {"cart", "pole"}
    assert len(SPECS[CommandKind.EFFORT].actuators) == 1
    problem = prepared(all_segments(specs, [told]))
    assert problem.driven == ("cart",)
    left = problem.position_errors(())
    np.testing.assert_allclose(np.sqrt(np.mean(np.concatenate(left) ** 2)), NOISE, rtol=0.1)


def test_what_is_commanded_stays_as_it_is():
    recording = replace(swung(0, 0.0), metadata={})
    specs, (told,) = with_idle_drives(SPECS, [recording])
    assert told is recording
    assert len(specs[CommandKind.EFFORT].actuators) == 1


@pytest.mark.slow
def test_friction_of_a_joint_that_nothing_drives_is_named():
    runs = [swung(seed, HIDDEN) for seed in range(4)]
    found = diagnose(SPECS, runs[:3], runs[3:])
    (named,) = found.effects
    assert (named.effect, named.joints) == ("viscous_friction", ("pole",))
    low, high = named.parameters["coefficient"].ci95
    assert low < HIDDEN < high
    assert named.parameters["coefficient"].value == pytest.approx(HIDDEN, rel=0.02)
    assert found.error.after < 1.1 * NOISE
    corrected = mujoco.MjSpec.from_string(found.corrected_xml)
    assert [actuator.name for actuator in corrected.actuators] == ["cart"]


def with_gripper(recording):
    """Returns a recording in which a finger was measured, too."""
    return replace(
        recording,
        joint_names=("finger", "cart", "pole"),
        position=np.concatenate([recording.position[:, :1], recording.position], axis=1),
        command=np.concatenate([0.0 * recording.command[:, :1], recording.command], axis=1),
        metadata={UNCOMMANDED: "finger, pole"},
    )


def test_a_joint_that_no_model_has_and_no_command_names_is_left_out_and_said_to_be():
    recording = swung(0, 0.0)
    (told,), notes = without_strangers(SPECS, [with_gripper(recording)])
    assert told.joint_names == ("cart", "pole")
    np.testing.assert_array_equal(told.position, recording.position)
    np.testing.assert_array_equal(told.command, recording.command)
    assert told.uncommanded == ("pole",)
    assert len(notes) == 1
    assert "finger" in notes[0]
    assert without_strangers(SPECS, [recording]) == ([recording], [])


def test_a_gripper_on_a_tendon_that_no_command_names_is_left_out():
    gripper = """<body><joint name="finger" type="slide"/><geom size="0.01" mass="0.1"/></body>"""
    pulled = """<tendon><fixed name="grip"><joint joint="finger" coef="1"/></fixed></tendon>"""
    text = CART_POLE.replace("</worldbody>", f"{gripper}</worldbody>{pulled}").replace(
        "</actuator>", '<position name="grip" tendon="grip" kp="9"/></actuator>'
    )
    specs = {CommandKind.EFFORT: mujoco.MjSpec.from_string(text)}
    recording = swung(0, 0.0)
    (told,), (note,) = without_strangers(specs, [with_gripper(recording)])
    assert told.joint_names == ("cart", "pole")
    assert "finger" in note
