"""Stands between whoever commands and the robot."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from typing_extensions import override

from gfm import __version__
from gfm.core import Clock, Command, CommandKind, GfmError, Observation, RefusedError, Status
from gfm.service import Service, make_status
from gfm.transport import Request, Transport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.gate import CommandGate
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.limits import Limiter, Reason
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.robot import Robot
from gfm_wire import Ack, ByHand, PlaceObject, RecordStart, RecordStop, ReleaseRobot

_log = logging.getLogger(__name__)

COMMAND = "robot/command"
RECORD = "robot/record"
OBJECT = "robot/object"
RELEASE = "robot/release"
OBSERVATION = "robot/observation"
_RETRY_NS = 1_000_000_000
_QUATERNION_TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class _Exchange:
    """What the robot was told in the exchange that is under way.

    Attributes:
        request: Who waits for the answer.
        applied: The command as the recording has it, or None where the last one goes on.
        reason: Why it is not what was requested.
    """

    request: Request | None = None
    applied: Command | None = None
    reason: Reason = Reason.NONE


@final
class BridgeService(Service):
    """Serves `robot/command`, `robot/record`, `robot/object`; publishes `robot/observation`.

    A Command is answered, a control period later, by the newest Observation; it says what was
    applied and why that differs. On the lockstep clock the robot's time passes only in these
    periods. On the wall clock there is an exchange every period, and silence trips the watchdog.
    """

    def __init__(
        self, config: BridgeConfig, robot: Robot, transport: Transport, clock: Clock
    ) -> None:
        self._config = config
        self._robot = robot
        self._transport = transport
        self._clock = clock
        self._limiter = Limiter(
            robot.limits,
            period_s=config.period_ns * 1e-9,
            margin_rad=config.position_margin_rad,
            velocity_share=config.velocity_share,
        )
        oldest_ns = round(config.command_age_s * 1e9) if config.clock == "wall" else None
        lease = Lease("the robot", round(config.lease_s * 1e9))
        self._gate = CommandGate(robot.joint_names, lease, oldest_ns)
        self._recorder = Recorder(Path(config.recordings), _about(config))
        self._commands = transport.serve(COMMAND)
        self._records = transport.serve(RECORD)
        self._places = transport.serve(OBJECT)
        self._releases = transport.serve(RELEASE)
        self._counters: Counter[str] = Counter(dict.fromkeys(_COUNTERS, 0))
        self._newest: Observation | None = None
        self._exchange: _Exchange | None = None
        self._deadline_ns = clock.now_ns()
        self._note = "waiting for the robot"

    @override
    def step(self) -> bool:
        if self._exchange is not None:
            return self._continue_exchange(self._exchange)
        if (request := self._records.receive()) is not None:
            self._answer_record(request)
            return True
        if (request := self._places.receive()) is not None:
            self._answer_place(request)
            return True
        if (request := self._releases.receive()) is not None:
            self._answer_release(request)
            return True
        if self._newest is None or self._config.clock == "wall":
            return self._tick_on_time()
        newest = self._newest_command()
        if newest is not None:
            self._take_command(*newest, self._newest)
        return newest is not None

    @override
    def status(self) -> Status:
        counters = dict(self._counters) | {"recordings": self._recorder.finished}
        gauges = {"robot_time_s": self._robot.time_ns() * 1e-9}
        return make_status(
            "robot_bridge", self._config.name, counters=counters, gauges=gauges, note=self._note
        )

    @override
    def close(self) -> None:
        """Leaves the robot holding (its own watchdog stands behind this), the recording whole."""
        if self._newest is not None:
            self._robot.begin(self._stamped(self._hold(self._newest)), 0)
        if self._recorder.name:
            self._recorder.stop()

    def _tick_on_time(self) -> bool:
        """Begins the exchange of a period when it is due (the first one also in lockstep)."""
        now_ns = self._clock.now_ns()
        if now_ns < self._deadline_ns:
            return False
        if now_ns - self._deadline_ns > self._config.period_ns:
            self._counters["overruns"] += self._newest is not None
            self._deadline_ns = now_ns
        self._deadline_ns += self._config.period_ns
        if self._newest is None:
            self._begin(_Exchange())
        elif (newest := self._newest_command()) is not None:
            self._take_command(*newest, self._newest)
        else:
            self._watch(now_ns, self._newest)
        return True

    def _watch(self, now_ns: int, newest: Observation) -> None:
        """Begins an exchange without a request; holds where there should have been one."""
        silent_ns = self._gate.silent_ns(now_ns)
        if silent_ns < self._config.watchdog_periods * self._config.period_ns:
            self._begin(_Exchange())
            return
        fault = f"no command for {silent_ns * 1e-6:.0f} ms, the robot holds"
        self._counters["watchdog_trips"] += 1
        self._note = fault
        _log.warning("%s", fault)
        self._gate.latch(fault)
        hold = self._hold(newest)
        self._apply(None, hold, hold.values, Reason.WATCHDOG)

    def _newest_command(self) -> tuple[Request, Command] | None:
        """Empties the queue; returns the newest command that is listened to, refuses the rest."""
        found: tuple[Request, Command] | None = None
        while (request := self._commands.receive()) is not None:
            command = request.message
            if not isinstance(command, Command):
                self._refuse(request, f"got {type(command).__name__}, expected Command")
            elif problem := self._problem(request, command):
                self._refuse(request, problem)
            else:
                if found is not None:
                    self._counters["superseded_commands"] += 1
                    found[0].refuse(
                        f"command {found[1].number}: a newer one came, {command.number}"
                    )
                if self._gate.accept(command, request.stamp, self._clock.now_ns()):
                    self._limiter.forget()
                found = request, command
        return found

    def _problem(self, request: Request, command: Command) -> str:
        stale = self._gate.stale(command, self._clock.utc_ns())
        self._counters["stale_commands"] += bool(stale)
        return stale or self._gate.refusal(command, request.stamp, self._clock.now_ns())

    def _take_command(self, request: Request, command: Command, newest: Observation) -> None:
        order = [command.joint_names.index(name) for name in self._robot.joint_names]
        requested = replace(
            command, joint_names=self._robot.joint_names, values=command.values[order]
        )
        values, reason = self._limiter.limited(requested, newest.position, newest.velocity)
        self._counters["clipped_commands"] += bool(reason)
        self._note = f"commanded in {command.kind} mode"
        self._apply(request, requested, values, reason)

    def _apply(
        self, request: Request | None, requested: Command, values: np.ndarray, reason: Reason
    ) -> None:
        """Tells the robot; what is recorded is stamped with the time at which it acts."""
        sent = self._stamped(replace(requested, values=values))
        acts_ns = sent.stamp_ns + self._robot.command_latency_ns
        applied = replace(sent, stamp_ns=acts_ns)
        self._recorder.command(replace(requested, stamp_ns=acts_ns), applied)
        self._begin(_Exchange(request=request, applied=applied, reason=reason), sent)

    def _begin(self, exchange: _Exchange, command: Command | None = None) -> None:
        first = self._newest is None
        self._exchange = exchange
        self._robot.begin(command, 0 if first else self._config.period_ns)

    def _continue_exchange(self, exchange: _Exchange) -> bool:
        try:
            reports = self._robot.poll()
        except GfmError as error:
            self._fail(exchange, str(error))
            return True
        if reports is None:
            return False
        self._exchange = None
        self._counters["ticks"] += 1
        self._take_reports(reports, exchange)
        if exchange.request is not None and self._newest is not None:
            exchange.request.reply(self._newest)
        return True

    def _take_reports(self, reports: tuple[Observation, ...], exchange: _Exchange) -> None:
        """Records and publishes what is new among the robot's reports."""
        last_ns = -1 if self._newest is None else self._newest.stamp_ns
        in_force = exchange.applied or (self._newest.applied if self._newest else None)
        received_ns = self._clock.now_ns()
        for report in reports:
            if report.stamp_ns > last_ns:
                self._recorder.report(report)
        if reports:
            self._newest = replace(
                reports[-1],
                received_ns=received_ns,
                applied=in_force,
                reason=int(exchange.reason),
            )
            self._transport.publish(OBSERVATION, self._newest)

    def _fail(self, exchange: _Exchange, problem: str) -> None:
        """The robot did not answer: whoever asked is told, and the next try waits a little."""
        self._exchange = None
        self._counters["robot_failures"] += 1
        self._note = f"robot: {problem}"
        _log.warning("robot: %s", problem)
        self._gate.latch(f"robot: {problem}")
        self._deadline_ns = self._clock.now_ns() + _RETRY_NS
        if exchange.request is not None:
            self._refuse(exchange.request, f"robot: {problem}")

    def _answer_record(self, request: Request) -> None:
        message = request.message
        try:
            if isinstance(message, RecordStart):
                self._recorder.start(message)
                request.reply(Ack())
            elif isinstance(message, RecordStop):
                request.reply(self._recorder.stop())
            else:
                got = type(message).__name__
                self._refuse(request, f"got {got}, expected RecordStart or RecordStop")
        except RefusedError as error:
            self._refuse(request, str(error))

    def _answer_place(self, request: Request) -> None:
        message = request.message
        if not isinstance(message, PlaceObject):
            self._refuse(request, f"got {type(message).__name__}, expected PlaceObject")
            return
        if problem := self._gate.lease.refusal(request.stamp, self._clock.now_ns()):
            self._refuse(request, problem)
            return
        length = float(np.linalg.norm(message.pose[3:]))
        if abs(length - 1.0) > _QUATERNION_TOLERANCE:
            self._refuse(request, f"pose has a quaternion of length {length:.3g}, expected 1")
            return
        request.reply(Ack() if self._robot.place_object(message.pose) else ByHand())

    def _answer_release(self, request: Request) -> None:
        """Ends the holder's session."""
        message = request.message
        if not isinstance(message, ReleaseRobot):
            self._refuse(request, f"got {type(message).__name__}, expected ReleaseRobot")
        elif problem := self._gate.lease.refusal(request.stamp, self._clock.now_ns()):
            self._refuse(request, problem)
        else:
            self._gate.release()
            request.reply(Ack())

    def _refuse(self, request: Request, reason: str) -> None:
        self._counters["rejected_messages"] += 1
        request.refuse(reason)

    def _stamped(self, command: Command) -> Command:
        return replace(command, stamp_ns=self._robot.time_ns())

    def _hold(self, newest: Observation) -> Command:
        """Returns the command to come to rest: at no speed in velocity mode, else where it is."""
        in_force = None if newest.applied is None else newest.applied.kind
        by_speed = in_force is CommandKind.VELOCITY
        return Command(
            kind=CommandKind.VELOCITY if by_speed else CommandKind.POSITION,
            joint_names=self._robot.joint_names,
            values=np.zeros_like(newest.position) if by_speed else newest.position,
            stamp_ns=0,
        )


_COUNTERS = (
    "ticks",
    "clipped_commands",
    "stale_commands",
    "superseded_commands",
    "overruns",
    "watchdog_trips",
    "robot_failures",
    "rejected_messages",
)


def _about(config: BridgeConfig) -> dict[str, str]:
    """Returns what every recording says about itself."""
    return {
        "run": config.run,
        "software": f"gfm {__version__}",
        "robot": config.robot,
        "clock": config.clock,
        "control_hz": f"{config.control_hz:g}",
    }
