"""`gfm watch` beside a router and a bridge as processes, by certificates."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("foxglove")
pytest.importorskip("websockets")

from foxglove_viewer import Foxglove
from gfm.launch import Supervisor, own_system, router_process
from gfm.launch.spec import ProcessSpec

STATES = "/joint_states"


def sees_the_robot(viewer: Foxglove) -> None:
    viewer.subscribe(STATES)
    stamps = []
    while len(stamps) < 10:
        one = viewer.received(60.0)
        assert one is not None
        stamps.append(one[1])
    assert stamps == sorted(set(stamps))
    viewer.leave()


def test_a_viewer_sees_the_robot_of_a_running_system(tmp_path: Path) -> None:
    words = ("--robot", "mirror", "--recordings", str(tmp_path))
    bridge = ProcessSpec(
        role="robot_bridge", name="bridge", module="gfm_robot_bridge", arguments=words
    )
    system = own_system("watched", tmp_path, (router_process(), bridge))
    with Supervisor(system, tmp_path / "logs") as supervisor:
        supervisor.start()
        flags = ("--foxglove", "127.0.0.1:0", "--wait-s", "60", *system.address.flags)
        command = (sys.executable, "-m", "gfm.cli", "watch", *flags)
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as watch:
            try:
                assert watch.stderr is not None
                said = next(line for line in watch.stderr if "ws://" in line)
                port = re.search(r"ws://127\.0\.0\.1:(\d+)$", said.strip())
                assert port is not None
                sees_the_robot(Foxglove(int(port[1])))
                watch.send_signal(signal.SIGINT)
                assert watch.wait(30.0) == 0
                assert re.search(r"\d+ periods shown, \d+ lost", watch.stderr.read())
            finally:
                watch.kill()
