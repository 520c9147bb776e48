"""Stands between whoever commands and the robot."""

from __future__ import annotations

import logging
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import final

from typing_extensions import override

from gfm.core import Clock, GfmError, Observation, Status
from gfm.service import Service, make_status
from gfm.transport import Request, Transport
from gfm_robot_bridge.background import AtOnce, Background
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.content import content_of
from gfm_robot_bridge.desk import Controls, Desk
from gfm_robot_bridge.flight import FlightRecord
from gfm_robot_bridge.following import Following
from gfm_robot_bridge.gate import CommandGate
from gfm_robot_bridge.guard import Guard, Loss
from gfm_robot_bridge.inbox import Heard, Inbox
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Reason
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.robot_line import Decision, RobotLine
from gfm_robot_bridge.timing import Timing
from gfm_wire import PROTECTIVE_STOP, RobotClock

_log = logging.getLogger(__name__)

OBSERVATION = "robot/observation"
_RETRY_NS = 1_000_000_000
#: A stop takes less than this, or the robot does not answer.
_LONGEST_STOP_NS = 1_000_000_000
_POLL_NS = 500_000
_LONGEST_WRITE_S = 5.0


@final
class BridgeService(Service, Controls):
    """Serves what is under `robot/`, with `Desk`; publishes `robot/observation`.

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
        guard: Of what the arm must not touch; None where no model tells.
    """

    def __init__(
        self,
        config: BridgeConfig,
        robot: Robot,
        transport: Transport,
        clock: Clock,
        background: Background | None = None,
        guard: Guard | None = None,
    ) -> None:
        self._config = config
        self._robot = robot
        self._transport = transport
        self._clock = clock
        bounds = config.bounds(robot.limits, robot.patience_s)
        self._limiter = Limiter(bounds, robot.dynamics, config.period_ns * 1e-9, guard)
        self._guard = guard
        if guard is None:
            _log.warning("no model of this robot: nothing keeps it from running into something")
        oldest_ns = round(config.command_age_s * 1e9) if config.clock == RobotClock.WALL else None
        lease = Lease("the robot", round(config.lease_s * 1e9))
        self._gate = CommandGate(robot.joint_names, lease, oldest_ns)
        self._following = Following(bounds.still, config.behind_rad, config.behind_s)
        folder, background = Path(config.recordings), background or AtOnce()
        content = content_of(config, robot)
        self._recorder = Recorder(folder, self._about, background, content)
        periods = math.ceil(config.flight_s * config.control_hz)
        self._flight = FlightRecord(folder / "flight", periods, config.flights_kept, background)
        self._counters: Counter[str] = Counter(dict.fromkeys(_COUNTERS, 0))
        self._inbox = Inbox(transport, clock, self._gate, self._limiter.refusal)
        self._desk = Desk(transport, clock, robot, self._recorder, lease, controls=self)
        self._line = RobotLine(robot, clock, self._recorder, self._flight)
        self._reads = False
        self._waiting: Request | None = None
        self._stopping, self._sinks = Reason.NONE, False
        self._began_ns = 0
        self._timing = Timing()
        self._deadline_ns = self._retry_ns = clock.now_ns()
        self._note = self._why = "waiting for the robot"

    @override
    def step(self) -> bool:
        if self._line.under_way:
            return self._continue_exchange()
        answered = self._desk.answer()
        return self._tick() or answered

    @override
    def due_ns(self) -> int | None:
        waits = self._line.newest is None or self._config.clock == RobotClock.WALL
        return self._deadline_ns if waits and not self._line.under_way else None

    def _tick(self) -> bool:
        """Begins a period where it is time for one; returns whether it was."""
        if self._line.newest is None or self._config.clock == RobotClock.WALL:
            return self._tick_on_time()
        return self._decide(self._line.newest)

    @override
    def status(self) -> Status:
        counters = {**self._counters, **self._inbox.counters, **self._robot.counters()}
        counters |= {
            "recordings": self._recorder.finished,
            "lost_recordings": self._recorder.failed,
            "flight_records": self._flight.written,
        }
        counters["rejected_messages"] += self._desk.rejected
        gauges = {
            "robot_time_s": self._robot.time_ns() * 1e-9,
            "geometry_guarded": float(self._guard is not None),
            "waits_for_reset": float(bool(self._gate.locked)),
            **self._robot.gauges(),
        }
        return make_status(
            "robot_bridge",
            self._config.name,
            counters=counters | self._timing.counters(),
            gauges=gauges | self._timing.gauges(),
            note=self._note,
        )

    @override
    def close(self) -> None:
        """Leaves the robot at rest (its own watchdog stands behind this), the recording whole."""
        self._gate.shut("the bridge is closed")
        if self._line.newest is not None:
            self._stop(Reason.STOPPED, "the bridge is closed")
        until_ns = self._clock.now_ns() + _LONGEST_STOP_NS
        while self._stopping and self._clock.now_ns() < until_ns:
            if not self.step():
                self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        self._end_stop()
        self._robot.close()
        self._recorder.close(_LONGEST_WRITE_S)

    def _tick_on_time(self) -> bool:
        """Begins the exchange of a period when it is due (the first one also in lockstep)."""
        now_ns = self._clock.now_ns()
        if now_ns < self._deadline_ns:
            return False
        self._reads = self._line.newest is not None
        late_ns = now_ns - self._deadline_ns
        missed = late_ns // self._config.period_ns
        self._deadline_ns += (missed + 1) * self._config.period_ns
        if self._reads:
            self._counters["overruns"] += missed
            self._timing.jitter.add(late_ns)
        self._began_ns = now_ns
        self._line.ask(self._config.period_ns if self._reads else 0)
        return True

    def _decide(self, newest: Observation) -> bool:
        """Tells the robot what is next, by its newest report; returns whether there is anything."""
        heard = self._inbox.newest()
        if heard is not None and heard.begins:
            self._end_stop()
        if self._stopping:
            return self._clock.now_ns() >= self._retry_ns and self._go_on_stopping(newest)
        if old := self._old_report(newest):
            if heard is not None:
                self._inbox.refuse(heard.request, old)
            self._counters["stale_reports"] += 1
            self._stop(Reason.STOPPED, old)
            return self._go_on_stopping(newest)
        if heard is not None:
            self._take_command(heard, newest)
            return True
        silent_ns = self._gate.silent_ns(self._clock.now_ns())
        watched = self._config.clock == RobotClock.WALL
        if not watched or silent_ns < self._config.watchdog_periods * self._config.period_ns:
            return False
        self._counters["watchdog_trips"] += 1
        self._stop(Reason.WATCHDOG, f"no command for {silent_ns * 1e-6:.0f} ms, the robot holds")
        return self._go_on_stopping(newest)

    def _about(self) -> dict[str, str]:
        return {**self._config.about, **self._robot.about()}

    def _old_report(self, newest: Observation) -> str:
        """Returns in words how old the newest report is, where that is too old to drive by."""
        age_s = (self._robot.time_ns() - newest.stamp_ns) * 1e-9
        if not self._gate.in_session or age_s <= self._config.report_age_s:
            return ""
        return (
            f"robot: its newest report is {age_s * 1e3:.0f} ms old, expected at most "
            f"{self._config.report_age_s * 1e3:g} ms"
        )

    def _stop(self, reason: Reason, fault: str) -> None:
        """Begins to stop the robot, and ends the session with a fault."""
        self._note = self._why = fault
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
    def unlock(self) -> bool:
        was_locked, self._gate.locked = bool(self._gate.locked), ""
        return was_locked

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
            self._end_stop()
            return False
        self._tell(Decision(plan=replace(plan, reason=plan.reason | self._stopping)))
        return True

    def _end_stop(self) -> None:
        """Writes down how it came to a stop that has ended."""
        if self._stopping:
            self._flight.write(self._why, self._clock.utc_ns(), self._about())
        self._stopping, self._sinks = Reason.NONE, False

    def _take_command(self, heard: Heard, newest: Observation) -> None:
        command = heard.command
        order = [command.joint_names.index(name) for name in self._robot.joint_names]
        requested = replace(
            command, joint_names=self._robot.joint_names, values=command.values[order]
        )
        plan = self._limiter.limited(requested, newest)
        decided_ns = self._clock.now_ns()
        if self._config.clock == RobotClock.WALL:
            self._timing.ages.add(self._clock.utc_ns() - command.stamp_ns)
        self._counters["clipped_commands"] += bool(plan.reason)
        self._counters["workspace_limits"] += Reason.WORKSPACE in plan.reason
        self._counters["collision_limits"] += Reason.COLLISION in plan.reason
        self._note = f"commanded in {command.kind} mode"
        self._waiting = heard.request
        self._tell(
            Decision(plan=plan, requested=requested, heard_ns=heard.heard_ns, decided_ns=decided_ns)
        )

    def _tell(self, decision: Decision) -> None:
        """Tells the robot; in lockstep a period passes with that."""
        lockstep = self._config.clock == RobotClock.LOCKSTEP
        sent_ns = self._line.tell(decision, self._config.period_ns if lockstep else 0)
        if not lockstep:
            self._timing.delays.add(sent_ns - self._began_ns)

    def _continue_exchange(self) -> bool:
        try:
            passed_ns = self._line.poll()
        except GfmError as error:
            self._fail(str(error))
            return True
        if passed_ns is None:
            return False
        reads, self._reads = self._reads, False
        newest = self._line.newest
        if newest is None:
            return True
        self._heed_fault()
        self._watch_joints(newest, passed_ns * 1e-9)
        if not (reads and self._decide(newest)):
            self._end_period(newest)
        return True

    def _heed_fault(self) -> None:
        """Listens to nobody while the robot has a fault; what was told before it does not count."""
        fault = self._robot.fault()
        closed = f"robot: {fault}" if fault else ""
        if closed == self._gate.closed:
            return
        self._gate.closed = closed
        self._limiter.forget()
        self._note = closed or "the robot may be driven"
        _log.warning("%s", self._note)
        if fault:
            self._counters["robot_faults"] += 1
        if fault and self._gate.in_session:
            self._stop(Reason.STOPPED, closed)

    def _watch_joints(self, newest: Observation, passed_s: float) -> None:
        """Stops the robot where something holds a joint, or it is where it was not to go."""
        if self._guard is not None and self._sinks:
            self._guard.sink(newest)
        if self._stopping or passed_s <= 0.0:
            return
        if self._guard is not None and (loss := self._guard.loss(newest)):
            self._lose_clearance(loss)
            return
        if problem := self._following.problem(self._limiter.told, newest, passed_s):
            self._counters["stalls"] += 1
            self._stop(Reason.STOPPED, PROTECTIVE_STOP + problem)

    def _lose_clearance(self, loss: Loss) -> None:
        """Stops the robot; where it was not led away since the last time, a person has to look."""
        self._counters["lost_clearances"] += 1
        self._stop(Reason.STOPPED, PROTECTIVE_STOP + loss.words)
        self._sinks = True
        if loss.again:
            self._gate.locked = f"{self._why}, and again: lead it away by hand, then reset"
            self._note = self._gate.locked

    def _end_period(self, newest: Observation) -> None:
        """Publishes the newest report, by which the last command is answered."""
        self._counters["ticks"] += 1
        self._recorder.period(newest)
        self._transport.publish(OBSERVATION, newest)
        if self._waiting is not None:
            self._waiting.reply(newest)
            self._waiting = None

    def _fail(self, problem: str) -> None:
        """The robot did not answer: whoever asked is told, and the next try waits a little."""
        self._line.drop()
        self._reads = False
        self._counters["robot_failures"] += 1
        if self._stopping and not self._gate.in_session:
            self._note = f"robot: {problem}"  # its driver is told what stopped it at first
        else:
            self._stop(Reason.STOPPED, f"robot: {problem}")
        self._limiter.forget()
        self._deadline_ns = self._retry_ns = self._clock.now_ns() + _RETRY_NS
        if self._waiting is not None:
            self._inbox.refuse(self._waiting, f"robot: {problem}")
            self._waiting = None
        self._inbox.refuse_all(f"robot: {problem}")


_COUNTERS = (
    "ticks",
    "clipped_commands",
    "workspace_limits",
    "collision_limits",
    "overruns",
    "watchdog_trips",
    "stalls",
    "lost_clearances",
    "stale_reports",
    "robot_failures",
    "robot_faults",
)
