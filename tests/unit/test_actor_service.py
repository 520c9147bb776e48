"""The actor service: when it acts, when it waits, and what it never sends."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import ConfigError, EnvironmentSpec, ManualClock, Weights
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.envs.point_mass import PointMass
from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner_state import LearnerSettings, init_learner, policy_tensors
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.__main__ import main
from gfm_actor.config import ActorConfig
from gfm_actor.service import ActorService
from gfm_wire import SequenceAck

T, HORIZON = 5, 10


def config(**changes):
    settings = {
        "name": "actor",
        "env": "point_mass",
        "environment": EnvironmentSettings(horizon=HORIZON),
        "num_envs": 2,
        "sequence_length": T,
        "window": 8,
        "max_weights_age_s": 10.0,
    }
    return ActorConfig(**(settings | changes))


class Bench:
    """An actor, and someone who answers as learner and replay."""

    def __init__(self, env=None, **changes):
        self.clock = ManualClock(10**9)
        self.config = config(**changes)
        self.env = env or PointMass(2, horizon=HORIZON)
        hub = MemoryHub()
        self.other = MemoryTransport(hub, name="other", clock=self.clock)
        self.inserts = self.other.serve("replay/insert")
        self.asked = self.other.serve("weights/current")
        self.weights = None
        self.received = []
        self.actor = ActorService(
            self.config,
            self.env,
            MemoryTransport(hub, name="actor", clock=self.clock),
            self.clock,
            np.random.default_rng(0),
        )

    def publish(self, version=0):
        settings = LearnerSettings(policy_hidden=(4,), critic_hidden=(4,), initial_stddev=0.5)
        self.tensors = policy_tensors(init_learner(self.env.spec, settings, version))
        self.weights = Weights(
            version=version,
            created_ns=0,
            spec_digest=self.env.spec.digest,
            tensors=self.tensors,
            run="default",
            life=1,
        )
        self.other.publish("weights", self.weights)
        self.clock.advance_s(0.3)
        self._answer()

    def _answer(self):
        """Lets the actor ask for weights, and answers as the learner."""
        self.actor._policy.poll()
        while (request := self.asked.receive()) is not None:
            if self.weights is not None:
                request.reply(self.weights)
        self.actor._policy.poll()

    def run(self, steps, *, acknowledge=True):
        return [self._step(acknowledge=acknowledge) for _ in range(steps)]

    def _step(self, *, acknowledge):
        worked = self.actor.step()
        while acknowledge and (request := self.inserts.receive()) is not None:
            self.received.append(request.message)
            number, epoch = request.message.number, request.message.epoch
            request.reply(SequenceAck(actor="actor", epoch=epoch, number=number, cursor=0))
        return worked

    @property
    def status(self):
        return self.actor.status()


def test_nothing_is_done_before_the_first_weights():
    bench = Bench()
    assert not any(bench.run(20))
    assert bench.received == []
    assert bench.status.counters["env_steps"] == 0
    assert bench.status.note == "waiting for the learner's first weights"


def test_sequences_are_numbered_from_zero_and_carry_the_policy_that_acted():
    bench = Bench()
    bench.publish(version=7)
    bench.run(2 * T)
    assert [sequence.number for sequence in bench.received] == [0, 1, 2, 3]
    assert {sequence.weights_version for sequence in bench.received} == {7}
    assert {sequence.epoch for sequence in bench.received} == {10**9}
    assert {sequence.spec_digest for sequence in bench.received} == {bench.env.spec.digest}


def test_stored_log_probabilities_are_those_of_the_stored_actions():
    bench = Bench()
    bench.publish()
    bench.run(T)
    policy = GaussianPolicy.from_weights(bench.tensors)
    for sequence in bench.received:
        # The stddev of the first policy is 0.5 everywhere, but for what its last layer adds.
        mean = policy.mean_action(sequence.observation[:-1])
        scaled = (sequence.action - mean) / 0.5
        expected = (-0.5 * scaled**2 - np.log(0.5 * np.sqrt(2 * np.pi))).sum(-1)
        np.testing.assert_allclose(sequence.log_prob, expected, atol=0.15)


def test_sequences_never_cross_a_reset():
    bench = Bench()
    bench.publish()
    bench.run(4 * HORIZON)
    assert len(bench.received) == 2 * 4 * HORIZON / T
    for sequence in bench.received:
        x, v = sequence.observation.T
        np.testing.assert_allclose(x[1:], x[:-1] + 0.05 * v[1:], atol=1e-6)
    assert bench.status.counters["lost_steps"] == 0
    assert bench.status.counters["episodes"] == 8


def test_stops_when_the_window_is_full_and_goes_on_when_it_is_not():
    bench = Bench(window=4)
    bench.publish()
    worked = bench.run(10 * T, acknowledge=False)
    assert bench.status.counters["sequences_sent"] == 4
    assert not worked[-1]
    assert bench.status.note == "waiting for replay to acknowledge 4 sequences"
    bench.run(T)
    assert bench.status.counters["sequences_acked"] >= 4
    assert bench.status.note == "acting"


def test_stops_with_stale_weights_and_says_how_old_they_are():
    bench = Bench(max_weights_age_s=10.0)
    bench.publish(version=3)
    assert bench.run(1) == [True]
    bench.clock.advance_s(12.0)
    assert bench.run(1) == [False]
    assert bench.status.note == "waiting for the learner: weights are 12 s old, limit 10 s"
    assert bench.status.gauges["weights_age_s"] == 12.0
    bench.publish(version=3)
    assert bench.run(1) == [True]


def test_everything_arrives_once_though_replay_was_away():
    bench = Bench(timeout_s=1.0)
    bench.publish()
    bench.run(2 * T, acknowledge=False)
    while bench.inserts.receive() is not None:
        pass  # taken by a replay that dies before it answers
    bench.clock.advance_s(1.5)
    bench.run(1)
    bench.clock.advance_s(0.2)
    bench.run(2)
    assert sorted(sequence.number for sequence in bench.received) == [0, 1, 2, 3]
    assert bench.status.counters["sequences_resent"] == 4


def test_the_rate_is_bounded_where_it_is_asked_to_be():
    bench = Bench(max_steps_per_s=20.0)  # two instances: ten steps of both per second
    bench.publish()
    for _ in range(1000):
        bench.clock.advance_s(0.001)
        bench.run(1)
    assert bench.status.counters["env_steps"] == pytest.approx(20, abs=4)


def test_closing_waits_for_what_is_unacknowledged_but_not_for_ever():
    bench = Bench(drain_s=2.0)
    bench.publish()
    bench.run(T, acknowledge=False)
    before = bench.clock.now_ns()
    bench.actor.close()
    assert bench.clock.now_ns() - before == pytest.approx(2e9, abs=2e6)
    bench.run(1)
    before = bench.clock.now_ns()
    bench.actor.close()
    assert bench.clock.now_ns() == before


class Failing(BatchedEnvironment):
    """A point mass whose first instance reports NaN in one step."""

    def __init__(self, at):
        self._env = PointMass(2, horizon=HORIZON)
        self.spec, self.num_envs = self._env.spec, 2
        self._at = at
        self.resets = []

    def reset(self, ids=None):
        self.resets.append(ids)
        return self._env.reset(ids)

    def step(self, action):
        transition = self._env.step(action)
        observation = transition.observation
        self._at -= 1
        if self._at == 0:
            observation[0] = np.nan
        return Transition(
            observation=observation,
            reward=transition.reward,
            discount=transition.discount,
            ended=transition.ended,
        )


def test_nan_never_leaves_is_counted_and_resets_the_instance():
    bench = Bench(Failing(at=3))
    bench.publish()
    bench.run(2 * HORIZON)
    assert bench.status.counters["unusable_steps"] == 1
    assert 0 in bench.env.resets[1]
    for sequence in bench.received:
        assert np.isfinite(sequence.observation).all()
        x, v = sequence.observation.T
        np.testing.assert_allclose(x[1:], x[:-1] + 0.05 * v[1:], atol=1e-6)


def test_actions_that_are_none_where_no_probe_looked_are_not_sent_and_end_nobody():
    bench = Bench()
    bench.publish()
    policy = bench.actor._policy.policy
    bad = replace(policy, mean=replace(policy.mean, bias=np.array([np.nan], np.float32)))
    bench.actor._policy.policy = bad
    bench.run(2 * T)
    assert bench.status.counters["unusable_steps"] == 2 * 2 * T
    assert bench.received == []
    bench.actor._policy.policy = policy
    bench.run(T)
    assert [sequence.number for sequence in bench.received] == [0, 1]


def test_another_environment_of_the_same_size_is_not_acted_for():
    bench = Bench()
    other = EnvironmentSpec(name="other", observation_size=2, action_size=1)
    tensors = policy_tensors(init_learner(other, LearnerSettings(), 0))
    bench.other.publish(
        "weights", Weights(version=1, created_ns=0, spec_digest=other.digest, tensors=tensors)
    )
    assert not any(bench.run(5))
    assert bench.status.counters["rejected_messages"] == 1


def test_a_horizon_that_is_no_multiple_of_the_sequence_is_refused_with_both():
    with pytest.raises(ConfigError, match="horizon is 10 and sequence_length is 4"):
        config(sequence_length=4)


def test_a_window_smaller_than_the_instances_is_refused_with_both():
    with pytest.raises(ConfigError, match="window is 1 and num_envs is 2"):
        config(window=1)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--num-envs", "0"], "num_envs"),
        (["--horizon", "7"], "horizon is 7 and sequence_length is 10"),
        (["--model", "sideways=x.xml"], "sideways"),
    ],
)
def test_the_command_refuses_bad_settings_with_one_line(argv, message, capsys):
    assert main([*argv, "--wait-s", "0"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
