"""Kills a replay service again and again, and counts what of the acknowledged is lost or doubled.

    python benchmarks/replay_kills.py --kills 20 --seed 0 --folder /tmp/kills

The service is a process of its own that keeps its sequences in the folder; an actor's outbox sends
to it over zenoh as fast as it acknowledges. It is killed (SIGKILL) at random times. Between two
lives of it the folder is compared with the outbox's own books: whatever was acknowledged must be
there, once, and what is there must be what was sent.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gfm.core import EnvironmentSpec, MonotonicClock, Sequence, Status
from gfm.launch import free_endpoint
from gfm.service.refusals import Refusals
from gfm.transport import ZenohTransport, ask
from gfm_actor.outbox import Outbox
from gfm_replay.journal import Journal
from gfm_wire import RunEnvironment, SampleRequest, StatusRequest

SPEC = EnvironmentSpec(name="kills", observation_size=24, action_size=7)
RUN, STEPS, WINDOW = "kills", 10, 64
SHORTEST_S, LONGEST_S, PATIENCE_S = 0.05, 0.6, 180.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of the sequences.

    Attributes:
        acknowledged: By any life of the service.
        lost: Acknowledged, and not in the folder after a kill.
        doubled: More than once in the folder after a kill.
        wrong: In the folder with other values than were sent.
        given_up: Numbers that the last life of the service believes to be lost.
    """

    acknowledged: int
    lost: int
    doubled: int
    wrong: int
    given_up: int


class Actor:
    """An outbox that is never empty, and somebody who says what the run learns for."""

    def __init__(self, endpoint: str) -> None:
        self.clock = MonotonicClock()
        self.transport = ZenohTransport.open(
            run=RUN, name="actor", listen=[endpoint], insecure=True
        )
        self._learner = self.transport.serve("run/environment")
        self.outbox = Outbox(self.transport, self.clock, Refusals(), window=WINDOW, timeout_s=1.0)
        self._epoch = self.clock.utc_ns()
        self._sampled: object | None = None

    def step(self, *, send: bool) -> None:
        """Sends what fits into the window, takes in answers, and asks for a batch now and then."""
        while (request := self._learner.receive()) is not None:
            request.reply(RunEnvironment(name=SPEC.name, settings="{}", spec=SPEC))
        self.outbox.poll()
        if send and self.outbox.has_room(WINDOW // 2):
            for _ in range(WINDOW // 2):
                self.outbox.send(sequence(self._epoch, self.outbox.sent))
            request = SampleRequest(batch_size=8, spec_digest=SPEC.digest)
            self._sampled = self.transport.request("replay/sample", request, timeout_s=1.0)
        self.clock.sleep_until_ns(self.clock.now_ns() + 200_000)

    def acknowledged(self) -> set[int]:
        """Returns the numbers of what has arrived, as far as the actor knows."""
        return set(range(self.outbox.sent)) - self.outbox.waiting


def sequence(epoch: int, number: int) -> Sequence:
    """Returns a sequence whose values tell its number."""
    value = float(number % 1000)
    return Sequence(
        actor="actor",
        epoch=epoch,
        number=number,
        weights_life=1,
        weights_version=number,
        spec_digest=SPEC.digest,
        observation=np.full((STEPS + 1, SPEC.observation_size), value, np.float32),
        action=np.full((STEPS, SPEC.action_size), value, np.float32),
        reward=np.full(STEPS, value, np.float32),
        discount=np.ones(STEPS, np.float32),
        log_prob=np.full(STEPS, value, np.float32),
    )


def start(endpoint: str, folder: Path, capacity_mib: int = 128) -> subprocess.Popen[bytes]:
    """Returns a new process of the service."""
    settings = ("--folder", str(folder), "--capacity-mib", str(capacity_mib), "--min-size", "1")
    where = ("--connect", endpoint, "--run", RUN, "--name", "replay", "--log-level", "warning")
    return subprocess.Popen([sys.executable, "-m", "gfm_replay", *where, *settings])


def until_answered(actor: Actor) -> None:
    """Returns when one more sequence was acknowledged."""
    before, deadline_s = actor.outbox.acked, time.monotonic() + PATIENCE_S
    while actor.outbox.acked == before:
        actor.step(send=True)
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"no acknowledgement within {PATIENCE_S} s: {actor.outbox.note}")


def stored(folder: Path) -> list[tuple[int, bool]]:
    """Returns the number of every sequence in the folder, and whether it is as it was sent."""
    journal = Journal(folder)
    kept = journal.open()
    journal.close()
    if kept is None:
        return []
    fields = ("observation", "action", "reward", "log_prob")
    as_sent = np.ones(len(kept.records), bool)
    for name in fields:
        values = kept.records[name].reshape(len(kept.records), -1)
        as_sent &= (values == (kept.records["number"] % 1000)[:, None]).all(axis=1)
    return list(zip(kept.records["number"].tolist(), as_sent.tolist(), strict=True))


def run(kills: int, seed: int, folder: Path) -> Outcome:
    """Returns what became of the sequences over so many kills."""
    rng, endpoint = np.random.default_rng(seed), free_endpoint()
    actor = Actor(endpoint)
    lost: set[int] = set()
    doubled = wrong = 0
    for life in itertools.count():
        process = start(endpoint, folder)
        try:
            until_answered(actor)
            end_s = time.monotonic() + rng.uniform(SHORTEST_S, LONGEST_S)
            while time.monotonic() < end_s:
                actor.step(send=True)
            if life == kills:
                given_up = _finish(actor)
                break
        finally:
            process.kill()
            process.wait()
        actor.outbox.poll()
        acknowledged, found = actor.acknowledged(), stored(folder)
        numbers = [number for number, _ in found]
        lost |= acknowledged - set(numbers)
        doubled = max(doubled, len(numbers) - len(set(numbers)))
        wrong = max(wrong, sum(not as_sent for _, as_sent in found))
    found = stored(folder)
    numbers = [number for number, _ in found]
    lost |= actor.acknowledged() - set(numbers)
    actor.transport.close()
    return Outcome(
        acknowledged=actor.outbox.acked,
        lost=len(lost),
        doubled=max(doubled, len(numbers) - len(set(numbers))),
        wrong=max(wrong, sum(not as_sent for _, as_sent in found)),
        given_up=given_up,
    )


def _finish(actor: Actor) -> int:
    """Waits until all is acknowledged; returns what the service counts as lost."""
    while len(actor.outbox):
        actor.step(send=False)
    return status(actor).counters["given_up"]


def status(actor: Actor) -> Status:
    """Returns what the service says of itself."""
    key, request = "status/replay/replay", StatusRequest()
    answer = ask(actor.transport, key, request, timeout_s=10.0, clock=actor.clock)
    assert isinstance(answer, Status)
    return answer


def main() -> None:
    """Runs it and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the times of the kills")
    parser.add_argument("--folder", type=Path, required=True, help="new, for the sequences")
    asked = parser.parse_args()
    outcome = run(asked.kills, asked.seed, asked.folder)
    print(
        f"| {asked.kills} kills, seed {asked.seed} | {outcome.acknowledged} acknowledged | "
        f"{outcome.lost} lost | {outcome.doubled} doubled | {outcome.wrong} with other values | "
        f"{outcome.given_up} believed lost |"
    )


if __name__ == "__main__":
    main()
