"""A control task goes round through actor, replay and learner, and gets harder on the way."""

import numpy as np

from gfm.core import MonotonicClock
from gfm.envs.control_settings import ControlSettings, Curriculum
from gfm.envs.registry import EnvironmentSettings, make_environment
from gfm.rl.learner_state import LearnerSettings
from gfm.service.metrics import NoMetrics
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.__main__ import build
from gfm_actor.config import ActorConfig
from gfm_learner.checkpoint import begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService

NAME, STAGE, STEPS = "position_matching", 4, 32
CURRICULUM = Curriculum(gains=(6.0, 1.0), stage_steps=STAGE)
ENVIRONMENT = EnvironmentSettings(horizon=16, control=ControlSettings(curriculum=CURRICULUM))
LEARNING = LearnerSettings(
    policy_hidden=(16, 16), critic_hidden=(16, 16), samples=2, target_period=2, normaliser_steps=0
)


def test_position_matching_goes_round_and_its_gain_comes_down():
    clock, hub = MonotonicClock(), MemoryHub()
    replay = ReplayService(
        ReplayConfig(name="replay", min_size=8, max_samples_per_insert=4.0),
        MemoryTransport(hub, name="replay"),
        clock,
        np.random.default_rng(0),
    )
    spec = make_environment(NAME, ENVIRONMENT, num_envs=1, seed=0).spec
    config = LearnerConfig(
        name="learner", env=NAME, environment=ENVIRONMENT, learning=LEARNING, batch_size=4
    )
    learner = LearnerService(
        config, begin(config, spec), MemoryTransport(hub, name="learner"), clock, NoMetrics()
    )
    acting = ActorConfig(
        name="actor", env=NAME, environment=ENVIRONMENT, num_envs=4, sequence_length=8
    )
    actor = build(acting, MemoryTransport(hub, name="actor"), clock)
    gains = []
    while learner.status().counters["learner_steps"] < STEPS:
        for service in (actor, replay, learner):
            service.step()
        gains.append(actor.status().gauges["curriculum_gain"])
    assert gains[0] == 6.0
    assert gains[-1] == 1.0
    assert sorted(gains, reverse=True) == gains
    status = actor.status()
    assert 0.0 <= status.gauges["success_rate"] <= 1.0
    assert status.counters["lost_steps"] == 0
    assert status.counters["unusable_steps"] == 0
