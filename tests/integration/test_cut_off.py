"""One who is cut off, and joins again from elsewhere: it and all others go on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np
import pytest
from relay import Relay

from certificates import certificates
from gfm.core import Status, UnreachableError, Weights
from gfm.launch import RunAddress, free_endpoint
from gfm.transport import PendingReply, Server, Subscription, Transport, ZenohTransport
from gfm_wire import Role, StatusRequest

LONGEST_S = 90.0
SETTLED_S = 12.0
"""By then what became of the old connection has happened: three times the lease."""

WEIGHTS = Weights(
    version=1, created_ns=1, spec_digest="d", tensors={"w": np.zeros(100_000, np.float32)}
)


def acknowledgement() -> Status:
    return Status(role="replay", name="replay", pid=1, host="h", counters={}, gauges={}, note="")


@dataclass
class Asker:
    """A client that asks replay, one question at a time, and counts its answers."""

    transport: Transport
    pending: PendingReply | None = None
    answers: int = 0

    def turn(self) -> None:
        if self.pending is None:
            self.pending = self.transport.request("replay/insert", StatusRequest(), timeout_s=2.0)
        try:
            if self.pending.poll() is not None:
                self.answers += 1
                self.pending = None
        except UnreachableError:
            self.pending = None


@dataclass
class System:
    """Router, replay and learner, an actor whose line can fall silent, and one whose can't."""

    line: Relay
    replay: Server
    learner: Transport
    actor: Asker
    neighbour: Asker
    weights: Subscription
    heard: int = 0
    sent_s: float = field(default_factory=time.monotonic)

    def turn(self) -> None:
        """Lets everybody do what there is to do; the learner sends more than a line can hold."""
        if time.monotonic() - self.sent_s > 0.05:
            self.sent_s = time.monotonic()
            self.learner.publish("weights", WEIGHTS)
        while (request := self.replay.receive()) is not None:
            request.reply(acknowledgement())
        for asker in (self.actor, self.neighbour):
            asker.turn()
        self.heard += self.weights.latest() is not None
        time.sleep(0.001)

    def go_on(self) -> None:
        """Returns once all have heard something new."""
        before = (self.actor.answers, self.neighbour.answers, self.heard)
        deadline_s = time.monotonic() + LONGEST_S
        while not all(
            now > then
            for now, then in zip(
                (self.actor.answers, self.neighbour.answers, self.heard), before, strict=True
            )
        ):
            assert time.monotonic() < deadline_s, "somebody hears nothing"
            self.turn()


@pytest.fixture(params=[False, True], ids=["tcp", "tls"])
def system(request, tmp_path) -> Iterator[System]:
    certs = str(certificates(tmp_path)) if request.param else ""
    endpoint = free_endpoint(secure=request.param)
    place, _, port = endpoint.rpartition(":")
    at = RunAddress(run="cut", endpoint=endpoint, certs=certs)
    with ExitStack() as stack:
        router = ZenohTransport.open(
            run="cut", listen=[endpoint], credentials=at.credentials(Role.ROUTER)
        )
        stack.enter_context(router)
        line = Relay(int(port))
        stack.callback(line.cut)
        away = RunAddress(run="cut", endpoint=f"{place}:{line.port}", certs=certs)
        replay, learner, actor, neighbour = (
            stack.enter_context(where.open(role, name=role))
            for where, role in (
                (at, Role.REPLAY),
                (at, Role.LEARNER),
                (away, Role.ACTOR),
                (at, Role.ACTOR),
            )
        )
        yield System(
            line=line,
            replay=replay.serve("replay/insert"),
            learner=learner,
            actor=Asker(actor),
            neighbour=Asker(neighbour),
            weights=actor.subscribe("weights"),
        )


@pytest.mark.slow
def test_one_who_was_cut_off_hears_again_for_good_and_so_do_the_others(system):
    system.go_on()
    for _ in range(2):
        system.line.hush()
        settled_s = time.monotonic() + SETTLED_S
        while time.monotonic() < settled_s:
            system.turn()
        for _ in range(3):
            system.go_on()
