"""What a running system says of itself, in sum and one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from gfm.core import Status
from gfm.launch.keeper import SUPERVISOR_KEY
from gfm.transport import Transport
from gfm_wire import StatusRequest


@dataclass(frozen=True, kw_only=True)
class Missing:
    """A process that should be there and is not, or not as it should be.

    Attributes:
        role: Its role.
        name: Its name.
        since_s: How long it has been as it is: down or, where it runs, running.
        why: In words.
    """

    role: str
    name: str
    since_s: float
    why: str


def statuses(transport: Transport, *, timeout_s: float = 2.0) -> list[Status]:
    """Returns the answers of all services of the run, by role and name."""
    return _survey(transport, "status/*/*", timeout_s)


def keeper_statuses(transport: Transport, *, timeout_s: float = 2.0) -> list[Status]:
    """Returns what their keeper says of all processes that should be there, by role and name.

    Empty where nobody keeps them.
    """
    return _survey(transport, f"{SUPERVISOR_KEY}/*", timeout_s)


def _survey(transport: Transport, key: str, timeout_s: float) -> list[Status]:
    answers = transport.survey(key, StatusRequest(), timeout_s=timeout_s)
    found = [answer for answer in answers if isinstance(answer, Status)]
    return sorted(found, key=lambda status: (status.role, status.name))


def missing_of(found: Sequence[Status], kept: Sequence[Status]) -> list[Missing] | None:
    """Returns who is not as they should be; None where nobody knows who should be there.

    Args:
        found: What the services say.
        kept: What their keeper says of them.
    """
    if not kept:
        return None
    answered = {(status.role, status.name) for status in found}
    return [
        Missing(
            role=status.role,
            name=status.name,
            since_s=round(status.gauges["since_s"], 1),
            why=status.note or "runs, but does not answer",
        )
        for status in kept
        if status.note or (status.role, status.name) not in answered
    ]


def summary(found: Sequence[Status], missing: Sequence[Missing] | None = None) -> dict[str, Any]:
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
        "missing": None if missing is None else [vars(one) for one in missing],
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
    "memory_mib",
    "open_files",
)


def status_table(found: Sequence[Status], missing: Sequence[Missing] | None = None) -> Table:
    """Returns one row per service, with the numbers that people ask for first.

    Who is missing stands below them.
    """
    table = Table("role", "name", "pid", "host", "number", "", "note", show_lines=True)
    for status in found:
        rows = [(name, f"{count:,}") for name, count in status.counters.items() if count]
        links = sorted(name for name in status.gauges if name.startswith("connected_"))
        shown = [*(name for name in _TABLE_GAUGES if name in status.gauges), *links]
        rows += [(n, f"{status.gauges[n]:.4g}") for n in shown]
        names, values = (
            ("\n".join(column) for column in zip(*rows, strict=True)) if rows else ("", "")
        )
        table.add_row(
            status.role, status.name, str(status.pid), status.host, names, values, status.note
        )
    for one in missing or ():
        table.add_row(one.role, one.name, "", "", "", "", f"missing: {one.why}", style="bold red")
    table.columns[4].no_wrap = table.columns[5].no_wrap = True
    table.columns[5].justify = "right"
    return table


def summary_line(sums: Mapping[str, Any]) -> str:
    """Returns the sums in one line."""
    names = ("actors", "env_steps", "replay_sequences", "learner_steps", "weights_version")
    counts = [f"{name} {sums[name]:,}" for name in (*names, "rejected_messages")]
    missing = [f"missing {one['name']}" for one in sums["missing"] or ()]
    return "  ".join((*counts, *missing))
