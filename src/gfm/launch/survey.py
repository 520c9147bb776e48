"""What a running system says of itself, in sum and one by one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
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


def status_table(found: Sequence[Status]) -> Table:
    """Returns one row per service."""
    table = Table("role", "name", "pid", "host", "counts", "values", "note")
    for status in found:
        table.add_row(
            status.role,
            status.name,
            str(status.pid),
            status.host,
            _lines((name, f"{count:,}") for name, count in status.counters.items() if count),
            _lines((name, f"{value:.4g}") for name, value in status.gauges.items()),
            status.note,
        )
    return table


def summary_line(sums: Mapping[str, Any]) -> str:
    """Returns the sums in one line."""
    names = ("actors", "env_steps", "replay_sequences", "learner_steps", "weights_version")
    return "  ".join(f"{name} {sums[name]:,}" for name in (*names, "rejected_messages"))


def _lines(pairs: Iterable[tuple[str, str]]) -> str:
    return "\n".join(f"{name} {value}" for name, value in pairs)
