"""A system of real processes goes on, whichever of them is killed or hangs."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm.core import (
    Command,
    CommandKind,
    MonotonicClock,
    Observation,
    ProcessDiedError,
    RefusedError,
    Status,
    UnreachableError,
)
from gfm.launch import (
    Keeper,
    SupervisionConfig,
    Supervisor,
    actor_processes,
    learner_process,
    own_system,
    replay_process,
    robot_processes,
    router_process,
    statuses,
    summary,
)
from gfm.launch.process import ChildProcess
from gfm.sim.sawyer import JOINT_NAMES
from gfm_wire import Message, Role, StatusRequest

LONGEST_S = 90.0
BEGINS = re.compile("expected 0 to begin a session|a command with number 0 begins again")


class Kept:
    """A system and its keeper, stepped by whoever waits."""

    def __init__(self, supervisor: Supervisor, config: SupervisionConfig) -> None:
        self.supervisor = supervisor
        self._keeper = Keeper(supervisor, config, MonotonicClock())

    def child(self, name: str) -> ChildProcess:
        return next(child for child in self.supervisor.children if child.spec.name == name)

    def step(self) -> None:
        self._keeper.step()
        time.sleep(0.02)

    @property
    def missing(self) -> list[str]:
        return self._keeper.missing

    def until(self, true: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + LONGEST_S
        while not true():
            assert time.monotonic() < deadline_s, f"it never happened; missing: {self.missing}"
            self.step()

    def sums(self) -> dict[str, Any]:
        return summary(statuses(self.supervisor.transport, timeout_s=1.0))

    def progress(self) -> tuple[int, ...]:
        """Returns steps by role: of the actors, of replay, of the learner."""
        sums = self.sums()
        return tuple(sums[name] for name in ("env_steps", "replay_sequences", "learner_steps"))

    def keeper_says(self, name: str) -> Status:
        """Returns what the keeper answers to whoever asks for a process."""
        status = self.asked(Role.WATCHER, f"supervisor/{name}", StatusRequest())
        assert isinstance(status, Status)
        return status

    def asked(self, role: Role, key: str, message: Message) -> Message:
        """Returns the answer to a question of a role, keeping the system meanwhile."""
        with self.supervisor.spec.address.open(role, name="test") as transport:
            pending = transport.request(key, message, timeout_s=10.0)
            while (answer := pending.poll()) is None:
                self.step()
        return answer

    def goes_on(self) -> None:
        """Returns once everybody runs and has made progress from what was there then."""
        count = len(self.supervisor.children)
        self.until(lambda: not self.missing and len(self.sums()["processes"]) == count)
        before = self.progress()
        self.until(lambda: all(a > b for a, b in zip(self.progress(), before, strict=True)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("survival")


@pytest.fixture(scope="module")
def kept(folder) -> Iterator[Kept]:
    env = ("--env", "point_mass")
    learner = ("--checkpoint-dir", str(folder / "learner"), "--checkpoint-period-s", "1")
    processes = (
        router_process(),
        replay_process(("--min-size", "32", "--folder", str(folder / "replay"))),
        learner_process((*env, *learner)),
        *actor_processes(2, 0, (*env, "--max-steps-per-s", "300")),
    )
    system = own_system("survival", folder, processes)
    config = SupervisionConfig(deadline_s={"replay": 4.0}, stop_s=1.0, most_deaths=100)
    with Supervisor(system, folder / "logs") as supervisor:
        supervisor.start()
        kept = Kept(supervisor, config)
        kept.goes_on()
        yield kept


@pytest.mark.slow
@pytest.mark.parametrize("name", ["actor-0", "learner", "replay", "router"])
def test_the_system_goes_on_when_one_is_killed(kept, folder, name):
    pids = {child.spec.name: child.pid for child in kept.supervisor.children}
    os.kill(pids[name], signal.SIGKILL)
    kept.until(lambda: kept.child(name).pid != pids[name])
    kept.goes_on()
    others = {child.spec.name: child.pid for child in kept.supervisor.children}
    assert {who for who, pid in others.items() if pid != pids[who]} == {name}
    assert (folder / "logs" / f"{name}.1.log").is_file()


@pytest.mark.slow
def test_the_learner_goes_on_from_its_checkpoint_and_replay_with_its_sequences(kept):
    enough = kept.sums()["learner_steps"] + 40
    kept.until(lambda: kept.sums()["learner_steps"] > enough)
    before = kept.sums()
    for name in ("learner", "replay"):
        os.kill(kept.child(name).pid, signal.SIGKILL)
    kept.goes_on()
    after = kept.sums()
    assert after["learner_steps"] > enough - 40
    assert after["replay_sequences"] >= before["replay_sequences"]


@pytest.mark.slow
def test_what_hangs_is_told_then_stopped_and_the_system_goes_on(kept):
    hung = kept.child("replay").pid
    os.kill(hung, signal.SIGSTOP)
    kept.until(lambda: bool(kept.missing))
    said = kept.keeper_says("replay")
    assert said.note.startswith("no beat for ")
    assert said.note.endswith("is stopped after 4 s")
    found = statuses(kept.supervisor.transport, timeout_s=0.5)
    assert [status.name for status in found] == ["actor-0", "actor-1", "learner", "router"]
    kept.until(lambda: kept.child("replay").pid != hung)
    kept.goes_on()
    said = kept.keeper_says("replay")
    assert (said.note, said.pid) == ("", kept.child("replay").pid)
    assert said.counters["hangs"] == 1


def rest(number: int) -> Command:
    """Returns a command to stand still, stamped now."""
    return Command(
        kind=CommandKind.VELOCITY,
        joint_names=JOINT_NAMES,
        values=np.zeros(len(JOINT_NAMES)),
        stamp_ns=time.time_ns(),
        number=number,
    )


def refusal(kept: Kept, command: Command) -> str:
    """Returns why a command was not taken; empty where it was."""
    try:
        assert isinstance(kept.asked(Role.DRIVER, "robot/command", command), Observation)
    except (RefusedError, UnreachableError) as error:
        return str(error)
    return ""


@pytest.mark.slow
def test_a_bridge_that_is_started_again_moves_nothing_until_its_driver_begins_again(tmp_path):
    robot = robot_processes(("--recordings", str(tmp_path / "recordings")))
    system = own_system("robot", tmp_path, (router_process(), *robot))
    with Supervisor(system, tmp_path / "logs") as supervisor:
        supervisor.start()
        kept = Kept(supervisor, SupervisionConfig())
        kept.until(lambda: refusal(kept, rest(0)) == "")
        os.kill(kept.child("robot-bridge").pid, signal.SIGKILL)
        kept.until(lambda: bool(kept.missing))
        kept.until(lambda: not kept.missing)
        reasons: list[str] = []
        until_s = time.monotonic() + LONGEST_S
        while time.monotonic() < until_s and not BEGINS.search(" ".join(reasons)):
            reasons.append(refusal(kept, rest(7)))
        assert "" not in reasons
        assert BEGINS.search(reasons[-1])
        kept.until(lambda: refusal(kept, rest(0)) == "")


def test_one_who_dies_too_often_and_is_the_last_of_a_role_ends_the_system(tmp_path):
    processes = (router_process(), replay_process())
    system = own_system("lost", tmp_path, processes)
    with Supervisor(system, tmp_path) as supervisor:
        supervisor.start()
        kept = Kept(supervisor, SupervisionConfig(most_deaths=2, first_pause_s=0.01))
        first = kept.child("replay").pid
        os.kill(first, signal.SIGKILL)
        kept.until(lambda: kept.child("replay").pid != first and not kept.missing)
        os.kill(kept.child("replay").pid, signal.SIGKILL)
        with pytest.raises(ProcessDiedError, match="replay ended with status -9"):
            kept.until(lambda: False)
    assert (tmp_path / "replay.1.log").is_file()
