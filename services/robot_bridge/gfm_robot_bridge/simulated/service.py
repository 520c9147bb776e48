"""Serves the simulated robot under `sawyer/exchange`."""

from __future__ import annotations

from collections import Counter, deque
from typing import final

from typing_extensions import override

from gfm.core import Clock, Observation, RefusedError, Status
from gfm.service import Service, make_status
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import Request, Transport
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.pace import WallPace
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_wire import RobotClock, RobotExchange, RobotStates

EXCHANGE = "sawyer/exchange"
#: An exchange that asks for more than this is a mistake, and would stop the answers for long.
_LONGEST_ADVANCE_NS = 10_000_000_000
_KEPT_REPORTS = 1000
#: Another bridge is listened to after this silence of the first, as when that was started anew.
_BRIDGE_SILENCE_NS = 5_000_000_000


@final
class SimulatedService(Service):
    """Answers RobotExchange with RobotStates, to one bridge: nobody goes past it to the robot.

    On the lockstep clock the robot's time passes in exchanges only, by as much as they ask for.
    On the wall clock it passes by itself, and an exchange returns what was reported since the
    last one.
    """

    def __init__(
        self, config: SimulatedConfig, robot: SimulatedRobot, transport: Transport, clock: Clock
    ) -> None:
        self._config = config
        self._robot = robot
        self._clock = clock
        self._pace = WallPace(robot, clock)
        self._server = transport.serve(EXCHANGE)
        self._bridge = Lease("this robot", _BRIDGE_SILENCE_NS)
        self._reports: deque[Observation] = deque(maxlen=_KEPT_REPORTS)
        self._counters: Counter[str] = Counter(exchanges=0, rejected_messages=0)

    @override
    def step(self) -> bool:
        behind = False
        if self._config.clock == RobotClock.WALL:
            reports, behind = self._pace.keep_up()
            self._reports.extend(reports)
        request = self._server.receive()
        if request is not None:
            self._answer(request)
        return behind or request is not None

    @override
    def status(self) -> Status:
        return make_status(
            "robot",
            self._config.name,
            counters=self._counters,
            gauges={"robot_time_s": self._robot.time_ns * 1e-9},
            note=f"simulated Sawyer on the {self._config.clock} clock",
        )

    @override
    def close(self) -> None:
        """Nothing: the robot vanishes with its process."""

    def _answer(self, request: Request) -> None:
        message = request.message
        problem = self._problem(message) or self._bridge.refusal(
            request.stamp, self._clock.now_ns()
        )
        if problem or not isinstance(message, RobotExchange):
            self._counters["rejected_messages"] += 1
            request.refuse(problem)
            return
        self._bridge.take(request.stamp, self._clock.now_ns())
        if message.object_pose is not None:
            try:
                self._robot.place_object(message.object_pose)
            except RefusedError as error:
                request.refuse(str(error))
                return
        if message.payload is not None:
            self._robot.carry(message.payload)
        self._counters["exchanges"] += 1
        advance_ns = 0 if self._config.clock == RobotClock.WALL else message.advance_ns
        for command in message.commands:
            self._robot.take(command)
        self._reports.extend(self._robot.advance(None, advance_ns))
        states = tuple(self._reports) or (self._robot.latest,)
        self._reports.clear()
        request.reply(RobotStates(states=states))

    def _problem(self, message: object) -> str:
        """Returns why an exchange is refused, or nothing."""
        if not isinstance(message, RobotExchange):
            return f"got {type(message).__name__}, expected RobotExchange"
        return _exchange_problem(message, self._config.clock)


def _exchange_problem(message: RobotExchange, clock: RobotClock) -> str:
    if message.clock != clock:
        return (
            f"the bridge is on the {message.clock} clock and this robot on the {clock} clock, "
            "expected both on the same (--clock)"
        )
    if message.advance_ns > _LONGEST_ADVANCE_NS:
        return f"advance_ns is {message.advance_ns}, expected at most {_LONGEST_ADVANCE_NS}"
    for command in message.commands:
        if set(command.joint_names) != set(JOINT_NAMES):
            names, expected = ", ".join(command.joint_names), ", ".join(JOINT_NAMES)
            return f"command names {names}, expected {expected}"
    return ""
