"""What `gfm up` may be told about processes that die or hang."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import msgspec
from msgspec import Meta

from gfm.core import ConfigError
from gfm.launch.spec import START_ORDER

Positive = Annotated[float, Meta(gt=0.0)]
Count = Annotated[int, Meta(ge=1)]

DEADLINES_S: Mapping[str, float] = {
    "router": 10.0,
    "replay": 30.0,
    "learner": 120.0,
    "robot": 30.0,
    "robot_bridge": 10.0,
    "actor": 60.0,
}
"""Silence after which a process hangs. A step of router and bridge takes milliseconds; replay may
wait for a disk, the simulated robot and an actor for all that they simulate, on a machine that is
busy with others; a learner's step takes as long as its network is large. All are far longer than
what is healthy takes: to stop what only was slow costs more than to find what hangs a little
later."""


class SupervisionConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of `gfm up` for processes that die or hang.

    Attributes:
        first_pause_s: Before the first restart; long enough for a port to be free again.
        longest_pause_s: Pauses double from death to death up to this: short enough that a system
            is soon whole again when what made it fail has gone.
        most_deaths: A process that died so often within `within_s` is given up. With pauses that
            double up to 30 s, eight deaths take a minute and a half: longer than a disk or a
            network is usually away, short enough to tell a person who waits.
        within_s: The time that counts for that.
        start_s: How long a process may take until its first beat; a learner reads recordings.
        stop_s: How long one that is told to stop may take, before it is killed.
        deadline_s: Silence after which a process hangs, by role; DEADLINES_S for the others.
    """

    first_pause_s: Positive = 0.5
    longest_pause_s: Positive = 30.0
    most_deaths: Count = 8
    within_s: Positive = 600.0
    start_s: Positive = 60.0
    stop_s: Positive = 10.0
    deadline_s: dict[str, Positive] = {}

    def __post_init__(self) -> None:
        if unknown := self.deadline_s.keys() - DEADLINES_S.keys():
            raise ConfigError(
                f"deadline_s has {', '.join(sorted(unknown))}, expected {', '.join(START_ORDER)}"
            )
        if self.longest_pause_s < self.first_pause_s:
            raise ConfigError(
                f"longest_pause_s is {self.longest_pause_s:g} and first_pause_s is "
                f"{self.first_pause_s:g}, expected at least as long"
            )

    def pause_s(self, deaths: int) -> float:
        """Returns how long to wait before the next start, after so many recent deaths."""
        doublings = min(max(deaths - 1, 0), 30)
        return min(self.first_pause_s * 2.0**doublings, self.longest_pause_s)
