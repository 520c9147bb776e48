"""An interrupted run against one that was not: learner and replay stop together and go on."""

import numpy as np

from gfm.core import EnvironmentSpec, ManualClock, Sequence
from gfm.rl.learner_state import LearnerSettings, state_arrays
from gfm.service.metrics import NoMetrics
from gfm.transport import MemoryHub, MemoryTransport
from gfm_learner.checkpoint import begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService

SPEC = EnvironmentSpec(name="test", observation_size=3, action_size=2)
LEARNING = LearnerSettings(
    policy_hidden=(8, 8), critic_hidden=(8, 8), target_period=3, critic_first_steps=5
)


def sequence(number):
    rng = np.random.default_rng(number)

    def draw(*shape):
        return rng.standard_normal(shape, dtype=np.float32)

    return Sequence(
        actor="actor",
        epoch=1,
        number=number,
        weights_life=1,
        weights_version=0,
        spec_digest=SPEC.digest,
        observation=draw(5, 3),
        action=draw(4, 2),
        reward=draw(4),
        discount=np.ones(4, np.float32),
        log_prob=draw(4),
    )


class System:
    """A learner and its replay, both keeping what they have in `folder`."""

    def __init__(self, folder):
        hub, self.clock = MemoryHub(), ManualClock(10**9)
        clock = self.clock
        self.replay = ReplayService(
            ReplayConfig(name="replay", min_size=8, folder=str(folder / "replay")),
            MemoryTransport(hub, name="replay", clock=clock),
            clock,
            np.random.default_rng(0),
        )
        config = LearnerConfig(
            name="learner",
            learning=LEARNING,
            batch_size=4,
            prefetch=1,
            checkpoint_dir=str(folder / "learner"),
        )
        self.learner = LearnerService(
            config,
            begin(config, SPEC),
            MemoryTransport(hub, name="learner", clock=clock),
            clock,
            NoMetrics(),
        )
        self.actor = MemoryTransport(hub, name="actor", clock=clock)
        self.replay.step()  # asks what the run learns for
        self.learner.step()

    def insert(self, numbers):
        for number in numbers:
            self.actor.request("replay/insert", sequence(number), timeout_s=5.0)
            self.replay.step()

    def learn(self, until):
        while True:
            self.learner.step()
            if self.learner.status().counters["learner_steps"] == until:
                return
            self.replay.step()
            self.clock.advance_s(0.05)

    def stop(self):
        for service in (self.learner, self.replay):
            service.close()


def test_an_interrupted_run_ends_with_the_very_networks_of_one_that_was_not(tmp_path):
    always, first = System(tmp_path / "always"), System(tmp_path / "broken")
    for system in (always, first):
        system.insert(range(20))
        system.learn(7)
    first.stop()
    again = System(tmp_path / "broken")
    for system in (always, again):
        system.learn(15)
    ours, theirs = (state_arrays(s.learner._progress.state) for s in (always, again))
    assert ours.keys() == theirs.keys()
    for name, array in ours.items():
        np.testing.assert_array_equal(array, theirs[name], err_msg=name)
