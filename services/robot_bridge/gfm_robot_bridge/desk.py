"""What is asked of the bridge beside commands: recordings, the object, stops, letting go."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

import numpy as np

from gfm.core import Clock, RefusedError
from gfm.transport import Request, Transport
from gfm_robot_bridge.lease import Lease, name_of
from gfm_robot_bridge.recorder import Pending, Recorder
from gfm_robot_bridge.robot import Robot
from gfm_wire import (
    Ack,
    ByHand,
    Message,
    PlaceObject,
    PowerAction,
    PowerRobot,
    RecordStart,
    RecordStop,
    ReleaseRobot,
    ScaleSpeed,
    SetPayload,
    Stamp,
    StopRobot,
)

RECORD = "robot/record"
OBJECT = "robot/object"
PAYLOAD = "robot/payload"
RELEASE = "robot/release"
STOP = "robot/stop"
SPEED = "robot/speed"
POWER = "robot/power"
_QUATERNION_TOLERANCE = 1e-3


class Controls(ABC):
    """What may be done to a robot beside commanding it."""

    @abstractmethod
    def let_go(self) -> None:
        """Ends its driver's session."""

    @abstractmethod
    def stop(self, why: str) -> None:
        """Stops it; only a new session moves it again."""

    @abstractmethod
    def unlock(self) -> bool:
        """Lets somebody drive again after a stop that only a person ends; returns whether."""

    @abstractmethod
    def carried(self, payload: SetPayload) -> None:
        """Takes note of what the robot was told that it carries."""

    @abstractmethod
    def scale(self) -> float:
        """Returns at which part of the commanded speed it goes."""

    @abstractmethod
    def set_scale(self, scale: float) -> None:
        """Lets it go at a part of the commanded speed, 0 to 1."""


@final
class Desk:
    """Answers one question at a time.

    Args:
        transport: On which they arrive.
        clock: Of this process.
        robot: That may put an object somewhere, and be told of a payload.
        recorder: That records it.
        lease: Who drives it.
        controls: That act on the robot.

    Attributes:
        rejected: Questions that were refused.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        robot: Robot,
        recorder: Recorder,
        lease: Lease,
        *,
        controls: Controls,
    ) -> None:
        self.rejected = 0
        self._clock = clock
        self._robot = robot
        self._recorder = recorder
        self._lease = lease
        self._controls = controls
        self._slowed_by: Stamp | None = None
        self._pending: list[tuple[Request, Pending]] = []
        self._servers = (
            (transport.serve(RECORD), self._answer_record),
            (transport.serve(OBJECT), self._answer_place),
            (transport.serve(PAYLOAD), self._answer_payload),
            (transport.serve(RELEASE), self._answer_release),
            (transport.serve(STOP), self._answer_stop),
            (transport.serve(SPEED), self._answer_speed),
            (transport.serve(POWER), self._answer_power),
        )

    def answer(self) -> bool:
        """Answers the next question, and those whose answer is known now; returns whether any."""
        waiting, self._pending = self._pending, []
        for asked, pending in waiting:
            self._answer_when_known(asked, pending)
        for server, answer in self._servers:
            if (request := server.receive()) is not None:
                answer(request)
                return True
        return len(self._pending) < len(waiting)

    def _answer_when_known(self, request: Request, pending: Pending) -> None:
        try:
            answer = pending()
        except RefusedError as error:
            self._refuse(request, str(error))
            return
        if answer is None:
            self._pending.append((request, pending))
        else:
            request.reply(answer)

    def _answer_record(self, request: Request) -> None:
        message = request.message
        try:
            if isinstance(message, RecordStart):
                self._answer_when_known(request, self._recorder.start(message))
            elif isinstance(message, RecordStop):
                self._answer_when_known(request, self._recorder.stop())
            else:
                self._refuse_kind(request, "RecordStart or RecordStop")
        except RefusedError as error:
            self._refuse(request, str(error))

    def _answer_place(self, request: Request) -> None:
        message = request.message
        if not isinstance(message, PlaceObject):
            self._refuse_kind(request, "PlaceObject")
            return
        length = float(np.linalg.norm(message.pose[3:]))
        if abs(length - 1.0) > _QUATERNION_TOLERANCE:
            self._refuse(request, f"pose has a quaternion of length {length:.3g}, expected 1")
        elif self._is_holders(request):
            request.reply(Ack() if self._robot.place_object(message.pose) else ByHand())

    def _answer_payload(self, request: Request) -> None:
        message = request.message
        if not isinstance(message, SetPayload):
            self._refuse_kind(request, "SetPayload")
        elif message.problem:
            self._refuse(request, message.problem)
        elif self._is_holders(request):
            request.reply(self._told_payload(message))

    def _told_payload(self, payload: SetPayload) -> Message:
        if not self._robot.carry(payload):
            return ByHand()
        self._controls.carried(payload)
        return Ack()

    def _answer_release(self, request: Request) -> None:
        if not isinstance(request.message, ReleaseRobot):
            self._refuse_kind(request, "ReleaseRobot")
        elif self._is_holders(request):
            self._controls.let_go()
            request.reply(Ack())

    def _answer_stop(self, request: Request) -> None:
        message = request.message
        if not isinstance(message, StopRobot):
            self._refuse_kind(request, "StopRobot")
            return
        self._controls.stop(f"stopped by {name_of(request.stamp)}: {message.reason}")
        request.reply(Ack())

    def _answer_speed(self, request: Request) -> None:
        """Slows the robot down for anybody; the same one, or the driver, may end that."""
        message = request.message
        if not isinstance(message, ScaleSpeed):
            self._refuse_kind(request, "ScaleSpeed")
        elif not 0.0 <= message.scale <= 1.0:
            self._refuse(request, f"scale is {message.scale}, expected 0 to 1")
        elif message.scale > self._controls.scale() and not self._may_raise(request.stamp):
            who = "nobody" if self._slowed_by is None else name_of(self._slowed_by)
            self._refuse(request, f"slowed down by {who}; expected that it or the driver ends that")
        else:
            self._slowed_by = request.stamp
            self._controls.set_scale(message.scale)
            request.reply(Ack())

    def _answer_power(self, request: Request) -> None:
        """Switches the drives for anybody: nothing moves by that, and its driver begins again."""
        if not isinstance(request.message, PowerRobot):
            self._refuse_kind(request, "PowerRobot")
            return
        action = request.message.action
        if action is PowerAction.RESET and self._controls.unlock() and not self._robot.fault():
            request.reply(Ack())
            return
        try:
            is_done = self._robot.power(action)
        except RefusedError as error:
            self._refuse(request, str(error))
        else:
            self._answer_when_known(request, lambda: Ack() if is_done() else None)

    def _may_raise(self, sender: Stamp) -> bool:
        slowed = self._slowed_by
        # By name: a command for people is another connection each time.
        is_same = slowed is not None and slowed.sender == sender.sender
        return is_same or self._lease.is_held_by(sender)

    def _is_holders(self, request: Request) -> bool:
        """Returns whether whoever asks may do so; refuses where somebody else drives."""
        problem = self._lease.refusal(request.stamp, self._clock.now_ns())
        if problem:
            self._refuse(request, problem)
        return not problem

    def _refuse_kind(self, request: Request, expected: str) -> None:
        self._refuse(request, f"got {type(request.message).__name__}, expected {expected}")

    def _refuse(self, request: Request, reason: str) -> None:
        self.rejected += 1
        request.refuse(reason)
