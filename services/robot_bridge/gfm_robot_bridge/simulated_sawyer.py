"""The simulated Sawyer, as seen from the bridge: another process behind the transport."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from typing_extensions import override

from gfm.core import Clock, Command, Observation, RefusedError
from gfm.core.checks import Array
from gfm.sim.sawyer_numbers import JOINTS
from gfm.transport import PendingReply, Transport
from gfm_robot_bridge.robot import Robot, told
from gfm_robot_bridge.sawyer_dynamics import SawyerDynamics
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_wire import RobotClock, RobotExchange, RobotStates, SetPayload

EXCHANGE = "sawyer/exchange"
#: Documented by the robot: its controller keeps commands until then.
COMMAND_LATENCY_NS = 4_000_000
#: Documented by the robot: after so much silence it stops by itself.
PATIENCE_S = 0.2


@final
class SimulatedSawyer(Robot):
    """Asks whoever serves `sawyer/exchange`.

    Args:
        transport: The connection.
        clock: Of this process.
        robot_clock: How the robot's time passes.
        timeout_s: How long to wait for an answer.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        robot_clock: RobotClock,
        timeout_s: float = 10.0,
    ) -> None:
        self.joint_names = tuple(joint.name for joint in JOINTS)
        self.limits = sawyer_limits()
        self.command_latency_ns = COMMAND_LATENCY_NS
        self.patience_s = PATIENCE_S
        self.dynamics = SawyerDynamics()
        self._transport = transport
        self._clock = clock
        self._robot_clock = robot_clock
        self._timeout_s = timeout_s
        self._pending: PendingReply | None = None
        self._object_pose: Array | None = None
        self._carries: SetPayload | None = None
        self._payload: SetPayload | None = None
        self._robot_ns = 0
        self._heard_ns = clock.now_ns()

    @override
    def time_ns(self) -> int:
        if self._robot_clock == RobotClock.LOCKSTEP:
            return self._robot_ns
        return self._robot_ns + self._clock.now_ns() - self._heard_ns

    @override
    def begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        exchange = RobotExchange(
            commands=tuple(commands),
            advance_ns=advance_ns,
            object_pose=self._object_pose,
            payload=self._payload,
            clock=self._robot_clock,
        )
        self._object_pose = self._payload = None
        self._pending = self._transport.request(EXCHANGE, exchange, timeout_s=self._timeout_s)

    @override
    def place_object(self, pose: Array) -> bool:
        self._object_pose = pose
        return True

    @override
    def carry(self, payload: SetPayload) -> bool:
        self._carries = self._payload = payload
        return True

    @override
    def about(self) -> Mapping[str, str]:
        return told(self._carries)

    @override
    def poll(self) -> tuple[Observation, ...] | None:
        if self._pending is None:
            return ()
        answer = self._pending.poll()
        if answer is None:
            return None
        self._pending = None
        if not isinstance(answer, RobotStates) or not answer.states:
            raise RefusedError(f"the robot answered {type(answer).__name__}, expected RobotStates")
        if answer.states[-1].stamp_ns > self._robot_ns:
            self._robot_ns = answer.states[-1].stamp_ns
            self._heard_ns = self._clock.now_ns()
        return answer.states
