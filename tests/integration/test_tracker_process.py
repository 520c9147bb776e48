"""A tracker, a router and a bridge as processes: poses arrive, and none outlives its tracker."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2")

from gfm.core import Command, CommandKind, MonotonicClock, Observation, RefusedError
from gfm.launch import Supervisor, own_system, router_process
from gfm.launch.spec import ProcessSpec
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import Transport, ask
from gfm_wire import Role
from projected_tracker import LIES

#: A machine that is busy with other things is not what this is about.
PATIENT = "watchdog_periods = 100\ncommand_age_s = 5.0\nreport_age_s = 5.0\n"
OLDEST_S = 0.5


def eventually(true: Callable[[], bool], what: str) -> None:
    deadline_s = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


def stand(transport: Transport, number: int) -> None:
    """Commands an arm to stand, for where the object is."""
    clock = MonotonicClock()
    command = Command(
        kind=CommandKind.VELOCITY,
        joint_names=JOINT_NAMES,
        values=np.zeros(len(JOINT_NAMES)),
        stamp_ns=clock.utc_ns(),
        number=number,
        needs_object=True,
    )
    answer = ask(transport, "robot/command", command, timeout_s=10.0, clock=clock)
    assert isinstance(answer, Observation)


def test_a_killed_tracker_leaves_no_pose_and_stops_who_needs_one(tmp_path: Path) -> None:
    settings = tmp_path / "bridge.toml"
    settings.write_text(PATIENT)
    words = ("--robot", "mirror", "--config", str(settings), "--recordings", str(tmp_path))
    bridge = ProcessSpec(
        role="robot_bridge", name="bridge", module="gfm_robot_bridge", arguments=words
    )
    system = own_system("tracked", tmp_path, (router_process(), bridge))
    with Supervisor(system, tmp_path / "logs") as supervisor:
        supervisor.start()
        script = Path(__file__).parents[1] / "projected_tracker.py"
        tracker = subprocess.Popen(
            [sys.executable, str(script), system.endpoint, system.run, system.certs]
        )
        with system.address.open(Role.DRIVER, name="test") as driver:
            observations = driver.subscribe("robot/observation")
            seen: list[Observation] = []

            def sees() -> bool:
                newest = observations.latest()
                if isinstance(newest, Observation):
                    seen.append(newest)
                return bool(seen) and seen[-1].object_position is not None

            try:
                eventually(sees, "a pose arrives")
                stand(driver, 0)
            finally:
                tracker.kill()
                tracker.wait()
            with_pose = [one for one in seen if one.object_position is not None]
            assert np.abs(with_pose[-1].object_position - LIES[:3]).max() < 0.01
            eventually(lambda: not sees(), "the pose is gone")
            ages_s = [
                1e-9 * (one.stamp_ns - one.object_stamp_ns)
                for one in seen
                if one.object_position is not None
            ]
            assert max(ages_s) <= OLDEST_S
            with pytest.raises(RefusedError, match=r"object: its pose is \d+ ms old"):
                stand(driver, 1)
