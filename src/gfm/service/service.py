"""The port of every service, and its answers to how it is.

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

from gfm.core import Status
from gfm.service.sums import Sums
from gfm.service.usage import process_usage
from gfm.transport import Transport
from gfm_wire import StatusRequest

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

    def lasting(self) -> frozenset[str]:
        """Returns the counters that go on by themselves when the service is started again."""
        return frozenset()

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

    def __init__(self, service: Service, transport: Transport, sums: Sums | None = None) -> None:
        self._service = service
        self._sums = sums
        self._transport = transport
        status = service.status()
        self._server = transport.serve(f"status/{status.role}/{status.name}")

    def step(self) -> bool:
        """Steps the service and answers one question for its status; returns whether any did."""
        worked = self._service.step()
        if self._sums is not None and self._sums.is_due():
            self.write_sums()
        return self.answer(self.status) or worked

    def write_sums(self) -> None:
        """Writes what the next process of this service shall go on from, where that is wanted."""
        if self._sums is not None:
            self._sums.write(self.status().counters)

    def answer(self, status: Callable[[], Status]) -> bool:
        """Answers one question for the status, if there is one, and returns whether there was.

        Another thread than the one that steps may call this: each question is received once.
        """
        request = self._server.receive()
        if request is None:
            return False
        if isinstance(request.message, StatusRequest):
            request.reply(status())
        else:
            request.refuse(f"got {type(request.message).__name__}, expected StatusRequest")
        return True

    def status(self) -> Status:
        """Returns the service's status with what its process uses and its transport refused.

        `rejected_messages` is the sum of refusals, what the service itself refused included.
        """
        status = self._service.status()
        refused = self._transport.rejected
        counters = dict(status.counters)
        counters |= {f"rejected_{reason}": count for reason, count in refused.items()}
        counters["rejected_messages"] = counters.get("rejected_messages", 0) + sum(refused.values())
        if self._sums is not None:
            counters = self._sums.total(counters, self._service.lasting())
        gauges = {**status.gauges, **process_usage()}
        return replace(status, counters=counters, gauges=gauges)
