"""Says what is no message, or no sensible one, under every key of a running system.

    python benchmarks/mutated_bodies.py --bodies 200000 --folder runs/mutated

Bodies that the system itself sends, and the worst well-formed ones of every kind, are damaged: in
one half bits are turned, bytes cut out, doubled, put in or exchanged, bodies joined; in the other
one value is taken out, or an odd one stands in its place. All services of a run step in one thread
and have to go on after every thousand. A chunk is made from the seed and its number alone; the
folder keeps what was done, and the same command goes on there.
Exit status 1 where anybody failed; the chunk that did it is named.
"""

from __future__ import annotations

import argparse
import json
import logging
import resource
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import msgpack
import numpy as np

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
from gfm_robot_bridge import __main__ as bridge_command
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated import __main__ as robot_command
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import CHANNELS, SCHEMAS, RobotClock, Stamp, StatusRequest, decode, encode
from hostile import worst

CHUNK = 1000
LOG = "mutated.jsonl"
ROLES = ("replay", "learner", "actor", "robot", "robot_bridge")
#: What must grow between two looks, by who counts it.
WORK = {"actor": "env_steps", "replay": "replay_sequences", "learner": "learner_steps"}
_STEPS = 400


class NoProgressError(AssertionError):
    """Somebody did not go on."""


@final
class System:
    """All services of a run but the router, and a stranger."""

    def __init__(self, folder: Path) -> None:
        self.hub, self.clock = MemoryHub(), ManualClock(10**18)
        self.stranger = MemoryTransport(self.hub, name="stranger", clock=self.clock)
        self.heard: dict[str, bytes] = {}
        self._running: dict[str, RunningService] = {}
        common = {"env": "point_mass", "environment": EnvironmentSettings(horizon=10)}
        small = LearnerSettings(policy_hidden=(4,), critic_hidden=(4,), samples=2, target_period=2)
        lockstep = RobotClock.LOCKSTEP
        made: tuple[tuple[Any, Any], ...] = (
            (gfm_replay.__main__, ReplayConfig(name="replay", min_size=8, capacity_mib=1)),
            (gfm_learner.__main__, LearnerConfig(name="learner", learning=small, **common)),
            (
                gfm_actor.__main__,
                ActorConfig(name="actor", num_envs=4, window=64, seed=0, **common),
            ),
            (robot_command, SimulatedConfig(name="robot", clock=lockstep)),
            (
                bridge_command,
                BridgeConfig(name="robot_bridge", recordings=str(folder), clock=lockstep),
            ),
        )
        self.hub.tamper = self._listen
        for module, config in made:
            transport = MemoryTransport(self.hub, name=config.name, clock=self.clock)
            service = module.build(config, transport, self.clock)
            self._running[config.name] = RunningService(service, transport)
        self.goes_on()

    def _listen(self, key: str, body: bytes) -> bytes:
        self.heard.setdefault(f"{key} {type(decode(body)).__name__}", body)
        return body

    def step(self) -> None:
        """Steps everybody once."""
        for running in self._running.values():
            running.step()
        self.clock.advance_s(0.01)

    def say(self, key: str, body: bytes, *, broadcast: bool) -> None:
        """Lets the stranger say a body under a key."""
        self.hub.tamper = lambda _key, _body: body
        if broadcast:
            self.stranger.publish(key, StatusRequest())
        else:
            self.stranger.request(key, StatusRequest(), timeout_s=0.05)
        self.hub.tamper = _untouched

    def goes_on(self) -> None:
        """Returns once all answer, and actor, replay and learner have done more than now.

        Raises:
            NoProgressError: somebody does not.
        """
        before = self._done()
        for _ in range(_STEPS):
            self.step()
            done = self._done()
            if all(done[name] > before[name] for name in WORK):
                break
        else:
            raise NoProgressError(f"{before} and then {done}")
        for name in self._running:
            self._answers(name)

    def _answers(self, name: str) -> None:
        pending = self.stranger.request(f"status/{name}/{name}", StatusRequest(), timeout_s=5.0)
        for _ in range(_STEPS):
            self.step()
            if pending.poll() is not None:
                return
        raise NoProgressError(f"{name} does not answer")

    def _done(self) -> dict[str, int]:
        return {
            name: self._running[name].status().counters[counter] for name, counter in WORK.items()
        }

    def refused(self) -> int:
        """Returns how many messages all have refused."""
        statuses = [running.status() for running in self._running.values()]
        return sum(status.counters.get("rejected_messages", 0) for status in statuses)


def _untouched(_key: str, body: bytes) -> bytes:
    return body


def mutated(body: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Returns a body with one to eight damages; `other` is what it may be joined with."""
    for _ in range(rng.integers(1, 9)):
        if not body:
            break
        at, length = int(rng.integers(len(body))), int(rng.integers(1, 17))
        before, here, after = body[:at], body[at : at + length], body[at + length :]
        turned = bytes([body[at] ^ 1 << int(rng.integers(8))])
        ways = (
            before + turned + body[at + 1 :],
            before + rng.bytes(1) + body[at + 1 :],
            before + after,
            before + rng.bytes(length) + here + after,
            before + here + here + after,
            before,
            before + other[int(rng.integers(len(other))) :],
        )
        body = ways[int(rng.integers(len(ways)))]
    return body


ODD: tuple[object, ...] = (
    *(0, -1, 2**63 - 1, -(2**63), 2**64 - 1),
    *(0.0, -1e300, float("nan"), float("inf")),
    *("", "x" * 5000, "../../etc", "\0", b"", b"\0" * 64),
    *(None, True, [], {}, [[]] * 100, {"dtype": "<f4", "shape": [2**40], "data": b""}),
)
"""Values that hardly a field takes."""


def altered(body: bytes, rng: np.random.Generator) -> bytes:
    """Returns a body that is well-packed, in which one value is odd, missing or too much."""
    whole = msgpack.unpackb(body)
    at = whole
    while True:
        places = list(at) if isinstance(at, dict) else list(range(len(at)))
        place = places[int(rng.integers(len(places)))]
        below = at[place]
        if not isinstance(below, (dict, list)) or not below or rng.random() < 0.2:
            break
        at = below
    kind = rng.integers(6)
    if kind == 0:
        del at[place]
    elif kind == 1 and isinstance(at, dict):
        at["more"] = below
    else:
        at[place] = ODD[int(rng.integers(len(ODD)))]
    return bytes(msgpack.packb(whole))


def keys() -> list[tuple[str, bool]]:
    """Returns every key that somebody listens to here, and whether it is a broadcast."""
    found = []
    for channel in CHANNELS:
        broadcast = channel.kind == "broadcast"
        if channel.key == "status/ROLE/NAME":
            found += [(f"status/{role}/{role}", broadcast) for role in ROLES]
        elif channel.key != "supervisor/NAME":
            found.append((channel.key, broadcast))
    return found


def chunk(
    system: System, seeds: list[bytes], key: tuple[str, bool], rng: np.random.Generator
) -> Counter[str]:
    """Says a chunk of bodies; returns how many were well formed, or why not."""
    found: Counter[str] = Counter()
    for number in range(CHUNK):
        body, other = (seeds[int(rng.integers(len(seeds)))] for _ in range(2))
        body = altered(body, rng) if number % 2 else mutated(body, other, rng)
        try:
            decode(body)
        except WireError as error:
            found[str(error.reason)] += 1
        else:
            found["well formed"] += 1
        system.say(key[0], body, broadcast=key[1])
        if number % 4 == 3:
            system.step()
    system.goes_on()
    return found


def done(folder: Path) -> list[dict[str, Any]]:
    """Returns what was done before."""
    path = folder / LOG
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines]


def say_all(folder: Path, chunks: int, seed: int) -> None:
    """Says what is left of the chunks, key after key."""
    system = System(folder / "recordings")
    system.hub.tamper = _untouched
    worsts = [encode(worst(schema), Stamp(sender="stranger", epoch=1)) for schema in SCHEMAS]
    seeds = [*system.heard.values(), *worsts]
    everywhere = keys()
    for number in range(len(done(folder)), chunks):
        key, began_s = everywhere[number % len(everywhere)], time.monotonic()
        before = system.refused()
        try:
            found = chunk(system, seeds, key, np.random.default_rng((seed, number)))
        except Exception:
            print(f"failed in chunk {number} under {key[0]}, seed {seed}")
            raise
        row = {
            "key": key[0],
            "found": found,
            "refused": system.refused() - before,
            "seconds": round(time.monotonic() - began_s, 2),
            "memory_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        }
        with (folder / LOG).open("a", encoding="utf-8") as log:
            log.write(json.dumps(row) + "\n")


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Returns how many bodies were what, by key."""
    by_key: dict[str, Counter[str]] = {}
    for row in rows:
        by_key.setdefault(row["key"], Counter()).update(row["found"] | {"refused": row["refused"]})
    made = [
        "| key | bodies | no message | well formed | counted as refused |",
        "|---|---|---|---|---|",
    ]
    for key, found in by_key.items():
        refused, well = found.pop("refused"), found["well formed"]
        total = found.total()
        made.append(f"| `{key}` | {total} | {total - well} | {well} | {refused} |")
    return made


def main() -> int:
    """Says them and prints what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--bodies", type=int, default=200_000)
    parser.add_argument("--folder", type=Path, required=True, help="new, or of this command")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)  # counted below
    (asked.folder / "recordings").mkdir(parents=True, exist_ok=True)
    say_all(asked.folder, -(-asked.bodies // CHUNK), asked.seed)
    rows = done(asked.folder)
    print("\n".join(table(rows)))
    reasons: Counter[str] = sum((Counter(row["found"]) for row in rows), Counter())
    print(", ".join(f"{reason} {count}" for reason, count in reasons.most_common()))
    memory = [row["memory_mib"] for row in rows]
    print(f"{len(rows) * CHUNK} bodies in {sum(row['seconds'] for row in rows):.0f} s")
    print(f"memory at most {memory[len(memory) // 10]} MiB after a tenth, {memory[-1]} in the end")
    return 0


if __name__ == "__main__":
    sys.exit(main())
