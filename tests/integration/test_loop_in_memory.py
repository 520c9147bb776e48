"""The loop of actor, replay and learner in one thread over the in-memory transport.

The stand-ins do no physics and no learning: what flows round, and when, is what is tested here.
"""

from __future__ import annotations

from collections import deque
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Batch, Clock, EnvironmentSpec, GfmError, ManualClock, Sequence, Status, Weights
from gfm.launch import statuses, summary
from gfm.service import RunningService, Service, make_status
from gfm.transport import MemoryHub, MemoryTransport, PendingReply, Transport
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService
from gfm_wire import RunEnvironment, SampleRequest, SequenceAck

SPEC = EnvironmentSpec(name="counting", observation_size=3, action_size=2)
STEPS = 4


@final
class StandInActor(Service):
    """Sends sequences that carry the version of the newest weights; resends what is lost."""

    def __init__(self, name: str, transport: Transport) -> None:
        self._name = name
        self._transport = transport
        self._weights = transport.subscribe("weights")
        self._pending: PendingReply | None = None
        self.sent: deque[Sequence] = deque()
        self.version = 0
        self.number = 0

    @override
    def step(self) -> bool:
        weights = self._weights.latest()
        if isinstance(weights, Weights):
            self.version = weights.version
        if self._pending is None:
            self._pending = self._transport.request(
                "replay/insert", self._sequence(), timeout_s=1.0
            )
            return True
        try:
            ack = self._pending.poll()
        except GfmError:
            self._pending = None  # the same number again
            return True
        if isinstance(ack, SequenceAck):
            self.number, self._pending = self.number + 1, None
        return ack is not None

    def _sequence(self) -> Sequence:
        return Sequence(
            actor=self._name,
            epoch=1,
            number=self.number,
            weights_life=1,
            weights_version=self.version,
            spec_digest=SPEC.digest,
            observation=np.zeros((STEPS + 1, SPEC.observation_size), np.float32),
            action=np.zeros((STEPS, SPEC.action_size), np.float32),
            reward=np.full(STEPS, self.version, np.float32),
            discount=np.ones(STEPS, np.float32),
            log_prob=np.zeros(STEPS, np.float32),
        )

    @override
    def status(self) -> Status:
        return make_status("actor", self._name, counters={"env_steps": STEPS * self.number})

    @override
    def close(self) -> None:
        pass


@final
class StandInLearner(Service):
    """Publishes a new version of its weights for every batch that it gets."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._asked = transport.serve("run/environment")
        self._pending: PendingReply | None = None
        self.version = 0
        self.newest_seen = 0

    @override
    def step(self) -> bool:
        if (asked := self._asked.receive()) is not None:
            asked.reply(RunEnvironment(name=SPEC.name, settings="{}", spec=SPEC))
        if self._pending is None:
            request = SampleRequest(batch_size=8, spec_digest=SPEC.digest)
            self._pending = self._transport.request("replay/sample", request, timeout_s=1.0)
            return True
        try:
            batch = self._pending.poll()
        except GfmError:
            self._pending = None
            return True
        if batch is None:
            return False
        self._pending = None
        if isinstance(batch, Batch):
            self._learn(batch)
        return True

    def _learn(self, batch: Batch) -> None:
        np.testing.assert_array_equal(batch.reward[:, 0], batch.weights_version)
        self.newest_seen = max(self.newest_seen, int(batch.weights_version.max()))
        self.version += 1
        tensors = {"w": np.zeros((2, 2), np.float32)}
        self._transport.publish(
            "weights",
            Weights(version=self.version, created_ns=0, spec_digest=SPEC.digest, tensors=tensors),
        )

    @override
    def status(self) -> Status:
        return make_status(
            "learner",
            "learner",
            counters={"learner_steps": self.version},
            gauges={"weights_version": self.version},
        )

    @override
    def close(self) -> None:
        pass


class Loop:
    """Two actors, replay and learner, stepped in turn."""

    def __init__(self) -> None:
        self.hub, self.clock = MemoryHub(), ManualClock()
        self.replay = ReplayService(
            ReplayConfig(name="replay", min_size=5, max_samples_per_insert=4.0),
            self.connect(),
            self.clock,
            np.random.default_rng(0),
        )
        self.actors = [StandInActor(f"actor-{i}", self.connect()) for i in range(2)]
        self.learner = StandInLearner(self.connect())
        services = [self.replay, *self.actors, self.learner]
        self._running = [RunningService(service, self.connect()) for service in services]

    def connect(self) -> Transport:
        return MemoryTransport(self.hub, clock=self.clock)

    def step(self, times: int) -> None:
        for _ in range(times):
            for service in self._running:
                service.step()
            self.clock.advance_s(0.01)


def test_sequences_batches_and_weights_go_all_the_way_round():
    loop = Loop()
    loop.step(200)
    counters = loop.replay.status().counters
    assert counters["replay_sequences"] >= sum(actor.number for actor in loop.actors) > 20
    assert loop.learner.newest_seen > 10  # weights reached an actor, acted, and came back
    # The learner steps last: its newest weights may not have been taken yet.
    assert all(loop.learner.version - actor.version <= 1 for actor in loop.actors)
    assert counters["samples"] <= 4 * counters["replay_sequences"]


def test_what_is_lost_on_the_way_is_sent_again_and_stored_once():
    loop = Loop()
    faults = np.random.default_rng(1)
    loop.hub.tamper = lambda _key, body: None if faults.random() < 0.3 else body
    loop.step(3000)
    loop.hub.tamper = lambda _key, body: body
    loop.step(200)
    accepted = sum(actor.number for actor in loop.actors)
    counters = loop.replay.status().counters
    assert accepted > 20
    assert 0 <= counters["replay_sequences"] - accepted <= len(loop.actors)


def test_damaged_bodies_are_counted_and_stop_nobody():
    loop = Loop()
    faults = np.random.default_rng(2)

    def damage(_key: str, body: bytes) -> bytes:
        return body[: int(faults.integers(len(body)))] if faults.random() < 0.3 else body

    loop.hub.tamper = damage
    loop.step(500)
    before = loop.learner.version
    loop.hub.tamper = lambda _key, body: body
    loop.step(500)
    assert loop.learner.version > before


@final
class SteppingClock(Clock):
    """Whoever waits by this clock lets the loop go on meanwhile."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop

    @override
    def now_ns(self) -> int:
        return self._loop.clock.now_ns()

    @override
    def utc_ns(self) -> int:
        return self._loop.clock.utc_ns()

    @override
    def sleep_until_ns(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:
            self._loop.step(1)


def test_the_system_says_how_it_is_while_it_runs():
    loop = Loop()
    loop.step(100)
    found = statuses(MemoryTransport(loop.hub, clock=SteppingClock(loop)))
    assert [status.name for status in found] == ["actor-0", "actor-1", "learner", "replay"]
    sums = summary(found)
    assert sums["actors"] == 2
    assert sums["weights_version"] == sums["learner_steps"] > 10
    assert sums["env_steps"] >= STEPS * (sums["replay_sequences"] - 2) > 0
