"""The bridge's geometry: distances, what is foreseen, and what is let through because of them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfm.core import (
    Command,
    CommandKind,
    ConfigError,
    ManualClock,
    Observation,
    Reason,
    RefusedError,
)
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES, READY, sawyer_spec
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.foresight import Foresight
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.mirror import MirrorRobot, UnitMasses
from gfm_robot_bridge.plan import Plan
from gfm_robot_bridge.sawyer_dynamics import SawyerDynamics
from gfm_robot_bridge.sawyer_guard import sawyer_guard
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_robot_bridge.surroundings import Surroundings, guarded_model
from gfm_wire import Message, PowerAction, PowerRobot, RobotClock

PERIOD_S = 0.02
CLEARANCE_M = 0.01
#: What the guard leaves to noise: of a distance on the way, and of one at its end.
NOISE_M = 0.002

# A ball of 5 cm on two slides, x and z, above a floor at z = 0, between walls at x = -0.4 and 0.4


def slides(kind: CommandKind) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    box, sphere = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
    spec.worldbody.add_geom(name="floor", type=box, size=(1.0, 1.0, 0.1), pos=(0, 0, -0.1))
    body = spec.worldbody
    for name, axis in (("x", (1, 0, 0)), ("z", (0, 0, 1))):
        body = body.add_body(name=name)
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        actuator = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=[1.0] + [0.0] * 5
        )
        match kind:
            case CommandKind.POSITION:
                actuator.set_to_position(kp=800.0, kv=80.0)
            case CommandKind.VELOCITY:
                actuator.set_to_velocity(kv=50.0)
            case CommandKind.EFFORT:
                actuator.set_to_motor()
        body.mass, body.inertia, body.explicitinertial = (
            (1.0 if name == "z" else 1e-6),
            [1.0] * 3,
            True,
        )
    body.add_geom(name="ball", type=sphere, size=(0.05, 0.0, 0.0), mass=0.0)
    return spec


WALLS = (-0.4, -1.0, -1.0, 0.4, 1.0, 1.0)
SLIDES = Limits(
    lower=np.full(2, -9.0),
    upper=np.full(2, 9.0),
    velocity=np.full(2, 1.0),
    acceleration=np.full(2, 10.0),
    effort=np.full(2, 20.0),
)


class Rig:
    """A limiter with a guard, and a nominal arm that does what it is told."""

    def __init__(
        self, guard: Guard, models: dict[CommandKind, mujoco.MjModel], limits: Limits, at: Array
    ) -> None:
        bounds = BridgeConfig(name="bridge").bounds(limits, 0.2)
        sawyer = len(at) == len(JOINT_NAMES)
        dynamics = SawyerDynamics() if sawyer else UnitMasses()
        self.limiter = Limiter(bounds, dynamics, PERIOD_S, guard)
        self.names = JOINT_NAMES if sawyer else ("x", "z")
        self.position, self.velocity = np.array(at), np.zeros(len(at))
        self._models = models

    @property
    def seen(self) -> Observation:
        return Observation(
            joint_names=self.names,
            position=self.position,
            velocity=self.velocity,
            effort=np.zeros(len(self.names)),
            stamp_ns=0,
        )

    def send(self, kind: CommandKind, values: Array) -> Plan:
        command = Command(kind=kind, joint_names=self.names, values=values, stamp_ns=0)
        plan = self.limiter.limited(command, self.seen)
        model = self._models[plan.kind]
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = self.position, self.velocity
        for step in range(round(PERIOD_S / model.opt.timestep)):
            number = int(step * model.opt.timestep / plan.spacing_s + 1e-9)
            data.ctrl[:] = plan.values[min(number, len(plan.values) - 1)]
            mujoco.mj_step(model, data)
        self.position, self.velocity = data.qpos.copy(), data.qvel.copy()
        return plan


def stepped(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Returns a model to move with: weightless, without contacts, in steps of 1 ms."""
    spec.option.timestep, spec.option.gravity = 1e-3, np.zeros(3)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return spec.compile()


def ball_guard() -> Guard:
    foresight = Foresight(
        {kind: slides(kind).compile() for kind in CommandKind},
        np.full(2, 7.0),
        np.full(2, 5.0),
        0.035,
        0.235,
    )
    surroundings = Surroundings(guarded_model(slides(CommandKind.EFFORT), WALLS))
    return Guard(surroundings, foresight, CLEARANCE_M)


def ball(x: float = 0.0, z: float = 0.3) -> Rig:
    models = {kind: stepped(slides(kind)) for kind in CommandKind}
    return Rig(ball_guard(), models, SLIDES, np.array([x, z]))


def sawyer() -> Rig:
    guard = sawyer_guard(BridgeConfig(name="bridge", task="position"), MirrorRobot(JOINT_NAMES))
    models = {
        kind: stepped(sawyer_spec(command=kind, end_effector="plate")) for kind in CommandKind
    }
    return Rig(guard, models, sawyer_limits(), READY)


# Distances


def test_distances_are_exact_and_beyond_sight_there_are_none() -> None:
    surroundings = Surroundings(guarded_model(slides(CommandKind.EFFORT), WALLS))
    near = surroundings.near(np.array([0.3, 0.08]))
    found = dict(zip(map(surroundings.reason, near.pair.tolist()), near.distance, strict=True))
    assert found == pytest.approx({Reason.COLLISION: 0.03, Reason.WORKSPACE: 0.05})
    assert surroundings.near(np.array([0.0, 0.01])).distance == pytest.approx([-0.04])
    assert len(surroundings.near(np.array([0.0, 0.3])).distance) == 0


def test_the_plate_is_as_high_above_the_basket_as_its_tip() -> None:
    spec = sawyer_spec(command=CommandKind.EFFORT, end_effector="plate", basket=True)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = READY
    mujoco.mj_kinematics(model, data)
    height = data.site("end_effector").xpos[2] - data.body("basket").xpos[2]
    guarded = guarded_model(spec, ())
    near = Surroundings(guarded).near(READY)
    floor, plate = guarded.geom("basket_floor").id, guarded.geom("plate").id
    pair = floor * guarded.ngeom + plate, plate * guarded.ngeom + floor
    assert near.distance[np.isin(near.pair, pair)].min() == pytest.approx(height, abs=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_hulls_are_as_near_as_the_shapes_that_they_stand_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spec = sawyer_spec(command=CommandKind.EFFORT, end_effector="plate", basket=True)
    model = spec.compile()
    data, surroundings = mujoco.MjData(model), Surroundings(guarded_model(spec, ()))
    for position in READY + rng.uniform(-0.6, 0.6, (200, 7)):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        near, least = surroundings.near(position), {}
        for pair, distance in zip(near.pair.tolist(), near.distance, strict=True):
            least[pair] = min(distance, least.get(pair, 1.0))
        plate = model.geom("plate").id
        for other in range(model.ngeom):
            true = mujoco.mj_geomDistance(model, data, plate, other, 0.3, None)
            pairs = (plate * model.ngeom + other, other * model.ngeom + plate)
            if 0.0 < true < 0.05 and model.body_weldid[model.geom_bodyid[other]] == 0:
                assert min(least.get(p, 1.0) for p in pairs) == pytest.approx(true, abs=3e-3)


def test_parting_is_the_derivative_of_the_distances() -> None:
    surroundings = Surroundings(
        guarded_model(sawyer_spec(command=CommandKind.EFFORT, end_effector="ball", basket=True), ())
    )
    before = surroundings.near(READY)
    rows, h = surroundings.parting(), 1e-5
    for joint in range(7):
        after = surroundings.near(READY + h * np.eye(7)[joint])
        np.testing.assert_array_equal(after.pair, before.pair)
        slope = (after.distance - before.distance) / h
        np.testing.assert_allclose(rows[:, joint], slope, atol=1e-4)


def test_no_point_of_the_arm_moves_farther_than_its_reach() -> None:
    model = guarded_model(sawyer_spec(command=CommandKind.EFFORT, end_effector="plate"), ())
    reach, data, rng = Surroundings(model).reach, mujoco.MjData(model), np.random.default_rng(0)
    for position in rng.uniform(-2.0, 2.0, (50, 7)):
        step = 1e-3 * rng.standard_normal(7)
        places = []
        for place in (position, position + step):
            data.qpos[:] = place
            mujoco.mj_kinematics(model, data)
            places.append(data.geom_xpos.copy())
        gone = np.linalg.norm(places[1] - places[0], axis=1).max()
        assert gone <= reach @ np.abs(step)
    assert reach[0] < 2.0


# Foresight


def test_it_foresees_how_the_robot_stops_by_itself() -> None:
    limits, robot = sawyer_limits(), SimulatedRobot(READY)
    speed = 0.3 * limits.velocity * np.array([1, -1, 1, -1, 1, -1, 1])
    command = Command(kind=CommandKind.VELOCITY, joint_names=JOINT_NAMES, values=speed, stamp_ns=0)
    robot.advance(command, 100_000_000)
    began = robot.latest
    robot.advance(None, 900_000_000)  # 0.1 s of its patience are left
    foresight = Foresight(
        {kind: sawyer_spec(command=kind).compile() for kind in CommandKind},
        0.7 * limits.acceleration,
        0.5 * limits.acceleration,
        next_s=0.02,
        patience_s=0.104,
    )
    plan = Plan(kind=CommandKind.VELOCITY, values=speed[None], spacing_s=0.004)
    alone, stopped = foresight.paths(began.position, began.velocity, plan)
    gone = robot.latest.position - began.position
    np.testing.assert_allclose(alone[-1] - began.position, gone, atol=0.05 * np.abs(gone).max())
    assert (np.abs(stopped[-1] - began.position) < np.abs(alone[-1] - began.position)).all()


def test_it_foresees_that_a_position_is_arrived_at() -> None:
    foresight = Foresight(
        {kind: slides(kind).compile() for kind in CommandKind},
        np.full(2, 7.0),
        np.full(2, 5.0),
        0.02,
        0.22,
    )
    plan = Plan(kind=CommandKind.POSITION, values=np.array([[0.0, 0.29]]), spacing_s=0.02)
    arrived, stopped = foresight.paths(np.array([0.0, 0.3]), np.zeros(2), plan)
    np.testing.assert_allclose(arrived[-1], [0.0, 0.29], atol=1e-3)
    assert 0.29 < stopped[-1][1] < 0.3


def test_it_foresees_that_setpoints_go_on_where_the_arm_lags_behind_them() -> None:
    braking, slowing = np.full(2, 7.0), np.full(2, 5.0)
    models = {kind: slides(kind).compile() for kind in CommandKind}
    foresight = Foresight(models, braking, slowing, 0.035, 0.235)
    plan = Plan(kind=CommandKind.POSITION, values=np.array([[0.0, 0.29]]), spacing_s=0.02)
    still, falls = np.zeros(2), np.array([0.0, -0.3])
    _, stopped = foresight.paths(np.array([0.0, 0.3]), still, plan, slowing=falls)
    np.testing.assert_allclose(stopped[-1], [0.0, 0.29 - 0.3**2 / (2.0 * 5.0)], atol=1.5e-3)


# What is let through


@pytest.mark.parametrize("kind", list(CommandKind))
def test_what_leads_down_comes_to_rest_above_the_floor(kind: CommandKind) -> None:
    rig, reasons = ball(), Reason.NONE
    for _ in range(150):
        values = {"position": -1.0, "velocity": -5.0, "effort": -5.0}[kind]
        reasons |= rig.send(kind, np.array([0.0, values])).reason
        assert rig.position[1] - 0.05 >= CLEARANCE_M - NOISE_M
    assert rig.position[1] - 0.05 < CLEARANCE_M + 0.01
    assert np.abs(rig.velocity).max() < 0.01
    assert Reason.COLLISION in reasons
    assert Reason.WORKSPACE not in reasons


def test_the_sides_of_the_workspace_are_kept_and_named() -> None:
    rig, reasons = ball(), Reason.NONE
    for _ in range(150):
        reasons |= rig.send(CommandKind.VELOCITY, np.array([5.0, 0.0])).reason
        assert 0.4 - rig.position[0] - 0.05 >= CLEARANCE_M - NOISE_M
    assert Reason.WORKSPACE in reasons
    assert Reason.COLLISION not in reasons


def test_what_is_far_from_everything_passes_unchanged() -> None:
    rig = ball()
    plan = rig.send(CommandKind.VELOCITY, np.array([0.05, -0.05]))
    assert plan.reason is Reason.NONE
    assert plan.values[-1].tolist() == [0.05, -0.05]


def test_along_the_floor_it_goes_on() -> None:
    rig = ball(x=-0.3, z=0.0605)
    for _ in range(50):
        plan = rig.send(CommandKind.VELOCITY, np.array([0.2, -0.1]))
        assert rig.position[1] - 0.05 >= CLEARANCE_M - NOISE_M
    assert plan.reason == Reason.COLLISION
    assert rig.velocity[0] == pytest.approx(0.2, abs=0.01)


def test_what_starts_too_near_may_go_away_or_along_but_no_nearer() -> None:
    for speed, expected in (((0.0, 0.05), Reason.NONE), ((0.05, 0.0), Reason.NONE)):
        rig = ball(z=0.055)
        plan = rig.send(CommandKind.VELOCITY, np.array(speed))
        assert plan.reason is expected
        assert plan.values[-1].tolist() == list(speed)
    rig = ball(z=0.055)
    for _ in range(100):
        assert Reason.COLLISION in rig.send(CommandKind.VELOCITY, np.array([0.0, -0.05])).reason
    assert rig.position[1] >= 0.055 - NOISE_M


def test_what_was_pushed_too_near_is_only_let_away() -> None:
    rig = ball(z=0.1)
    rig.send(CommandKind.VELOCITY, np.zeros(2))
    rig.position = np.array([0.0, 0.054])
    for speed in ([0.05, 0.0], [0.0, -0.05]):
        rig.send(CommandKind.VELOCITY, np.array(speed))
        assert rig.position[1] >= 0.054 - 1e-4
    for _ in range(60):
        rig.send(CommandKind.VELOCITY, np.array([0.0, 0.05]))
    assert rig.position[1] > 0.1


def test_a_clearance_that_is_lost_is_said_once_and_it_can_be_led_away() -> None:
    guard, at = ball_guard(), Rig(ball_guard(), {}, SLIDES, np.array([0.0, 0.052])).seen
    assert guard.loss(at) is None  # it was never seen farther away
    guard.look(replace(at, position=np.array([0.0, 0.3])))
    assert guard.loss(replace(at, position=np.array([0.0, 0.056]))) is None
    said = guard.loss(at)
    assert said is not None
    assert re.search(r"ball and floor are 2 mm apart, expected at least 10 mm", said.words)
    assert not said.again
    assert guard.loss(at) is None
    guard.look(at)
    along = Plan(kind=CommandKind.VELOCITY, values=np.array([[0.1, 0.0]]), spacing_s=0.004)
    assert guard.reason(along) is Reason.NONE


def test_a_clearance_lost_again_is_told_apart_by_whether_it_was_led_away() -> None:
    guard, at = ball_guard(), Rig(ball_guard(), {}, SLIDES, np.array([0.0, 0.3])).seen

    def lost_at(z: float) -> bool | None:
        loss = guard.loss(replace(at, position=np.array([0.0, z])))
        return None if loss is None else loss.again

    guard.look(at)
    assert lost_at(0.052) is False
    guard.sink(replace(at, position=np.array([0.0, 0.045])))
    assert lost_at(0.041) is None  # what the stop still cost is no new loss
    assert lost_at(0.039) is True
    guard.look(at)
    assert lost_at(0.052) is False


class Served:
    """A bridge with a guard, and a ball that does what it is told, or is pushed."""

    def __init__(self, folder: Path) -> None:
        hub, clock = MemoryHub(), ManualClock()
        self.robot = MirrorRobot(("x", "z"), SLIDES)
        self.push(0.3)
        config = BridgeConfig(name="bridge", recordings=str(folder), clock=RobotClock.LOCKSTEP)
        transport = MemoryTransport(hub, clock=clock)
        self.bridge = BridgeService(config, self.robot, transport, clock, guard=ball_guard())
        self._asker, self._clock = MemoryTransport(hub, name="asker", clock=clock), clock

    def push(self, z: float) -> None:
        place = Command(
            kind=CommandKind.POSITION,
            joint_names=("x", "z"),
            values=np.array([0.0, z]),
            stamp_ns=0,
        )
        self.robot.begin([place], 0)

    def ask(self, key: str, message: Message) -> Message:
        pending = self._asker.request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self._clock.advance_s(1e-3)
            while self.bridge.step():
                pass
        return answer

    def stand(self, number: int) -> None:
        still = Command(
            kind=CommandKind.VELOCITY,
            joint_names=("x", "z"),
            values=np.zeros(2),
            stamp_ns=0,
            number=number,
        )
        self.ask("robot/command", still)


def test_after_a_clearance_was_lost_twice_nobody_drives_until_a_person_resets(
    tmp_path: Path,
) -> None:
    served = Served(tmp_path)
    served.stand(0)
    served.push(0.054)
    served.stand(1)
    with pytest.raises(RefusedError, match=r"protective stop: .* a command with number 0 begins"):
        served.stand(2)
    served.stand(0)
    served.push(0.048)
    served.stand(1)
    for number in (2, 0):
        with pytest.raises(
            RefusedError, match=r"protective stop: .* by hand, then `gfm robot reset`"
        ):
            served.stand(number)
    assert served.bridge.status().gauges["waits_for_reset"] == 1.0
    served.ask("robot/power", PowerRobot(action=PowerAction.RESET))
    assert served.bridge.status().gauges["waits_for_reset"] == 0.0
    served.stand(0)
    with pytest.raises(RefusedError, match="nothing to switch"):
        served.ask("robot/power", PowerRobot(action=PowerAction.RESET))


@pytest.mark.parametrize("kind", list(CommandKind))
def test_once_kept_away_it_goes_back(kind: CommandKind) -> None:
    rig = ball()
    for sign in (-1.0, 1.0):
        for _ in range(100):
            rig.send(kind, np.array([0.0, sign]))
    assert rig.position[1] > 0.2


@settings(max_examples=12, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(list(CommandKind)), st.integers(0, 10**6), st.integers(3, 25)),
        min_size=1,
        max_size=6,
    )
)
def test_no_sequence_of_commands_leads_a_nominal_sawyer_too_near(
    sent: list[tuple[CommandKind, int, int]],
) -> None:
    rig, limits = sawyer(), sawyer_limits()
    spec = sawyer_spec(command=CommandKind.EFFORT, end_effector="plate", basket=True)
    judge = Surroundings(guarded_model(spec, BridgeConfig(name="bridge").workspace_m))
    for kind, seed, times in sent:
        rng = np.random.default_rng(seed)
        target = READY + rng.uniform(-1.0, 1.0, 7)
        for _ in range(times):
            values = {
                "position": target,
                "velocity": 3.0 * (target - rig.position),
                "effort": limits.effort * np.sign(target - rig.position),
            }[kind]
            rig.send(kind, values)
            near = judge.near(rig.position)
            assert near.distance.min(initial=1.0) >= CLEARANCE_M - NOISE_M


def test_a_path_that_is_let_through_keeps_away_in_all_its_moments() -> None:
    rng, limits, let = np.random.default_rng(0), sawyer_limits(), 0
    spec = sawyer_spec(command=CommandKind.EFFORT, end_effector="plate", basket=True)
    judge = Surroundings(guarded_model(spec, BridgeConfig(name="bridge").workspace_m))
    models = {
        kind: sawyer_spec(command=kind, end_effector="plate").compile() for kind in CommandKind
    }
    shares = (0.7 * limits.acceleration, 0.5 * limits.acceleration)
    foresight = Foresight(models, *shares, next_s=0.035, patience_s=0.235)
    guard = Guard(judge, foresight, CLEARANCE_M)
    for position in READY + rng.uniform(-0.4, 0.4, (150, 7)):
        if judge.near(position).distance.min(initial=1.0) < CLEARANCE_M:
            continue
        velocity, speed = 0.4 * limits.velocity * rng.uniform(-1.0, 1.0, (2, 7))
        seen = Observation(
            joint_names=JOINT_NAMES,
            position=position,
            velocity=velocity,
            effort=np.zeros(7),
            stamp_ns=0,
        )
        plan = Plan(kind=CommandKind.VELOCITY, values=speed[None], spacing_s=0.004)
        guard.look(seen)
        if guard.reason(plan):
            continue
        let += 1
        for path in foresight.paths(position, velocity, plan):
            for place in path:
                assert judge.near(place).distance.min(initial=1.0) >= CLEARANCE_M - 2 * NOISE_M
    assert 20 < let < 140


# Settings


def test_a_limiter_without_a_guard_knows_no_geometry() -> None:
    rig = ball()
    rig.limiter = Limiter(BridgeConfig(name="bridge").bounds(SLIDES, 0.2), UnitMasses(), PERIOD_S)
    for _ in range(100):
        assert not rig.send(CommandKind.VELOCITY, np.array([0.0, -0.4])).reason & (
            Reason.COLLISION | Reason.WORKSPACE
        )
    assert rig.position[1] < 0.0


@pytest.mark.parametrize("box", [(0.0, 0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)])
def test_a_workspace_is_two_corners(box: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=r"workspace_m is \[0.0, .*expected a lower corner"):
        BridgeConfig(name="bridge", workspace_m=box)
    assert BridgeConfig(name="bridge", workspace_m=()).workspace_m == ()
