"""What the robot bridge lets through, judged in the simulated robot's own physics.

    python benchmarks/bridge_safety.py --commands 1000000 --tries 100 --parts build/bridge
    python benchmarks/bridge_safety.py --commands 3000 --tries 0 --hidden payload_1kg late

Bridge, simulated Sawyer and a hostile driver in one process, on the wall clock's path with a clock
that is moved by hand. The arm is watched at every step of its integrator: positions against the
joints' ranges, speeds against the allowed share of their limits, accelerations against theirs,
distances to the sides of the workspace, to basket and ground, and to itself. Then it is stopped
from 5 % and from 50 % of its speed limits, in every mode and in every way.

The bridge believes in a plate in the arm's hand and a basket in front of it, and distances are
those of that cell; the arm that moves has neither: nothing holds it where it comes too near. Where
the bridge waits for a person's reset, the arm begins anew from where it was at first.

With --parts several processes share the work, and what was broken off goes on.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from bridge_geometry import TARGETS
from bridge_hostility import attack
from bridge_rig import Rig, Setting
from bridge_stops import CAUSES, stop_once
from parts import Part, commits, done_parts, print_or_write

from gfm.core import CommandKind
from gfm_robot_bridge.simulated.hidden import GivenEffect, given

#: Which share of the commands comes at which rate.
RATES = ((0.1, 20.0), (0.2, 50.0), (0.3, 100.0), (0.4, 200.0))
_COMMANDS_IN_A_PART = 5_000
_TRIES_IN_A_PART = 25
_COUNTED = (
    "workspace_limits",
    "collision_limits",
    "load_limits",
    "stalls",
    "heavy_loads",
    "lost_clearances",
)


def _payload(mass: float) -> GivenEffect:
    where = {"com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    return GivenEffect(effect="payload", parameters={"mass": mass} | where)


#: What robots may hide.
HIDDEN = {
    "payload_half_kg": _payload(0.5),
    "payload_1kg": _payload(1.0),
    "payload_3kg": _payload(3.0),
    "gain": GivenEffect(effect="actuator_gain", joints=("right_j1",), parameters={"scale": 1.2}),
    "friction": GivenEffect(
        effect="coulomb_friction", joints=("right_j1",), parameters={"torque": 4.5}
    ),
    "late": GivenEffect(effect="command_delay", parameters={"delay": 0.03}),
}


@dataclass(frozen=True, kw_only=True)
class Attack:
    """Hostile commands in one setting.

    Attributes:
        hidden: What the robot hides, a key of HIDDEN, or nothing.
        guarded: Whether the bridge knows any geometry.
        observed: Whether it observes the load that the arm bears.
        control_hz: Of the bridge.
        first: Number of the first command ...
        count: ... and how many there are.
    """

    hidden: str
    guarded: bool
    observed: bool
    control_hz: float
    first: int
    count: int

    @property
    def group(self) -> tuple[str, float]:
        """What belongs together in a table."""
        words = [self.hidden]
        words += [] if self.guarded else ["no geometry"]
        words += [] if self.observed else ["load not observed"]
        return ", ".join(words), self.control_hz

    def made(self, folder: Path, seed: int) -> Part:
        """Attacks; returns the worst that the arm did, and what was counted."""
        effects = given((HIDDEN[self.hidden],)) if self.hidden in HIDDEN else ()
        setting = Setting(
            control_hz=self.control_hz,
            guarded=self.guarded,
            observed=self.observed,
            effects=effects,
        )
        rng = np.random.default_rng([seed, int(self.control_hz), self.first])
        sent: Counter[str] = Counter()
        counters: Counter[str] = Counter(dict.fromkeys((*_COUNTED, "resets"), 0))
        worst: dict[str, float] = {}
        spent_us: list[int] = []
        while (left := self.count - sum(sent.values())) > 0:
            rig = Rig(folder, setting, int(rng.integers(2**31)))
            sent += attack(rig, left, rng)
            told = rig.bridge.status().counters
            counters.update({name: told[name] for name in _COUNTED})
            counters["resets"] += rig.waits_for_reset
            spent_us += [round(1e6 * spent_s) for spent_s in rig.spent_s]
            found = {f"{name} {kind}": value for (name, kind), value in rig.arm.worst.items()}
            worst = _worst((worst, found))
        return {"sent": dict(sent), "counters": counters, "worst": worst, "spent_us": spent_us}


@dataclass(frozen=True, kw_only=True)
class Stops:
    """Stops of one kind; see `stop_once`."""

    share: float
    cause: str
    kind: CommandKind
    first: int
    count: int

    @property
    def group(self) -> tuple[str, str, str]:
        """What belongs together in a table."""
        return f"{self.share:.0%}", self.cause, str(self.kind)

    def made(self, folder: Path, seed: int) -> Part:
        """Stops; returns the longest time, s, and the highest deceleration by its limit."""
        numbers = range(seed + self.first, seed + self.first + self.count)
        stops = [stop_once(folder, self.kind, self.share, self.cause, i) for i in numbers]
        return {
            "time_s": max(stop.time_s for stop in stops),
            "slowed": max(stop.slowed for stop in stops),
            "tries": len(stops),
        }


Work = Attack | Stops


def _worst(found: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Returns the largest of each value."""
    worst: dict[str, float] = {}
    for one in found:
        for name, value in one.items():
            worst[name] = max(value, worst.get(name, value))
    return worst


def attacks(arguments: argparse.Namespace) -> Iterator[Attack]:
    """Yields the attacks that were asked for, the rates one after the other."""
    settings = [(arguments.commands, name, 50.0) for name in arguments.hidden or ()]
    if not arguments.hidden:
        settings = [(round(share * arguments.commands), "nothing", hz) for share, hz in RATES]
    for commands, hidden, hz in settings:
        for first in range(0, commands, _COMMANDS_IN_A_PART):
            yield Attack(
                hidden=hidden,
                guarded=not arguments.without_geometry,
                observed=not arguments.without_load,
                control_hz=hz,
                first=first,
                count=min(_COMMANDS_IN_A_PART, commands - first),
            )


def stops(tries: int) -> Iterator[Stops]:
    """Yields all kinds of stops, so often each."""
    for share in (0.05, 0.5):
        for cause in CAUSES:
            for kind in CommandKind:
                for first in range(0, tries, _TRIES_IN_A_PART):
                    count = min(_TRIES_IN_A_PART, tries - first)
                    yield Stops(share=share, cause=cause, kind=kind, first=first, count=count)


def named(work: Work, seed: int) -> str:
    """Returns the name of a part: a file's name."""
    words = "_".join(str(word) for word in work.group).replace(", ", "_").replace(" ", "_")
    return f"seed_{seed}_{words}_{work.first}_to_{work.first + work.count}".replace("%", "")


def attack_lines(group: tuple[str, float], parts: Sequence[Part]) -> list[str]:
    """Returns the rows of a table, one for each mode of the servo."""
    worst = _worst(part["worst"] for part in parts)
    sent = sum(sum(part["sent"].values()) for part in parts)
    return [
        f"| {group[0]} | {group[1]:g} | {sent:,} | {kind} | {worst[f'speed {kind}']:.3f} | "
        f"{worst[f'acceleration {kind}']:.3f} | {worst[f'past_end_rad {kind}']:.3f} | "
        + " | ".join(f"{-1e3 * worst[f'{target} {kind}']:.1f}" for target in TARGETS)
        + " |"
        for kind in map(str, CommandKind)
        if f"speed {kind}" in worst
    ]


def count_line(group: tuple[str, float], parts: Sequence[Part]) -> str:
    """Returns a row of what was counted, and of the bridge's processor time."""
    counted: Counter[str] = Counter()
    for part in parts:
        counted.update(part["counters"])
    spent_ms = 1e-3 * np.concatenate([part["spent_us"] for part in parts])
    numbers = " | ".join(f"{counted[name]:,}" for name in (*_COUNTED, "resets"))
    typical, most = np.quantile(spent_ms, (0.5, 0.99))
    return f"| {group[0]} | {group[1]:g} | {numbers} | {typical:.2f} | {most:.2f} |"


def stop_line(group: tuple[str, str, str], parts: Sequence[Part]) -> str:
    """Returns a row of the stops of one kind."""
    longest, hardest = (max(part[name] for part in parts) for name in ("time_s", "slowed"))
    tries = sum(part["tries"] for part in parts)
    return f"| {' | '.join(group)} | {tries} | {longest:.3f} | {hardest:.2f} |"


def report(done: Mapping[Work, Part], seed: int, ran_on: str) -> str:
    """Returns tables in Markdown."""
    attacked: dict[tuple[str, float], list[Part]] = {}
    stopped: dict[tuple[str, str, str], list[Part]] = {}
    for work, part in done.items():
        if isinstance(work, Attack):
            attacked.setdefault(work.group, []).append(part)
        else:
            stopped.setdefault(work.group, []).append(part)
    lines = [
        f"Commit {ran_on}, seed {seed}.",
        "",
        "| hidden | Hz | commands | mode | speed / limit | acceleration / limit | "
        "rad past an end | mm to the box | to basket, ground | to itself |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *(line for group, parts in attacked.items() for line in attack_lines(group, parts)),
        "",
        "| hidden | Hz | limited by the workspace | by collisions | by a load | stalls | "
        "too heavy | lost clearances | resets | ms of a period, p50 | p99 |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *(count_line(group, parts) for group, parts in attacked.items()),
        "",
        "| from | stopped by | mode | tries | still after, s | deceleration / limit |",
        "|---|---|---|---|---|---|",
        *(stop_line(group, parts) for group, parts in stopped.items()),
        "",
    ]
    return "\n".join(lines)


def _timed(make: Callable[[], Part], name: str) -> Part:
    began_s = time.monotonic()
    part = make()
    print(f"{name}: {time.monotonic() - began_s:.0f} s", flush=True)
    return part


def main() -> None:
    """Attacks, stops, and writes what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--commands",
        type=int,
        default=20_000,
        help="in all, over four rates, or for each that is hidden",
    )
    parser.add_argument("--tries", type=int, default=3, help="of each stop, or 0")
    parser.add_argument(
        "--hidden", nargs="+", choices=HIDDEN, help="attack robots that hide these, at 50 Hz"
    )
    parser.add_argument(
        "--without-geometry", action="store_true", help="attack a bridge that knows none"
    )
    parser.add_argument(
        "--without-load", action="store_true", help="attack a bridge that observes no load"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--parts", type=Path, help="where parts are kept (default: nowhere)")
    parser.add_argument(
        "--no-work", action="store_true", help="only report the parts that are done"
    )
    parser.add_argument("--shuffled", action="store_true", help="parts in random order")
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    seed = arguments.seed
    works = {named(work, seed): work for work in (*attacks(arguments), *stops(arguments.tries))}
    names = list(works)
    if arguments.shuffled:
        np.random.default_rng(seed).shuffle(names)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)

        def do(name: str) -> Part:
            return _timed(partial(works[name].made, folder / "recordings", seed), name)

        parts = done_parts(
            arguments.parts or folder / "parts", names, None if arguments.no_work else do
        )
    done = {work: parts[name] for name, work in works.items() if name in parts}
    text = report(done, seed, commits(parts))
    print_or_write(text, arguments.out)


if __name__ == "__main__":
    main()
