"""All services as processes of this machine: drive, record, fit, and leave nothing behind."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import Command, CommandKind, MonotonicClock
from gfm.launch import (
    LOCKSTEP,
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
from gfm.recording import read_recording
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import Transport, ask
from gfm_wire import Message, RecordDone, RecordStart, RecordStop, Role

MODELS = Path(__file__).parents[2] / "models"
PERIOD_S = 0.02
TICKS = 150


def asked(transport: Transport, key: str, message: Message) -> Message:
    return ask(transport, key, message, timeout_s=10.0, clock=MonotonicClock())


def record_a_motion(transport: Transport) -> Path:
    """Drives every joint of the robot back and forth once; returns the recording."""
    asked(transport, "robot/record", RecordStart(name="motion", metadata={"kind": "sine"}))
    for tick in range(TICKS):
        phase = 2.0 * np.pi * tick / TICKS
        asked(
            transport,
            "robot/command",
            Command(
                kind=CommandKind.VELOCITY,
                joint_names=JOINT_NAMES,
                values=np.full(len(JOINT_NAMES), 0.2 * np.sin(phase)),
                stamp_ns=round(tick * PERIOD_S * 1e9),
                number=tick,
            ),
        )
    done = asked(transport, "robot/record", RecordStop())
    assert isinstance(done, RecordDone)
    assert done.ticks >= TICKS - 1
    return Path(done.path)


def wait_until(true: Callable[[dict[str, Any]], bool], supervisor: Supervisor) -> dict[str, Any]:
    """Returns the system's sums as soon as `true` says so of them; fails after a minute."""
    deadline_s = time.monotonic() + 60.0
    while not true(sums := summary(statuses(supervisor.transport))):
        supervisor.check()
        assert time.monotonic() < deadline_s, sums
        time.sleep(0.1)
    return sums


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_whole_system_drives_records_and_fits_on_this_machine(tmp_path):
    processes = (
        router_process(),
        replay_process(("--min-size", "32")),
        *robot_processes(("--recordings", str(tmp_path / "recordings"), *LOCKSTEP), LOCKSTEP),
    )
    system = own_system("system", tmp_path, processes)
    with Supervisor(system, tmp_path / "logs") as supervisor:
        supervisor.start()
        with system.address.open(Role.DRIVER, name="test") as driver:
            recording = record_a_motion(driver)
        model = f"velocity={MODELS / 'sawyer_velocity.xml'}"
        env = ("--env", "gfm_fit", "--recording", str(recording), "--model", model)
        supervisor.add(
            learner_process((*env, "--checkpoint-dir", str(tmp_path / "checkpoints"))),
            *actor_processes(2, 0, (*env, "--max-steps-per-s", "500")),
        )
        sums = wait_until(
            lambda sums: sums["weights_version"] >= 25 and oldest_policy(sums) > 0, supervisor
        )
        pids = [process["pid"] for process in sums["processes"]]
    check_sums(sums)
    assert not any(is_running(pid) for pid in pids)
    assert all("stopped" in log.read_text() for log in (tmp_path / "logs").glob("*.log"))
    assert list((tmp_path / "checkpoints").iterdir())
    trajectory = read_recording(recording)
    assert trajectory.joint_names == JOINT_NAMES
    assert np.ptp(trajectory.position, axis=0).min() > 0.05


def oldest_policy(sums: dict[str, Any]) -> float:
    """Returns the version of the oldest policy that an actor acts with."""
    return min(
        service["gauges"]["weights_version"]
        for service in sums["services"]
        if service["role"] == "actor"
    )


def check_sums(sums: dict[str, Any]) -> None:
    roles = sorted(process["role"] for process in sums["processes"])
    assert roles == ["actor", "actor", "learner", "replay", "robot", "robot_bridge", "router"]
    assert sums["actors"] == 2
    assert sums["env_steps"] > sums["replay_sequences"] > 32
    assert sums["learner_steps"] >= sums["weights_version"] >= 25
    assert sums["rejected_messages"] == 0
