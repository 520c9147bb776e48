"""The line to the robot: plans go out on it, reports come back, and both are recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

from gfm.core import Clock, Command, Observation, Reason
from gfm_robot_bridge.flight import FlightRecord
from gfm_robot_bridge.object_port import ObjectPort
from gfm_robot_bridge.plan import Plan
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What the robot is told, and how it came to that.

    Attributes:
        plan: What it is told.
        requested: What its driver asked for; None where the bridge itself acts.
        heard_ns: When that was taken, on the bridge's clock.
        decided_ns: When the plan was made.
    """

    plan: Plan
    requested: Command | None = None
    heard_ns: int = 0
    decided_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class _InForce:
    """What the robot was told last, as the recording has it; None before the first."""

    applied: Command | None = None
    requested: Command | None = None
    reason: Reason = Reason.NONE
    heard_ns: int = 0
    decided_ns: int = 0
    sent_ns: int = 0


@final
class RobotLine:
    """One exchange at a time.

    Args:
        robot: At the other end.
        clock: Of this process.
        recorder: Takes commands, stamped with when they act, and reports.
        flight: Remembers both.
        objects: Adds where the object is to the newest report, where the robot does not say.

    Attributes:
        newest: The newest report, with what is in force; None before the first.
        reports: What the last exchange brought, oldest first.
        under_way: Whether an exchange is.
    """

    def __init__(
        self,
        robot: Robot,
        clock: Clock,
        recorder: Recorder,
        flight: FlightRecord,
        objects: ObjectPort,
    ) -> None:
        self.newest: Observation | None = None
        self.reports: tuple[Observation, ...] = ()
        self.under_way = False
        self._robot = robot
        self._clock = clock
        self._recorder = recorder
        self._flight = flight
        self._objects = objects
        self._in_force = _InForce()
        self._stamp_ns = -1

    def ask(self, advance_ns: int) -> None:
        """Asks for reports; a robot whose time passes on demand lets so much pass."""
        self._begin((), advance_ns)

    def tell(self, decision: Decision, advance_ns: int) -> int:
        """Tells the robot what was decided, and asks as `ask` does; returns when, on the clock."""
        sent = self._stamped(decision)
        now_ns = self._clock.now_ns()
        for command in sent:
            acts_ns = command.stamp_ns + self._robot.command_latency_ns
            applied = replace(command, stamp_ns=acts_ns)
            requested = replace(decision.requested or command, stamp_ns=acts_ns)
            self._recorder.command(requested, applied, int(decision.plan.reason))
            self._in_force = _InForce(
                applied=applied,
                requested=None if decision.requested is None else requested,
                reason=decision.plan.reason,
                heard_ns=decision.heard_ns,
                decided_ns=decision.decided_ns,
                sent_ns=now_ns,
            )
        self._flight.told(decision.requested, sent, decision.plan.reason)
        self._begin(sent, advance_ns)
        return now_ns

    def poll(self) -> int | None:
        """Returns how much of the robot's time passed since its last report, ns; None: not yet.

        Raises:
            UnreachableError: the robot does not answer.
            RefusedError: it said no.
        """
        reports = self._robot.poll()
        if reports is None:
            return None
        self.under_way, self.reports = False, reports
        before_ns = -1 if self.newest is None else self.newest.stamp_ns
        for report in reports:
            if report.stamp_ns > before_ns:
                self._recorder.report(report)
        if not reports:
            return 0
        self.newest = replace(
            self._objects.added_to(reports[-1]),
            received_ns=self._clock.now_ns(),
            **(vars(self._in_force) | {"reason": int(self._in_force.reason)}),
        )
        passed_ns = self.newest.stamp_ns - before_ns
        if passed_ns > 0:
            self._flight.report(self.newest)
        return passed_ns if before_ns >= 0 else 0

    def drop(self) -> None:
        """Forgets the exchange that failed."""
        self.under_way = False

    def _stamped(self, decision: Decision) -> list[Command]:
        """Returns the setpoints of a plan; each is stamped later than whatever came before."""
        now_ns = max(self._robot.time_ns(), self._stamp_ns + 1)
        plan, requested = decision.plan, decision.requested
        sent = [
            Command(
                kind=plan.kind,
                joint_names=self._robot.joint_names,
                values=values,
                stamp_ns=now_ns + round(k * plan.spacing_s * 1e9),
                number=0 if requested is None else requested.number,
                speed_share=1.0 if requested is None else requested.speed_share,
            )
            for k, values in enumerate(plan.values)
        ]
        self._stamp_ns = sent[-1].stamp_ns
        return sent

    def _begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        self.under_way = True
        self._robot.begin(commands, advance_ns)
