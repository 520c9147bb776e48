"""Starts a system's processes, waits until they answer, watches them, and stops them in order."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self, final

from gfm.core import Clock, MonotonicClock, RefusedError, UnreachableError
from gfm.launch.process import ChildProcess
from gfm.launch.spec import START_ORDER, STOP_ORDER, ProcessSpec, SystemSpec, in_order
from gfm.transport import PendingReply, Transport
from gfm_wire import Role, StatusRequest

_POLL_NS = 50_000_000
_ASK_S = 1.0
_IDLE_NS, _CHECK_NS = 100_000, 100_000_000


@final
class Supervisor:
    """A system of processes on this machine; leaving its `with` block stops all of them."""

    def __init__(
        self,
        spec: SystemSpec,
        log_dir: Path,
        *,
        start_timeout_s: float = 60.0,
        stop_timeout_s: float = 10.0,
        clock: Clock | None = None,
    ) -> None:
        """Prepares a system; nothing runs yet.

        Args:
            spec: The processes.
            log_dir: Gets one log file per process.
            start_timeout_s: How long they may take until they answer.
            stop_timeout_s: How long one may take to stop before it is killed.
            clock: Time; the operating system's by default.
        """
        self.spec = spec
        self._log_dir = log_dir
        self._start_timeout_s = start_timeout_s
        self._stop_timeout_s = stop_timeout_s
        self._clock = clock or MonotonicClock()
        self._children: list[ChildProcess] = []
        self._transport: Transport | None = None

    @property
    def transport(self) -> Transport:
        """A connection to the running system."""
        if self._transport is None:
            raise RuntimeError("the system has not been started")
        return self._transport

    @property
    def children(self) -> tuple[ChildProcess, ...]:
        """The processes, in the order in which they were started."""
        return tuple(self._children)

    def start(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Starts everything and returns when every process has answered, or `stopped` says so.

        Raises:
            BadInputError: a process cannot do what it was told.
            ProcessDiedError: a process ended.
            UnreachableError: a process did not answer in time.
        """
        self._start(self.spec.processes, stopped)

    def add(self, *processes: ProcessSpec) -> None:
        """Starts more processes in the running system and returns when they have answered.

        Raises:
            BadInputError, ProcessDiedError, UnreachableError: as `start` does.
        """
        self.spec = replace(self.spec, processes=(*self.spec.processes, *processes))
        self._start(processes, lambda: False)

    def _start(self, processes: Sequence[ProcessSpec], stopped: Callable[[], bool]) -> None:
        self._log_dir.mkdir(parents=True, exist_ok=True)
        # Actors ask the learner what they shall do: before, they cannot answer.
        actors = [process for process in processes if process.role == "actor"]
        others = [process for process in processes if process.role != "actor"]
        for group in (others, actors):
            if group and not stopped():
                self._start_together(group, stopped)

    def _start_together(self, group: Sequence[ProcessSpec], stopped: Callable[[], bool]) -> None:
        deadline_ns = self._clock.now_ns() + round(self._start_timeout_s * 1e9)
        children = [
            ChildProcess(process, self.spec.arguments(process), self._log_dir)
            for process in in_order(group, START_ORDER)
        ]
        self._children += children
        for _ in self._readiness(children, deadline_ns):
            if stopped():
                break
            self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)

    def check(self) -> None:
        """Returns while every process runs; raises as `start` does where one has ended."""
        for child in self._children:
            child.check()

    def restart(self, dead: ChildProcess) -> None:
        """Starts a process that has ended again; does not wait until it answers."""
        dead.finish(self._stop_timeout_s)
        again = ChildProcess(dead.spec, self.spec.arguments(dead.spec), self._log_dir)
        self._children[self._children.index(dead)] = again

    def stop(self) -> None:
        """Stops every process, role by role in STOP_ORDER; those of one role at the same time."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None
        self._children.sort(key=lambda child: STOP_ORDER.index(child.spec.role))
        for _, group in itertools.groupby(self._children, key=lambda child: child.spec.role):
            children = list(group)
            for child in children:
                child.terminate()
            for child in children:
                child.finish(self._stop_timeout_s)
        self._children.clear()

    def _readiness(self, children: list[ChildProcess], deadline_ns: int) -> Iterator[None]:
        """Yields for as long as something is still waited for."""
        while self._transport is None:
            self._check_start("the hub", deadline_ns)
            try:
                self._transport = self.spec.address.open(Role.SUPERVISOR, timeout_s=0.0)
            except UnreachableError:
                yield
        for child in children:
            yield from self._first_answer(child, deadline_ns)

    def _first_answer(self, child: ChildProcess, deadline_ns: int) -> Iterator[None]:
        key = f"status/{child.spec.role}/{child.spec.name}"
        pending: PendingReply | None = None
        while True:
            self._check_start(child.spec.name, deadline_ns)
            pending = pending or self.transport.request(key, StatusRequest(), timeout_s=_ASK_S)
            try:
                if pending.poll() is not None:
                    return
            except (UnreachableError, RefusedError):
                pending = None
            yield

    def _check_start(self, waited_for: str, deadline_ns: int) -> None:
        self.check()
        if self._clock.now_ns() >= deadline_ns:
            raise UnreachableError(f"{waited_for} (logs: {self._log_dir})", self._start_timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()


def watching(supervisor: Supervisor, clock: Clock) -> Callable[[], None]:
    """Returns what to do while waiting: nap, and now and then see whether everybody is alive."""
    checked_ns = clock.now_ns()

    def idle() -> None:
        nonlocal checked_ns
        now_ns = clock.now_ns()
        if now_ns - checked_ns >= _CHECK_NS:
            supervisor.check()
            checked_ns = now_ns
        clock.sleep_until_ns(now_ns + _IDLE_NS)

    return idle
