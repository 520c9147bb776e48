"""What the robot bridge lets through, judged in the simulated robot's own physics.

    python benchmarks/bridge_safety.py --commands 1000000 --tries 100 --out results.md
    python benchmarks/bridge_safety.py --commands 3000 --hidden payload_1kg payload_3kg late

Bridge, simulated Sawyer and a hostile driver in one process, on the wall clock's path with a clock
that is moved by hand. The arm is watched at every step of its integrator: positions against the
joints' ranges, speeds against the allowed share of their limits, accelerations against theirs,
distances to the sides of the workspace, to basket and ground, and to itself. Then it is stopped
from 5 % and from 50 % of its speed limits, in every mode and in every way.

The bridge believes in a plate in the arm's hand and a basket in front of it, and distances are
those of that cell; the arm that moves has neither: nothing holds it where it comes too near.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bridge_geometry import TARGETS, Geometry
from bridge_rig import LIMITS, Rig, Setting

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.sawyer import READY
from gfm_robot_bridge.simulated.hidden import GivenEffect, given
from gfm_wire import ScaleSpeed, StopRobot

_STANDS_S = 0.15


# Hostile commands


@dataclass(kw_only=True)
class Hostility:
    """A way to be hostile for a while.

    Attributes:
        kind: Of its commands; None: another one each time.
        values: From the time since it began and the arm's position, what is commanded.
        number: What is added to the next number.
        age_s: How old the stamps are.
        burst: Commands per period.
    """

    kind: CommandKind | None
    values: Callable[[float, Array], Array]
    number: int = 0
    age_s: float = 0.0
    burst: int = 1


def scale_of(kind: CommandKind, position: Array) -> tuple[Array, Array]:
    """Returns the middle and the size of commands of a kind, shape (7,) each."""
    if kind is CommandKind.POSITION:
        return position, 0.5 * (LIMITS.upper - LIMITS.lower)
    size = LIMITS.velocity if kind is CommandKind.VELOCITY else LIMITS.effort
    return np.zeros(7), size


WAYS = (
    "random",
    "small",
    "flipping",
    "oscillating",
    "drifting",
    "huge",
    "nan",
    "stale",
    "reordered",
    *TARGETS,
)


def hostility(
    rng: np.random.Generator, way: str, kind: CommandKind | None, geometry: Geometry | None
) -> Hostility:
    """Returns one way to be hostile; of a kind of command, or of all mixed."""
    if way in TARGETS and geometry is not None:
        return aimed(rng, way, kind, geometry)
    sign, frequency = rng.choice([-1.0, 1.0], 7), 10.0 ** rng.uniform(-0.5, 1.4)
    phase, size = rng.uniform(0.0, 2 * np.pi, 7), 10.0 ** rng.uniform(-1.5, 1.0)

    def values(time_s: float, position: Array) -> Array:
        chosen = kind or list(CommandKind)[int(rng.integers(3))]
        middle, unit = scale_of(chosen, position)
        shapes = {
            "random": lambda: rng.uniform(-3.0, 3.0, 7),
            "small": lambda: 0.1 * rng.standard_normal(7),
            "flipping": lambda: rng.choice([-1e3, 1e3], 7),
            "oscillating": lambda: size * np.sign(np.sin(2 * np.pi * frequency * time_s + phase)),
            "drifting": lambda: sign * min(0.02 + 0.2 * time_s, size),
            "huge": lambda: rng.choice([-1e9, 1e308, 1e-308, -1e12], 7),
            "nan": lambda: np.where(rng.random(7) < 0.5, np.nan, np.inf),
        }
        shape = shapes.get(way, shapes["random"])()
        return np.asarray(middle + unit * shape if way not in ("huge", "nan") else shape)

    found = Hostility(kind=kind, values=values, burst=int(rng.choice([1, 1, 1, 5])))
    if way == "stale":
        found.age_s = float(rng.choice([0.0, 0.1, 0.3, 100.0, -5.0]))
    if way == "reordered":
        found.number = -int(rng.integers(1, 50))
    return found


def aimed(
    rng: np.random.Generator, target: str, kind: CommandKind | None, geometry: Geometry
) -> Hostility:
    """Returns commands that lead a link straight to a target, slowly or too fast."""
    choice, speed_m_s = rng.random(4), 10.0 ** rng.uniform(-2.0, 0.7)

    def values(time_s: float, position: Array) -> Array:
        chosen = kind or list(CommandKind)[int(rng.integers(3))]
        speed = speed_m_s * geometry.speed_towards(target, position, choice)
        sizes = {
            CommandKind.POSITION: position + 0.2 * speed * min(time_s + 0.1, 1.0),
            CommandKind.VELOCITY: speed,
            CommandKind.EFFORT: 20.0 * speed,
        }
        return np.asarray(sizes[chosen])

    return Hostility(kind=kind, values=values, burst=int(rng.choice([1, 1, 1, 5])))


def attack(rig: Rig, commands: int, rng: np.random.Generator) -> Counter[str]:
    """Sends hostile commands; returns how many of each way."""
    sent: Counter[str] = Counter()
    period_s = rig.config.period_ns * 1e-9
    kinds: list[CommandKind | None] = [*CommandKind, None]
    while sum(sent.values()) < commands:
        way = str(rng.choice(WAYS))
        one = hostility(rng, way, kinds[int(rng.integers(len(kinds)))], rig.geometry)
        rig.number = 0
        for step in range(int(rng.uniform(0.2, 3.0) / period_s)):
            for _ in range(one.burst):
                kind = one.kind or list(CommandKind)[int(rng.integers(3))]
                number = max(rig.number + one.number, 1) if one.number and step % 2 else None
                values = one.values(step * period_s, rig.arm.position)
                rig.send(kind, values, number=number, age_s=one.age_s if step % 3 else 0.0)
                sent[way] += 1
            rig.pass_time(period_s)
    return sent


# Stops

CAUSES = ("driver silent", "stopped by request", "scaled to zero", "bridge closed", "bridge killed")


@dataclass(frozen=True, kw_only=True)
class Stop:
    """What came of one stop: s until the arm was still, highest deceleration by its limit."""

    time_s: float
    slowed: float


def stop_once(folder: Path, kind: CommandKind, share: float, cause: str, seed: int) -> Stop:
    """Drives all joints at a share of their speed limits, and has that stopped."""
    rng = np.random.default_rng([seed, 17])
    # A little more than half is allowed, so that from half of the limit can be stopped at all.
    # Nor does it know any geometry, which would keep some from getting that fast.
    control_hz = float(rng.choice([20.0, 50.0, 100.0, 200.0]))
    setting = Setting(control_hz=control_hz, share=0.6, guarded=False, judged=False)
    rig = Rig(folder, setting, seed)
    drive = _driving(rig, kind, share, rng)
    for _ in range(round(rng.uniform(0.5, 0.7) * rig.config.control_hz)):
        drive()
    rig.pass_time(rng.uniform(0.0, 1.0 / rig.config.control_hz))
    rig.arm.slowed, began_s = 0.0, rig.arm.time_s
    goes_on, period_s = _stop(rig, cause), rig.config.period_ns * 1e-9
    while rig.arm.time_s - max(rig.arm.moved_s, began_s) < _STANDS_S:
        if goes_on:
            drive()
        else:
            rig.pass_time(period_s)
    return Stop(time_s=max(rig.arm.moved_s - began_s, 0.0), slowed=rig.arm.slowed)


def _driving(
    rig: Rig, kind: CommandKind, share: float, rng: np.random.Generator
) -> Callable[[], None]:
    """Returns what sends the next command of a motion at constant speed."""
    away = np.where(READY > 0.5 * (LIMITS.lower + LIMITS.upper), -1.0, 1.0)  # noqa: SIM300
    speed = share * LIMITS.velocity * away * np.where(rng.random(7) < 0.3, -1.0, 1.0)
    period_s = rig.config.period_ns * 1e-9
    target = rig.arm.position

    def drive() -> None:
        nonlocal target
        target = target + speed * period_s
        seen = rig.newest()
        slow = speed - (np.zeros(7) if seen is None else seen.velocity)
        values = {
            CommandKind.VELOCITY: speed,
            CommandKind.POSITION: target,
            CommandKind.EFFORT: 15.0 * slow,
        }
        rig.send(kind, values[kind])
        rig.pass_time(period_s)

    return drive


def _stop(rig: Rig, cause: str) -> bool:
    """Has the robot stopped; returns whether its driver goes on meanwhile."""
    match cause:
        case "stopped by request":
            rig.ask("robot/stop", StopRobot(reason="tried"))
        case "scaled to zero":
            rig.ask("robot/speed", ScaleSpeed(scale=0.0))
        case "bridge killed":
            rig.bridge_lives = False
        case "bridge closed":
            rig.close_bridge()
    return cause == "scaled to zero"


# Results


def _payload(mass: float) -> GivenEffect:
    where = {"com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    return GivenEffect(effect="payload", parameters={"mass": mass} | where)


#: Which share of the commands comes at which rate.
RATES = ((0.1, 20.0), (0.2, 50.0), (0.3, 100.0), (0.4, 200.0))
#: What robots may hide.
HIDDEN = {
    "payload_1kg": _payload(1.0),
    "payload_3kg": _payload(3.0),
    "gain": GivenEffect(effect="actuator_gain", joints=("right_j1",), parameters={"scale": 1.2}),
    "late": GivenEffect(effect="command_delay", parameters={"delay": 0.03}),
}


def commit() -> str:
    """Returns what this ran on."""
    words = ("git", "rev-parse", "--short", "HEAD")
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def attack_lines(folder: Path, commands: int, setting: Setting, name: str, seed: int) -> list[str]:
    """Attacks in one setting; returns rows of a table."""
    rig = Rig(folder, setting, seed)
    began_s = time.monotonic()
    sent = attack(rig, commands, np.random.default_rng([seed, int(setting.control_hz)]))
    took_s, worst = time.monotonic() - began_s, rig.arm.worst
    counters = rig.bridge.status().counters
    spent = " and ".join(f"{1e3 * float(np.quantile(rig.spent_s, p)):.2f}" for p in (0.5, 0.99))
    print(
        f"{name}, {setting.control_hz:g} Hz: {dict(sent)}, {counters['workspace_limits']} "
        f"limited by the workspace, {counters['collision_limits']} by collisions, "
        f"{counters['stalls']} stalls, {counters['lost_clearances']} lost clearances, "
        f"{took_s:.0f} s; a period takes the bridge {spent} ms (p50, "
        "p99)",
        flush=True,
    )
    return [
        f"| {name} | {setting.control_hz:g} | {sum(sent.values()):,} | {kind} | "
        f"{worst['speed', kind]:.3f} | {worst['acceleration', kind]:.3f} | "
        f"{worst['past_end_rad', kind]:.3f} | "
        + " | ".join(f"{-1e3 * worst[target, kind]:.1f}" for target in TARGETS)
        + " |"
        for kind in map(str, CommandKind)
        if ("speed", kind) in worst
    ]


def stop_lines(folder: Path, tries: int, seed: int) -> list[str]:
    """Stops in every way; returns rows of a table."""
    lines: list[str] = []
    for share in (0.05, 0.5) if tries else ():
        for cause in CAUSES:
            for kind in CommandKind:
                stops = [stop_once(folder, kind, share, cause, seed + i) for i in range(tries)]
                longest = max(stop.time_s for stop in stops)
                hardest = max(stop.slowed for stop in stops)
                lines.append(f"| {share:.0%} | {cause} | {kind} | {longest:.3f} | {hardest:.2f} |")
                print(lines[-1], flush=True)
    return lines


def settings(arguments: argparse.Namespace) -> Iterator[tuple[int, Setting, str]]:
    """Yields how many commands are sent in which setting, and what the robot hides."""
    guarded = not arguments.without_geometry
    for name in arguments.hidden or ():
        setting = Setting(control_hz=50.0, guarded=guarded, effects=given((HIDDEN[name],)))
        yield arguments.commands, setting, name
    for share, control_hz in () if arguments.hidden else RATES:
        count = round(share * arguments.commands)
        yield count, Setting(control_hz=control_hz, guarded=guarded), "nothing"


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
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    seed, began_s, ran_on = arguments.seed, time.monotonic(), commit()
    with tempfile.TemporaryDirectory() as folder:
        attacks = [
            line
            for count, setting, name in settings(arguments)
            for line in attack_lines(Path(folder), count, setting, name, seed)
        ]
        stops = stop_lines(Path(folder), arguments.tries, seed)
    text = "\n".join(
        (
            f"Commit {ran_on}, seed {seed}, {time.monotonic() - began_s:.0f} s.",
            "",
            "| hidden | Hz | commands | mode | speed / limit | acceleration / limit | "
            "rad past an end | mm to the box | to basket, ground | to itself |",
            "|---|---|---|---|---|---|---|---|---|---|",
            *attacks,
            "",
            "| from | stopped by | mode | still after, s | deceleration / limit |",
            "|---|---|---|---|---|",
            *stops,
            "",
        )
    )
    if arguments.out is None:
        print(text)
    else:
        arguments.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
