"""What a running system says of itself, in sum and one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from gfm.core import Status
from gfm.transport import Transport
from gfm_wire import StatusRequest


def statuses(transport: Transport, *, timeout_s: float = 2.0) -> list[Status]:
    """Returns the answers of all services of the run, by role and name."""
    answers = transport.survey("status/*/*", StatusRequest(), timeout_s=timeout_s)
    found = [answer for answer in answers if isinstance(answer, Status)]
    return sorted(found, key=lambda status: (status.role, status.name))


def summary(found: Sequence[Status]) -> dict[str, Any]:
    """Returns the system in numbers, ready for JSON; NaN and infinity become null."""

    def total(counter: str) -> int:
        return sum(status.counters.get(counter, 0) for status in found)

    versions = [int(status.gauges.get("weights_version", 0)) for status in found]
    return {
        "actors": sum(status.role == "actor" for status in found),
        "env_steps": total("env_steps"),
        "replay_sequences": total("replay_sequences"),
        "learner_steps": total("learner_steps"),
        "weights_version": max(versions, default=0),
        "rejected_messages": total("rejected_messages"),
        "processes": [
            {"role": status.role, "pid": status.pid, "name": status.name, "host": status.host}
            for status in found
        ],
        "services": [_as_json(status) for status in found],
    }


def _as_json(status: Status) -> dict[str, Any]:
    gauges = {
        name: value if math.isfinite(value) else None for name, value in status.gauges.items()
    }
    return {**vars(status), "counters": dict(status.counters), "gauges": gauges}


_TABLE_GAUGES = (
    "weights_version",
    "weights_age_s",
    "episode_return_mean",
    "learner_steps_per_s",
    "samples_per_insert",
    "robot_time_s",
    "jitter_p99_ms",
    "jitter_most_ms",
    "read_to_send_p99_ms",
    "command_age_p99_ms",
)


def status_table(found: Sequence[Status]) -> Table:
    """Returns one row per service, with the numbers that people ask for first."""
    table = Table("role", "name", "pid", "host", "number", "", "note", show_lines=True)
    for status in found:
        rows = [(name, f"{count:,}") for name, count in status.counters.items() if count]
        rows += [(n, f"{status.gauges[n]:.4g}") for n in _TABLE_GAUGES if n in status.gauges]
        names, values = (
            ("\n".join(column) for column in zip(*rows, strict=True)) if rows else ("", "")
        )
        table.add_row(
            status.role, status.name, str(status.pid), status.host, names, values, status.note
        )
    table.columns[4].no_wrap = table.columns[5].no_wrap = True
    table.columns[5].justify = "right"
    return table


def summary_line(sums: Mapping[str, Any]) -> str:
    """Returns the sums in one line."""
    names = ("actors", "env_steps", "replay_sequences", "learner_steps", "weights_version")
    return "  ".join(f"{name} {sums[name]:,}" for name in (*names, "rejected_messages"))
