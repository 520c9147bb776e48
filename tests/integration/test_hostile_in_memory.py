"""Every kind of message with the worst values that its form allows, at every door of a system.

Actor, replay and learner run in one thread. A stranger says each thing once; then the system must
learn on as if nothing had been said.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import pytest

import gfm_actor.__main__
import gfm_learner.__main__
import gfm_replay.__main__
from gfm.core import ManualClock, WireError
from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner_state import LearnerSettings
from gfm.service import RunningService
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig
from gfm_wire import SCHEMAS, Stamp, decode, encode
from hostile import worst

ENVIRONMENT = EnvironmentSettings(horizon=10)
DOORS = ("replay/insert", "replay/sample", "weights/current", "run/environment")
SMALL = LearnerSettings(policy_hidden=(4,), critic_hidden=(4,), samples=2, target_period=2)


class System:
    """The three services of a run, and a stranger."""

    def __init__(self) -> None:
        self.hub, self.clock = MemoryHub(), ManualClock(10**18)
        self._running = {}
        self.stranger = MemoryTransport(self.hub, name="stranger", clock=self.clock)
        common = {"env": "point_mass", "environment": ENVIRONMENT}
        for build, config in (
            (gfm_replay.__main__.build, ReplayConfig(name="replay", min_size=8, capacity_mib=1)),
            (
                gfm_learner.__main__.build,
                LearnerConfig(name="learner", batch_size=8, prefetch=1, learning=SMALL, **common),
            ),
            (
                gfm_actor.__main__.build,
                ActorConfig(name="actor", num_envs=4, seed=0, max_weights_age_s=5.0, **common),
            ),
        ):
            transport = MemoryTransport(self.hub, name=config.name, clock=self.clock)
            service = build(config, transport, self.clock)
            self._running[config.name] = RunningService(service, transport)

    def step(self, times: int) -> None:
        for _ in range(times):
            for running in self._running.values():
                running.step()
            self.clock.advance_s(0.01)

    def counter(self, name: str, counter: str) -> int:
        return self._running[name].status().counters[counter]

    def goes_on(self) -> None:
        """Fails where the system does not act, store, hand out and learn as before."""
        watched = [
            ("actor", "env_steps"),
            ("actor", "sequences_acked"),
            ("replay", "replay_sequences"),
            ("learner", "learner_steps"),
        ]
        before = [self.counter(*one) for one in watched]
        for _ in range(100):
            self.step(5)
            after = [self.counter(*one) for one in watched]
            if all(new > old + 3 for new, old in zip(after, before, strict=True)):
                break
        else:
            raise AssertionError(dict(zip(watched, zip(before, after, strict=True), strict=True)))
        versions = [
            self._running[name].status().gauges["weights_version"] for name in ("actor", "learner")
        ]
        assert abs(versions[0] - versions[1]) <= 4
        assert self.counter("actor", "sequences_refused") == 0


@pytest.fixture(scope="module")
def system() -> System:
    system = System()
    system.goes_on()
    return system


def names(schemas):
    return [schema.name for schema in schemas]


@pytest.mark.parametrize("schema", SCHEMAS, ids=names(SCHEMAS))
def test_the_worst_message_of_each_kind_is_well_formed_and_changes_nothing(system, schema):
    message = worst(schema)
    decode(encode(message))
    for door in DOORS:
        system.stranger.request(door, message, timeout_s=1.0)
    for name in ("replay/replay", "learner/learner", "actor/actor"):
        system.stranger.request(f"status/{name}", message, timeout_s=1.0)
    system.stranger.publish("weights", message)
    system.goes_on()


WRONG_IN_ONE_PLACE = {
    "reward": ("replay/insert", "Sequence", {"reward": 1e30}),
    "epoch": ("replay/insert", "Sequence", {"epoch": 2**62}),
    "number": ("replay/insert", "Sequence", {"number": 2**62}),
    "version": ("weights", "Weights", {"version": 10**12}),
    "life": ("weights", "Weights", {"life": 2**62}),
    "zeros": ("weights", "Weights", {"tensors": 0.0}),
    "batch_size": ("replay/sample", "SampleRequest", {"batch_size": 10**12}),
}


@pytest.mark.parametrize(
    ("key", "kind", "change"), WRONG_IN_ONE_PLACE.values(), ids=WRONG_IN_ONE_PLACE
)
def test_a_message_of_the_system_itself_with_one_harmful_value_changes_nothing(
    system, key, kind, change
):
    message = heard(system, key, kind)
    system_says = changed(message, change)
    if key == "weights":
        system.stranger.publish(key, system_says)
    else:
        system.stranger.request(key, system_says, timeout_s=1.0)
    system.goes_on()


ANSWERS = [
    ("replay/insert", "SequenceAck"),
    ("replay/insert", "Refusal"),
    ("replay/sample", "Batch"),
    ("replay/sample", "NotReady"),
    ("replay/sample", "Refusal"),
    ("weights/current", "Weights"),
    ("weights/current", "Refusal"),
]


@pytest.mark.parametrize(("key", "kind"), ANSWERS)
def test_one_hostile_answer_in_place_of_the_true_one_changes_nothing_for_long(system, key, kind):
    (schema,) = (schema for schema in SCHEMAS if schema.name == kind)
    body = encode(worst(schema), Stamp(sender="broken", epoch=1))
    answered = []

    def broken(at, sent):
        with suppress(WireError):
            if at == key and not answered and is_answer(decode(sent)):
                answered.append(at)
                return body
        return sent

    rumour = changed(heard(system, "weights", "Weights"), {"version": 10**12})
    system.hub.tamper = broken
    system.stranger.publish("weights", rumour)  # about which the learner is asked
    for _ in range(100):
        system.step(1)
    system.hub.tamper = lambda _key, sent: sent
    assert answered == [key]
    refused = system.counter("actor", "sequences_refused")
    assert refused <= (key, kind).count("Refusal")
    system._running["actor"]._service._outbox.refused = 0
    system.goes_on()


def is_answer(message):
    return type(message).__name__ in {"SequenceAck", "Batch", "NotReady", "Weights", "Refusal"}


def heard(system, key, kind):
    """Returns a message that the system itself sends under a key."""
    found = []

    def listen(at, sent):
        if at == key and type(message := decode(sent)).__name__ == kind:
            found.append(message)
        return sent

    system.hub.tamper = listen
    while not found:
        system.step(1)
    system.hub.tamper = lambda _key, sent: sent
    return found[-1]


def changed(message, change):
    ((name, value),) = change.items()
    old = getattr(message, name)
    if name == "tensors":
        return replace(message, tensors={at: tensor * 0.0 for at, tensor in old.items()})
    return replace(message, **{name: value if isinstance(old, int) else old * 0.0 + value})
