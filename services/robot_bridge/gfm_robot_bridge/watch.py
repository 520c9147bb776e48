"""What makes the bridge stop the robot by itself: silence, age, and what the arm does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from gfm.core import Observation, Reason
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.following import Following
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Bounds
from gfm_wire import PROTECTIVE_STOP, RobotClock


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """Why the robot is to be stopped.

    Attributes:
        words: For its driver.
        counter: Under which it is counted; empty: under none.
        reason: In the mask of what is told from then on.
        sinks: Whether clearances may be lost until the arm is at rest.
        locks: What a person has to do before somebody drives again; empty: nothing.
    """

    words: str
    counter: str = ""
    reason: Reason = Reason.STOPPED
    sinks: bool = False
    locks: str = ""


@final
class Watch:
    """Looks at reports and at the time.

    Args:
        config: Says how much is too much.
        bounds: Say when a joint is at rest.
        guard: Of what the arm must not touch; None where no model tells.
    """

    def __init__(self, config: BridgeConfig, bounds: Bounds, guard: Guard | None) -> None:
        self._config = config
        self._guard = guard
        self._following = Following(bounds.still, config.behind_rad, config.behind_s)

    def age(self, report: Observation, robot_ns: int) -> Alarm | None:
        """Returns how the newest report is too old to drive by; None where it is not."""
        age_s, most_s = (robot_ns - report.stamp_ns) * 1e-9, self._config.report_age_s
        if age_s <= most_s:
            return None
        words = (
            f"robot: its newest report is {age_s * 1e3:.0f} ms old, expected at most "
            f"{most_s * 1e3:g} ms"
        )
        return Alarm(words=words, counter="stale_reports")

    def silence(self, silent_ns: int) -> Alarm | None:
        """Returns how its driver is silent for too long; None where it is not."""
        most_ns = self._config.watchdog_periods * self._config.period_ns
        if self._config.clock != RobotClock.WALL or silent_ns < most_ns:
            return None
        words = f"no command for {silent_ns * 1e-6:.0f} ms, the robot holds"
        return Alarm(words=words, counter="watchdog_trips", reason=Reason.WATCHDOG)

    def arm(self, limiter: Limiter, report: Observation, passed_s: float) -> Alarm | None:
        """Returns how something holds a joint, bears on it, or led the arm where it was not to go.

        Args:
            limiter: Knows what the arm was to follow, and what it bears.
            report: What it did.
            passed_s: Since the last report.
        """
        loss = None if self._guard is None else self._guard.loss(report)
        if loss is not None:
            words = PROTECTIVE_STOP + loss.words
            again = f"{words}, and again: lead it away by hand, then `gfm robot reset`"
            return Alarm(
                words=words,
                counter="lost_clearances",
                sinks=True,
                locks=again if loss.again else "",
            )
        if not limiter.is_in_position and (heavy := limiter.excess()):
            words = PROTECTIVE_STOP + heavy
            return Alarm(words=words, counter="heavy_loads", reason=Reason.LOAD)
        if held := self._following.problem(limiter.told, report, passed_s):
            return Alarm(words=PROTECTIVE_STOP + held, counter="stalls")
        return None

    def sink(self, report: Observation) -> None:
        """Lets clearances be lost while the arm comes to rest."""
        if self._guard is not None:
            self._guard.sink(report)
