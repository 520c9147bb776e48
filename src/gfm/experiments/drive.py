"""Drives the robot along motions, through the bridge, and has them recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from gfm.core import (
    BadInputError,
    Clock,
    Command,
    CommandKind,
    Observation,
    RefusedError,
    UnreachableError,
)
from gfm.core.checks import Array
from gfm.excitation.motion import JointRanges, Motion, Purpose, minimum_jerk
from gfm.sim.sawyer import JOINT_NAMES, READY
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

#: Velocity commands follow the reference with this gain on the position error, 1/s: enough to stay
#: on it, too little to hide what the drives do.
_FEEDBACK = 2.0
#: A motion is approached at this speed, rad/s, in at least this time, s, and begun at rest.
_APPROACH_SPEED = 0.4
_SHORTEST_APPROACH_S = 0.5
_SETTLE_S = 0.6
_POLL_NS = 100_000
_RETRY_NS = 500_000_000
#: By how much the bridge's period may differ from the motion's.
_PERIOD_TOLERANCE = 0.2
#: Over so many periods it is measured before anything moves.
_RATE_PERIODS = 20


@dataclass(frozen=True, kw_only=True)
class Driven:
    """One motion that was driven and recorded.

    Attributes:
        name: Of the motion.
        purpose: Training or held out.
        kind: Of its commands.
        path: The recording, where the bridge wrote it.
        reports: Sensor reports in it.
    """

    name: str
    purpose: Purpose
    kind: CommandKind
    path: Path
    reports: int


def sawyer_ranges() -> JointRanges:
    """Returns where the arm may be driven: around the pose above the basket, at half speed."""
    return JointRanges(
        joint_names=JOINT_NAMES,
        center=READY,
        half_width=np.array([0.5, 0.35, 0.5, 0.4, 0.7, 0.5, 0.8]),
        speed=np.array([0.75, 0.55, 0.85, 0.85, 1.0, 1.0, 1.0]),
        acceleration=np.array([10.0, 8.0, 10.0, 10.0, 12.0, 12.0, 12.0]),
    )


def drive(
    transport: Transport,
    clock: Clock,
    motions: Sequence[Motion],
    *,
    wait_s: float = 30.0,
    idle: Callable[[], None] | None = None,
    before: Callable[[Observation], None] | None = None,
) -> Iterator[Driven]:
    """Drives motions one after the other; yields each when its recording is complete.

    Args:
        transport: The connection to the run in which the bridge is.
        clock: To wait by.
        motions: What to drive.
        wait_s: How long to wait for the bridge and the robot at first.
        idle: Called while waiting for an answer; sleeps a little by default.
        before: Called with the first observation, before anything moves; may raise.

    Raises:
        UnreachableError: no bridge, or no robot behind it.
        RefusedError: the bridge said no.
        BadInputError: the bridge has another control period than a motion.
    """
    driver = Driver(transport, clock, idle)
    driver.begin(motions[0].joint_names, wait_s)
    if before is not None:
        before(driver.newest)
    for motion in motions:
        driver.approach(motion)
        yield driver.record(motion)
    driver.release()


@final
class Driver:
    """Sends commands and waits for what they did."""

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

    def begin(self, joint_names: tuple[str, ...], wait_s: float, at: Array | None = None) -> None:
        """Begins a session by standing still; waits for a bridge and a robot that come later.

        Args:
            joint_names: J of them.
            wait_s: How long.
            at: A position near which to stand, rad, shape (J,): of an arm that the bridge holds in
                position mode. None: in velocity mode.
        """
        kind, values = CommandKind.POSITION, at
        if values is None:
            kind, values = CommandKind.VELOCITY, np.zeros(len(joint_names))
        deadline_ns = self._clock.now_ns() + round(wait_s * 1e9)
        while True:
            self._number = 0
            try:
                self.command(kind, joint_names, values)
            except (UnreachableError, RefusedError):
                if self._clock.now_ns() > deadline_ns:
                    raise
                self._wait_ns(_RETRY_NS)
            else:
                return

    def command(
        self,
        kind: CommandKind,
        joint_names: tuple[str, ...],
        values: Array,
        *,
        needs_object: bool = False,
    ) -> Observation:
        """Sends one command; returns what the robot reported a control period later."""
        command = Command(
            kind=kind,
            joint_names=joint_names,
            values=values,
            stamp_ns=self._clock.utc_ns(),
            number=self._number,
            needs_object=needs_object,
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

    def approach(self, motion: Motion) -> None:
        """Goes to where a motion begins and comes to rest there, in the motion's mode."""
        self.go_to(motion.joint_names, motion.position[0], motion.period_s)
        if motion.kind is not CommandKind.POSITION:
            self._follow(motion, 0, np.zeros(len(motion.joint_names)))

    def go_to(
        self,
        joint_names: tuple[str, ...],
        position: Array,
        period_s: float,
        interrupts: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Goes somewhere and comes to rest there; returns False where that was broken off.

        It begins a session: a driver that wrote files meanwhile was too silent for the last one.

        Args:
            joint_names: J of them.
            position: rad, shape (J,).
            period_s: Of the bridge.
            interrupts: Asked before every command whether to break off.
        """
        self._number = 0
        start, way = self.newest.position, position - self.newest.position
        duration_s = max(1.875 * float(np.abs(way).max()) / _APPROACH_SPEED, _SHORTEST_APPROACH_S)
        for time_s in np.arange(0.0, duration_s + _SETTLE_S, period_s):
            if interrupts():
                return False
            target = start + minimum_jerk(np.array((time_s + period_s) / duration_s)) * way
            self.command(CommandKind.POSITION, joint_names, target)
        return True

    def check_rate(self, joint_names: tuple[str, ...], period_s: float) -> None:
        """Stands still for a moment, by which the bridge's control period is measured.

        Raises:
            BadInputError: it is another one.
        """
        began_ns = self.newest.stamp_ns
        for _ in range(_RATE_PERIODS):
            self.command(CommandKind.VELOCITY, joint_names, np.zeros(len(joint_names)))
        self._check_period("standing still", period_s, _RATE_PERIODS, began_ns)

    def rest(self, joint_names: tuple[str, ...], period_s: float) -> None:
        """Stands still for one period, which passes here, too, where the robot is faster."""
        began_ns = self._clock.now_ns()
        self.command(CommandKind.VELOCITY, joint_names, np.zeros(len(joint_names)))
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

    def record(self, motion: Motion) -> Driven:
        """Drives one motion while the bridge records it."""
        about = {"purpose": str(motion.purpose), "motion": motion.name}
        began_ns = self.newest.stamp_ns
        with self.recording(motion.name, about) as told:
            for step, speed in enumerate(motion.velocity):
                self._follow(motion, step, speed)
        self._check_period(motion.name, motion.period_s, len(motion.position), began_ns)
        if not told:
            raise RefusedError(f"the bridge says nothing of the recording of {motion.name}")
        return Driven(
            name=motion.name,
            purpose=motion.purpose,
            kind=motion.kind,
            path=Path(told[0].path),
            reports=told[0].ticks,
        )

    def _follow(self, motion: Motion, step: int, speed: Array) -> None:
        """Commands one period of a motion."""
        behind = motion.position[step] - self.newest.position
        values = motion.position[step]
        if motion.tracking is not None:
            slow = speed - self.newest.velocity
            tracking = motion.tracking
            values = tracking.torque[step] + tracking.stiffness * behind + tracking.damping * slow
        elif motion.kind is CommandKind.VELOCITY:
            values = speed + _FEEDBACK * behind
        self.command(motion.kind, motion.joint_names, values)

    def _check_period(self, what: str, period_s: float, count: int, began_ns: int) -> None:
        passed_s, expected_s = (self.newest.stamp_ns - began_ns) * 1e-9, period_s * count
        if abs(passed_s - expected_s) > _PERIOD_TOLERANCE * expected_s:
            raise BadInputError(
                f"{what} took {passed_s:.2f} s of robot time; expected {expected_s:.2f} s: "
                f"the bridge's control rate is not {1 / period_s:g} Hz"
            )

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
