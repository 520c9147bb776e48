"""What a running service says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Status:
    """One service's answer to "how are you".

    Attributes:
        role: actor, learner, replay, robot_bridge, robot, router.
        name: Unique within a run.
        pid: Process id on its own host.
        host: Name of that host.
        counters: Things that only grow, by name (env_steps, learner_steps, rejected_messages ...).
        gauges: Things that go up and down, by name with unit (weights_age_s ...).
        note: What it is doing or waiting for, in words.
    """

    role: str
    name: str
    pid: int
    host: str
    counters: Mapping[str, int] = field(default_factory=dict)
    gauges: Mapping[str, float] = field(default_factory=dict)
    note: str = ""
