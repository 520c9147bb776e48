"""What a Sawyer has said on one connection."""

from __future__ import annotations

import logging
from collections import Counter
from typing import final

from gfm.core import ConfigError, Observation, RefusedError
from gfm_robot_bridge.intera.assembly import Assembly
from gfm_robot_bridge.intera.clock_offset import ClockOffset
from gfm_robot_bridge.intera.introduction import version_of
from gfm_robot_bridge.intera.link import Arrived
from gfm_robot_bridge.intera.messages import assembly, joint_limits, joint_report
from gfm_robot_bridge.intera.topics import JOINT_LIMITS, JOINT_STATES, STATE
from gfm_robot_bridge.limits import Limits

_log = logging.getLogger(__name__)

#: A stamp so much older than the last one is of a clock that was set.
_CLOCK_SET_NS = 1_000_000_000


@final
class Hearing:
    """Takes messages in, and remembers the newest of each.

    Args:
        joint_names: Of the arm.
        counters: Where `late_reports` and `refused_reports` are counted.

    Attributes:
        version: Of the robot's software; empty before it said it.
        limits: Of its joints, as it says; None before.
        assembly: Its state; None before.
        assembly_ns: When it said that, on this process's clock.
        heard_ns: When it said anything.
        offset: Of its clock.
        refused: Why it is not driven by this process any more; None where it may be.
    """

    def __init__(self, joint_names: tuple[str, ...], counters: Counter[str], now_ns: int) -> None:
        self.version = ""
        self.limits: Limits | None = None
        self.assembly: Assembly | None = None
        self.assembly_ns = 0
        self.heard_ns = now_ns
        self.offset = ClockOffset()
        self.refused: ConfigError | None = None
        self._joint_names = joint_names
        self._counters = counters
        self._stamp_ns = -1
        self._reports: list[Observation] = []
        self._newest: tuple[Observation, ...] = ()
        self._fault = ""

    @property
    def missing(self) -> str:
        """What has to be known of a robot and is not, in words."""
        known = {
            "its software's version": bool(self.version),
            JOINT_LIMITS.name: self.limits is not None,
            STATE.name: self.assembly is not None,
            JOINT_STATES.name: self.offset.known,
        }
        return ", ".join(what for what, there in known.items() if not there)

    def take_reports(self) -> tuple[Observation, ...]:
        """Returns the reports since the last call, oldest first; the last one again if none came.

        As every other robot does: a command is answered by a report, with what became of it.
        """
        if self._reports:
            self._newest = (self._reports[-1],)
        reports, self._reports = tuple(self._reports), []
        return reports or self._newest

    def take_fault(self) -> str:
        """Returns the first fault since the last call, or the one that there is, in words."""
        fault, self._fault = self._fault, "" if self.assembly is None else self.assembly.fault()
        return fault or self._fault

    def take(self, arrived: Arrived) -> None:
        """Takes a message in; one that is not as declared is counted, and nothing else."""
        self.heard_ns = arrived.at_ns
        try:
            self._take(arrived)
        except RefusedError as error:
            self._counters["refused_reports"] += 1
            _log.debug("refused: %s", error)
        except ConfigError as error:
            self.refused = error

    def _take(self, arrived: Arrived) -> None:
        op = arrived.op
        match op.get("op"), op.get("topic"):
            case "publish", JOINT_STATES.name:
                self._take_report(joint_report(op.get("msg"), self._joint_names), arrived.at_ns)
            case "publish", STATE.name:
                self.assembly = assembly(op.get("msg"))
                self.assembly_ns = arrived.at_ns
                self._fault = self._fault or self.assembly.fault()
            case "publish", JOINT_LIMITS.name:
                self.limits = joint_limits(op.get("msg"), self._joint_names)
            case "service_response", _:
                self.version = version_of(op)
            case "status", _:
                _log.warning("rosbridge: %s: %s", op.get("level"), op.get("msg"))
            case kind, topic:
                raise RefusedError(f"{kind} of {topic}, expected what was asked for")

    def _take_report(self, report: Observation | None, at_ns: int) -> None:
        if report is None:
            return
        back_ns = self._stamp_ns - report.stamp_ns
        if back_ns > _CLOCK_SET_NS:
            raise ConfigError(
                f"the robot's clock went back by {back_ns * 1e-9:.1f} s; start the bridge anew"
            )
        if back_ns >= 0:
            self._counters["late_reports"] += 1
            return
        self.offset.add(report.stamp_ns, at_ns)
        self._stamp_ns = report.stamp_ns
        self._reports.append(report)
