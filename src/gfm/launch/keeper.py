"""Keeps the processes of a running system alive, and says how each of them does."""

from __future__ import annotations

import logging
import signal
import socket
from collections.abc import Sequence
from dataclasses import replace
from typing import final

from gfm.core import Clock, Status
from gfm.launch import policy
from gfm.launch.policy import Action, Life
from gfm.launch.process import BAD_INPUT, ChildProcess
from gfm.launch.supervision import SupervisionConfig
from gfm.launch.supervisor import Supervisor
from gfm.transport import Server
from gfm_wire import StatusRequest

_log = logging.getLogger(__name__)

SUPERVISOR_KEY = "supervisor"
"""Under this and a process's name its keeper says how it does, also while it cannot say so."""

_LONGEST_LOOK_S = 1.0
"""What counts of the time between two looks: five times what `gfm up` lets pass."""

_LONGEST_WHY = 200


@final
class Keeper:
    """Starts again what dies and stops what hangs, as `gfm.launch.policy` decides.

    Silence counts only as far as this process itself has looked: while it was stopped, or starved
    on a busy machine, others may have been so, too.
    """

    def __init__(self, supervisor: Supervisor, config: SupervisionConfig, clock: Clock) -> None:
        """Takes over a system that has been started."""
        self._supervisor = supervisor
        self._config = config
        self._clock = clock
        self._looked_s = self._now_s()
        self._lives = {
            child.spec.name: Life(role=child.spec.role, since_s=self._looked_s, beats=True)
            for child in supervisor.children
        }
        self._servers = {
            name: supervisor.transport.serve(f"{SUPERVISOR_KEY}/{name}") for name in self._lives
        }

    def step(self) -> None:
        """Looks at every process, does what there is to do, and answers who asks.

        Raises:
            BadInputError, ProcessDiedError: the last process of a role was given up.
        """
        now_s = self._now_s()
        children = {child.spec.name: child for child in self._supervisor.children}
        self._look(children, now_s)
        for name, action in policy.decide(now_s, self._lives, self._config).items():
            self._act(action, children[name], now_s)
        lost = policy.lost(self._lives, self._config)
        if lost is not None:
            raise children[lost].death()
        self._answer(now_s)

    @property
    def missing(self) -> list[str]:
        """Who is not as they should be, and why, in words."""
        now_s = self._now_s()
        troubles = {n: policy.trouble(now_s, life, self._config) for n, life in self._lives.items()}
        return [f"{name}: {trouble}" for name, trouble in troubles.items() if trouble]

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9

    def _look(self, children: dict[str, ChildProcess], now_s: float) -> None:
        passed_s, self._looked_s = min(now_s - self._looked_s, _LONGEST_LOOK_S), now_s
        for name, child in children.items():
            life = self._lives[name]
            if life.running and (status := child.status) is not None:
                why = cause(status, child.last_lines())
                hopeless = status == BAD_INPUT
                life = policy.died(life, now_s, why, self._config, hopeless=hopeless)
                self._lives[name] = life
                _log.warning("%s: %s", name, policy.trouble(now_s, life, self._config))
        beaten = {name for name, child in children.items() if child.has_beaten()}
        self._lives = policy.looked(self._lives, beaten, passed_s)

    def _act(self, action: Action, child: ChildProcess, now_s: float) -> None:
        name = child.spec.name
        life = self._lives[name]
        if action is Action.START:
            self._supervisor.restart(child)
            self._lives[name] = policy.started(life, now_s)
        elif action is Action.STOP:
            self._lives[name] = policy.told_to_stop(life, now_s)
            _log.warning("%s: %s", name, policy.trouble(now_s, self._lives[name], self._config))
            child.terminate()
        else:
            _log.warning("%s: did not stop, killed", name)
            child.kill()
            # Should it not end even so (a disk that hangs), this is tried again.
            self._lives[name] = replace(life, told_s=now_s)

    def _answer(self, now_s: float) -> None:
        pids = {child.spec.name: child.pid for child in self._supervisor.children}
        for name, server in self._servers.items():
            answer(server, status_of(name, pids[name], self._lives[name], now_s, self._config))


def cause(status: int, last_lines: Sequence[str]) -> str:
    """Returns in words how a process ended that had not been asked to.

    Args:
        status: Its exit status, negative where a signal ended it.
        last_lines: Of its log; an error's last line says what it was.
    """
    if status < 0:
        return f"ended by signal {-status} ({signal.strsignal(-status)})"
    last = f": {last_lines[-1][:_LONGEST_WHY]}" if status > 0 and last_lines else ""
    return f"ended with status {status}{last}"


def status_of(name: str, pid: int, life: Life, now_s: float, config: SupervisionConfig) -> Status:
    """Returns what a keeper says of one process; its note is empty where all is well."""
    return Status(
        role=life.role,
        name=name,
        pid=pid if life.running else 0,
        host=socket.gethostname(),
        counters={"starts": life.starts, "deaths": life.deaths, "hangs": life.hangs},
        gauges={"since_s": now_s - life.since_s, "silent_s": life.silent_s},
        note=policy.trouble(now_s, life, config),
    )


def answer(server: Server, status: Status) -> None:
    """Answers everybody who asks for a status."""
    while (request := server.receive()) is not None:
        if isinstance(request.message, StatusRequest):
            request.reply(status)
        else:
            request.refuse(f"got {type(request.message).__name__}, expected StatusRequest")
