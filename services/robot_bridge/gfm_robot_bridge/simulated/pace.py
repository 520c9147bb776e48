"""A simulated robot in real time: its time follows the clock of its process."""

from __future__ import annotations

import logging
from typing import final

from gfm.core import Clock, ConfigError, Observation
from gfm_robot_bridge.simulated.robot import SimulatedRobot

#: The robot is simulated in pieces of at least this length.
_SHORTEST_ADVANCE_NS = 2_000_000
#: ... and of at most this: in between it answers, and hears that it shall end.
_LONGEST_STRIDE_NS = 20_000_000
#: A robot so far behind the wall clock is no longer driven in real time, and seldom catches up.
_FARTHEST_BEHIND_NS = 2_000_000_000
#: One whose clock may slip does so when it is further behind than the robot's own watchdog is long.
_SLIPS_NS = 200_000_000

_log = logging.getLogger(__name__)


@final
class WallPace:
    """Lets time pass for a robot.

    Args:
        robot: At its time 0.
        clock: Of this process.
        slips: Whether a robot that cannot keep up has its clock stand still instead, as is told.
    """

    def __init__(self, robot: SimulatedRobot, clock: Clock, *, slips: bool = False) -> None:
        self._robot = robot
        self._clock = clock
        self._slips = slips
        self._started_ns = clock.now_ns()

    @property
    def wall_ns(self) -> int:
        """What the robot's clock would show if simulating took no time."""
        return self._clock.now_ns() - self._started_ns

    def keep_up(self) -> tuple[tuple[Observation, ...], bool]:
        """Lets the robot's time catch up a little; returns its reports and whether it is behind.

        Raises:
            ConfigError: it cannot, and its clock does not slip.
        """
        behind_ns = self.wall_ns - self._robot.time_ns
        if self._slips and behind_ns > _SLIPS_NS:
            _log.warning("its clock stood still for %.0f ms: it is too slow", behind_ns * 1e-6)
            self._started_ns += behind_ns
            return (), False
        if behind_ns > _FARTHEST_BEHIND_NS:
            raise ConfigError(
                f"clock is wall, and the robot is {behind_ns * 1e-9:.1f} s behind it: this machine "
                "is too slow or too busy for that; expected lockstep"
            )
        if behind_ns < _SHORTEST_ADVANCE_NS:
            return (), False
        reports = self._robot.advance(None, min(behind_ns, _LONGEST_STRIDE_NS))
        return reports, behind_ns > _LONGEST_STRIDE_NS
