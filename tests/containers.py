"""A system in containers, under a project name of its own, and the engine that runs it."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SERVICES = ("router", "replay", "learner", "actor", "robot", "robot_bridge")
PATIENCE_S = 900.0


@dataclass(frozen=True, kw_only=True)
class Project:
    """One system.

    Attributes:
        name: Apart from any other that runs on this machine.
        settings: What compose reads from the environment.
    """

    name: str
    settings: dict[str, str] = field(default_factory=dict)

    def compose(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Returns what `compose` did."""
        engine = shlex.split(os.environ.get("CONTAINER_ENGINE", "docker"))
        file = str(ROOT / "docker" / "compose.yaml")
        words = [*engine, "compose", "--profile", "commands", "-p", self.name, "-f", file]
        return self._run([*words, *arguments], check=check)

    def engine(self, *arguments: str, check: bool = True) -> str:
        """Returns what the engine's own command printed: compose can cut nobody off."""
        words = shlex.split(os.environ.get("CONTAINER_CLI", "docker"))
        return self._run([*words, *arguments], check=check).stdout

    def _run(self, words: list[str], *, check: bool) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            words,
            check=False,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            cwd=ROOT,
            env=os.environ | self.settings,
        )
        assert not (check and done.returncode), f"{shlex.join(words)}:\n{done.stdout}{done.stderr}"
        return done

    def containers(self, service: str) -> list[str]:
        """Returns the names of a service's running containers."""
        labels = {"project": self.name, "service": service}
        filters = [f"label=com.docker.compose.{key}={value}" for key, value in labels.items()]
        flags = [word for one in filters for word in ("--filter", one)]
        return sorted(self.engine("ps", *flags, "--format", "{{.Names}}").split())

    def asked(self) -> dict[str, Any]:
        """Returns what the system says of itself; empty while nobody answers."""
        done = self.compose("run", "--rm", "-T", "status", "--json", check=False)
        return dict(json.loads(done.stdout)) if done.returncode == 0 else {}

    def asked_until(self, true: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Returns what it says once that is as wanted."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not (sums := self.asked()) or not true(sums):
            assert time.monotonic() < deadline_s, sums
        return sums


@contextmanager
def running(project: Project, actors: int, services: Iterable[str] = SERVICES) -> Iterator[None]:
    """Brings up a system; nothing of it is left afterwards, nor was there from an earlier one."""
    _remove(project)
    try:
        project.compose("up", "-d", "--scale", f"actor={actors}", *services)
        yield
    finally:
        _remove(project)


def _remove(project: Project) -> None:
    """Removes containers and volumes.

    Some engines begin with volumes while the last containers still have them: what the first call
    left there the second one takes.
    """
    for _ in range(2):
        project.compose("down", "--remove-orphans", "--volumes", check=False)
