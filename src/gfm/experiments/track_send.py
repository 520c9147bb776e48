"""Sends what a tracker knows to the robot bridge of a run."""

from __future__ import annotations

import logging
from typing import final

from gfm.core import Clock, RefusedError, UnreachableError
from gfm.core.checks import Array
from gfm.tracking.rigid import Pose
from gfm.tracking.tracker import Tracked
from gfm.transport import PendingReply, Transport
from gfm_wire import ObjectPose, TrackedObject

_log = logging.getLogger(__name__)

KEY = "robot/tracked"
#: For an answer of the bridge, which comes in its next period.
_WAIT_S = 1.0


def as_message(told: Tracked, now_s: float, utc_ns: int) -> TrackedObject:
    """Returns what a bridge is told: a pose that may be used, or that there is none.

    Args:
        told: What is known.
        now_s: When that is, on the clock of its times.
        utc_ns: The date of that moment.
    """
    if not told.valid or told.pose is None or told.time_s is None or told.covariance is None:
        return TrackedObject(stamp_ns=utc_ns)
    return TrackedObject(
        stamp_ns=utc_ns - round(1e9 * (now_s - told.time_s)),
        pose=_pose(told.pose, told.covariance),
        views={name: _pose(view.pose, view.covariance) for name, view in told.views.items()},
    )


def _pose(pose: Pose, covariance: Array) -> ObjectPose:
    """Returns a pose as it is sent; rounding makes covariances a little lopsided."""
    return ObjectPose(
        position=pose.position,
        quaternion=pose.quaternion,
        covariance=0.5 * (covariance + covariance.T),
    )


@final
class PoseSender:
    """Sends the newest; where the bridge has not answered the last one yet, that is not waited for.

    What the bridge says against it is logged, once in a row.

    Args:
        transport: The connection to the run.
        clock: For the date.
    """

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self._pending: PendingReply | None = None
        self._problem = ""

    def tell(self, told: Tracked, now_s: float) -> None:
        """Sends what is known; see `as_message`."""
        self._hear()
        message = as_message(told, now_s, self._clock.utc_ns())
        self._pending = self._transport.request(KEY, message, timeout_s=_WAIT_S)

    def _hear(self) -> None:
        """Notes what became of the last one."""
        problem = self._problem
        try:
            if self._pending is not None and self._pending.poll() is not None:
                problem = ""
        except (RefusedError, UnreachableError) as error:
            problem = str(error)
        if problem != self._problem:
            _log.warning("%s", problem or "the bridge takes the poses again")
        self._problem = problem
