"""A Sawyer behind a rosbridge, as seen from the bridge."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
from gfm_robot_bridge.intera.hearing import Hearing
from gfm_robot_bridge.intera.introduction import check_version, same, tighter
from gfm_robot_bridge.intera.link import Due, Link, Op
from gfm_robot_bridge.intera.messages import joint_command, urdf_configuration
from gfm_robot_bridge.intera.power import Switching
from gfm_robot_bridge.intera.topics import (
    ADVERTISED,
    COMMAND_TIMEOUT,
    GET_PARAM,
    JOINT_COMMAND,
    SPEED_RATIO,
    STATE,
    SUBSCRIBED,
    URDF,
    VERSION_PARAM,
    Topic,
)
from gfm_robot_bridge.robot import Robot, told
from gfm_robot_bridge.sawyer_dynamics import SawyerDynamics
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_wire import PowerAction, SetPayload

_log = logging.getLogger(__name__)

#: The robot is told to leave velocity and torque mode after so much silence; its own default, too.
PATIENCE_S = 0.2
#: What the robot keeps (patience, speed ratio, payload) is told again and again: messages get lost.
_TELL_AGAIN_NS = 1_000_000_000
#: A robot that says nothing at all for so long is lost; its state has no stamp and may be no older.
_SILENCE_NS = 1_000_000_000
#: A setpoint of speed or torque that could not be sent for so long is not sent at all: by then the
#: robot is about to stop by itself, and should.
_WORTHLESS_NS = 100_000_000
#: A mode is left by a position that is held. It is told that so often and with such pauses, as one
#: message may be lost, and the arm would go on for another 0.2 s.
_HOLDS, _HOLD_SPACING_NS = 10, 4_000_000
#: How long the robot may take to introduce itself once it is connected.
_INTRODUCTION_NS = 5_000_000_000
_POLL_NS = 10_000_000


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
        self._counters: Counter[str] = Counter(late_reports=0, refused_reports=0, connections=0)
        self._hearing = Hearing(self.joint_names, self._counters, clock.now_ns())
        self._is_known = False
        self._greeted = self._loss_told = False
        self._told_ns = 0
        self._sent_kind: CommandKind | None = None
        self._switching: Switching | None = None
        self._payload: SetPayload | None = None
        self._payload_ns = 0

    def meet(self) -> None:
        """Waits until all is known that has to be before the first motion.

        Raises:
            UnreachableError: the robot stayed away.
            ConfigError: it is not as expected.
        """
        until_ns, why = self._clock.now_ns() + round(self._settings.wait_s * 1e9), ""
        while not self._is_known:
            self.begin((), 0)
            try:
                self.poll()
            except LostError as error:
                if self._hearing.refused is not None:
                    raise self._hearing.refused from error
                # That it is tried again says nothing of why it has to be.
                why = str(error) if self._link.problem or self._link.is_open else why
                if self._clock.now_ns() >= until_ns:
                    raise UnreachableError(f"a Sawyer ({why})", self._settings.wait_s) from error
            self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        _log.info("%s: software %s", self._link.peer, self._hearing.version)

    @override
    def time_ns(self) -> int:
        return self._clock.now_ns() + self._hearing.offset.ns

    @override
    def begin(self, commands: Sequence[Command], advance_ns: int) -> None:
        if self._is_due:
            self._connect()
        if not self._link.is_open:
            return
        if not self._greeted:
            self._greet()
        self._switch()
        self._remind()
        if commands:
            self._link.plan(self._planned(commands))

    @override
    def poll(self) -> tuple[Observation, ...] | None:
        for arrived in self._link.receive():
            self._hearing.take(arrived)
        if not self._link.is_open:
            self._loss_told = bool(self._link.problem)
            raise LostError(self._link.peer, self._link.problem or "it does not answer yet")
        silent_ns = self._clock.now_ns() - self._hearing.heard_ns
        if silent_ns > (_INTRODUCTION_NS if self._hearing.missing else _SILENCE_NS):
            self._link.drop(f"nothing was heard for {silent_ns * 1e-9:.1f} s")
            self._loss_told = True
            raise LostError(self._link.peer, self._link.problem)
        self._check()
        if missing := self._hearing.missing:
            raise LostError(self._link.peer, f"waiting for {missing}")
        return self._hearing.take_reports()

    @override
    def fault(self) -> str:
        silent_ns = self._clock.now_ns() - self._hearing.assembly_ns
        silent = f"{STATE.name} is silent" if silent_ns > _SILENCE_NS else ""
        return self._hearing.take_fault() or silent

    @override
    def power(self, action: PowerAction) -> Callable[[], bool]:
        switching = Switching(action, self._state(), self._clock.now_ns())
        self._switching = switching
        return lambda: switching.is_done(self._state(), self._clock.now_ns())

    @override
    def carry(self, payload: SetPayload) -> bool:
        self._payload, self._payload_ns = payload, self.time_ns()
        self._told_ns = self._clock.now_ns() - _TELL_AGAIN_NS
        return True

    @override
    def counters(self) -> Mapping[str, int]:
        return self._counters

    @override
    def gauges(self) -> Mapping[str, float]:
        if not self._hearing.offset.known:
            return {}
        return {
            "robot_clock_ahead_s": (self.time_ns() - self._clock.utc_ns()) * 1e-9,
            "report_delay_ms": self._hearing.offset.newest_delay_ns * 1e-6,
        }

    @override
    def about(self) -> Mapping[str, str]:
        measured = {name: f"{value:.6f}" for name, value in self.gauges().items()}
        return {"robot_software": self._hearing.version, **measured, **told(self._payload)}

    @override
    def close(self) -> None:
        self._link.close()

    def _state(self) -> Assembly:
        if self._hearing.assembly is None or not self._link.is_open:
            raise RefusedError("robot: it is not connected")
        return self._hearing.assembly

    @property
    def _is_due(self) -> bool:
        """Whether to connect anew: why a connection broke has to be told before that."""
        if not self._counters["connections"]:
            return True
        return bool(self._link.problem) and (self._loss_told or not self._greeted)

    def _connect(self) -> None:
        self._counters["connections"] += 1
        self._hearing = Hearing(self.joint_names, self._counters, self._clock.now_ns())
        self._greeted = self._loss_told = False
        self._sent_kind = self._switching = None
        self._link.open()

    def _greet(self) -> None:
        """Says what will be told, and asks for what is to be known."""
        self._greeted = True
        self._hearing.heard_ns = self._clock.now_ns()  # it is silent from now on, not before
        self._told_ns = self._clock.now_ns() - _TELL_AGAIN_NS
        for topic in ADVERTISED:
            kept = topic in (COMMAND_TIMEOUT, SPEED_RATIO)
            how = {"type": topic.type, "latch": kept, "queue_size": 1}
            self._link.say({"op": "advertise", "topic": topic.name, **how})
        for topic in SUBSCRIBED:
            self._link.say({"op": "subscribe", "topic": topic.name, "type": topic.type})
        arguments = {"name": VERSION_PARAM, "default": ""}
        self._link.say({"op": "call_service", "service": GET_PARAM, "args": arguments})

    def _switch(self) -> None:
        """Tells the robot again what it was asked to switch, while it has not."""
        state, switching = self._hearing.assembly, self._switching
        if switching and state and (due := switching.due(state, self._clock.now_ns())):
            self._link.say(_publication(*due))

    def _remind(self) -> None:
        """Tells the robot again what it is to keep."""
        now_ns = self._clock.now_ns()
        if now_ns - self._told_ns >= _TELL_AGAIN_NS:
            self._told_ns = now_ns
            self._link.say(_publication(COMMAND_TIMEOUT, {"data": PATIENCE_S}))
            self._link.say(_publication(SPEED_RATIO, {"data": self._settings.speed_ratio}))
            if self._payload is not None:
                load = urdf_configuration(self._payload, self._payload_ns)
                self._link.say(_publication(URDF, load))

    def _planned(self, commands: Sequence[Command]) -> list[Due]:
        planned = [self._due(command, command.stamp_ns) for command in commands]
        last, before = commands[-1], self._sent_kind
        self._sent_kind = last.kind
        if last.kind is CommandKind.POSITION and before is not CommandKind.POSITION:
            again = range(1, _HOLDS)
            planned += [self._due(last, last.stamp_ns + k * _HOLD_SPACING_NS) for k in again]
        return planned

    def _due(self, command: Command, at_robot_ns: int) -> Due:
        at_ns = at_robot_ns - self._hearing.offset.ns
        holds = command.kind is CommandKind.POSITION
        return Due(
            op=_publication(JOINT_COMMAND, joint_command(command)),
            at_ns=at_ns,
            until_ns=None if holds else at_ns + _WORTHLESS_NS,
        )

    def _check(self) -> None:
        """Refuses a robot that is not as expected, or not as it was.

        Raises:
            LostError: it is not.
        """
        hearing = self._hearing
        try:
            if hearing.version:
                check_version(hearing.version, self._settings.software)
            if hearing.limits is not None:
                limits = tighter(hearing.limits, sawyer_limits(), self.joint_names)
                if self._is_known and not same(limits, self.limits):
                    raise ConfigError("the robot's joint limits changed; start the bridge anew")
                self.limits = limits
        except ConfigError as error:
            hearing.refused = error
        if hearing.refused is not None:
            raise LostError(self._link.peer, str(hearing.refused))
        self._is_known = self._is_known or not hearing.missing


def _publication(topic: Topic, msg: Mapping[str, Any]) -> Op:
    return {"op": "publish", "topic": topic.name, "msg": msg}
