"""Actor, replay and learner in one thread over the in-memory transport: the loop learns."""

import numpy as np
import pytest

from gfm.core import MonotonicClock
from gfm.envs.point_mass import PointMass
from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner_state import LearnerSettings
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.metrics import NoMetrics
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.config import ActorConfig
from gfm_actor.service import ActorService
from gfm_learner.checkpoint import begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService

STEPS = 250
LEARNING = LearnerSettings(
    policy_hidden=(32, 32),
    critic_hidden=(32, 32),
    samples=8,
    discount=0.9,
    target_period=10,
    initial_log_temperature=0.0,
    initial_stddev=0.5,
    critic_first_steps=0,
    policy_learning_rate=3e-3,
    critic_learning_rate=3e-3,
)


class Loop:
    """The three services, stepped in turn."""

    def __init__(self, priority_exponent):
        clock, hub = MonotonicClock(), MemoryHub()
        env = PointMass(16, seed=1)
        config = LearnerConfig(name="learner", learning=LEARNING, max_steps=STEPS)
        acting = ActorConfig(name="actor", num_envs=16, environment=EnvironmentSettings(horizon=20))
        self.replay = ReplayService(
            ReplayConfig(name="replay", min_size=32, priority_exponent=priority_exponent),
            MemoryTransport(hub, name="replay"),
            clock,
            np.random.default_rng(0),
        )
        self.learner = LearnerService(
            config,
            begin(config, env.spec),
            MemoryTransport(hub, name="learner"),
            clock,
            NoMetrics(),
        )
        self.actor = ActorService(
            acting, env, MemoryTransport(hub, name="actor"), clock, np.random.default_rng(0)
        )

    def run(self):
        while self.learner.status().counters["learner_steps"] < STEPS:
            for service in (self.actor, self.replay, self.learner):
                service.step()


def mean_return(weights):
    """Returns what the mean action earns in 20 steps from 200 starts."""
    env = PointMass(200, seed=99)
    policy, observation = GaussianPolicy.from_weights(weights), env.reset()
    total = np.zeros(200)
    for _ in range(20):
        transition = env.step(policy.mean_action(observation))
        observation = transition.observation
        total += transition.reward
    return total.mean()


@pytest.mark.parametrize("priority_exponent", [0.0, 0.6], ids=["uniform", "prioritised"])
def test_the_loop_learns_and_weights_flow_all_the_way_round(priority_exponent):
    loop = Loop(priority_exponent)
    before = mean_return(loop.learner.weights)
    loop.run()
    loop.actor.close()  # takes in the last acknowledgements
    after = mean_return(loop.learner.weights)
    assert before < 14.6
    assert after > 15.6  # the best linear feedback reaches 16.4
    actor, learner = loop.actor.status(), loop.learner.status()
    assert learner.gauges["weights_version"] == STEPS
    assert actor.gauges["weights_version"] >= STEPS - LEARNING.target_period
    assert learner.gauges["staleness_mean_steps"] > 0.0
    assert loop.replay.status().counters["replay_sequences"] == actor.counters["sequences_acked"]
    assert actor.counters["sequences_refused"] == actor.counters["lost_steps"] == 0
