"""Drives the robot through its bridge: sessions, commands, ways, and what is beside them.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import final

import numpy as np

from gfm.core import (
    BadInputError,
    Clock,
    Command,
    CommandKind,
    Observation,
    Reason,
    RefusedError,
    UnreachableError,
)
from gfm.core.checks import Array
from gfm.excitation.motion import minimum_jerk
from gfm.transport import Transport
from gfm_wire import (
    Ack,
    ByHand,
    Message,
    PlaceObject,
    RecordDone,
    RecordStart,
    RecordStop,
    ReleaseRobot,
    SetPayload,
)

#: A way is gone at this speed, rad/s, in at least this time, s, and ends at rest.
_APPROACH_SPEED = 0.4
#: Share of the speed limits that a way asks for: its speed is 0.30 of the slowest joint's of a
#: Sawyer (right_j1), and what fell behind has to catch up.
WAY_SHARE = 0.35
#: The same for holding: the arm stands, or slows down.
_HOLD_SHARE = 0.05
_SHORTEST_APPROACH_S = 0.5
_SETTLE_S = 0.6
#: An arm that is told to be so near to the end of its way, rad, is there: to what it is told its
#: servos bring it, less what they give way by under a load.
_THERE_RAD = 0.005
#: Where it came no nearer for so long, s, by so much, rad, the bridge keeps it where it is.
_KEPT_S, _NEARER_RAD = 1.0, 1e-4
_POLL_NS = 100_000
_RETRY_NS = 500_000_000
#: By how much the bridge's period may differ from the one asked for.
_PERIOD_TOLERANCE = 0.2
#: Over so many periods it is measured before anything moves.
_RATE_PERIODS = 20


@final
class KeptError(RefusedError):
    """The bridge does not let the arm go where it is led: how far from there it is kept, and why.

    Args:
        left_rad: Of the joint that is farthest.
        reason: Of the last command.
    """

    def __init__(self, left_rad: float, reason: Reason) -> None:
        why = ", ".join(str(one.name).lower() for one in reason) or "nothing is said of why"
        super().__init__(
            f"the bridge keeps the arm {left_rad:.2f} rad from where it is led ({why})"
        )


@final
class Driver:
    """Sends commands and waits for what they did.

    Args:
        transport: The connection to the run in which the bridge is.
        clock: To wait by.
        idle: Called while waiting for an answer; sleeps a little by default.
    """

    def __init__(
        self, transport: Transport, clock: Clock, idle: Callable[[], None] | None = None
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._idle = idle or self._sleep
        self._number = 0
        self._newest: Observation | None = None

    @property
    def newest(self) -> Observation:
        """The newest observation; `begin` gets the first."""
        if self._newest is None:
            raise AssertionError("begin() comes first")
        return self._newest

    @property
    def held(self) -> Array | None:
        """Positions that the arm is told, rad, shape (J,); None where it is told no positions."""
        told = self.newest.applied
        return told.values if told is not None and told.kind is CommandKind.POSITION else None

    def begin(self, joint_names: tuple[str, ...], wait_s: float) -> None:
        """Begins a session by holding the arm; waits for a bridge and a robot that come later.

        Args:
            joint_names: J of them.
            wait_s: How long.
        """
        deadline_ns = self._clock.now_ns() + round(wait_s * 1e9)
        while True:
            self._number = 0
            try:
                if self._newest is None:  # nobody knows yet where it is
                    still = np.zeros(len(joint_names))
                    self.command(CommandKind.VELOCITY, joint_names, still, speed_share=_HOLD_SHARE)
                self.hold(joint_names)
            except (UnreachableError, RefusedError):
                if self._clock.now_ns() > deadline_ns:
                    raise
                self._wait_ns(_RETRY_NS)
            else:
                return

    def hold(self, joint_names: tuple[str, ...]) -> None:
        """Holds the arm for one period, in position mode; where it moves, it comes to rest first.

        At a speed of 0 an arm sinks under a load that its gravity compensation does not know. A
        position servo gives way once; told anew to hold what is reported, it would do so each time.
        """
        at = self.newest.position if self.held is None else self.held
        self.command(CommandKind.POSITION, joint_names, at, speed_share=_HOLD_SHARE)

    def command(
        self,
        kind: CommandKind,
        joint_names: tuple[str, ...],
        values: Array,
        *,
        speed_share: float,
        needs_object: bool = False,
    ) -> Observation:
        """Sends one command; returns what the robot reported a control period later.

        Args:
            kind: What the values are.
            joint_names: J of them.
            values: rad, rad/s or N m, shape (J,).
            speed_share: Of the robot's speed limits: no joint shall be told to go faster.
            needs_object: Whether it was made for where the object is.
        """
        command = Command(
            kind=kind,
            joint_names=joint_names,
            values=values,
            stamp_ns=self._clock.utc_ns(),
            number=self._number,
            needs_object=needs_object,
            speed_share=speed_share,
        )
        self._number += 1
        answer = self._ask("robot/command", command)
        if not isinstance(answer, Observation):
            raise RefusedError(f"the bridge answered {type(answer).__name__}, not Observation")
        order = [answer.joint_names.index(name) for name in joint_names]
        if order != list(range(len(order))):
            raise BadInputError(
                f"the robot has joints {', '.join(answer.joint_names)}, "
                f"expected {', '.join(joint_names)}"
            )
        self._newest = answer
        return answer

    def go_to(
        self,
        joint_names: tuple[str, ...],
        position: Array,
        period_s: float,
        interrupts: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Goes somewhere and comes to rest there; returns False where that was broken off.

        It begins a session: a driver that wrote files meanwhile was too silent for the last one.
        The way begins at the positions that the arm is told, see `hold`. Where the bridge lets the
        arm go on more slowly, it lasts until the arm is there.

        Args:
            joint_names: J of them.
            position: rad, shape (J,).
            period_s: Of the bridge.
            interrupts: Asked before every command whether to break off.

        Raises:
            KeptError: the bridge does not let it come there.
            RefusedError: the bridge says no.
        """
        self._number = 0
        while (start := self.held) is None:
            if interrupts():
                return False
            self.hold(joint_names)
        way = position - start
        duration_s = max(1.875 * float(np.abs(way).max()) / _APPROACH_SPEED, _SHORTEST_APPROACH_S)
        for time_s in np.arange(0.0, duration_s + _SETTLE_S, period_s):
            if interrupts():
                return False
            target = start + minimum_jerk(np.array((time_s + period_s) / duration_s)) * way
            self.command(CommandKind.POSITION, joint_names, target, speed_share=WAY_SHARE)
        return self._is_there(position) or self._arrives(
            joint_names, position, period_s, interrupts
        )

    def check_rate(self, joint_names: tuple[str, ...], period_s: float) -> None:
        """Holds the arm for a moment, by which the bridge's control period is measured.

        Raises:
            BadInputError: it is another one.
        """
        began_ns = self.newest.stamp_ns
        for _ in range(_RATE_PERIODS):
            self.hold(joint_names)
        self.check_period("standing still", period_s, _RATE_PERIODS, began_ns)

    def check_period(self, what: str, period_s: float, count: int, began_ns: int) -> None:
        """Compares what passed on the robot's clock with a number of periods.

        Args:
            what: Was done meanwhile, in words.
            period_s: That the bridge should have.
            count: Periods in which it was done.
            began_ns: When, on the robot's clock.

        Raises:
            BadInputError: the bridge has another period.
        """
        passed_s, expected_s = (self.newest.stamp_ns - began_ns) * 1e-9, period_s * count
        if abs(passed_s - expected_s) > _PERIOD_TOLERANCE * expected_s:
            raise BadInputError(
                f"{what} took {passed_s:.2f} s of robot time; expected {expected_s:.2f} s: "
                f"the bridge's control rate is not {1 / period_s:g} Hz"
            )

    def rest(self, joint_names: tuple[str, ...], period_s: float) -> None:
        """Holds the arm for one period, which passes here, too, where the robot is faster."""
        began_ns = self._clock.now_ns()
        self.hold(joint_names)
        self._wait_ns(began_ns + round(period_s * 1e9) - self._clock.now_ns())

    def place_object(self, pose: Array) -> bool:
        """Has the object put somewhere, at rest; returns whether the robot can do that.

        Args:
            pose: m and quaternion w x y z, shape (7,).

        Raises:
            RefusedError: the bridge says no.
        """
        answer = self._ask("robot/object", PlaceObject(pose=pose))
        if not isinstance(answer, Ack | ByHand):
            raise RefusedError(f"the bridge answered {type(answer).__name__}, not Ack or ByHand")
        return isinstance(answer, Ack)

    def carry(self, payload: SetPayload) -> None:
        """Tells the robot what it carries, from now on.

        Raises:
            BadInputError: it cannot be told.
            RefusedError: the bridge says no.
        """
        answer = self._ask("robot/payload", payload)
        if not isinstance(answer, Ack):
            raise BadInputError(
                f"this robot is told of no payload over its bridge, asked for {payload}; "
                "expected one that is"
            )

    def release(self) -> None:
        """Lets go of the robot: somebody else may drive it.

        Raises:
            RefusedError: somebody else does already.
        """
        self._ask("robot/release", ReleaseRobot())

    @contextmanager
    def recording(self, name: str, about: Mapping[str, str]) -> Iterator[list[RecordDone]]:
        """Has the bridge record what is done meanwhile; what it says in the end is in the list.

        A session begins with it: while files are opened no command comes, perhaps for too long.
        """
        if not isinstance(self._ask("robot/record", RecordStart(name=name, metadata=about)), Ack):
            raise RefusedError(f"the bridge does not record {name}")
        told: list[RecordDone] = []
        self._number = 0
        try:
            yield told
        finally:
            done = self._ask("robot/record", RecordStop())
            if isinstance(done, RecordDone):
                told.append(done)

    def _arrives(
        self,
        joint_names: tuple[str, ...],
        position: Array,
        period_s: float,
        interrupts: Callable[[], bool],
    ) -> bool:
        """Goes on to the end of a way on which the bridge slowed the arm down; as `go_to`."""
        nearest, kept_s, rests_s = self._left(position), 0.0, 0.0
        while rests_s < _SETTLE_S:
            if interrupts():
                return False
            self.command(CommandKind.POSITION, joint_names, position, speed_share=WAY_SHARE)
            left, reason = self._left(position), Reason(self.newest.reason)
            rests_s = rests_s + period_s if left <= _THERE_RAD else 0.0
            goes_on = rests_s > 0.0 or left < nearest - _NEARER_RAD or Reason.SCALED in reason
            nearest = min(left, nearest)
            kept_s = 0.0 if goes_on else kept_s + period_s
            if kept_s >= _KEPT_S:
                raise KeptError(left, reason)
        return True

    def _left(self, position: Array) -> float:
        """Returns how far it is to a position, rad, (J,), from where the arm is told to be."""
        at = self.newest.position if self.held is None else self.held
        return float(np.abs(position - at).max())

    def _is_there(self, position: Array) -> bool:
        return self.held is not None and self._left(position) <= _THERE_RAD

    def _ask(self, key: str, message: Message) -> Message:
        pending = self._transport.request(key, message, timeout_s=20.0)
        while (answer := pending.poll()) is None:
            self._idle()
        return answer

    def _wait_ns(self, wait_ns: int) -> None:
        until_ns = self._clock.now_ns() + wait_ns
        while self._clock.now_ns() < until_ns:
            self._idle()

    def _sleep(self) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
