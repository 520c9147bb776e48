"""The port of every service, and the loop that runs one.

A service is one class that is stepped. It has no thread, socket, signal or clock of its own, so
that several of them can be stepped in turn in one thread over the in-memory transport.
"""

from __future__ import annotations

import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import final

from gfm.core import Clock, Status
from gfm.transport import Transport
from gfm_wire import StatusRequest

_SHORTEST_NAP_NS = 100_000
_LONGEST_NAP_NS = 2_000_000
_LONGEST_NOTE = 500


class Service(ABC):
    """One running part of the system."""

    @abstractmethod
    def step(self) -> bool:
        """Does a short piece of work without waiting; returns whether there was any to do."""

    def due_ns(self) -> int | None:
        """Returns when it has to be stepped again at the latest; None: as others are."""
        return None

    @abstractmethod
    def status(self) -> Status:
        """Returns what this service says of itself; its role and name stay the same."""

    @abstractmethod
    def close(self) -> None:
        """Finishes what others rely on (a file, a checkpoint), while messages still flow."""


def make_status(
    role: str,
    name: str,
    *,
    counters: Mapping[str, int] | None = None,
    gauges: Mapping[str, float] | None = None,
    note: str = "",
) -> Status:
    """Returns a status of this process."""
    return Status(
        role=role,
        name=name,
        pid=os.getpid(),
        host=socket.gethostname(),
        counters=counters or {},
        gauges=gauges or {},
        note=note[:_LONGEST_NOTE],
    )


@final
class RunningService:
    """A service together with its answers to `status/<role>/<name>`."""

    def __init__(self, service: Service, transport: Transport) -> None:
        self._service = service
        self._transport = transport
        status = service.status()
        self._server = transport.serve(f"status/{status.role}/{status.name}")

    def step(self) -> bool:
        """Steps the service and answers one question for its status; returns whether any did."""
        worked = self._service.step()
        request = self._server.receive()
        if request is None:
            return worked
        if isinstance(request.message, StatusRequest):
            request.reply(self.status())
        else:
            request.refuse(f"got {type(request.message).__name__}, expected StatusRequest")
        return True

    def status(self) -> Status:
        """Returns the service's status with the messages that its transport refused.

        `rejected_messages` is their sum, what the service itself refused included.
        """
        status = self._service.status()
        refused = self._transport.rejected
        counters = dict(status.counters)
        counters |= {f"rejected_{reason}": count for reason, count in refused.items()}
        counters["rejected_messages"] = counters.get("rejected_messages", 0) + sum(refused.values())
        return replace(status, counters=counters)


def nap_ns(idle_ns: int) -> int:
    """Returns how long to sleep after `idle_ns` without work.

    Whoever was busy a moment ago is likely to be asked again soon: late by a sixteenth of the time
    since then at most, and by 2 ms in the end.
    """
    return min(max(idle_ns // 16, _SHORTEST_NAP_NS), _LONGEST_NAP_NS)


def run_service(
    service: Service, transport: Transport, clock: Clock, stopped: Callable[[], bool]
) -> None:
    """Steps a service until `stopped` says so, then closes it.

    The service is closed before its transport (which the caller owns), because closing may still
    have something to tell: an actor's last sequences, a bridge's hold command.
    """
    running = RunningService(service, transport)
    worked_ns = clock.now_ns()
    try:
        while not stopped():
            worked = running.step()
            now_ns = clock.now_ns()
            if worked:
                worked_ns = now_ns
            else:
                wake_ns, due_ns = now_ns + nap_ns(now_ns - worked_ns), service.due_ns()
                clock.sleep_until_ns(wake_ns if due_ns is None else min(wake_ns, due_ns))
    finally:
        service.close()
