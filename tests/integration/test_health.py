"""Whether a service is well: it answers for itself, and nobody else for it."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import pytest

from gfm.launch import (
    ProcessSpec,
    Supervisor,
    SystemSpec,
    free_endpoint,
    replay_process,
    router_process,
)
from gfm.launch.health import UnhealthyError, health, main

HOST = socket.gethostname()


def make_system(folder: Path) -> SystemSpec:
    bridge = ProcessSpec(
        role="robot_bridge",
        name="bridge",
        module="gfm_robot_bridge",
        arguments=("--robot", "mirror", "--recordings", str(folder / "recordings")),
    )
    return SystemSpec(
        run="health",
        endpoint=free_endpoint(),
        processes=(router_process(), replay_process(), bridge),
    )


def test_a_service_is_well_only_while_it_answers_itself(tmp_path, capsys):
    with Supervisor(make_system(tmp_path), tmp_path) as supervisor:
        supervisor.start()
        joining = ("--connect", supervisor.spec.endpoint, "--run", "health", "--timeout-s", "0.5")
        assert main(["robot_bridge", *joining]) == 0
        assert capsys.readouterr().out.startswith("bridge: ")
        with pytest.raises(UnhealthyError, match="no replay of host elsewhere answered within 0"):
            health(supervisor.transport, "replay", host="elsewhere", timeout_s=0.5)
        bridge = next(child for child in supervisor.children if child.spec.name == "bridge")
        os.kill(bridge.pid, signal.SIGSTOP)
        try:
            assert main(["robot_bridge", *joining]) == 1
            assert main(["replay", *joining]) == 0
        finally:
            os.kill(bridge.pid, signal.SIGCONT)
        assert capsys.readouterr().err == (
            f"error: no robot_bridge of host {HOST} answered within 0.5 s\n"
        )


def test_without_a_router_nothing_is_well(capsys):
    assert main(["replay", "--connect", free_endpoint(), "--timeout-s", "0.3"]) == 1
    assert "error: " in capsys.readouterr().err
