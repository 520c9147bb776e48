"""What comes out of the limiter keeps to the limits, whatever goes in; without a jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.core import Command, CommandKind, Observation, Reason
from gfm.sim.sawyer import READY
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Bounds, approach_speed, limited_speed
from gfm_robot_bridge.mirror import UnitMasses
from gfm_robot_bridge.plan import Plan, positions, speeds
from gfm_robot_bridge.sawyer_dynamics import SawyerDynamics
from gfm_robot_bridge.torque import limited_torque

PERIOD_S = 0.02
#: Positions that are followed by speeds: the joint is half a period ahead of its setpoint, rad.
_OVERSHOT = 3e-4
BOUNDS = Bounds(
    lower=np.array([-1.0, -2.0]),
    upper=np.array([1.0, 2.0]),
    velocity=np.array([0.5, 1.0]),
    velocity_limit=np.array([1.0, 2.0]),
    acceleration=np.array([5.0, 5.0]),
    braking=np.array([7.0, 7.0]),
    effort=np.array([5.0, 5.0]),  # as much as a joint of 1 kg m^2 needs to stop
    still=np.array([0.01, 0.02]),
    power_w=2.0,
    patience_s=0.22,
)


class Plant:
    """Two joints that do exactly what setpoints say, and remember what they did."""

    def __init__(self) -> None:
        self.limiter = Limiter(BOUNDS, UnitMasses(), PERIOD_S)
        self.position, self.velocity = np.zeros(2), np.zeros(2)
        self.fastest, self.hardest = np.zeros(2), np.zeros(2)

    def send(self, kind: CommandKind, values: np.ndarray) -> Plan:
        command = Command(kind=kind, joint_names=("a", "b"), values=values, stamp_ns=0)
        plan = self.limiter.limited(command, self.seen)
        self.follow(plan)
        return plan

    @property
    def seen(self) -> Observation:
        return Observation(
            joint_names=("a", "b"),
            position=self.position,
            velocity=self.velocity,
            effort=np.zeros(2),
            stamp_ns=0,
        )

    def follow(self, plan: Plan) -> None:
        before, place = self.velocity, self.position
        end = plan.values[-1]
        match plan.kind:
            case CommandKind.POSITION:
                self.position, self.velocity = end, (end - place) / PERIOD_S
            case CommandKind.VELOCITY:
                self.velocity = end
                self.position = place + PERIOD_S * (before + end) / 2.0
            case CommandKind.EFFORT:
                self.velocity = before + PERIOD_S * end
                self.position = place + PERIOD_S * (before + self.velocity) / 2.0
        self.fastest = np.maximum(self.fastest, np.abs(self.velocity))
        change = np.abs(self.velocity - before) / PERIOD_S
        self.hardest = np.maximum(self.hardest, change)


SETPOINTS = st.floats(allow_nan=False, allow_infinity=False, width=64)
SOME = st.floats(-3.0, 3.0)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(CommandKind)),
            st.one_of(st.tuples(SETPOINTS, SETPOINTS), st.tuples(SOME, SOME)),
            st.integers(1, 30),
        ),
        min_size=1,
        max_size=20,
    )
)
def test_no_sequence_of_commands_leads_out_of_the_limits(
    sent: list[tuple[CommandKind, tuple[float, float], int]],
) -> None:
    plant = Plant()
    for kind, values, times in sent:
        for _ in range(times):
            plant.send(kind, np.array(values))
            assert (plant.position >= BOUNDS.lower - _OVERSHOT).all()
            assert (plant.position <= BOUNDS.upper + _OVERSHOT).all()
    assert (plant.fastest <= BOUNDS.velocity + 1e-9).all()
    assert (plant.hardest <= BOUNDS.braking + 1e-6).all()


@pytest.mark.parametrize("kind", list(CommandKind))
def test_what_always_pushes_towards_an_end_comes_to_rest_before_it(kind: CommandKind) -> None:
    plant = Plant()
    for _ in range(1500):
        plant.send(kind, np.array([1e9, -1e9]))
        assert (plant.position <= BOUNDS.upper + 1e-4).all()
        assert (plant.position >= BOUNDS.lower - 1e-4).all()
    np.testing.assert_allclose(plant.position, [1.0, -2.0], atol=0.02)
    assert np.abs(plant.velocity).max() < 0.01


def test_a_far_position_is_reached_and_not_overshot() -> None:
    plant, highest = Plant(), 0.0
    for _ in range(150):
        plant.send(CommandKind.POSITION, np.array([0.5, 0.0]))
        highest = max(highest, plant.position[0])
    assert plant.position[0] == 0.5
    assert highest <= 0.5 + 5.0 * PERIOD_S**2


def test_positions_that_move_evenly_pass_unchanged() -> None:
    plant = Plant()
    for step in range(100):
        wanted = np.array([0.2, 0.5]) * (1.0 - np.cos(0.02 * step))
        plan = plant.send(CommandKind.POSITION, wanted)
        assert plan.reason is Reason.NONE
        np.testing.assert_array_equal(plan.values[-1], wanted)


def test_a_joint_outside_its_range_may_only_come_back() -> None:
    for sign, expected in ((1.0, 0.0), (-1.0, -0.1)):
        after, _ = limited_speed(
            np.array([sign, 0.0]),
            np.zeros(2),
            np.array([1.2, 0.0]),
            BOUNDS,
            period_s=PERIOD_S,
            after_s=0.2,
        )
        assert after[0] == pytest.approx(expected)


@pytest.mark.parametrize("after_s", [0.0, 0.3])
def test_from_the_approach_speed_a_joint_stops_exactly_there(after_s: float) -> None:
    distance, braking = np.array([0.4, 0.0, -1.0]), np.array([8.0, 8.0, 8.0])
    v = approach_speed(distance, braking, after_s)
    np.testing.assert_allclose(v * after_s + v**2 / (2 * braking), [0.4, 0.0, 0.0], atol=1e-12)


# Mode changes and stops


def test_positions_begin_when_the_arm_is_at_rest() -> None:
    plant = Plant()
    for _ in range(20):
        plant.send(CommandKind.VELOCITY, np.array([0.5, 0.5]))
    plans = [plant.send(CommandKind.POSITION, np.zeros(2)) for _ in range(6)]
    kinds = [plan.kind for plan in plans]
    change = kinds.index(CommandKind.POSITION)
    assert kinds == [CommandKind.VELOCITY] * change + [CommandKind.POSITION] * (6 - change)
    assert all(plan.reason & Reason.MODE for plan in plans[:change])
    assert change == 4  # 0.5 rad/s at 7 rad/s^2


@pytest.mark.parametrize("kind", list(CommandKind))
def test_a_stop_is_a_ramp_that_ends_in_holding(kind: CommandKind) -> None:
    plant = Plant()
    for step in range(25):
        wanted = {"velocity": 0.5, "effort": 2.0, "position": 0.01 * step}[kind]
        plant.send(kind, np.full(2, wanted))
    assert plant.velocity[1] > 0.3
    plant.hardest[:] = 0.0
    for _ in range(20):
        plan = plant.limiter.stopped(plant.seen)
        if plan is None:
            break
        plant.follow(plan)
    assert plant.limiter.holds
    assert plant.limiter.stopped(plant.seen) is None
    assert plant.velocity.tolist() == [0.0, 0.0]
    assert (plant.hardest <= BOUNDS.braking + 1e-9).all()


def test_an_arm_that_sinks_while_it_is_told_to_stand_is_held() -> None:
    limiter, kinds = Limiter(BOUNDS, None, PERIOD_S), []
    sinking = replace(Plant().seen, velocity=np.array([0.1, 0.0]))
    while (plan := limiter.stopped(sinking)) is not None:
        kinds.append(plan.kind)
    assert kinds == [CommandKind.VELOCITY] * 6 + [CommandKind.POSITION]  # 0.02 s and 0.08 s
    limiter.forget()
    command = Command(
        kind=CommandKind.POSITION, joint_names=("a", "b"), values=np.zeros(2), stamp_ns=0
    )
    kinds = [limiter.limited(command, sinking).kind for _ in range(8)]
    assert kinds == [CommandKind.VELOCITY] * 6 + [CommandKind.POSITION] * 2


def test_what_is_told_after_it_was_forgotten_begins_at_what_the_arm_does() -> None:
    plant = Plant()
    plant.velocity = np.array([0.3, 0.0])
    plant.limiter.forget()
    plan = plant.send(CommandKind.VELOCITY, np.array([0.5, 0.0]))
    assert plan.values[-1].tolist() == pytest.approx([0.4, 0.0])


# Setpoints within a period


def test_a_small_change_is_told_at_once_and_a_large_one_in_steps() -> None:
    ramp = speeds(np.zeros(2), np.array([0.02, 0.0]), np.full(2, 5.0), PERIOD_S)
    assert ramp.tolist() == [[0.02, 0.0]]
    ramp = speeds(np.zeros(2), np.array([0.1, -0.05]), np.full(2, 5.0), PERIOD_S)
    np.testing.assert_allclose(ramp[:, 0], [0.02, 0.04, 0.06, 0.08, 0.1])
    np.testing.assert_allclose(ramp[:, 1], [-0.02, -0.04, -0.05, -0.05, -0.05])
    way, spacing_s = positions(np.zeros(2), np.array([0.003, 0.0]), PERIOD_S)
    assert way.tolist() == [[0.003, 0.0]]
    way, spacing_s = positions(np.zeros(2), np.array([0.01, 0.0]), PERIOD_S)
    np.testing.assert_allclose(way[:, 0], [0.0025, 0.005, 0.0075, 0.01])
    assert spacing_s == 0.005


# Torques


def test_a_torque_that_would_lead_nowhere_bad_passes_unchanged() -> None:
    torque, reason = limited_torque(
        np.array([0.5, -0.5]), np.zeros(2), np.zeros(2), UnitMasses(), BOUNDS
    )
    assert torque.tolist() == [0.5, -0.5]
    assert reason is Reason.NONE


@pytest.mark.parametrize(
    ("position", "velocity", "expected", "reason"),
    [
        (0.0, 0.0, 0.5 / 0.22, Reason.VELOCITY),  # as fast as allowed after its patience
        (0.0, 0.5, 0.0, Reason.VELOCITY),
        (0.95, 0.5, -2.5, Reason.POSITION),  # -v^2 / (2 * 0.05): it stops at the end
    ],
)
def test_torques_are_limited_by_what_they_lead_to(
    position: float, velocity: float, expected: float, reason: Reason
) -> None:
    torque, why = limited_torque(
        np.array([4.0, 0.0]),
        np.array([position, 0.0]),
        np.array([velocity, 0.0]),
        UnitMasses(),
        BOUNDS,
    )
    assert torque[0] == pytest.approx(expected)
    assert reason in why


def test_torques_put_no_more_power_into_the_arm_than_allowed() -> None:
    velocity = np.array([0.4, 0.9])
    wide = Bounds(**(vars(BOUNDS) | {"power_w": 0.05, "velocity": np.array([9.0, 9.0])}))
    torque, why = limited_torque(np.array([1.0, -1.0]), np.zeros(2), velocity, UnitMasses(), wide)
    assert torque[0] * velocity[0] == pytest.approx(0.05)
    assert torque[1] == -1.0  # it brakes
    assert Reason.POWER in why


def test_a_robot_without_dynamics_takes_no_torques() -> None:
    limiter = Limiter(BOUNDS, None, PERIOD_S)
    assert limiter.refusal(CommandKind.EFFORT).startswith("effort commands need a robot with dyn")
    assert limiter.refusal(CommandKind.VELOCITY) == ""


def test_sawyers_torques_cause_the_accelerations_that_they_were_made_for() -> None:
    rng, dynamics = np.random.default_rng(0), SawyerDynamics()
    velocity, acceleration = rng.standard_normal((2, 7))
    torque = dynamics.torques(READY, velocity, acceleration)
    np.testing.assert_allclose(dynamics.accelerations(READY, velocity, torque), acceleration)
    assert np.abs(dynamics.torques(READY, np.zeros(7), np.zeros(7))).max() < 1e-12
