"""Processes really start, answer, die, are noticed, and leave nothing behind."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gfm.core import BadInputError, ProcessDiedError, UnreachableError
from gfm.launch import (
    ProcessSpec,
    Supervisor,
    SystemSpec,
    own_system,
    replay_process,
    router_process,
    statuses,
)
from gfm.launch.process import ChildProcess
from gfm_wire import Role, StatusRequest


def make_system(folder: Path, *arguments: str) -> SystemSpec:
    return own_system("launch", folder, (router_process(), replay_process(arguments)))


def replay_of(supervisor: Supervisor) -> ChildProcess:
    return next(child for child in supervisor.children if child.spec.name == "replay")


def eventually(true: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < deadline_s, "it never happened"


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_system_answers_once_started_and_is_gone_once_stopped(tmp_path):
    with Supervisor(make_system(tmp_path), tmp_path) as supervisor:
        supervisor.start()
        found = statuses(supervisor.transport)
        assert [(status.role, status.pid) for status in found] == [
            (child.spec.role, child.pid)
            for child in sorted(supervisor.children, key=lambda child: child.spec.role)
        ]
    assert not any(is_running(status.pid) for status in found)
    assert "INFO gfm.service.command: stopped" in (tmp_path / "replay.log").read_text()


def test_a_child_that_dies_is_reported_with_its_last_words(tmp_path):
    with Supervisor(make_system(tmp_path), tmp_path) as supervisor:
        supervisor.start()
        pid = replay_of(supervisor).pid
        os.kill(pid, signal.SIGKILL)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(ProcessDiedError, match="replay ended with status -9; log: ") as caught:
            supervisor.check()
    assert "gfm.service.command: running" in str(caught.value)


def test_a_child_that_refuses_its_settings_makes_the_start_bad_input(tmp_path):
    with (
        Supervisor(make_system(tmp_path, "--min-size", "0"), tmp_path) as supervisor,
        pytest.raises(BadInputError, match=r"^replay: min_size is 0, expected at least 1$"),
    ):
        supervisor.start()


def test_a_child_that_never_answers_is_given_up_at_the_deadline(tmp_path):
    mute = ProcessSpec(role="actor", name="mute", module="tests_have_no_such_module")
    system = own_system("launch", tmp_path, (router_process(), mute))
    with (
        Supervisor(system, tmp_path, start_timeout_s=0.0) as supervisor,
        pytest.raises(UnreachableError, match="no answer from the hub"),
    ):
        supervisor.start()


def test_a_child_that_does_not_stop_is_killed(tmp_path):
    with Supervisor(make_system(tmp_path), tmp_path, stop_timeout_s=0.2) as supervisor:
        supervisor.start()
        pid = replay_of(supervisor).pid
        os.kill(pid, signal.SIGSTOP)
    assert not is_running(pid)


def test_children_do_not_outlive_a_parent_that_is_killed(tmp_path):
    script = (
        "import sys, time; from pathlib import Path; from gfm.launch import *\n"
        "folder = Path(sys.argv[1]); spec = own_system('r', folder, (router_process(),))\n"
        "supervisor = Supervisor(spec, folder); supervisor.start()\n"
        "print(supervisor.children[0].pid, flush=True); time.sleep(60)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    with parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert is_running(child)
        parent.kill()
    eventually(lambda: not is_running(child))
    assert "SIGTERM: stopping" in (tmp_path / "router.log").read_text()


def test_the_router_counts_what_it_does_not_let_through(tmp_path):
    system = make_system(tmp_path)

    def dropped() -> int:
        found = statuses(supervisor.transport)
        return next(one.counters["dropped_messages"] for one in found if one.role == "router")

    with Supervisor(system, tmp_path) as supervisor:
        supervisor.start()
        assert dropped() == 0
        with system.address.open(Role.WATCHER, name="test") as watcher:
            published = itertools.count(1)

            def counted() -> bool:  # on a busy machine a broadcast may be lost on its way
                watcher.publish("weights", StatusRequest())
                next(published)
                return dropped() >= 5

            eventually(counted)
        assert 5 <= dropped() < next(published)
