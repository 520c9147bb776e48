"""A system of real processes that can be hurt in every way that needs no rights.

Router, replay, learner and actors learn `point_mass`, as `gfm up` starts and keeps them. Three of
them reach the router over lines that can be cut, all but the router have clocks that can be set
back, and those who write can be told that their disk is full (by a limit on the size of files).
"""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import final

import numpy as np
from relay import Relay
from resumes import Resumes
from survival import HANG_DEADLINE_S, grew, pid_of, progress

from gfm.core import MonotonicClock, Status, Weights
from gfm.launch import (
    Keeper,
    ProcessSpec,
    SupervisionConfig,
    Supervisor,
    actor_processes,
    learner_process,
    own_system,
    replay_process,
    router_process,
    statuses,
)
from gfm_wire import Role

ACTORS = 4
LINES = ("replay", "learner", "actor-0")
PATIENCE_S = 600.0
START_S = 300.0  # on a busy machine
#: Samples per insert, at least and at most.
RATIO = (4.0, 8.0)
_LOOK_S = 0.05
_FULL_BYTES = 1024
_ENV = ("--env", "point_mass")


class NeverWholeError(AssertionError):
    """The system did not recover."""


@final
class Rig:
    """The running system and its keeper, stepped by whoever waits.

    Attributes:
        versions_back: Times that weights of an older life than before were heard, or of an older
            version of the same life.
        resumes: How learners went on that were started again.
        began_ns: When the system was started, UTC: tells one rig from the next.
    """

    def __init__(self, folder: Path) -> None:
        """Starts a system that goes on with what is in the folder.

        Args:
            folder: Gets the sequences, checkpoints, ledgers and logs.
        """
        self.folder = folder
        self.began_ns = time.time_ns()
        self.versions_back = 0
        self.resumes = Resumes(folder / "checkpoints" / "policy.npz")
        self._newest = (0, 0)
        system = own_system("faults", folder, (router_process(),))
        self._port = int(system.endpoint.rpartition(":")[2])
        self._lines = {name: Relay(self._port) for name in LINES}
        system = replace(system, processes=(*system.processes, *self._processes()))
        self.supervisor = Supervisor(system, folder / "logs", start_timeout_s=START_S)
        self.supervisor.start()
        # Every fault is the first: what died before does not lengthen the pause.
        deadlines = dict.fromkeys(("router", "replay", "learner", "actor"), HANG_DEADLINE_S)
        config = SupervisionConfig(deadline_s=deadlines, stop_s=1.0, within_s=1.0)
        self._keeper = Keeper(self.supervisor, config, MonotonicClock())
        self._listener = system.address.open(Role.ACTOR, name="listener")
        self._weights = self._listener.subscribe("weights", keep=8)

    @property
    def names(self) -> list[str]:
        """Of all processes."""
        return [child.spec.name for child in self.supervisor.children]

    def _processes(self) -> Iterator[ProcessSpec]:
        folder = self.folder
        learner = ("--checkpoint-dir", str(folder / "checkpoints"), "--checkpoint-period-s", "5")
        acting = ("--max-steps-per-s", "50", "--ledger", str(folder / "ledgers"))
        ratio = (
            *("--min-samples-per-insert", f"{RATIO[0]:g}"),
            *("--max-samples-per-insert", f"{RATIO[1]:g}"),
            *("--max-batch-size", "32"),  # the learner's own: no more fits between the bounds
        )
        processes = (
            replay_process(("--folder", str(folder / "replay"), *ratio)),
            learner_process((*_ENV, *learner)),
            *actor_processes(ACTORS, 0, (*_ENV, *acting)),
        )
        return map(self._hurtable, processes)

    def _hurtable(self, process: ProcessSpec) -> ProcessSpec:
        """Returns a process whose clock can be set back and, if it has a line, that can be cut."""
        name, line = process.name, self._lines.get(process.name)
        clock = ("--set-back-file", str(self._clock_file(name)), "--service", process.module)
        cable = () if line is None else ("--connect", f"tls/127.0.0.1:{line.port}")
        return replace(process, module="set_back", arguments=(*clock, *process.arguments, *cable))

    def _clock_file(self, name: str) -> Path:
        return self.folder / f"{name}.set_back"

    def stop(self) -> None:
        """Stops everything in order."""
        self._listener.close()
        self.supervisor.stop()
        for line in self._lines.values():
            line.cut()

    def step(self) -> None:
        """Keeps the system for a moment, and listens to the learner."""
        self._keeper.step()
        while isinstance(weights := self._weights.take(), Weights):
            self.resumes.hear(weights)
            heard = (weights.life, weights.version)
            self.versions_back += heard < self._newest
            self._newest = max(self._newest, heard)
        time.sleep(_LOOK_S)

    def wait(self, true: Callable[[], bool], most_s: float = PATIENCE_S) -> float:
        """Returns how long it took until something was true, s.

        Raises:
            NeverWholeError: it took longer than `most_s`.
        """
        began_s = time.monotonic()
        while not true():
            if time.monotonic() - began_s > most_s:
                raise NeverWholeError(f"not whole after {most_s:g} s: {self._keeper.missing}")
            self.step()
        return time.monotonic() - began_s

    def pause(self, seconds: float) -> None:
        """Keeps the system for so long."""
        end_s = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() >= end_s)

    def whole(self) -> None:
        """Returns once all are there and actors, replay and learner have all gone on.

        Raises:
            NeverWholeError: that did not come to be.
        """
        count = len(self.supervisor.children)
        self.wait(lambda: not self._keeper.missing and len(self.told()) == count)
        before = progress(self.supervisor)
        self.wait(lambda: grew(progress(self.supervisor), before))

    def told(self) -> list[Status]:
        """Returns what the services say of themselves, those that answer."""
        return statuses(self.supervisor.transport, timeout_s=0.3)

    def everybody(self) -> list[Status]:
        """Returns what all services say of themselves.

        Raises:
            NeverWholeError: they never all answer.
        """
        found: list[Status] = []

        def all_answer() -> bool:
            found[:] = self.told()
            return len(found) == len(self.supervisor.children)

        self.wait(all_answer)
        return found

    def kill(self, name: str, _rng: np.random.Generator) -> None:
        """SIGKILL; returns when a new process was started."""
        pid = pid_of(self.supervisor, name)
        os.kill(pid, signal.SIGKILL)
        self.wait(lambda: pid_of(self.supervisor, name) != pid)

    def hang(self, name: str, _rng: np.random.Generator) -> None:
        """SIGSTOP for ever; returns when the keeper has ended it and started another."""
        pid = pid_of(self.supervisor, name)
        os.kill(pid, signal.SIGSTOP)
        self.wait(lambda: pid_of(self.supervisor, name) != pid)

    def freeze(self, name: str, rng: np.random.Generator) -> None:
        """SIGSTOP for less than the keeper's deadline, then SIGCONT."""
        pid = pid_of(self.supervisor, name)
        os.kill(pid, signal.SIGSTOP)
        self.pause(rng.uniform(0.5, 0.6 * HANG_DEADLINE_S))
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    def cut(self, name: str, rng: np.random.Generator) -> None:
        """Closes one line's connections, and lets nobody in for up to 6 s."""
        port = self._lines[name].port
        self._lines[name].cut()
        self.pause(rng.uniform(0.5, 6.0))
        self._lines[name] = Relay(self._port, port)

    def set_back(self, name: str, rng: np.random.Generator) -> None:
        """Sets a clock back by up to ten days, and kills who has it."""
        seconds = rng.uniform(60.0, 864e3)
        self._clock_file(name).write_text(f"{seconds:.3f}\n", encoding="ascii")
        self.kill(name, rng)

    def fill_disk(self, name: str, rng: np.random.Generator) -> None:
        """Lets one process write nothing for up to 5 s."""
        with _full_disk(pid_of(self.supervisor, name)):
            self.pause(rng.uniform(1.0, 5.0))


@contextmanager
def _full_disk(pid: int) -> Iterator[None]:
    before = resource.prlimit(pid, resource.RLIMIT_FSIZE, (_FULL_BYTES, resource.RLIM_INFINITY))
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            resource.prlimit(pid, resource.RLIMIT_FSIZE, before)
