"""Eight actors in containers that are killed, frozen and cut off: nothing is lost or doubled.

The actors note what replay acknowledged; in the end that is laid beside what replay kept.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from containers import PATIENCE_S, ROOT, Project, running

ACTORS = 8
AWAY_S = 8.0
WHOLE = ("router", "replay", "learner", "actor")

pytestmark = pytest.mark.containers


@pytest.fixture(scope="module")
def system(tmp_path_factory) -> Iterator[Project]:
    """Yields a system that learns, and whose actors keep ledgers."""
    settings = tmp_path_factory.mktemp("settings")
    for path in (ROOT / "docker" / "settings" / "point_mass").iterdir():
        text = path.read_text()
        more = 'ledger = "/ledgers"\n' if path.name == "actor.toml" else ""
        (settings / path.name).write_text(text.replace("= 200.0", "= 50.0") + more)
    settings.chmod(0o755)
    project = Project(name="gfm-faults", settings={"GFM_SETTINGS": str(settings)})
    with running(project, ACTORS, WHOLE):
        goes_on(project)
        yield project


def goes_on(project: Project) -> None:
    """Returns once all eleven answer and all have made progress from there."""
    count = ACTORS + len(WHOLE) - 1
    before = project.asked_until(lambda sums: len(sums["processes"]) == count)
    names = ("env_steps", "replay_sequences", "learner_steps")
    project.asked_until(
        lambda sums: len(sums["processes"]) == count and all(sums[n] > before[n] for n in names)
    )


def kill(project: Project, container: str) -> None:
    """Kills the service below the container's init, as this machine sees it: that takes its rights.

    Who is killed by the engine counts as stopped, and is not started again.
    """
    init = project.engine("inspect", "--format", "{{.State.Pid}}", container).strip()
    children = Path(f"/proc/{init}/task/{init}/children").read_text(encoding="ascii")
    for child in children.split():
        os.kill(int(child), signal.SIGKILL)
    deadline_s = time.monotonic() + PATIENCE_S
    while Path(f"/proc/{init}").exists() or state(project, container) != "running":
        assert time.monotonic() < deadline_s, "not started again"
        time.sleep(0.2)


def state(project: Project, container: str) -> str:
    """Returns the engine's word for how a container is."""
    return project.engine("inspect", "--format", "{{.State.Status}}", container).strip()


@pytest.mark.parametrize("service", WHOLE)
def test_the_system_goes_on_when_a_container_s_service_is_killed(system, service):
    kill(system, system.containers(service)[0])
    goes_on(system)


@pytest.mark.parametrize("service", WHOLE)
def test_the_system_goes_on_when_a_container_was_frozen(system, service):
    container = system.containers(service)[-1]
    system.engine("pause", container)
    try:
        time.sleep(AWAY_S)
    finally:
        system.engine("unpause", container)
    goes_on(system)


@pytest.mark.parametrize("service", WHOLE)
def test_the_system_goes_on_when_a_container_was_cut_off(system, service):
    container, network = system.containers(service)[-1], f"{system.name}_system"
    system.engine("network", "disconnect", network, container)
    try:
        time.sleep(AWAY_S)
    finally:
        system.engine("network", "connect", "--alias", service, network, container)
    goes_on(system)


def test_all_that_was_acknowledged_is_there_once_whatever_happened(system):
    system.engine("stop", *system.containers("actor"), *system.containers("replay"))
    folders = ("--folder", "/replay/point_mass", "--ledgers", "/ledgers")
    words = ("run", "--rm", "-T", "--no-deps", "--entrypoint", "python", "replay")
    done = system.compose(*words, "-m", "gfm_replay.audit", *folders, check=False)
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["lives"] >= ACTORS
    assert found["acknowledged"] > 1000
    wrong = {name: found[name] for name in ("evicted", "lost", "doubled", "changed")}
    assert wrong == {"evicted": 0, "lost": 0, "doubled": 0, "changed": 0}
