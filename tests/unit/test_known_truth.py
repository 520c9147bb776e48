"""The known-truth suite: clean robots agree with MuJoCo, and laws are what they say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from known_truth.amounts import Hidden
from known_truth.mjcf import mjcf
from known_truth.motion import MOTIONS
from known_truth.robots import PENDULUM, PLANAR, SPATIAL, Array, Robot, varied
from known_truth.run import STEP_S, Course, Run
from known_truth.simulation import simulate

# Simulating robots apart from everything else takes a minute.
pytestmark = pytest.mark.slow

EVERY = 20


def hidden(effect: str, *joints: int, **parameters: float) -> Hidden:
    return Hidden(effect=effect, joints=joints, parameters=parameters)


def drive(
    robot: Robot, kind: str, *effects: Hidden, seconds: float = 0.5, motion: str = "multisine"
) -> Run:
    """Returns a run along a motion, commanded every 10 ms from 0.1 s before."""
    first = -200
    time_s = (first + EVERY * np.arange(int((seconds / STEP_S - first) / EVERY) + 1)) * STEP_S
    path = MOTIONS[motion](robot, np.maximum(time_s, 0.0), np.random.default_rng(5))
    speeds = np.diff(path, axis=0, append=path[-1:]) / (EVERY * STEP_S)
    return Run(
        robot=robot,
        kind=kind,
        hidden=effects,
        start=path[0],
        first_command_step=first,
        command_every=EVERY,
        reference=speeds if kind == "velocity" else path,
        control=(0.4 * robot.stiffness, 0.7 * robot.servo_damping),
        measured_at=np.arange(0, round(seconds / STEP_S) + 1, 10),
    )


def free(robot: Robot, start: Array, *effects: Hidden, seconds: float = 0.8) -> Run:
    """Returns a run without any drive, measured at every time step."""
    run = drive(robot, "effort", *effects, seconds=seconds)
    nothing = np.zeros(len(robot.joints))
    every_step = np.arange(round(seconds / STEP_S) + 1)
    return replace(run, start=start, control=(nothing, nothing), measured_at=every_step)


def held(robot: Robot, at: float, *effects: Hidden) -> Run:
    """Returns a run in which a pendulum's servo is to stay where it is, measured once settled."""
    run = drive(robot, "position", *effects)
    target = np.array([[at]])
    return replace(run, start=target[0], reference=target, measured_at=np.array([0]))


def frictionless(robot: Robot) -> Robot:
    return replace(robot, damping=np.zeros(len(robot.joints)))


def in_mujoco(run: Run, course: Course) -> tuple[Array, Array]:
    """Returns positions and drive torques of the nominal model under the same commands."""
    spec = mujoco.MjSpec.from_string(mjcf(run.robot, run.kind))
    spec.option.timestep = STEP_S
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = course.position[0], course.velocity[0]
    positions, efforts = [], []
    for step in range(int(run.measured_at[-1]) + 1):
        if step in run.measured_at:
            mujoco.mj_forward(model, data)
            positions.append(data.qpos.copy())
            efforts.append(data.qfrc_actuator.copy())
        number = (step - run.first_command_step) // run.command_every
        data.ctrl[:] = course.command[min(number, len(course.command) - 1)]
        mujoco.mj_step(model, data)
    return np.array(positions), np.array(efforts)


CARRIED = replace(SPATIAL, compensated=True)


@pytest.mark.parametrize(
    ("robots", "kinds"),
    [
        ((PENDULUM, PENDULUM), ("position", "velocity")),
        ((PLANAR, PLANAR), ("position", "effort")),
        ((SPATIAL, CARRIED, CARRIED), ("position", "position", "velocity")),
    ],
)
def test_clean_robots_move_as_mujoco_says(robots: Sequence[Robot], kinds: Sequence[str]) -> None:
    rng = np.random.default_rng(1)
    runs = [drive(varied(r, rng), kind, seconds=0.4) for r, kind in zip(robots, kinds, strict=True)]
    for run, course in zip(runs, simulate(runs, settling_s=0.1), strict=True):
        position, effort = in_mujoco(run, course)
        assert np.ptp(course.position, axis=0).min() > 0.01
        assert np.abs(position - course.position).max() < 0.01 * run.robot.encoder_noise
        # At the first measurement MuJoCo has not been told the command yet.
        apart = np.abs(effort - course.effort)[1:].max(axis=0)
        assert (apart < 1e-3 * np.abs(course.effort).max(axis=0)).all()


def energy(robot: Robot, course: Course) -> Array:
    """Returns the energy of a pendulum, J, shape (T,)."""
    lever = float(np.hypot(*robot.com[0, [0, 2]]))
    inertia = robot.inertia[0, 1] + robot.mass[0] * lever**2 + robot.armature[0]
    q, v = course.position[:, 0], course.velocity[:, 0]
    return np.asarray(0.5 * inertia * v**2 - 9.81 * robot.mass[0] * lever * np.cos(q))


def work(course: Course, torque: Array) -> float:
    """Returns what a torque along a course adds to the energy, J."""
    power = torque * course.velocity[:, 0]
    return float(np.sum(0.5 * (power[1:] + power[:-1])) * STEP_S)


LAWS: Sequence[tuple[Hidden, Callable[[Array, Array], Array]]] = (
    (hidden("coulomb_friction", 0, torque=0.05), lambda _, v: -0.05 * np.sign(v)),
    (hidden("viscous_friction", 0, coefficient=0.02), lambda _, v: -0.02 * v),
    (hidden("quadratic_drag", 0, coefficient=0.02), lambda _, v: -0.02 * v * np.abs(v)),
    (
        hidden("stribeck_friction", 0, static_excess=0.05, stribeck_velocity=2.0),
        lambda _, v: -0.05 * np.sign(v) * np.exp(-((v / 2.0) ** 2)),
    ),
    (hidden("joint_spring", 0, stiffness=0.3, rest_angle=0.4), lambda q, _: -0.3 * (q - 0.4)),
    (hidden("torque_offset", 0, torque=0.1), lambda q, _: np.full_like(q, 0.1)),
    (
        hidden("cogging_torque", 0, amplitude=0.2, per_revolution=7.0, phase=0.3),
        lambda q, _: 0.2 * np.sin(7.0 * q + 0.3),
    ),
)
IDEAL = frictionless(PENDULUM)
HIGH, LOW = np.array([1.2]), np.array([0.1])
WEIGHT = 9.81 * 0.4 * 0.15
#: Of 0.06 N m against both directions, 0.08 and 0.04 are left.
ASYMMETRIC = free(
    replace(IDEAL, friction=np.array([0.06])),
    HIGH,
    hidden("asymmetric_friction", 0, difference=0.04),
)
LOADED = replace(
    free(IDEAL, HIGH, hidden("load_dependent_friction", 0, coefficient=0.3)),
    control=(np.array([2.0]), np.array([0.0])),
)
FREE = {
    "nothing": free(IDEAL, HIGH),
    "asymmetric": ASYMMETRIC,
    "loaded": LOADED,
    "lossy": replace(
        free(IDEAL, HIGH, hidden("drive_loss", 0, coefficient=0.1)),
        control=(np.array([2.0]), np.array([0.0])),
    ),
    "idle": replace(
        free(IDEAL, HIGH, hidden("drive_dead_zone", 0, torque=0.5)),
        control=(np.array([2.0]), np.array([0.0])),
    ),
    "stays": free(IDEAL, LOW, hidden("coulomb_friction", 0, torque=1.01 * WEIGHT * np.sin(0.1))),
    "slips": free(IDEAL, LOW, hidden("coulomb_friction", 0, torque=0.9 * WEIGHT * np.sin(0.1))),
    **{effect.effect: free(IDEAL, HIGH, effect) for effect, _ in LAWS},
}


@pytest.fixture(scope="module")
def swung() -> dict[str, Course]:
    """Returns how pendulums move that nothing holds."""
    return dict(zip(FREE, simulate(list(FREE.values()), settling_s=0.0), strict=True))


def gained(course: Course) -> float:
    """Returns by how much the energy grew, J."""
    levels = energy(PENDULUM, course)
    return float(levels[-1] - levels[0])


def test_a_pendulum_without_friction_keeps_its_energy(swung: dict[str, Course]) -> None:
    course = swung["nothing"]
    assert np.ptp(course.position) > 1.5
    swing = np.ptp(WEIGHT * np.cos(course.position))
    assert np.ptp(energy(PENDULUM, course)) < 1e-5 * swing


@pytest.mark.parametrize(("effect", "law"), LAWS, ids=[effect.effect for effect, _ in LAWS])
def test_energy_changes_by_the_work_of_the_law(
    swung: dict[str, Course], effect: Hidden, law: Callable[[Array, Array], Array]
) -> None:
    course = swung[effect.effect]
    expected = work(course, law(course.position[:, 0], course.velocity[:, 0]))
    assert abs(expected) > 5e-3
    assert gained(course) == pytest.approx(expected, rel=5e-3)


def test_dry_friction_holds_what_is_below_its_level_for_good(swung: dict[str, Course]) -> None:
    assert (swung["stays"].position == 0.1).all()
    assert swung["slips"].position[-1, 0] < 0.095


def test_friction_that_differs_by_direction_is_its_level_and_half_the_difference(
    swung: dict[str, Course],
) -> None:
    course = swung["asymmetric"]
    v = course.velocity[:, 0]
    assert v.min() < -1.0 < 1.0 < v.max()
    law = np.where(v > 0, -0.08, 0.04) * (v != 0)
    assert gained(course) == pytest.approx(work(course, law), rel=5e-3)


def test_friction_that_depends_on_the_load_grows_with_the_drive(
    swung: dict[str, Course],
) -> None:
    course = swung["loaded"]
    # The torque before the next command is that of the whole time step.
    drive_torque, turned = course.effort[1:, 0], np.diff(course.position[:, 0])
    rubbed = float(np.sum(-0.3 * np.abs(drive_torque) * np.abs(turned)))
    assert abs(rubbed) > 0.02
    assert gained(course) == pytest.approx(float(np.sum(drive_torque * turned)) + rubbed, rel=0.01)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("lossy", lambda asked: asked * (1.0 - 0.1 * np.abs(asked))),
        ("idle", lambda asked: np.sign(asked) * np.maximum(np.abs(asked) - 0.5, 0.0)),
    ],
)
def test_what_a_drive_loses_is_missing_in_its_effort(
    swung: dict[str, Course], name: str, given: Callable[[Array], Array]
) -> None:
    course, run = swung[name], FREE[name]
    number = (run.measured_at[1:] - 1 - run.first_command_step) // run.command_every
    asked = course.command[np.minimum(number, len(course.command) - 1), 0]
    assert np.ptp(asked) > 1.0
    np.testing.assert_allclose(course.effort[1:, 0], given(asked))
    worked = float(np.sum(course.effort[1:, 0] * np.diff(course.position[:, 0])))
    assert gained(course) == pytest.approx(worked, rel=0.01)


def test_a_drive_loses_of_the_weight_that_it_bears_as_of_all_else() -> None:
    robot, loss = replace(PENDULUM, compensated=True), hidden("drive_loss", 0, coefficient=0.1)
    runs = [drive(robot, "position", *e) for e in ((), (loss,))]
    right, lossy = simulate(runs, settling_s=0.1)
    number = (runs[0].measured_at[1:] - 1 - runs[0].first_command_step) // EVERY

    def asked(course: Course) -> Array:
        off = course.command[number] - course.position[1:]
        return robot.stiffness * off - robot.servo_damping * course.velocity[1:]

    np.testing.assert_allclose(right.servo[1:], asked(right), atol=1e-9)
    borne, leant = right.effort - right.servo, np.sin(right.position)
    weight = float(borne.ravel() @ leant.ravel()) / float(leant.ravel() @ leant.ravel())
    total = asked(lossy) + weight * np.sin(lossy.position[1:])
    np.testing.assert_allclose(lossy.effort[1:], total * (1.0 - 0.1 * np.abs(total)), atol=1e-9)


def test_coupled_friction_takes_from_one_joint_what_it_gives_the_other() -> None:
    robot = replace(frictionless(PLANAR), servo_damping=np.zeros(2))
    effect = hidden("coupled_friction", 0, 1, viscous=0.5)
    start = np.array([0.3, -0.4])
    nominal, coupled = simulate(
        [free(robot, start, *e, seconds=0.02) for e in ((), (effect,))], settling_s=0.0
    )
    # While both still move together from rest, only their difference is damped.
    apart = [c.velocity[-1, 0] - c.velocity[-1, 1] for c in (nominal, coupled)]
    assert abs(apart[1]) < 0.9 * abs(apart[0])


def test_a_saturated_servo_gives_its_limit_and_no_more() -> None:
    effect = hidden("torque_saturation", 0, limit=0.05)
    robots = (PENDULUM, replace(PENDULUM, compensated=True))
    courses = simulate([drive(r, "position", effect) for r in robots], settling_s=0.1)
    for course in courses:
        assert np.abs(course.servo).max() == pytest.approx(0.05)
    # Gravity compensation works beside the limit.
    assert np.abs(courses[1].effort).max() > 0.1


def test_a_delay_shifts_the_answer() -> None:
    still = replace(PENDULUM, rest=np.zeros(1))
    delay = hidden("command_delay", 0, delay=0.02)
    nominal, late = simulate(
        [drive(still, "position", *e, seconds=0.3) for e in ((), (delay,))], 0.0
    )
    # 0.02 s are four measurements.
    assert np.abs(late.position[4:] - nominal.position[:-4]).max() < 1e-9


def test_a_lag_is_a_first_order_filter_of_the_command() -> None:
    run = drive(PENDULUM, "position", hidden("actuator_lag", 0, time_constant=0.05))
    stepped = np.zeros_like(run.reference)
    stepped[10:] = 0.2  # from t = 0 on
    still = replace(run, reference=stepped, start=np.zeros(1), measured_at=np.array([20]))
    (course,) = simulate([still], settling_s=0.1)
    servo = 6.0 * (0.2 * (1 - np.exp(-0.2)) - course.position) - 0.25 * course.velocity
    assert course.servo[0, 0] == pytest.approx(float(servo[0, 0]), rel=1e-6)


PAYLOAD = hidden("payload", 0, mass=0.2, com_x=0.0, com_y=0.0, com_z=-0.2)
HELD = {
    "nothing": held(PENDULUM, 0.5),
    "gain": held(PENDULUM, 0.5, hidden("actuator_gain", 0, scale=1.5)),
    "elastic": held(PENDULUM, 0.5, hidden("joint_elasticity", 0, stiffness=20.0)),
    "play, right": held(PENDULUM, 0.5, hidden("backlash", 0, gap=0.02)),
    "play, left": held(PENDULUM, -0.5, hidden("backlash", 0, gap=0.02)),
    "encoder": held(PENDULUM, 0.5, hidden("encoder_offset", 0, offset=0.05)),
    "payload": held(replace(PENDULUM, compensated=True), 0.5, PAYLOAD),
    "tilt": held(PENDULUM, 0.5, hidden("gravity_direction", tilt_x=0.0, tilt_y=0.1)),
}


@pytest.fixture(scope="module")
def settled() -> dict[str, Course]:
    """Returns where held pendulums come to rest."""
    return dict(zip(HELD, simulate(list(HELD.values()), settling_s=2.0), strict=True))


@pytest.mark.parametrize(("name", "scale"), [("nothing", 1.0), ("gain", 1.5)])
def test_a_gain_scales_what_the_servo_gives(
    settled: dict[str, Course], name: str, scale: float
) -> None:
    q = settled[name].position[0, 0]
    assert scale * 6.0 * (0.5 - q) == pytest.approx(WEIGHT * np.sin(q), rel=1e-4)
    assert settled[name].effort[0, 0] == pytest.approx(WEIGHT * np.sin(q), rel=1e-4)


def test_an_elastic_joint_bends_by_torque_over_stiffness(settled: dict[str, Course]) -> None:
    q = settled["elastic"].position[0, 0]
    load = WEIGHT * np.sin(q)
    assert q == pytest.approx(0.5 - load / 6.0 - load / 20.0, abs=1e-5)


@pytest.mark.parametrize(("name", "side"), [("play, right", 1.0), ("play, left", -1.0)])
def test_free_play_lets_the_link_hang_by_half_the_gap(
    settled: dict[str, Course], name: str, side: float
) -> None:
    q = settled[name].position[0, 0]
    assert q == pytest.approx(side * (0.5 - 0.01) - WEIGHT * np.sin(q) / 6.0, abs=2e-5)


def test_an_offset_encoder_deceives_the_servo(settled: dict[str, Course]) -> None:
    reported = settled["encoder"].position[0, 0]
    assert 6.0 * (0.5 - reported) == pytest.approx(WEIGHT * np.sin(reported - 0.05), rel=1e-4)


def test_a_payload_weighs_and_is_not_compensated(settled: dict[str, Course]) -> None:
    q = settled["payload"].position[0, 0]
    assert settled["payload"].servo[0, 0] == pytest.approx(9.81 * 0.2 * 0.2 * np.sin(q), rel=1e-3)


def test_gravity_is_tilted_as_the_contract_says(settled: dict[str, Course]) -> None:
    q = settled["tilt"].position[0, 0]
    # g = 9.81 (-sin 0.1, 0, -cos 0.1); a pendulum along (-sin q, 0, -cos q) feels sin(q - 0.1).
    assert settled["tilt"].effort[0, 0] == pytest.approx(WEIGHT * np.sin(q - 0.1), rel=1e-3)


def test_armature_adds_inertia() -> None:
    robot = frictionless(PENDULUM)
    heavy = hidden("armature", 0, inertia=0.01)
    runs = [free(robot, np.array([1.0]), *e, seconds=0.01) for e in ((), (heavy,))]
    light, slow = (c.velocity[-1, 0] for c in simulate(runs, settling_s=0.0))
    inertia = 0.002 + 0.4 * 0.15**2 + 0.004
    assert light / slow == pytest.approx((inertia + 0.01) / inertia, rel=1e-3)
