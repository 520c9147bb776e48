"""The actor's parts: sequences cut rightly, delivered once, and weights that only go forwards."""

from typing import final

import numpy as np
import pytest

from gfm.core import ConfigError, EnvironmentSpec, ManualClock, RefusedError, Sequence, Weights
from gfm.envs.batched import Transition
from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner import LearnerSettings, init_learner, policy_tensors
from gfm.transport import MemoryHub, MemoryTransport, Transport
from gfm_actor.assembler import Acted, Assembler
from gfm_actor.config import ActorConfig
from gfm_actor.joining import complete
from gfm_actor.outbox import Outbox
from gfm_actor.subscription import PolicySubscription
from gfm_wire import RunEnvironment, SequenceAck, WeightsRequest

SPEC = EnvironmentSpec(name="counting", observation_size=1, action_size=1)
T = 3


class Counting:
    """Two instances whose observations count; says what an assembler makes of them."""

    def __init__(self):
        self.assembler = Assembler(SPEC, 2, T)
        self.at = np.zeros(2, np.float32)
        self.version = 0

    def step(self, *, ended=(), terminated=(), invalid=()):
        flags = np.zeros((3, 2), bool)
        for row, instances in enumerate((ended, terminated, invalid)):
            flags[row, list(instances)] = True
        acted = Acted(
            observation=self.at[:, None].copy(),
            action=-self.at[:, None],
            log_prob=self.at / 10,
            weights_version=self.version,
        )
        transition = Transition(
            observation=self.at[:, None] + 1,
            reward=self.at + 100,
            discount=np.where(flags[1], 0, 1).astype(np.float32),
            ended=flags[0] | flags[1],
        )
        segments = self.assembler.add(acted, transition, ~flags[2])
        self.at += 1
        return segments


def test_sequences_hold_consecutive_steps_and_do_not_overlap():
    env = Counting()
    made = [segment for _ in range(2 * T) for segment in env.step()]
    assert len(made) == 4
    for segment, start in zip(made, (0, 0, T, T), strict=True):
        steps = np.arange(start, start + T, dtype=np.float32)
        np.testing.assert_array_equal(segment.observation[:, 0], np.arange(start, start + T + 1))
        np.testing.assert_array_equal(segment.action[:, 0], -steps)
        np.testing.assert_array_equal(segment.reward, steps + 100)
        np.testing.assert_array_equal(segment.discount, 1.0)
        np.testing.assert_allclose(segment.log_prob, steps / 10)


def test_a_terminated_episode_rests_where_it_ended():
    env = Counting()
    env.step()
    (segment,) = env.step(terminated=[1])
    np.testing.assert_array_equal(segment.observation[:, 0], [0, 1, 2, 2])
    np.testing.assert_array_equal(segment.reward, [100, 101, 0])
    np.testing.assert_array_equal(segment.discount, [1, 0, 0])
    np.testing.assert_array_equal(segment.action[:, 0], [0, -1, 0])
    (other,) = env.step()  # the other instance is not disturbed
    np.testing.assert_array_equal(other.observation[:, 0], [0, 1, 2, 3])
    assert env.assembler.lost_steps == 0


def test_nothing_of_an_earlier_sequence_shows_in_a_filled_one():
    env = Counting()
    for _ in range(T):
        env.step()
    (segment, _) = env.step(terminated=[0, 1])
    np.testing.assert_array_equal(segment.observation[:, 0], [3, 4, 4, 4])
    np.testing.assert_array_equal(segment.log_prob[1:], 0)


def test_a_time_limit_at_the_end_of_a_sequence_keeps_its_bootstrap():
    env = Counting()
    env.step(), env.step()
    first, second = env.step(ended=[0, 1])
    np.testing.assert_array_equal(first.discount, 1.0)
    np.testing.assert_array_equal(second.discount, 1.0)


def test_a_time_limit_inside_a_sequence_is_counted_as_lost():
    env = Counting()
    env.step()
    assert env.step(ended=[0]) == []
    assert env.assembler.lost_steps == 2
    (other,) = env.step()
    np.testing.assert_array_equal(other.observation[:, 0], [0, 1, 2, 3])


def test_an_invalid_step_drops_the_sequence_under_way():
    env = Counting()
    env.step()
    assert env.step(invalid=[0]) == []
    env.step()
    env.step()
    (segment,) = env.step()
    np.testing.assert_array_equal(segment.observation[:, 0], [2, 3, 4, 5])


def test_a_sequence_carries_the_version_that_began_it():
    env = Counting()
    env.step()
    env.version = 7
    env.step()
    assert [segment.weights_version for segment in env.step()] == [0, 0]
    assert [s.weights_version for _ in range(T) for s in env.step()] == [7, 7]


def sequence(number):
    zeros = np.zeros(T, np.float32)
    return Sequence(
        actor="a",
        epoch=5,
        number=number,
        weights_version=0,
        spec_digest=SPEC.digest,
        observation=np.zeros((T + 1, 1), np.float32),
        action=zeros[:, None],
        reward=zeros,
        discount=zeros,
        log_prob=zeros,
    )


class Post:
    """An outbox, and someone who answers as replay."""

    def __init__(self, window=4):
        self.clock = ManualClock(10**9)
        hub = MemoryHub()
        self.server = MemoryTransport(hub, name="replay", clock=self.clock).serve("replay/insert")
        transport = MemoryTransport(hub, name="a", clock=self.clock)
        self.outbox = Outbox(transport, self.clock, window=window, timeout_s=1.0)

    def receive(self):
        requests = []
        while (request := self.server.receive()) is not None:
            requests.append(request)
        return requests

    def acknowledge(self):
        numbers = []
        for request in self.receive():
            numbers.append(request.message.number)
            request.reply(SequenceAck(actor="a", epoch=5, cursor=request.message.number + 1))
        return numbers


def test_the_window_is_full_until_sequences_are_acknowledged():
    post = Post(window=2)
    post.outbox.send(sequence(0))
    assert post.outbox.has_room(1)
    post.outbox.send(sequence(1))
    assert not post.outbox.has_room(1)
    assert post.acknowledge() == [0, 1]
    post.outbox.poll()
    assert post.outbox.has_room(2)
    assert (post.outbox.sent, post.outbox.acked) == (2, 2)


def test_what_got_no_answer_is_sent_again_under_the_same_number():
    post = Post()
    post.outbox.send(sequence(0))
    post.receive()  # taken, and never answered
    post.clock.advance_s(1.5)
    post.outbox.poll()
    assert "no answer from replay/insert" in post.outbox.note
    post.clock.advance_s(0.2)
    post.outbox.poll()
    assert post.acknowledge() == [0]
    post.outbox.poll()
    assert (post.outbox.acked, post.outbox.resent, len(post.outbox)) == (1, 1, 0)
    assert post.outbox.note == ""


def test_replay_gone_and_back_is_one_line_each(caplog):
    caplog.set_level("INFO")
    post = Post()
    post.outbox.send(sequence(0))
    post.outbox.send(sequence(1))
    post.receive()  # taken, and never answered
    for _ in range(3):
        post.clock.advance_s(1.5)
        post.outbox.poll()
    assert [line.split(",")[0] for line in caplog.messages] == ["replay does not answer"]
    post.clock.advance_s(0.2)
    post.outbox.poll()
    post.acknowledge()
    post.outbox.poll()
    assert caplog.messages[1:] == ["replay answers again, after 3.2 s"]


def test_what_is_refused_is_counted_and_not_sent_again():
    post = Post()
    post.outbox.send(sequence(0))
    post.receive()[0].refuse("another shape")
    post.outbox.poll()
    assert (post.outbox.refused, len(post.outbox)) == (1, 0)
    assert post.outbox.note == "replay refused sequence 0: another shape"


class Learner:
    """Someone who answers as the learner, and who follows it."""

    def __init__(self, max_age_s=10.0):
        self.clock = ManualClock(10**9)
        hub = MemoryHub()
        self.transport = MemoryTransport(hub, name="learner", clock=self.clock)
        self.server = self.transport.serve("weights/current")
        self.follower = PolicySubscription(
            SPEC,
            MemoryTransport(hub, name="a", clock=self.clock),
            self.clock,
            max_age_s=max_age_s,
        )

    def publish(self, version, spec=SPEC):
        self.transport.publish("weights", weights(version, spec))
        self.follower.poll()


def weights(version, spec=SPEC):
    state = init_learner(spec, LearnerSettings(policy_hidden=(4,), critic_hidden=(4,)), version)
    return Weights(
        version=version, created_ns=0, spec_digest=spec.digest, tensors=policy_tensors(state)
    )


def test_takes_newer_weights_and_leaves_older_ones():
    learner = Learner()
    learner.publish(3)
    learner.publish(2)
    assert learner.follower.version == 3
    learner.publish(4)
    assert learner.follower.version == 4


def test_a_repeated_version_is_a_sign_of_life():
    learner = Learner(max_age_s=10.0)
    learner.publish(1)
    learner.clock.advance_s(8.0)
    learner.publish(1)
    assert learner.follower.age_s == 0.0
    learner.clock.advance_s(11.0)
    assert learner.follower.is_stale


def test_an_older_version_is_no_sign_of_life_until_the_current_one_is_stale():
    learner = Learner(max_age_s=10.0)
    learner.publish(5)
    learner.clock.advance_s(8.0)
    learner.publish(4)
    assert (learner.follower.version, learner.follower.age_s) == (5, 8.0)
    learner.clock.advance_s(8.0)
    learner.publish(4)
    assert (learner.follower.version, learner.follower.age_s) == (4, 0.0)


def test_asks_for_the_current_weights_until_they_come():
    learner = Learner()
    learner.follower.poll()
    request = learner.server.receive()
    assert request.message == WeightsRequest(spec_digest=SPEC.digest)
    learner.clock.advance_s(5.0)  # no answer in time
    learner.follower.poll()
    learner.clock.advance_s(0.5)
    learner.follower.poll()
    learner.server.receive().reply(weights(9))
    learner.follower.poll()
    assert learner.follower.version == 9


def test_a_learner_gone_and_back_is_one_line_each(caplog):
    caplog.set_level("INFO")
    learner = Learner()
    for _ in range(4):
        learner.follower.poll()
        learner.clock.advance_s(3.0)
    learner.publish(1)
    assert [line.split(",")[0] for line in caplog.messages] == [
        "learner does not answer",
        "learner answers again",
    ]


def test_a_learner_for_another_environment_ends_it():
    learner = Learner()
    learner.follower.poll()
    learner.server.receive().refuse("this learner learns for something else")
    with pytest.raises(RefusedError, match="learns for something else"):
        learner.follower.poll()


def test_weights_that_do_not_fit_are_counted_and_left():
    learner = Learner()
    learner.publish(1, EnvironmentSpec(name="other", observation_size=1, action_size=1))
    broken = weights(2)
    tensors = {name: tensor for name, tensor in broken.tensors.items() if name != "mean.bias"}
    learner.transport.publish(
        "weights", Weights(version=2, created_ns=0, spec_digest=SPEC.digest, tensors=tensors)
    )
    learner.follower.poll()
    assert (learner.follower.version, learner.follower.rejected) == (-1, 2)


@final
class Teller(Transport):
    """Answers `run/environment` with what it was given, from the question `first` on."""

    def __init__(self, hub, clock, answer, first):
        self._transport = MemoryTransport(hub, clock=clock)
        self._other = MemoryTransport(hub, clock=clock)
        self._answer = answer
        self._server = self._other.serve("run/environment")
        self._first = first
        self.asked = 0

    def request(self, key, message, *, timeout_s):
        pending = self._transport.request(key, message, timeout_s=timeout_s)
        request, self.asked = self._server.receive(), self.asked + 1
        if self.asked >= self._first:
            self._answer(request)
        return pending

    def publish(self, key, message):
        self._transport.publish(key, message)

    def subscribe(self, key, *, keep=1):
        return self._transport.subscribe(key, keep=keep)

    def survey(self, key, message, *, timeout_s):
        return self._transport.survey(key, message, timeout_s=timeout_s)

    def serve(self, key):
        return self._transport.serve(key)

    def close(self):
        self._transport.close()


def completed(config, answer, first=1):
    clock = ManualClock(10**9)
    return complete(config, Teller(MemoryHub(), clock, answer, first), clock)


def telling(settings):
    told = RunEnvironment(name="gfm_fit", settings=settings)
    return lambda request: request.reply(told)


def test_an_actor_that_was_told_nothing_takes_the_runs_environment():
    config = completed(ActorConfig(), telling('{"horizon": 30, "recordings": ["/a.mcap"]}'))
    assert config.environment == EnvironmentSettings(horizon=30, recordings=("/a.mcap",))


def test_an_actor_that_was_told_does_not_ask():
    told = ActorConfig(environment=EnvironmentSettings(horizon=10))
    assert completed(told, telling('{"horizon": 30}')) == told


def test_an_actor_waits_for_its_learner_and_says_so(caplog):
    config = completed(ActorConfig(), telling('{"horizon": 30}'), first=20)
    assert config.environment == EnvironmentSettings(horizon=30)
    assert "waiting for a learner to tell its environment" in caplog.text


def test_an_actor_in_a_run_for_something_else_is_refused():
    with pytest.raises(RefusedError, match="learns for point_mass"):
        completed(ActorConfig(), lambda request: request.refuse("this run learns for point_mass"))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("{", "the learner's environment settings"),
        ('{"horizn": 30}', "unknown field `horizn`"),
        ('{"horizon": 7}', "horizon is 7 and sequence_length is 10"),
    ],
)
def test_environment_settings_that_cannot_be_used_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        completed(ActorConfig(), telling(settings))
