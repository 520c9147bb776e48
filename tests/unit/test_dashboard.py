"""The Grafana dashboard asks for numbers that `gfm metrics` serves, and for no others."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from prometheus_client.core import Metric

import gfm_actor.__main__
import gfm_learner.__main__
import gfm_replay.__main__
from gfm.core import ManualClock, Status
from gfm.envs.registry import EnvironmentSettings
from gfm.launch.prometheus import families
from gfm.rl.learner_state import LearnerSettings
from gfm.service import RunningService
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig
from gfm_robot_bridge.pilot import _COUNTERS
from gfm_robot_bridge.timing import Timing

ROOT = Path(__file__).resolve().parents[2]
DASHBOARD = json.loads((ROOT / "docker" / "grafana" / "dashboard.json").read_text())
NAME = re.compile(r"\bgfm_[a-z0-9_]+")


def told_by_a_system_that_learns() -> list[Status]:
    hub, clock = MemoryHub(), ManualClock(10**18)
    common = {"env": "point_mass", "environment": EnvironmentSettings(horizon=10)}
    small = LearnerSettings(policy_hidden=(4,), critic_hidden=(4,), samples=2, target_period=2)
    running = []
    for build, config in (
        (gfm_replay.__main__.build, ReplayConfig(name="replay", min_size=8, capacity_mib=1)),
        (
            gfm_learner.__main__.build,
            LearnerConfig(name="learner", batch_size=8, learning=small, metrics_every=1, **common),
        ),
        (gfm_actor.__main__.build, ActorConfig(name="actor", num_envs=4, seed=0, **common)),
    ):
        transport = MemoryTransport(hub, name=config.name, clock=clock)
        running.append(RunningService(build(config, transport, clock), transport))
    for _ in range(300):
        for one in running:
            one.step()
        clock.advance_s(0.01)
    return [one.status() for one in running]


@pytest.fixture(scope="module")
def served() -> set[str]:
    """Names of all samples."""
    bridge = Status(
        role="robot_bridge",
        name="b",
        pid=1,
        host="h",
        counters=dict.fromkeys((*_COUNTERS, "overruns"), 0),
        gauges=Timing().gauges(),
    )
    refusing = Status(role="replay", name="r", pid=1, host="h", counters={"refused_from_a": 1})
    made: list[Metric] = families([*told_by_a_system_that_learns(), bridge, refusing], ())
    return {sample.name for family in made for sample in family.samples} | {"gfm_up"}


def test_every_name_that_it_asks_for_is_served(served):
    asked = {
        name
        for panel in DASHBOARD["panels"]
        for target in panel["targets"]
        for name in NAME.findall(target["expr"])
    }
    assert len(asked) > 10
    assert asked <= served, asked - served


def test_panels_are_apart_and_have_a_title_and_the_chosen_source():
    ids = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(set(ids)) == len(ids)
    covered: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert not cells & covered, panel["title"]
        assert place["x"] + place["w"] <= 24
        covered |= cells
        assert panel["title"]
        assert panel["datasource"]["uid"] == "${source}"


def test_what_only_grows_is_shown_as_a_rate():
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            assert ("_total" in target["expr"]) == target["expr"].startswith("rate(")
