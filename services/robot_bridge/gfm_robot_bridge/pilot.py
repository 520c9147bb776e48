"""Decides, by every report, what the robot is told: its driver's command, or the way to a stop."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import final

from typing_extensions import override

from gfm.core import Clock, Observation, Reason
from gfm.transport import Request, Transport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.desk import Controls
from gfm_robot_bridge.gate import CommandGate
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.inbox import Heard, Inbox, in_order
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.load import LoadObserver
from gfm_robot_bridge.object_port import ObjectPort
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.robot_line import Decision
from gfm_robot_bridge.timing import Timing
from gfm_robot_bridge.watch import Alarm, Watch
from gfm_wire import RobotClock, SetPayload

_log = logging.getLogger(__name__)


@final
class Pilot(Controls):
    """Knows who drives, what was told last, and whether the robot is being stopped.

    Args:
        config: Settings of the bridge.
        robot: That is driven.
        transport: On which commands arrive.
        clock: Of this process.
        lease: Who drives.
        guard: Of what the arm must not touch; None where no model tells.
        observer: Of the load that the arm bears; None where no model tells.
        objects: Says whether it is known where the object is.
        timing: Gets the ages of commands.
        stood: Called with why the robot was stopped, when that is over.

    Attributes:
        note: How it is, in words.
    """

    def __init__(
        self,
        config: BridgeConfig,
        robot: Robot,
        transport: Transport,
        clock: Clock,
        *,
        lease: Lease,
        guard: Guard | None,
        observer: LoadObserver | None,
        objects: ObjectPort,
        timing: Timing,
        stood: Callable[[str], None],
    ) -> None:
        self.note = self._why = "waiting for the robot"
        self._config = config
        self._robot = robot
        self._clock = clock
        self._objects = objects
        self._timing = timing
        self._stood = stood
        bounds = config.bounds(robot.limits, robot.patience_s)
        self._observer = observer
        self._limiter = Limiter(bounds, robot.dynamics, config.period_ns * 1e-9, guard, observer)
        self._watch = Watch(config, bounds, guard)
        oldest_ns = round(config.command_age_s * 1e9) if config.clock == RobotClock.WALL else None
        self._gate = CommandGate(robot.joint_names, lease, oldest_ns)
        self._inbox = Inbox(transport, clock, self._gate, self._limiter.refusal)
        self._counters: Counter[str] = Counter(dict.fromkeys(_COUNTERS, 0))
        self._waiting: Request | None = None
        self._stopping, self._sinks = Reason.NONE, False
        self._retry_ns = 0
        self._says_load = False

    @property
    def counters(self) -> Counter[str]:
        """What was decided, by name."""
        return Counter({**self._counters, **self._inbox.counters})

    @property
    def is_stopping(self) -> bool:
        """Whether the robot is being stopped."""
        return bool(self._stopping)

    @property
    def waits_for_reset(self) -> bool:
        """Whether nobody is listened to until a person says so."""
        return bool(self._gate.locked)

    def decide(self, newest: Observation) -> Decision | None:
        """Returns what to tell the robot next, by its newest report; None: nothing."""
        heard = self._inbox.newest()
        if heard is not None and heard.begins:
            self.end_stop()
        if self._stopping:
            return self._further_stop(newest) if self._clock.now_ns() >= self._retry_ns else None
        if alarm := self._alarm(heard, newest):
            if heard is not None:
                self._inbox.refuse(heard.request, alarm.words)
            self._stop(alarm)
            return self._further_stop(newest)
        return None if heard is None else self._taken(heard, newest)

    def look(self, newest: Observation, passed_s: float, reports: Sequence[Observation]) -> None:
        """Begins to stop the robot where that is to be, by a new report.

        Args:
            newest: The report.
            passed_s: Of the robot's time since the last one.
            reports: All since then, oldest first.
        """
        if self._observer is not None:
            self._observer.take(reports)
        self._heed_fault()
        if self._sinks:
            self._watch.sink(newest)
        if self._stopping or passed_s <= 0.0:
            return
        if alarm := self._watch.arm(self._limiter, newest, passed_s):
            self._stop(alarm)

    def answer(self, newest: Observation) -> None:
        """Answers the last command by what came of it."""
        if self._waiting is not None:
            self._waiting.reply(newest)
            self._waiting = None

    def fail(self, problem: str, retry_ns: int) -> None:
        """The robot did not answer: whoever asked is told.

        Args:
            problem: Why, in words.
            retry_ns: When it is tried again.
        """
        self._counters["robot_failures"] += 1
        if self._stopping and not self._gate.in_session:
            self.note = problem  # its driver is told what stopped it at first
        else:
            self.stop(problem)
        self._limiter.forget()
        self._retry_ns = retry_ns
        if self._waiting is not None:
            self._inbox.refuse(self._waiting, problem)
            self._waiting = None
        self._inbox.refuse_all(problem)

    def shut(self, why: str) -> None:
        """Ends it for good: nobody begins another session."""
        self._gate.shut(why)

    def end_stop(self) -> None:
        """Says how it came to a stop that has ended."""
        if self._stopping:
            self._stood(self._why)
        self._stopping, self._sinks = Reason.NONE, False

    @override
    def let_go(self) -> None:
        self.stop("its driver let go, the robot holds")
        self._gate.release()

    @override
    def stop(self, why: str) -> None:
        self._stop(Alarm(words=why))

    @override
    def unlock(self) -> bool:
        was_locked, self._gate.locked = bool(self._gate.locked), ""
        return was_locked

    @override
    def carried(self, payload: SetPayload) -> None:
        if self._observer is not None:
            self._observer.carry(payload)

    @override
    def scale(self) -> float:
        return self._limiter.scale

    @override
    def set_scale(self, scale: float) -> None:
        _log.info("going at %.0f %% of the commanded speed", 100.0 * scale)
        self._limiter.scale = scale

    def _alarm(self, heard: Heard | None, newest: Observation) -> Alarm | None:
        """Returns why to stop the robot instead of doing what its driver wants; None: do that."""
        if self._gate.in_session and (old := self._watch.age(newest, self._robot.time_ns())):
            return old
        if heard is None:
            return self._watch.silence(self._gate.silent_ns(self._clock.now_ns()))
        if heard.command.needs_object and (unknown := self._objects.problem(newest)):
            return Alarm(words=unknown, counter="unknown_objects", reason=Reason.OBJECT)
        return None

    def _stop(self, alarm: Alarm) -> None:
        """Begins to stop the robot, and ends the session with a fault."""
        self._why = alarm.words
        self.note = alarm.locks or alarm.words
        _log.warning("%s", self.note)
        if alarm.counter:
            self._counters[alarm.counter] += 1
        self._gate.latch(alarm.words)
        self._gate.locked = alarm.locks or self._gate.locked
        self._stopping, self._sinks = alarm.reason, alarm.sinks

    def _heed_fault(self) -> None:
        """Listens to nobody while the robot has a fault; what was told before it does not count."""
        fault = self._robot.fault()
        closed = f"robot: {fault}" if fault else ""
        if closed == self._gate.closed:
            return
        self._gate.closed = closed
        self._limiter.forget()
        self.note = closed or "the robot may be driven"
        _log.warning("%s", self.note)
        if fault:
            self._counters["robot_faults"] += 1
        if fault and self._gate.in_session:
            self.stop(closed)

    def _further_stop(self, newest: Observation) -> Decision | None:
        """Returns the next part of a stop; None where the robot holds already."""
        plan = self._limiter.stopped(newest)
        if plan is None:
            self.end_stop()
            return None
        return Decision(plan=replace(plan, reason=plan.reason | self._stopping))

    def _taken(self, heard: Heard, newest: Observation) -> Decision:
        command = heard.command
        requested = in_order(command, self._robot.joint_names)
        plan = self._limiter.limited(requested, newest)
        decided_ns = self._clock.now_ns()
        if self._config.clock == RobotClock.WALL:
            self._timing.ages.add(self._clock.utc_ns() - command.stamp_ns)
        self._counters["clipped_commands"] += bool(plan.reason)
        self._counters["workspace_limits"] += Reason.WORKSPACE in plan.reason
        self._counters["collision_limits"] += Reason.COLLISION in plan.reason
        self._counters["load_limits"] += Reason.LOAD in plan.reason
        self._note(heard, plan.reason)
        self._waiting = heard.request
        return Decision(
            plan=plan, requested=requested, heard_ns=heard.heard_ns, decided_ns=decided_ns
        )

    def _note(self, heard: Heard, reason: Reason) -> None:
        """Says how it goes; of a load that changes commands, in the log once in a session."""
        self._says_load &= not heard.begins
        command = heard.command
        share = min(command.speed_share, self._config.velocity_share)
        self.note = f"commanded in {command.kind} mode, at most {share:.2g} of the speed limits"
        if Reason.LOAD not in reason:
            return
        self.note = f"limited by a load: {self._limiter.load_words()}"
        if not self._says_load:
            _log.warning("%s", self.note)
        self._says_load = True


_COUNTERS = (
    "clipped_commands",
    "workspace_limits",
    "collision_limits",
    "load_limits",
    "watchdog_trips",
    "stalls",
    "lost_clearances",
    "heavy_loads",
    "stale_reports",
    "unknown_objects",
    "robot_failures",
    "robot_faults",
)
