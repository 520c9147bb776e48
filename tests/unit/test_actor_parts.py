"""The actor's parts: sequences cut rightly, delivered once, and weights that only go forwards."""

from dataclasses import replace
from typing import final

import numpy as np
import pytest

from gfm.core import ConfigError, EnvironmentSpec, ManualClock, RefusedError, Sequence, Weights
from gfm.envs.batched import Transition
from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner_state import LearnerSettings, init_learner, policy_tensors
from gfm.service.ledger import Ledger
from gfm.service.refusals import Refusals
from gfm.transport import MemoryHub, MemoryTransport, Transport
from gfm_actor.assembler import Acted, Assembler
from gfm_actor.config import ActorConfig
from gfm_actor.joining import complete
from gfm_actor.outbox import Outbox
from gfm_actor.subscription import LEAP, PolicySubscription
from gfm_wire import NotReady, RunEnvironment, SequenceAck, StatusRequest, WeightsRequest

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
            weights_life=1,
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
        weights_life=1,
        weights_version=0,
        spec_digest=SPEC.digest,
        observation=np.zeros((T + 1, 1), np.float32),
        action=zeros[:, None],
        reward=zeros,
        discount=zeros,
        log_prob=zeros,
    )


def acknowledgement(sequence, **changes):
    about = {"actor": sequence.actor, "epoch": sequence.epoch, "number": sequence.number}
    return SequenceAck(**({"cursor": 0} | about | changes))


class Post:
    """An outbox, and someone who answers as replay."""

    def __init__(self, window=4, ledger=None):
        self.clock = ManualClock(10**9)
        self.hub = MemoryHub()
        self.replay = MemoryTransport(self.hub, name="replay", clock=self.clock)
        self.server = self.replay.serve("replay/insert")
        transport = MemoryTransport(self.hub, name="a", clock=self.clock)
        self.refusals = Refusals()
        self.outbox = Outbox(
            transport, self.clock, self.refusals, window=window, timeout_s=1.0, ledger=ledger
        )

    def receive(self):
        requests = []
        while (request := self.server.receive()) is not None:
            requests.append(request)
        return requests

    def acknowledge(self):
        numbers = []
        for request in self.receive():
            numbers.append(request.message.number)
            request.reply(acknowledgement(request.message))
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


WRONG = {
    "another_number": {"number": 7},
    "another_actor": {"actor": "b"},
    "another_epoch": {"epoch": 2**62},
    "a_far_cursor": {"cursor": 2**62},
}


@pytest.mark.parametrize("changes", WRONG.values(), ids=WRONG)
def test_an_acknowledgement_of_something_else_counts_for_nothing(changes):
    post = Post()
    post.outbox.send(sequence(0))
    (request,) = post.receive()
    request.reply(acknowledgement(request.message, **changes))
    post.outbox.poll()
    assert (post.outbox.acked, len(post.outbox)) == (0, 1)
    assert post.refusals.counters["refused_answer"] == 1
    post.clock.advance_s(0.2)
    post.outbox.poll()
    assert post.acknowledge() == [0]
    post.outbox.poll()
    assert (post.outbox.acked, len(post.outbox)) == (1, 0)


@pytest.mark.parametrize("says", ["yes", "no", "later", "something_else"])
def test_a_second_replay_takes_nothing_from_the_first_and_shows(says):
    post = Post(window=40)
    second = MemoryTransport(post.hub, name="second", clock=post.clock).serve("replay/insert")
    arrived = []
    for number in range(32):
        post.outbox.send(sequence(number))
        request = second.receive()
        {
            "yes": lambda r: r.reply(acknowledgement(r.message)),
            "no": lambda r: r.refuse("not wanted"),
            "later": lambda r: r.reply(NotReady(reason="later")),
            "something_else": lambda r: r.reply(StatusRequest()),
        }[says](request)
        if says != "yes":
            post.outbox.poll()
            arrived += post.acknowledge()
            post.outbox.poll()
    arrived += [request.message.number for request in post.receive()]
    post.outbox.poll()
    assert arrived == list(range(32))
    assert (post.outbox.acked, post.outbox.refused) == (32, 0)


def test_another_replay_is_counted_and_said_once(caplog):
    post = Post()
    post.outbox.send(sequence(0))
    post.acknowledge()
    post.outbox.poll()
    post.replay.close()
    other = MemoryTransport(post.hub, name="other", clock=post.clock)
    post.server = other.serve("replay/insert")
    for number in (1, 2):
        post.outbox.send(sequence(number))
        post.acknowledge()
        post.outbox.poll()
    assert post.outbox.replays == 1
    assert caplog.messages == ["another replay than before acknowledges: 'other'"]


def test_what_replay_cannot_take_now_is_sent_again():
    post = Post()
    post.outbox.send(sequence(0))
    post.receive()[0].reply(NotReady(reason="no room on disk"))
    post.outbox.poll()
    assert post.outbox.note == "replay takes nothing now: no room on disk"
    post.clock.advance_s(0.6)
    post.outbox.poll()
    assert post.acknowledge() == [0]
    post.outbox.poll()
    assert (post.outbox.acked, post.outbox.refused, post.outbox.note) == (1, 0, "")


def test_what_is_refused_is_counted_and_not_sent_again():
    post = Post()
    post.outbox.send(sequence(0))
    post.receive()[0].refuse("another shape")
    post.outbox.poll()
    assert (post.outbox.refused, len(post.outbox)) == (1, 0)
    assert post.outbox.note == "replay refused sequence 0: another shape"


class Learner:
    """Someone who is the learner, someone who follows it, and a stranger."""

    def __init__(self, max_age_s=10.0, follow=True):
        self.clock = ManualClock(10**9)
        self.hub = MemoryHub()
        self.refusals = Refusals()
        self.start(0, life=1)
        self.stranger = self.connect("stranger")
        self.follower = PolicySubscription(
            SPEC, self.connect("a"), self.clock, self.refusals, run="run", max_age_s=max_age_s
        )
        if follow:
            self.follow()

    def connect(self, name):
        return MemoryTransport(self.hub, name=name, clock=self.clock)

    def start(self, version, life):
        """Begins a new life of the learner."""
        self.transport = self.connect("learner")
        self.server = self.transport.serve("weights/current")
        self.weights = weights(version, life=life)

    def stop(self):
        self.transport.close()

    def publish(self, version, **changes):
        """Broadcasts; what it broadcast is also what it answers with."""
        self.weights = weights(version, life=self.weights.life)
        self.transport.publish("weights", replace(self.weights, **changes))
        self.follow()

    def intrude(self, message):
        self.stranger.publish("weights", message)
        self.follow()

    def follow(self):
        """Lets the follower ask, the learner answer, and the follower hear."""
        self.clock.advance_s(0.3)
        self.follower.poll()
        while (request := self.server.receive()) is not None:
            request.reply(self.weights)
        self.follower.poll()

    @property
    def identity(self):
        return self.follower.life, self.follower.version


def weights(version, spec=SPEC, life=1):
    settings = LearnerSettings(policy_hidden=(4, 4), critic_hidden=(4,))
    return Weights(
        version=version,
        created_ns=0,
        spec_digest=spec.digest,
        tensors=policy_tensors(init_learner(spec, settings, version)),
        run="run",
        life=life,
    )


def changed(message, **tensors):
    """Returns weights with other tensors; None takes one away."""
    kept = {**message.tensors, **tensors}
    return replace(message, tensors={name: t for name, t in kept.items() if t is not None})


def test_takes_newer_weights_and_leaves_older_ones():
    learner = Learner()
    learner.publish(3)
    learner.intrude(weights(2))
    assert learner.identity == (1, 3)
    learner.publish(4)
    assert learner.identity == (1, 4)


def test_a_repeated_version_is_a_sign_of_life():
    learner = Learner(max_age_s=10.0)
    learner.publish(1)
    learner.clock.advance_s(8.0)
    learner.publish(1)
    assert learner.follower.age_s == 0.0
    learner.clock.advance_s(11.0)
    assert learner.follower.is_stale


def test_a_learner_that_began_anew_is_followed_at_once_though_its_versions_are_smaller():
    learner = Learner()
    learner.publish(1025)
    learner.stop()
    learner.start(557, life=2)
    learner.publish(558)
    assert learner.identity == (2, 558)
    learner.publish(559)
    assert learner.identity == (2, 559)


def test_the_same_version_of_two_lives_is_two_policies():
    learner = Learner()
    learner.publish(5)
    before = learner.follower.policy
    learner.stop()
    learner.start(5, life=2)
    learner.publish(5)
    assert learner.identity == (2, 5)
    assert learner.follower.policy is not before


def test_an_earlier_life_is_taken_only_where_nothing_is_heard_of_the_current_one():
    learner = Learner(max_age_s=10.0)
    learner.publish(5)
    learner.stop()
    learner.start(9, life=0)  # its clock was set back
    learner.publish(9)
    assert learner.identity == (1, 5)
    assert learner.refusals.counters["refused_life"] == 1
    learner.clock.advance_s(11.0)
    learner.publish(10)
    assert learner.identity == (0, 10)


@pytest.mark.parametrize(
    "message",
    [
        weights(10**12),
        weights(1, life=2**62),
        weights(2**62, life=2**62),
        replace(weights(2), run="another"),
        weights(2, EnvironmentSpec(name="other", observation_size=1, action_size=1)),
    ],
    ids=["far_version", "future_life", "both", "run", "spec"],
)
def test_what_a_stranger_broadcasts_changes_nothing(message):
    learner = Learner()
    learner.publish(1)
    before = learner.follower.policy
    learner.intrude(message)
    assert learner.identity == (1, 1)
    assert learner.follower.policy is before
    learner.publish(2)
    assert learner.identity == (1, 2)


def test_a_stranger_who_is_first_is_not_believed():
    learner = Learner(follow=False)
    learner.stranger.publish("weights", weights(10**12, life=2**62))
    learner.follow()
    assert learner.identity == (1, 0)


def test_a_leap_of_the_learner_itself_is_asked_about_and_believed():
    learner = Learner()
    learner.publish(1)
    learner.publish(2 + LEAP)
    assert learner.identity == (1, 2 + LEAP)


def test_a_broadcast_under_the_learners_name_does_not_hold_for_long():
    learner = Learner()
    learner.publish(1)
    learner.transport.publish("weights", weights(500))
    learner.follower.poll()
    assert learner.identity == (1, 500)
    learner.publish(2)
    assert learner.identity == (1, 2)


ZEROS = {name: np.zeros_like(tensor) for name, tensor in weights(0).tensors.items()}
HARMFUL = {
    "zeros": ZEROS,
    "no_scale": {"scale": np.zeros(1, np.float32)},
    "huge": {name: tensor + np.float32(1e38) for name, tensor in weights(0).tensors.items()},
    "far": {"mean.bias": np.full(1, 1e9, np.float32)},
    "missing": {"mean.bias": None},
    "no_first_layer_of_two": {"hidden.0.bias": None},
    "bias_of_another_size": {"mean.bias": np.zeros(2, np.float32)},
    "bias_without_shape": {"mean.bias": np.float32(0.0)},
    "weight_of_another_shape": {"hidden.0.weight": np.zeros((4, 9), np.float32)},
    "weight_of_three_dimensions": {"mean.weight": np.zeros((1, 4, 1), np.float32)},
    "empty": {name: np.zeros(0, np.float32) for name in ZEROS},
}


@pytest.mark.parametrize("tensors", HARMFUL.values(), ids=HARMFUL)
def test_weights_that_cannot_act_are_refused_counted_and_the_old_ones_stay(tensors):
    learner = Learner()
    learner.publish(1)
    before = learner.follower.policy
    learner.weights = changed(weights(2), **tensors)
    learner.transport.publish("weights", learner.weights)
    learner.follow()
    assert learner.identity == (1, 1)
    assert learner.follower.policy is before
    assert learner.refusals.counters["refused_policy"] >= 1
    assert learner.refusals.counters["refused_from_learner"] >= 1
    learner.publish(3)
    assert learner.identity == (1, 3)


def test_asks_for_the_current_weights_until_they_come():
    learner = Learner(follow=False)
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
    learner = Learner(follow=False)
    for _ in range(4):
        learner.follower.poll()
        learner.server.receive()  # taken, and never answered
        learner.clock.advance_s(3.0)
    learner.follow()
    learner.follow()
    assert [line.split(",")[0] for line in caplog.messages] == [
        "learner does not answer",
        "learner answers again",
    ]


def test_a_learner_for_another_environment_ends_it():
    learner = Learner(follow=False)
    learner.follower.poll()
    learner.server.receive().refuse("this learner learns for something else")
    with pytest.raises(RefusedError, match="learns for something else"):
        learner.follower.poll()


def test_a_refusal_does_not_end_an_actor_that_has_a_policy():
    learner = Learner()
    learner.intrude(weights(10**12))
    learner.clock.advance_s(0.3)
    learner.stranger.publish("weights", weights(10**12))
    learner.follower.poll()
    learner.server.receive().refuse("this learner learns for something else")
    learner.follower.poll()
    learner.publish(1)
    assert learner.identity == (1, 1)


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

    def request(self, key, message, *, timeout_s, everybody=False):
        pending = self._transport.request(key, message, timeout_s=timeout_s, everybody=everybody)
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
    told = RunEnvironment(name="gfm_fit", settings=settings, spec=SPEC)
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


class Noted(Ledger):
    """Remembers what it was told."""

    def __init__(self):
        self.numbers = []

    def note(self, sequence):
        self.numbers.append(sequence.number)


def test_the_ledger_hears_of_what_was_acknowledged_and_of_nothing_else():
    noted = Noted()
    post = Post(ledger=noted)
    for number in range(3):
        post.outbox.send(sequence(number))
    first, second, _ = post.receive()
    first.reply(acknowledgement(first.message))
    second.refuse("no")
    post.outbox.poll()
    assert noted.numbers == [0]
