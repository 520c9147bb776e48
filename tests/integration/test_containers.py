"""The system in containers: built by `make images`, brought up by compose, asked from inside."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = "gfm-test"

pytestmark = pytest.mark.containers


def compose(*arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Returns what `compose` did, as a project apart from any that runs here."""
    engine = shlex.split(os.environ.get("CONTAINER_ENGINE", "docker"))
    file = str(ROOT / "docker" / "compose.yaml")
    return subprocess.run(
        [*engine, "compose", "--profile", "commands", "-p", PROJECT, "-f", file, *arguments],
        check=check,
        capture_output=True,
        text=True,
        timeout=300.0,
        cwd=ROOT,
    )


@pytest.fixture(scope="module")
def system() -> Iterator[None]:
    """Brings up the system with four actors; nothing of it is left afterwards."""
    services = ("router", "replay", "learner", "actor", "robot", "robot_bridge")
    try:
        compose("up", "-d", "--scale", "actor=4", *services)
        yield
    finally:
        compose("down", "--remove-orphans", "--volumes", check=False)


def asked() -> dict[str, Any]:
    """Returns what the system says of itself; empty while nobody answers."""
    done = compose("run", "--rm", "-T", "status", "--json", check=False)
    return dict(json.loads(done.stdout)) if done.returncode == 0 else {}


def asked_until(name: str, least: int) -> dict[str, Any]:
    deadline_s = time.monotonic() + 180.0
    while (sums := asked()).get(name, 0) < least:
        assert time.monotonic() < deadline_s, sums
    return sums


@pytest.mark.usefixtures("system")
def test_four_actors_learn_with_everybody_in_a_container_of_its_own():
    sums = asked_until("weights_version", 50)
    roles = sorted(process["role"] for process in sums["processes"])
    services = ["learner", "replay", "robot", "robot_bridge", "router"]
    assert roles == ["actor"] * 4 + services
    assert len({process["host"] for process in sums["processes"]}) == 9
    assert sums["env_steps"] > sums["replay_sequences"] > 0
    assert sums["rejected_messages"] == 0


@pytest.mark.usefixtures("system")
def test_the_robot_is_driven_and_recorded_from_a_container():
    done = compose("run", "--rm", "-T", "record", "--only", "heldout", "--duration-s", "4")
    assert "/recordings/heldout_06_position_multisine.mcap: 400 measurements" in done.stdout


@pytest.mark.usefixtures("system")
def test_learning_goes_on_when_replay_was_killed_and_started_again():
    asked_until("weights_version", 50)
    compose("kill", "-s", "SIGKILL", "replay")
    before = asked()
    assert before["replay_sequences"] == 0
    compose("start", "replay")
    after = asked_until("weights_version", before["weights_version"] + 50)
    assert after["actors"] == 4
    assert after["rejected_messages"] == 0


@pytest.mark.parametrize(
    ("service", "absent"),
    [("replay", "torch mujoco scipy mcap"), ("robot_bridge", "torch"), ("actor", "torch")],
)
def test_an_image_holds_only_what_its_service_needs(service, absent):
    program = (
        "import importlib.util, os\n"
        f"found = [name for name in {absent.split()} if importlib.util.find_spec(name)]\n"
        "print(found, os.getuid())"
    )
    done = compose(
        "run", "--rm", "-T", "--no-deps", "--entrypoint", "python", service, "-c", program
    )
    assert done.stdout.split("\n")[-2] == "[] 10001"
