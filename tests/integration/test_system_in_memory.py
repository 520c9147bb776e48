"""The real services in one thread over the in-memory transport, stepped in turn."""

from __future__ import annotations

import numpy as np
import pytest

import gfm_actor.__main__
import gfm_learner.__main__
import gfm_replay.__main__
from gfm.core import Command, CommandKind, ManualClock, Observation, Status
from gfm.envs.registry import EnvironmentSettings
from gfm.service import RunningService, Service
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig
from gfm_robot_bridge import __main__ as bridge_command
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated import __main__ as robot_command
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import RobotClock

ENVIRONMENT = EnvironmentSettings(horizon=10)


class System:
    """Services that share a hub and a clock."""

    def __init__(self) -> None:
        self.hub, self.clock = MemoryHub(), ManualClock()
        self._running: dict[str, RunningService] = {}

    def connect(self) -> MemoryTransport:
        return MemoryTransport(self.hub, clock=self.clock)

    def add(self, build, config) -> None:
        transport = self.connect()
        service: Service = build(config, transport, self.clock)
        self._running[config.name] = RunningService(service, transport)

    def step(self) -> None:
        for running in self._running.values():
            running.step()
        self.clock.advance_s(0.001)

    def status(self, name: str) -> Status:
        return self._running[name].status()


@pytest.fixture
def learning() -> System:
    system = System()
    system.add(gfm_replay.__main__.build, ReplayConfig(name="replay", min_size=16))
    learner = LearnerConfig(
        name="learner", env="point_mass", environment=ENVIRONMENT, batch_size=8, max_steps=25
    )
    system.add(gfm_learner.__main__.build, learner)
    for i in range(2):
        actor = ActorConfig(
            name=f"actor-{i}", env="point_mass", environment=ENVIRONMENT, num_envs=4, seed=i
        )
        system.add(gfm_actor.__main__.build, actor)
    return system


def test_sequences_batches_and_weights_go_all_the_way_round(learning):
    actors = [f"actor-{i}" for i in range(2)]
    for _ in range(400):
        learning.step()
        if min(learning.status(name).gauges["weights_version"] for name in actors) > 0:
            break
    replay, learner = learning.status("replay"), learning.status("learner")
    assert learner.counters["learner_steps"] == 25
    assert [learning.status(name).gauges["weights_version"] for name in actors] == [25, 25]
    acked = sum(learning.status(name).counters["sequences_acked"] for name in actors)
    assert replay.counters["replay_sequences"] >= acked > 16
    assert replay.counters["batches"] >= 25
    for name in ("replay", "learner", *actors):
        assert learning.status(name).counters["rejected_messages"] == 0


def test_a_command_goes_through_the_bridge_to_the_robot_and_its_effect_comes_back(tmp_path):
    system = System()
    system.add(robot_command.build, SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP))
    bridge = BridgeConfig(name="bridge", recordings=str(tmp_path), clock=RobotClock.LOCKSTEP)
    system.add(bridge_command.build, bridge)
    asking = system.connect()
    positions = []
    for number in range(20):
        command = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINT_NAMES,
            values=np.full(len(JOINT_NAMES), 0.1),
            stamp_ns=system.clock.utc_ns(),
            number=number,
        )
        pending = asking.request("robot/command", command, timeout_s=5.0)
        while (observation := pending.poll()) is None:
            system.step()
        assert isinstance(observation, Observation)
        positions.append(observation.position)
    moved = positions[-1] - positions[0]
    assert np.all(moved > 0.01)
