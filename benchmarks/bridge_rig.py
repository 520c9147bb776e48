"""Driver, bridge and simulated Sawyer in one thread, with the arm watched at every step."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import final

import msgspec
import numpy as np
from bridge_geometry import TARGETS, Geometry, Nearest
from typing_extensions import override

from gfm.core import Clock, Command, CommandKind, ManualClock, Observation
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.transport import MemoryHub, MemoryTransport, PendingReply
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.sawyer_guard import sawyer_guard
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.sawyer_load import sawyer_load
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.mechanics import Mechanics
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_robot_bridge.simulated.service import SimulatedService
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import Message, ObjectPose, RobotClock, SetPayload, TrackedObject

LIMITS = sawyer_limits()
_SHARE = 0.5
_STILL = 0.01
_STEP_S = 2e-3
_SOMEWHERE = ObjectPose(
    position=np.array([0.6, 0.0, 0.05]),
    quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    covariance=1e-6 * np.eye(6),
)


@final
class WatchedArm(Mechanics):
    """The simulated arm, and the worst that it did.

    Attributes:
        worst: By name and by the mode that the servo was in: speed and acceleration over the
            robot's limits, how far beyond the end of a range, rad (negative: before it), and how
            far beyond a side of the workspace, into the basket or into itself, m.
        slowed: Highest deceleration by its limit since it was last set to 0.
        time_s: Of the arm.
        moved_s: When it moved last, at more than 1 % of a limit.
    """

    def __init__(self, arm: Arm, geometry: Geometry | None) -> None:
        self._arm = arm
        self._nearest = None if geometry is None else Nearest(geometry)
        self.servo = arm.servo
        self.worst: dict[tuple[str, str], float] = {}
        self.slowed = self.time_s = self.moved_s = 0.0

    @property
    @override
    def position(self) -> Array:
        return self._arm.position

    @property
    @override
    def velocity(self) -> Array:
        return self._arm.velocity

    @property
    @override
    def object_pose(self) -> Array | None:
        return self._arm.object_pose

    @override
    def put_object(self, pose: Array) -> None:
        self._arm.put_object(pose)

    @override
    def carry(self, payload: SetPayload) -> None:
        self._arm.carry(payload)

    @override
    def drive(self) -> Array:
        return self._arm.drive()

    @override
    def step(self, h: float) -> None:
        before = self._arm.velocity
        self._arm.step(h)
        if h <= 0.0:
            return
        q, v = self._arm.position, self._arm.velocity
        a = (v - before) / h
        self.time_s += h
        if (np.abs(v) >= _STILL * LIMITS.velocity).any():
            self.moved_s = self.time_s
        past = np.maximum(LIMITS.lower - q, q - LIMITS.upper).max()
        self._note("speed", np.abs(v / LIMITS.velocity).max())
        self._note("acceleration", np.abs(a / LIMITS.acceleration).max())
        self._note("past_end_rad", past)
        if self._nearest is not None:
            kind = str(self.servo.kind)
            least = {target: -self.worst.get((target, kind), -np.inf) for target in TARGETS}
            for target, distance in self._nearest.below(q, least).items():
                self._note(target, -distance)
        slowing = np.where(a * v < 0.0, np.abs(a) / LIMITS.acceleration, 0.0)
        self.slowed = max(self.slowed, float(slowing.max()))

    def _note(self, name: str, value: float) -> None:
        key = (name, str(self.servo.kind))
        self.worst[key] = max(self.worst.get(key, -np.inf), float(value))


@final
class Waits(Clock):
    """The clock of a bridge that may wait for its robot, which goes on meanwhile."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @override
    def now_ns(self) -> int:
        return self._rig.clock.now_ns()

    @override
    def utc_ns(self) -> int:
        return self._rig.clock.utc_ns()

    @override
    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._rig.clock.sleep_until_ns(deadline_ns)
        self._rig.robot.step()


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What is tried.

    Attributes:
        control_hz: Of the bridge.
        share: Of the velocity limits that it allows.
        guarded: Whether it knows any geometry.
        observed: Whether it observes the load that the arm bears.
        judged: Whether distances are measured at every step.
        effects: What the robot hides from it.
    """

    control_hz: float
    share: float = _SHARE
    guarded: bool = True
    observed: bool = True
    judged: bool = True
    effects: tuple[HiddenEffect, ...] = ()


@final
class Rig:
    """Driver, bridge and robot in one thread; the clock moves when told to.

    Attributes:
        spent_s: Processor time of the bridge in every stretch of time that was let pass.
        object_is_seen: Whether cameras see an object.
    """

    def __init__(self, folder: Path, setting: Setting, seed: int) -> None:
        control_hz = setting.control_hz
        self.clock, hub = ManualClock(10**9), MemoryHub()
        self.watched: list[WatchedArm] = []
        self.spent_s: list[float] = []
        config = BridgeConfig(
            name="bridge",
            clock=RobotClock.WALL,
            control_hz=control_hz,
            recordings=str(folder),
            velocity_share=setting.share,
            task="position",
        )
        self.config = config
        self.geometry = Geometry(config.workspace_m) if setting.judged else None
        transport = MemoryTransport(hub, name="bridge", clock=self.clock)
        sawyer = SimulatedSawyer(transport, self.clock, robot_clock=RobotClock.WALL)
        guard = sawyer_guard(config, sawyer) if setting.guarded else None
        # The arm that moves has no plate: of a load that is none the bridge shall not know.
        bare = msgspec.structs.replace(config, task="none")
        observer = sawyer_load(bare) if setting.observed else None
        self.bridge = BridgeService(
            config, sawyer, transport, Waits(self), guard=guard, observer=observer
        )
        robot = SimulatedRobot(READY, effects=setting.effects, seed=seed, mechanics=self._watch)
        self.robot = SimulatedService(
            SimulatedConfig(name="robot", clock=RobotClock.WALL),
            robot,
            MemoryTransport(hub, name="robot", clock=self.clock),
            self.clock,
        )
        self._driver = MemoryTransport(hub, name="driver", clock=self.clock)
        self._tracker = MemoryTransport(hub, name="tracker", clock=self.clock)
        self.object_is_seen = True
        self.observations = self._driver.subscribe("robot/observation")
        self.bridge_lives = True
        self.number = 0
        self.pass_time(2.0 / control_hz)

    def ask(self, key: str, message: Message) -> None:
        """Sends something else."""
        self._driver.request(key, message, timeout_s=1.0)

    @property
    def waits_for_reset(self) -> bool:
        """Whether the bridge listens to nobody until a person resets it."""
        return bool(self.bridge.status().gauges["waits_for_reset"])

    @property
    def arm(self) -> WatchedArm:
        """The arm."""
        return self.watched[0]

    def _watch(self, position: Array, effects: tuple[HiddenEffect, ...], cell: Cell) -> Mechanics:
        self.watched.append(WatchedArm(Arm(position, effects, cell), self.geometry))
        return self.watched[0]

    def pass_time(self, seconds: float) -> None:
        """Lets time pass for all, in steps of at most two milliseconds."""
        steps = math.ceil(seconds / _STEP_S - 1e-9)
        self.spent_s.append(0.0)
        for _ in range(steps):
            self.clock.advance_s(seconds / steps)
            self._work()

    def _work(self) -> None:
        for _ in range(8):
            worked = self.robot.step()
            if self.bridge_lives:
                began_s = time.thread_time()
                worked |= self.bridge.step()
                self.spent_s[-1] += time.thread_time() - began_s
            if not worked:
                return

    def close_bridge(self) -> None:
        """Closes the bridge, which is stepped no more after that."""
        self.bridge.close()
        self.bridge_lives = False

    def track(self) -> None:
        """Tells where the object is, or that no camera sees it."""
        seen = TrackedObject(
            stamp_ns=self.clock.utc_ns(), pose=_SOMEWHERE if self.object_is_seen else None
        )
        self._tracker.request("robot/tracked", seen, timeout_s=1.0)

    def send(
        self,
        kind: CommandKind,
        values: Array,
        *,
        number: int | None = None,
        age_s: float = 0.0,
        needs_object: bool = False,
        share: float = 1.0,
    ) -> PendingReply:
        """Sends one command."""
        command = Command(
            kind=kind,
            joint_names=JOINT_NAMES,
            values=values,
            stamp_ns=self.clock.utc_ns() - round(age_s * 1e9),
            number=self.number if number is None else number,
            needs_object=needs_object,
            speed_share=share,
        )
        self.number += number is None
        return self._driver.request("robot/command", command, timeout_s=1.0)

    def newest(self) -> Observation | None:
        """Returns the newest observation that the driver sees."""
        seen = self.observations.latest()
        return seen if isinstance(seen, Observation) else None
