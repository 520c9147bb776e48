"""A Sawyer behind a rosbridge, as seen from the bridge."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

from typing_extensions import override

from gfm.core import (
    Clock,
    Command,
    CommandKind,
    ConfigError,
    LostError,
    Observation,
    RefusedError,
    UnreachableError,
)
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.intera.assembly import Assembly
from gfm_robot_bridge.intera.clock_offset import ClockOffset
from gfm_robot_bridge.intera.introduction import check_version, same, tighter, version_of
from gfm_robot_bridge.intera.link import Arrived, Due, Link, Op
from gfm_robot_bridge.intera.messages import assembly, joint_command, joint_limits, joint_report
from gfm_robot_bridge.intera.power import Switching
from gfm_robot_bridge.intera.topics import (
    ADVERTISED,
    COMMAND_TIMEOUT,
    GET_PARAM,
    JOINT_COMMAND,
    JOINT_LIMITS,
    JOINT_STATES,
    SPEED_RATIO,
    STATE,
    SUBSCRIBED,
    VERSION_PARAM,
    Topic,
)
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.sawyer_dynamics import SawyerDynamics
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_wire import PowerAction

_log = logging.getLogger(__name__)

#: The robot is told to leave velocity and torque mode after so much silence; its own default, too.
PATIENCE_S = 0.2
#: Settings that the robot keeps are told it again and again: a message may be lost.
_TELL_AGAIN_NS = 1_000_000_000
#: A robot that says nothing at all for so long is lost; its state has no stamp and may be no older.
_SILENCE_NS = 1_000_000_000
#: A setpoint of speed or torque that could not be sent for so long is not sent at all: by then the
#: robot is about to stop by itself, and should.
_WORTHLESS_NS = 100_000_000
#: A mode is left by a position that is held. It is told that so often and with such pauses, as one
#: message may be lost, and the arm would go on for another 0.2 s.
_HOLDS, _HOLD_SPACING_NS = 10, 4_000_000
#: A stamp so much older than the last one is of a clock that was set.
_CLOCK_SET_NS = 1_000_000_000
_POLL_NS = 10_000_000
#: How long the robot may take to introduce itself once it is connected.
_INTRODUCTION_NS = 5_000_000_000


@dataclass(frozen=True, kw_only=True)
class SawyerSettings:
    """How a Sawyer is driven.

    Attributes:
        software: Versions of the robot's software that are accepted.
        latency_s: From when a command is sent until it acts.
        speed_ratio: To which part of its joint speeds the robot limits itself in position mode.
        wait_s: How long to wait for the robot at first.
    """

    software: tuple[str, ...]
    latency_s: float
    speed_ratio: float
    wait_s: float


@dataclass(kw_only=True)
class _Heard:
    """What the robot has said on one connection."""

    version: str = ""
    limits: Limits | None = None
    assembly: Assembly | None = None
    assembly_ns: int = 0
    stamp_ns: int = -1
    reports: list[Observation] = field(default_factory=list)

    @property
    def missing(self) -> str:
        """What is to be known of a robot and is not, in words."""
        known = {
            "its software's version": bool(self.version),
            JOINT_LIMITS.name: self.limits is not None,
            STATE.name: self.assembly is not None,
            JOINT_STATES.name: self.stamp_ns >= 0,
        }
        return ", ".join(what for what, there in known.items() if not there)


@final
class InteraSawyer(Robot):
    """Says joint commands, hears joint states, on one connection at a time.

    A connection that was lost is opened again by the next exchange, and the robot introduces
    itself anew: one that has become another is refused.

    Args:
        link: To the rosbridge.
        clock: Of this process.
        settings: How it is driven.
    """

    def __init__(self, link: Link, clock: Clock, settings: SawyerSettings) -> None:
        self.joint_names = JOINT_NAMES
        self.limits = sawyer_limits()
        self.command_latency_ns = round(settings.latency_s * 1e9)
        self.patience_s = PATIENCE_S
        self.dynamics = SawyerDynamics()
        self._link = link
        self._clock = clock
        self._settings = settings
        self._offset = ClockOffset()
        self._heard = _Heard()
        self._fault = ""
        self._known = False
        self._greeted = False
        self._refused: ConfigError | None = None
        self._heard_ns = self._told_ns = 0
        self._sent_kind: CommandKind | None = None
        self._switching: Switching | None = None
        self._counters: Counter[str] = Counter(late_reports=0, refused_reports=0, connections=0)

    def meet(self) -> None:
        """Waits until all is known that has to be before the first motion.

        Raises:
            UnreachableError: the robot stayed away.
            ConfigError: it is not as expected.
        """
        until_ns = self._clock.now_ns() + round(self._settings.wait_s * 1e9)
        while not self._known:
            self.begin((), 0)
            try:
                self.poll()
            except LostError as error:
                if self._refused is not None:
                    raise self._refused from error
                if self._clock.now_ns() >= until_ns:
                    raise UnreachableError(str(error), self._settings.wait_s) from error
            self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        self._heard.reports.clear()
        _log.info("%s: software %s", self._link.peer, self._heard.version)

    @override
    def time_ns(self) -> int:
        return self._clock.now_ns() + self._offset.ns

    @override
    def begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        if not self._link.is_open and (self._link.problem or not self._counters["connections"]):
            self._connect()
        if not self._link.is_open:
            return
        if not self._greeted:
            self._greet()
        self._tell_settings()
        if commands:
            self._link.plan(self._planned(commands))

    @override
    def poll(self) -> tuple[Observation, ...] | None:
        self._hear()
        if not self._link.is_open:
            raise LostError(self._link.peer, self._link.problem or "it does not answer yet")
        silent_ns = self._clock.now_ns() - self._heard_ns
        if missing := self._heard.missing:
            if silent_ns > _INTRODUCTION_NS:
                self._link.drop(f"nothing was heard of {missing}")
            raise LostError(self._link.peer, f"waiting for {missing}")
        if silent_ns > _SILENCE_NS:
            self._link.drop(f"nothing was heard for {silent_ns * 1e-9:.1f} s")
            raise LostError(self._link.peer, self._link.problem)
        self._check()
        reports = tuple(self._heard.reports)
        self._heard.reports.clear()
        return reports

    @override
    def fault(self) -> str:
        fault, state = self._fault, self._heard.assembly
        self._fault = "" if state is None else state.fault()
        silent_ns = self._clock.now_ns() - self._heard.assembly_ns
        if not fault and self._known and silent_ns > _SILENCE_NS:
            return f"{STATE.name} is silent"
        return fault

    @override
    def power(self, action: PowerAction) -> Callable[[], bool]:
        switching = Switching(action, self._state(), self._clock.now_ns())
        self._switching = switching
        return lambda: switching.is_done(self._state(), self._clock.now_ns())

    @override
    def counters(self) -> Mapping[str, int]:
        return self._counters

    @override
    def gauges(self) -> Mapping[str, float]:
        return {
            "robot_clock_ahead_s": (self.time_ns() - self._clock.utc_ns()) * 1e-9,
            "report_delay_ms": self._offset.newest_delay_ns * 1e-6,
        }

    @override
    def about(self) -> Mapping[str, str]:
        return {
            "robot_software": self._heard.version,
            "robot_clock_ahead_s": f"{self.gauges()['robot_clock_ahead_s']:.6f}",
        }

    @override
    def close(self) -> None:
        self._link.close()

    def _state(self) -> Assembly:
        if self._heard.assembly is None or not self._link.is_open:
            raise RefusedError("robot: it is not connected")
        return self._heard.assembly

    def _connect(self) -> None:
        self._counters["connections"] += 1
        self._heard, self._offset = _Heard(), ClockOffset()
        self._greeted, self._sent_kind, self._switching = False, None, None
        self._link.open()

    def _greet(self) -> None:
        """Says what will be told, and asks for what is to be known."""
        self._greeted = True
        self._heard_ns = self._clock.now_ns()
        self._told_ns = self._heard_ns - _TELL_AGAIN_NS
        for topic in ADVERTISED:
            kept = topic in (COMMAND_TIMEOUT, SPEED_RATIO)
            self._link.say(
                {
                    "op": "advertise",
                    "topic": topic.name,
                    "type": topic.type,
                    "latch": kept,
                    "queue_size": 1,
                }
            )
        for topic in SUBSCRIBED:
            self._link.say({"op": "subscribe", "topic": topic.name, "type": topic.type})
        arguments = {"name": VERSION_PARAM, "default": ""}
        self._link.say({"op": "call_service", "service": GET_PARAM, "args": arguments})

    def _tell_settings(self) -> None:
        now_ns = self._clock.now_ns()
        state, switching = self._heard.assembly, self._switching
        if switching and state and (due := switching.due(state, now_ns)):
            self._link.say(_publication(*due))
        if now_ns - self._told_ns >= _TELL_AGAIN_NS:
            self._told_ns = now_ns
            self._link.say(_publication(COMMAND_TIMEOUT, {"data": PATIENCE_S}))
            self._link.say(_publication(SPEED_RATIO, {"data": self._settings.speed_ratio}))

    def _planned(self, commands: Sequence[Command]) -> list[Due]:
        planned = [self._due(command, command.stamp_ns) for command in commands]
        last = commands[-1]
        if last.kind is CommandKind.POSITION and self._sent_kind is not CommandKind.POSITION:
            planned += [
                self._due(last, last.stamp_ns + k * _HOLD_SPACING_NS) for k in range(1, _HOLDS)
            ]
        self._sent_kind = last.kind
        return planned

    def _due(self, command: Command, at_robot_ns: int) -> Due:
        at_ns = at_robot_ns - self._offset.ns
        holds = command.kind is CommandKind.POSITION
        return Due(
            op=_publication(JOINT_COMMAND, joint_command(command)),
            at_ns=at_ns,
            until_ns=None if holds else at_ns + _WORTHLESS_NS,
        )

    def _hear(self) -> None:
        for arrived in self._link.receive():
            self._heard_ns = arrived.at_ns
            try:
                self._take(arrived)
            except RefusedError as error:
                self._counters["refused_reports"] += 1
                _log.debug("%s: %s", self._link.peer, error)
            except ConfigError as error:
                self._refused = error

    def _take(self, arrived: Arrived) -> None:
        op = arrived.op
        match op.get("op"), op.get("topic"):
            case "publish", JOINT_STATES.name:
                self._take_report(joint_report(op.get("msg"), self.joint_names), arrived.at_ns)
            case "publish", STATE.name:
                self._heard.assembly = assembly(op.get("msg"))
                self._heard.assembly_ns = arrived.at_ns
                self._fault = self._fault or self._heard.assembly.fault()
            case "publish", JOINT_LIMITS.name:
                self._heard.limits = joint_limits(op.get("msg"), self.joint_names)
            case "service_response", _:
                self._heard.version = version_of(op)
            case "status", _:
                _log.warning("%s: %s %s", self._link.peer, op.get("level"), op.get("msg"))
            case _:
                raise RefusedError(f"got {op.get('op')} of {op.get('topic')}, expected neither")

    def _take_report(self, report: Observation | None, at_ns: int) -> None:
        if report is None:
            return
        back_ns = self._heard.stamp_ns - report.stamp_ns
        if back_ns > _CLOCK_SET_NS:
            self._refused = ConfigError(
                f"{self._link.peer}: the robot's clock went back by {back_ns * 1e-9:.1f} s; start "
                "the bridge anew"
            )
        if back_ns >= 0:
            self._counters["late_reports"] += 1
            return
        self._offset.add(report.stamp_ns, at_ns)
        self._heard.stamp_ns = report.stamp_ns
        self._heard.reports.append(report)

    def _check(self) -> None:
        """Refuses a robot that is not as expected, or not as it was.

        Raises:
            LostError: it is not.
        """
        if self._refused is None and self._heard.limits is not None:
            try:
                check_version(self._heard.version, self._settings.software)
                limits = tighter(self._heard.limits, sawyer_limits(), self.joint_names)
                if self._known and not same(limits, self.limits):
                    raise ConfigError(
                        "the robot's joint limits are others now; start the bridge anew"
                    )
                self.limits, self._known = limits, True
            except ConfigError as error:
                self._refused = error
        if self._refused is not None:
            raise LostError(self._link.peer, str(self._refused))


def _publication(topic: Topic, msg: Mapping[str, Any]) -> Op:
    return {"op": "publish", "topic": topic.name, "msg": msg}
