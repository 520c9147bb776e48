"""The system in containers: built by `make images`, brought up by compose, asked from inside."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from containers import Project, running

PROJECT = Project(name="gfm-test")

pytestmark = pytest.mark.containers


@pytest.fixture(scope="module")
def system() -> Iterator[None]:
    with running(PROJECT, actors=4):
        yield


def has_weights(least: int):
    return lambda sums: sums["weights_version"] >= least


@pytest.mark.usefixtures("system")
def test_four_actors_learn_with_everybody_in_a_container_of_its_own():
    sums = PROJECT.asked_until(
        lambda sums: sums["weights_version"] >= 50 and len(sums["processes"]) == 9
    )
    roles = sorted(process["role"] for process in sums["processes"])
    services = ["learner", "replay", "robot", "robot_bridge", "router"]
    assert roles == ["actor"] * 4 + services
    assert len({process["host"] for process in sums["processes"]}) == 9
    assert sums["env_steps"] > sums["replay_sequences"] > 0
    assert sums["rejected_messages"] == 0


@pytest.mark.usefixtures("system")
def test_the_robot_is_driven_and_recorded_from_a_container():
    done = PROJECT.compose("run", "--rm", "-T", "record", "--only", "heldout", "--duration-s", "4")
    # 100 a second by the wall clock; what starts late on a busy machine takes a little longer.
    found = re.search(r"/recordings/heldout_06_position_multisine.mcap: (\d+) meas", done.stdout)
    assert found, done.stdout
    assert int(found[1]) >= 400


@pytest.mark.usefixtures("system")
def test_learning_goes_on_when_replay_was_killed_and_started_again():
    before = PROJECT.asked_until(has_weights(50))
    PROJECT.compose("kill", "-s", "SIGKILL", "replay")
    assert PROJECT.asked()["replay_sequences"] == 0
    PROJECT.compose("start", "replay")
    learned = has_weights(before["weights_version"] + 50)
    after = PROJECT.asked_until(
        lambda sums: learned(sums) and sums["replay_sequences"] >= before["replay_sequences"]
    )
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
    done = PROJECT.compose(
        "run", "--rm", "-T", "--no-deps", "--entrypoint", "python", service, "-c", program
    )
    assert done.stdout.split("\n")[-2] == "[] 10001"
