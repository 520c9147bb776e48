"""A running system at a glance: one row per process, with what it does per second.

What `gfm top` shows in a terminal and `gfm metrics` on its page is the same.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

from gfm.core import Clock, Status
from gfm.launch.survey import Missing, keeper_statuses, missing_of, statuses
from gfm.transport import Transport

#: The counter that says best what a role does, and what it counts, in a word.
_WORK = {
    "actor": ("env_steps", "steps"),
    "replay": ("replay_sequences", "sequences"),
    "learner": ("learner_steps", "steps"),
    "robot_bridge": ("ticks", "periods"),
}
#: Gauges that are shown, in this order, and how: the words stand where the number is put in.
_SHOWN = {
    "episode_return_mean": "return {:.4g}",
    "weights_age_s": "weights {:.1f} s old",
    "sequences_unacknowledged": "{:.0f} unacknowledged",
    "samples_per_insert": "{:.3g} samples per insert",
    "weights_version": "version {:,.0f}",
    "jitter_p99_ms": "jitter {:.2g} ms",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One process.

    Attributes:
        role: Its role.
        name: Unique within the run.
        host: Where it runs; empty where that is not known.
        done: How much of its work it has done; None where it counts none.
        unit: What it counts, in a word.
        per_s: Of that since the look before; None where there was none, or it began anew.
        refused: Messages that it refused.
        memory_mib: Resident; None where it does not tell.
        open_files: None where it does not tell.
        state: What else is worth a look, in words.
        note: What it is doing or waiting for; why, where it is missing.
        is_well: Whether it is there and as it should be.
    """

    role: str
    name: str
    host: str = ""
    done: int | None = None
    unit: str = ""
    per_s: float | None = None
    refused: int = 0
    memory_mib: float | None = None
    open_files: float | None = None
    state: str = ""
    note: str = ""
    is_well: bool = True


@dataclass(frozen=True, kw_only=True)
class Look:
    """What was heard of a system at one time.

    Attributes:
        at_s: When, of a monotonic clock.
        found: What the services say.
        missing: Who is not as they should be; None where nobody knows who should be there.
    """

    at_s: float
    found: Sequence[Status]
    missing: Sequence[Missing] | None


@final
class Onlooker:
    """Looks at a system now and then; each look is compared with the one before.

    Several threads may look.
    """

    def __init__(self, transport: Transport, clock: Clock, *, timeout_s: float) -> None:
        """Has not looked yet.

        Args:
            transport: A watcher's connection to the run.
            clock: Of the times between looks.
            timeout_s: How long to wait for a service that does not answer.
        """
        self._transport = transport
        self._clock = clock
        self._timeout_s = timeout_s
        self._before: Look | None = None
        self._lock = threading.Lock()

    def look(self) -> list[Row]:
        """Returns the rows of now."""
        with self._lock:
            found = statuses(self._transport, timeout_s=self._timeout_s)
            kept = keeper_statuses(self._transport, timeout_s=self._timeout_s)
            at_s = self._clock.now_ns() * 1e-9
            look = Look(at_s=at_s, found=found, missing=missing_of(found, kept))
            before, self._before = self._before, look
        return rows(look, before)


def rows(look: Look, before: Look | None) -> list[Row]:
    """Returns a row per process that answers, and one per process that is missing and does not.

    Args:
        look: At the system.
        before: The look before that one, for what was done since; None: there was none.
    """
    ailing = {(one.role, one.name): one.why for one in look.missing or ()}
    earlier = {_life(status): status for status in before.found} if before else {}
    passed_s = look.at_s - before.at_s if before else 0.0
    answered = [
        _row(
            status, earlier.get(_life(status)), passed_s, ailing.pop((status.role, status.name), "")
        )
        for status in look.found
    ]
    absent = [
        Row(role=role, name=name, note=why, is_well=False) for (role, name), why in ailing.items()
    ]
    return sorted((*answered, *absent), key=lambda row: (row.role, row.name))


def _life(status: Status) -> tuple[str, str, str, int]:
    return status.role, status.name, status.host, status.pid


def _row(status: Status, before: Status | None, passed_s: float, why: str) -> Row:
    counter, unit = _WORK.get(status.role, ("", ""))
    done = status.counters.get(counter)
    return Row(
        role=status.role,
        name=status.name,
        host=status.host,
        done=done,
        unit=unit if done is not None else "",
        per_s=_rate(status.counters, before.counters, counter, passed_s) if before else None,
        refused=status.counters.get("rejected_messages", 0),
        memory_mib=status.gauges.get("memory_mib"),
        open_files=status.gauges.get("open_files"),
        state=", ".join(
            words.format(status.gauges[name])
            for name, words in _SHOWN.items()
            if name in status.gauges
        ),
        note=why or status.note,
        is_well=not why,
    )


def _rate(
    now: Mapping[str, int], before: Mapping[str, int], counter: str, passed_s: float
) -> float | None:
    if counter not in now or counter not in before or passed_s <= 0.0:
        return None
    more = now[counter] - before[counter]
    return more / passed_s if more >= 0 else None
