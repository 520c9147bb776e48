"""Each hidden effect does what its law says, alone and on the arm."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.sawyer import READY, sawyer_spec
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.coupling import Elastic, Play
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.laws import DryFriction, smooth_laws
from gfm_robot_bridge.simulated.servo import Servo
from gfm_wire import SetPayload

STEP_S = 5e-4
JOINT = 3


def effect(name: str, joint: int = JOINT, **parameters: float) -> HiddenEffect:
    return HiddenEffect(effect=name, joints=(joint,), parameters=parameters)


def slider(force_n: float, *effects: HiddenEffect, seconds: float = 2.0) -> tuple[float, float]:
    """Pushes 1 kg m^2 with dry friction; returns where it is after a while, and how fast."""
    friction = DryFriction(JOINT, effects, 0.0)
    q = v = 0.0
    for _ in range(round(seconds / 1e-4)):
        v += 1e-4 * (force_n + friction.torque(q, v, force_n))
        q += 1e-4 * v
        friction.slide(q, v, force_n)
    return q, v


def test_dry_friction_holds_below_its_level_for_good() -> None:
    level = effect("coulomb_friction", torque=2.0)
    early, _ = slider(1.9, level, seconds=1.0)
    late, speed = slider(1.9, level, seconds=5.0)
    assert 0.0 < early < 5e-5
    assert late == pytest.approx(early, abs=1e-9)
    assert speed == pytest.approx(0.0, abs=1e-9)


def test_dry_friction_takes_its_level_from_what_slides() -> None:
    _, speed = slider(3.0, effect("coulomb_friction", torque=2.0))
    assert speed == pytest.approx((3.0 - 2.0) * 2.0, rel=1e-3)


def test_dry_friction_does_not_drift_when_shaken_below_its_level() -> None:
    friction = DryFriction(JOINT, [effect("coulomb_friction", torque=2.0)], 0.0)
    q = v = 0.0
    for step in range(100_000):
        force = 1.0 + 0.8 * np.sin(2 * np.pi * 30.0 * step * 1e-4)
        v += 1e-4 * (force + friction.torque(q, v, 0.0))
        q += 1e-4 * v
        friction.slide(q, v, 0.0)
    assert abs(q) < 1e-5


def test_excess_friction_holds_more_at_rest_and_fades_with_speed() -> None:
    both = (
        effect("coulomb_friction", torque=1.0),
        effect("stribeck_friction", static_excess=1.0, stribeck_velocity=0.1),
    )
    assert slider(1.9, *both)[1] == pytest.approx(0.0, abs=1e-9)
    friction = DryFriction(JOINT, both, 0.0)
    friction.slide(1.0, 0.1, 0.0)
    assert friction.torque(1.0, 0.1, 0.0) == pytest.approx(-(1.0 + np.exp(-1.0)))
    assert friction.torque(1.0, 1.0, 0.0) == pytest.approx(-1.0)


def test_asymmetric_friction_differs_by_its_difference() -> None:
    both = (
        effect("coulomb_friction", torque=2.0),
        effect("asymmetric_friction", difference=1.0),
    )
    friction = DryFriction(JOINT, both, 0.0)
    friction.slide(1.0, 0.5, 0.0)
    forward = friction.torque(1.0, 0.5, 0.0)
    friction.slide(0.0, -0.5, 0.0)
    backward = friction.torque(0.0, -0.5, 0.0)
    assert (forward, backward) == (pytest.approx(-2.5), pytest.approx(1.5))


def test_load_dependent_friction_grows_with_the_drive() -> None:
    friction = DryFriction(JOINT, [effect("load_dependent_friction", coefficient=0.1)], 0.0)
    friction.slide(1.0, 0.5, -20.0)
    assert friction.torque(1.0, 0.5, -20.0) == pytest.approx(-2.0)


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        (effect("viscous_friction", coefficient=3.0), -3.0 * -0.5),
        (effect("quadratic_drag", coefficient=3.0), 3.0 * 0.25),
        (effect("joint_spring", stiffness=10.0, rest_angle=0.5), -10.0 * (0.2 - 0.5)),
        (effect("torque_offset", torque=-1.5), -1.5),
        (
            effect("cogging_torque", amplitude=2.0, per_revolution=6.0, phase=0.3),
            2.0 * np.sin(6.0 * 0.2 + 0.3),
        ),
    ],
)
def test_smooth_laws(hidden: HiddenEffect, expected: float) -> None:
    (law,) = smooth_laws([hidden])
    torque = np.zeros(7)
    law(np.full(7, 0.2), np.full(7, -0.5), torque)
    assert torque[JOINT] == pytest.approx(expected)
    assert np.count_nonzero(torque) == 1


def test_coupled_friction_acts_on_both_joints_and_sums_to_nothing() -> None:
    hidden = HiddenEffect(effect="coupled_friction", joints=(1, 2), parameters={"viscous": 4.0})
    (law,) = smooth_laws([hidden])
    torque = np.zeros(7)
    law(np.zeros(7), np.array([9.0, 1.0, 0.25, 9.0, 9.0, 9.0, 9.0]), torque)
    assert torque.tolist() == [0.0, -3.0, 3.0, 0.0, 0.0, 0.0, 0.0]


def test_play_pushes_at_its_flanks_and_never_pulls() -> None:
    play = Play(0, gap=0.02)
    assert play.torque(0.0099, 1.0) == play.torque(-0.0099, -1.0) == 0.0
    assert play.torque(0.0101, 0.0) == pytest.approx(1e5 * 1e-4)
    assert play.torque(-0.0101, 0.0) == pytest.approx(-1e5 * 1e-4)
    assert play.torque(0.0101, -100.0) == play.torque(-0.0101, 100.0) == 0.0
    assert Elastic(0, 500.0).torque(0.01, 3.0) == pytest.approx(5.0)


def servo(*effects: HiddenEffect) -> Servo:
    made = Servo(np.zeros(7), effects)
    made.command(CommandKind.VELOCITY, np.full(7, 0.1), np.zeros(7))
    return made


def test_gain_scales_the_servo_and_saturation_limits_it() -> None:
    still = np.zeros(7)
    nominal = servo().torque(still, still, 0.0)
    assert nominal[JOINT] == pytest.approx(5.0)
    scaled = servo(effect("actuator_gain", scale=0.6)).torque(still, still, 0.0)
    assert (scaled / nominal).tolist() == pytest.approx([1, 1, 1, 0.6, 1, 1, 1])
    limited = servo(effect("torque_saturation", limit=2.0)).torque(still, still, 0.0)
    assert limited[JOINT] == 2.0
    assert limited[0] == nominal[0]


def test_the_drives_keep_to_their_own_limits() -> None:
    made = servo()
    made.command(CommandKind.EFFORT, np.full(7, -1e3), np.zeros(7))
    assert made.torque(np.zeros(7), np.zeros(7), 0.0).tolist() == [-80, -80, -40, -40, -9, -9, -9]


def test_a_lag_follows_its_exponential_in_steps_of_any_size() -> None:
    made = servo(effect("actuator_lag", time_constant=0.05))
    still = np.zeros(7)
    assert made.torque(still, still, 0.0)[JOINT] == 0.0
    within = made.torque(still, still, 0.05)[JOINT]
    assert within == pytest.approx(5.0 * (1 - np.exp(-1.0)))
    for _ in range(100):
        made.pass_time(STEP_S)
    assert made.torque(still, still, 0.0)[JOINT] == pytest.approx(within)


def settled(*effects: HiddenEffect, seconds: float = 3.0) -> Arm:
    arm = Arm(READY, effects)
    for _ in range(round(seconds / 1e-3)):
        arm.step(1e-3)
    return arm


def shift(*effects: HiddenEffect) -> Array:
    """Returns how far an effect moves the arm that holds its position, rad, shape (J,)."""
    return settled(*effects).position - READY


def test_nothing_hidden_is_nothing_seen() -> None:
    assert abs(shift()).max() < 1e-9


def test_an_offset_bends_the_servo() -> None:
    away = shift(effect("torque_offset", torque=2.0))
    assert away[JOINT] == pytest.approx(2.0 / 800.0, rel=1e-3)
    assert abs(np.delete(away, JOINT)).max() < 1e-9


def test_a_spring_pulls_towards_its_rest() -> None:
    rest = READY[JOINT] + 0.2
    away = shift(effect("joint_spring", stiffness=20.0, rest_angle=rest))
    assert away[JOINT] == pytest.approx(20.0 * 0.2 / 820.0, rel=1e-3)


def test_a_payload_weighs_on_the_arm_and_only_the_servo_feels_it() -> None:
    away = shift(effect("payload", 6, mass=1.5, com_x=0.0, com_y=0.0, com_z=0.1))
    arm = settled(effect("payload", 6, mass=1.5, com_x=0.0, com_y=0.0, com_z=0.1))
    assert abs(away[1]) > 3e-3
    # The servo's torque is what its position error says, beside the compensation.
    nominal = settled()
    assert arm.drive()[1] - nominal.drive()[1] == pytest.approx(-800.0 * away[1], rel=0.02)


def test_a_payload_that_the_controller_was_told_of_bends_nothing() -> None:
    load = effect("payload", 6, mass=1.5, com_x=0.05, com_y=0.02, com_z=0.1)
    arm = Arm(READY, (load,))
    arm.carry(SetPayload(mass_kg=1.5, com_m=np.array([0.05, 0.02, 0.1])))
    for _ in range(1000):
        arm.step(STEP_S)
    assert arm.position == pytest.approx(READY, abs=1e-9)


def test_a_payload_pulls_where_its_centre_is_told_to_be() -> None:
    mass, com = 1.5, np.array([0.05, 0.0, 0.1])
    where = {"com_x": com[0], "com_y": com[1], "com_z": com[2]}
    away = shift(effect("payload", 6, mass=mass, **where))
    model = sawyer_spec(command=CommandKind.EFFORT).compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = READY + away
    mujoco.mj_forward(model, data)
    link = model.body("right_l6").id
    point = data.xpos[link] + data.xmat[link].reshape(3, 3) @ com
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, point, link)
    assert away[1] == pytest.approx(-9.81 * mass * jacobian[2, 1] / 800.0, rel=1e-3)


def test_tilted_gravity_shows_on_the_vertical_joint() -> None:
    tilt = HiddenEffect(
        effect="gravity_direction", joints=(), parameters={"tilt_x": 0.05, "tilt_y": 0.03}
    )
    assert abs(shift(tilt)[0]) > 5e-4


def test_an_encoder_offset_is_believed_by_servo_and_compensation() -> None:
    arm = settled(effect("encoder_offset", 1, offset=0.1))
    # Held as reported, up to what the wrong compensation of gravity bends the servo by.
    assert 2e-4 < abs(arm.position[1] - READY[1] - 0.1) < 5e-3


def torque_at_speed(*effects: HiddenEffect, speed: float = 0.2) -> float:
    """Returns the mean torque of a drive that turns the vertical joint at constant speed."""
    arm = Arm(READY, effects)
    command = np.zeros(7)
    command[0] = speed
    arm.servo.command(CommandKind.VELOCITY, command, arm.position)
    torques = []
    for step in range(1500):
        arm.step(1e-3)
        if step > 1000:
            torques.append(arm.drive()[0])
    return float(np.mean(torques))


def test_friction_is_felt_by_the_drive() -> None:
    nominal = torque_at_speed()
    dry = torque_at_speed(effect("coulomb_friction", 0, torque=2.0))
    assert dry - nominal == pytest.approx(2.0, abs=0.05)


def jerk_response(*effects: HiddenEffect) -> float:
    arm = Arm(READY, effects)
    push = np.zeros(7)
    push[0] = 10.0
    arm.servo.command(CommandKind.EFFORT, push, arm.position)
    for _ in range(100):
        arm.step(1e-3)
    return float(arm.velocity[0])


def test_armature_adds_inertia() -> None:
    light, heavy = jerk_response(), jerk_response(effect("armature", 0, inertia=1.0))
    inertia = 10.0 * 0.1 / light
    assert heavy == pytest.approx(10.0 * 0.1 / (inertia + 1.0), rel=0.02)


def test_an_elastic_joint_bends_under_the_links_inertia() -> None:
    rigid = jerk_response()
    stiff = jerk_response(effect("joint_elasticity", 0, stiffness=1e5))
    soft = jerk_response(effect("joint_elasticity", 0, stiffness=100.0))
    assert stiff == pytest.approx(rigid, rel=0.1)
    assert soft < 0.7 * rigid


def test_the_link_falls_through_its_play() -> None:
    """The motor holds; the link can be moved by the whole gap, and no further."""
    gap = 0.02
    tilt = {"tilt_x": 0.0, "tilt_y": 0.0}
    ends = []
    for side in (-0.1, 0.1):
        lean = HiddenEffect(
            effect="gravity_direction", joints=(), parameters=tilt | {"tilt_x": side}
        )
        play, level = effect("backlash", 0, gap=gap), shift(lean)[0]
        ends.append(shift(play, lean)[0] - level)
    assert abs(ends[0] - ends[1]) == pytest.approx(gap, rel=0.05)


def test_the_integrator_is_of_third_order() -> None:
    def end(step_s: float) -> Array:
        arm = Arm(READY, (effect("quadratic_drag", coefficient=5.0),))
        target = READY + np.array([0.2, 0.1, -0.2, 0.2, 0.2, -0.2, 0.3]) * 0.1
        arm.servo.command(CommandKind.POSITION, target, arm.position)
        for _ in range(round(0.048 / step_s)):
            arm.step(step_s)
        return arm.position

    exact = end(5e-4 / 4)
    coarse, fine = (np.abs(end(h) - exact).max() for h in (4e-3, 2e-3))
    assert 6.0 < coarse / fine < 11.0
