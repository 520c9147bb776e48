"""Stands between whoever commands and the robot."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from typing_extensions import override

from gfm import __version__
from gfm.core import Clock, Command, GfmError, Observation, Status
from gfm.service import Service, make_status
from gfm.transport import QUEUED_REQUESTS, Request, Transport
from gfm_robot_bridge.background import AtOnce, Background
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.desk import Controls, Desk
from gfm_robot_bridge.following import Following
from gfm_robot_bridge.gate import CommandGate
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Reason
from gfm_robot_bridge.plan import Plan
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.robot import Robot
from gfm_wire import RobotClock

_log = logging.getLogger(__name__)

COMMAND = "robot/command"
OBSERVATION = "robot/observation"
_RETRY_NS = 1_000_000_000
#: A stop takes less than this, or the robot does not answer.
_LONGEST_STOP_NS = 1_000_000_000
_POLL_NS = 500_000
_LONGEST_WRITE_S = 5.0


@dataclass(frozen=True, kw_only=True)
class _InForce:
    """What the robot was told last.

    Attributes:
        applied: The command as the recording has it, or None before the first.
        reason: Why it is not what was requested.
    """

    applied: Command | None = None
    reason: Reason = Reason.NONE


@final
class BridgeService(Service, Controls):
    """Serves `robot/command`, `robot/record`, `robot/object`; publishes `robot/observation`.

    A Command is answered, a control period later, by the newest Observation; it says what was
    applied and why that differs. On the lockstep clock the robot's time passes only in these
    periods, and while the robot is stopped. On the wall clock the robot's reports are read every
    period, the command is decided by them and sent, and silence trips the watchdog.

    Args:
        config: Its settings.
        robot: To drive.
        transport: The connection to whoever commands.
        clock: Of this process.
        background: That writes recordings; by default they are written at once.
    """

    def __init__(
        self,
        config: BridgeConfig,
        robot: Robot,
        transport: Transport,
        clock: Clock,
        background: Background | None = None,
    ) -> None:
        self._config = config
        self._robot = robot
        self._transport = transport
        self._clock = clock
        bounds = config.bounds(robot.limits, robot.patience_s)
        self._limiter = Limiter(bounds, robot.dynamics, config.period_ns * 1e-9)
        oldest_ns = round(config.command_age_s * 1e9) if config.clock == RobotClock.WALL else None
        lease = Lease("the robot", round(config.lease_s * 1e9))
        self._gate = CommandGate(robot.joint_names, lease, oldest_ns)
        self._following = Following(bounds.still, config.behind_rad, config.behind_s)
        self._recorder = Recorder(Path(config.recordings), _about(config), background or AtOnce())
        self._counters: Counter[str] = Counter(dict.fromkeys(_COUNTERS, 0))
        self._commands = transport.serve(COMMAND)
        self._desk = Desk(transport, clock, robot, self._recorder, lease, controls=self)
        self._newest: Observation | None = None
        self._under_way = False
        self._reads = False
        self._waiting: Request | None = None
        self._in_force = _InForce()
        self._stopping = Reason.NONE
        self._stamp_ns = -1
        self._deadline_ns = self._retry_ns = clock.now_ns()
        self._note = "waiting for the robot"

    @override
    def step(self) -> bool:
        if self._under_way:
            return self._continue_exchange()
        answered = self._desk.answer()
        return self._tick() or answered

    def _tick(self) -> bool:
        """Begins a period where it is time for one; returns whether it was."""
        if self._newest is None or self._config.clock == RobotClock.WALL:
            return self._tick_on_time()
        return self._decide(self._newest)

    @override
    def status(self) -> Status:
        counters = dict(self._counters)
        counters |= {
            "recordings": self._recorder.finished,
            "lost_recordings": self._recorder.failed,
        }
        counters["rejected_messages"] += self._desk.rejected
        gauges = {"robot_time_s": self._robot.time_ns() * 1e-9}
        return make_status(
            "robot_bridge", self._config.name, counters=counters, gauges=gauges, note=self._note
        )

    @override
    def close(self) -> None:
        """Leaves the robot at rest (its own watchdog stands behind this), the recording whole."""
        self._stop(Reason.STOPPED, "the bridge is closed")
        until_ns = self._clock.now_ns() + _LONGEST_STOP_NS
        while self._stopping and self._clock.now_ns() < until_ns:
            if not self.step():
                self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        self._recorder.close(_LONGEST_WRITE_S)

    def _tick_on_time(self) -> bool:
        """Begins the exchange of a period when it is due (the first one also in lockstep)."""
        now_ns = self._clock.now_ns()
        if now_ns < self._deadline_ns:
            return False
        if now_ns - self._deadline_ns > self._config.period_ns:
            self._counters["overruns"] += self._newest is not None
            self._deadline_ns = now_ns
        self._deadline_ns += self._config.period_ns
        self._reads = self._newest is not None
        self._begin((), passes=self._reads)
        return True

    def _decide(self, newest: Observation) -> bool:
        """Tells the robot what is next, by its newest report; returns whether there is anything."""
        found = self._newest_command()
        if self._stopping:
            return self._clock.now_ns() >= self._retry_ns and self._go_on_stopping(newest)
        if found is not None:
            self._take_command(*found, newest)
            return True
        silent_ns = self._gate.silent_ns(self._clock.now_ns())
        watched = self._config.clock == RobotClock.WALL
        if not watched or silent_ns < self._config.watchdog_periods * self._config.period_ns:
            return False
        self._counters["watchdog_trips"] += 1
        self._stop(Reason.WATCHDOG, f"no command for {silent_ns * 1e-6:.0f} ms, the robot holds")
        return self._go_on_stopping(newest)

    def _stop(self, reason: Reason, fault: str) -> None:
        """Begins to stop the robot, and ends the session with a fault."""
        self._note = fault
        _log.warning("%s", fault)
        self._gate.latch(fault)
        self._stopping = reason

    @override
    def let_go(self) -> None:
        self._stop(Reason.STOPPED, "its driver let go, the robot holds")
        self._gate.release()

    @override
    def stop(self, why: str) -> None:
        self._stop(Reason.STOPPED, why)

    @override
    def scale(self) -> float:
        return self._limiter.scale

    @override
    def set_scale(self, scale: float) -> None:
        _log.info("going at %.0f %% of the commanded speed", 100.0 * scale)
        self._limiter.scale = scale

    def _go_on_stopping(self, newest: Observation) -> bool:
        """Tells the robot the next part of a stop; returns False where it holds already."""
        plan = self._limiter.stopped(newest)
        if plan is None:
            self._stopping = Reason.NONE
            return False
        self._apply(None, replace(plan, reason=plan.reason | self._stopping))
        return True

    def _newest_command(self) -> tuple[Request, Command] | None:
        """Empties the queue; returns the newest command that is listened to, refuses the rest."""
        found: tuple[Request, Command] | None = None
        for _ in range(QUEUED_REQUESTS):  # who sends without pause shall not hold up the robot
            if (request := self._commands.receive()) is None:
                break
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
                    self._stopping = Reason.NONE
                found = request, command
        return found

    def _problem(self, request: Request, command: Command) -> str:
        stale = self._gate.stale(command, self._clock.utc_ns())
        self._counters["stale_commands"] += bool(stale)
        refused = self._gate.refusal(command, request.stamp, self._clock.now_ns())
        return stale or refused or self._limiter.refusal(command.kind)

    def _take_command(self, request: Request, command: Command, newest: Observation) -> None:
        order = [command.joint_names.index(name) for name in self._robot.joint_names]
        requested = replace(
            command, joint_names=self._robot.joint_names, values=command.values[order]
        )
        plan = self._limiter.limited(requested, newest)
        self._counters["clipped_commands"] += bool(plan.reason)
        self._note = f"commanded in {command.kind} mode"
        self._waiting = request
        self._apply(requested, plan)

    def _apply(self, requested: Command | None, plan: Plan) -> None:
        """Tells the robot a plan; what is recorded is stamped with the time at which it acts."""
        now_ns = max(self._robot.time_ns(), self._stamp_ns + 1)
        sent = [
            Command(
                kind=plan.kind,
                joint_names=self._robot.joint_names,
                values=values,
                stamp_ns=now_ns + round(k * plan.spacing_s * 1e9),
                number=0 if requested is None else requested.number,
            )
            for k, values in enumerate(plan.values)
        ]
        self._stamp_ns = sent[-1].stamp_ns
        for command in sent:
            acts_ns = command.stamp_ns + self._robot.command_latency_ns
            applied = replace(command, stamp_ns=acts_ns)
            self._recorder.command(replace(requested or applied, stamp_ns=acts_ns), applied)
            self._in_force = _InForce(applied=applied, reason=plan.reason)
        self._begin(sent, passes=self._config.clock == RobotClock.LOCKSTEP)

    def _begin(self, commands: Sequence[Command], *, passes: bool) -> None:
        """Begins an exchange; says whether a robot on the lockstep clock lets a period pass."""
        self._under_way = True
        self._robot.begin(commands, self._config.period_ns if passes else 0)

    def _continue_exchange(self) -> bool:
        try:
            reports = self._robot.poll()
        except GfmError as error:
            self._fail(str(error))
            return True
        if reports is None:
            return False
        self._under_way = False
        reads, self._reads = self._reads, False
        newest = self._take_reports(reports)
        if newest is not None and not (reads and self._decide(newest)):
            self._end_period(newest)
        return True

    def _end_period(self, newest: Observation) -> None:
        """Publishes the newest report, by which the last command is answered."""
        self._counters["ticks"] += 1
        self._transport.publish(OBSERVATION, newest)
        if self._waiting is not None:
            self._waiting.reply(newest)
            self._waiting = None

    def _take_reports(self, reports: tuple[Observation, ...]) -> Observation | None:
        """Records what is new among the robot's reports; returns the newest."""
        last_ns = -1 if self._newest is None else self._newest.stamp_ns
        for report in reports:
            if report.stamp_ns > last_ns:
                self._recorder.report(report)
        if reports and last_ns >= 0 and not self._stopping:
            passed_s = (reports[-1].stamp_ns - last_ns) * 1e-9
            if problem := self._following.problem(self._limiter.told, reports[-1], passed_s):
                self._counters["stalls"] += 1
                self._stop(Reason.STOPPED, problem)
        if reports:
            self._newest = replace(
                reports[-1],
                received_ns=self._clock.now_ns(),
                applied=self._in_force.applied,
                reason=int(self._in_force.reason),
            )
        return self._newest

    def _fail(self, problem: str) -> None:
        """The robot did not answer: whoever asked is told, and the next try waits a little."""
        self._under_way = self._reads = False
        self._counters["robot_failures"] += 1
        self._stop(Reason.STOPPED, f"robot: {problem}")
        self._limiter.forget()
        self._deadline_ns = self._retry_ns = self._clock.now_ns() + _RETRY_NS
        if self._waiting is not None:
            self._refuse(self._waiting, f"robot: {problem}")
            self._waiting = None
        while (request := self._commands.receive()) is not None:
            self._refuse(request, f"robot: {problem}")

    def _refuse(self, request: Request, reason: str) -> None:
        self._counters["rejected_messages"] += 1
        request.refuse(reason)


_COUNTERS = (
    "ticks",
    "clipped_commands",
    "stale_commands",
    "superseded_commands",
    "overruns",
    "watchdog_trips",
    "stalls",
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
