"""What is asked of the bridge beside commands: recordings, the object, letting go."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from gfm.core import Clock, RefusedError
from gfm.transport import Request, Transport
from gfm_robot_bridge.lease import Lease
from gfm_robot_bridge.recorder import Pending, Recorder
from gfm_robot_bridge.robot import Robot
from gfm_wire import Ack, ByHand, PlaceObject, RecordStart, RecordStop, ReleaseRobot

RECORD = "robot/record"
OBJECT = "robot/object"
RELEASE = "robot/release"
_QUATERNION_TOLERANCE = 1e-3


@final
class Desk:
    """Answers one question at a time.

    Args:
        transport: On which they arrive.
        clock: Of this process.
        robot: That may put an object somewhere.
        recorder: That records it.
        lease: Who drives it.
        released: Called where the driver lets go.

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
        released: Callable[[], None],
    ) -> None:
        self.rejected = 0
        self._clock = clock
        self._robot = robot
        self._recorder = recorder
        self._lease = lease
        self._released = released
        self._pending: list[tuple[Request, Pending]] = []
        self._servers = (
            (transport.serve(RECORD), self._answer_record),
            (transport.serve(OBJECT), self._answer_place),
            (transport.serve(RELEASE), self._answer_release),
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

    def _answer_release(self, request: Request) -> None:
        if not isinstance(request.message, ReleaseRobot):
            self._refuse_kind(request, "ReleaseRobot")
        elif self._is_holders(request):
            self._released()
            request.reply(Ack())

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
