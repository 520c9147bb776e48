"""What the robot bridge lets through, judged in the simulated robot's own physics.

    python benchmarks/bridge_safety.py --commands 1000000 --tries 100 --out results.md

Bridge, simulated Sawyer and a hostile driver in one process, on the wall clock's path with a clock
that is moved by hand. The arm is watched at every step of its integrator: positions against the
joints' ranges, speeds against the allowed share of their limits, accelerations against theirs.
Then it is stopped from 5 % and from 50 % of its speed limits, in every mode and in every way.
"""

from __future__ import annotations

import argparse
import logging
import math
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Clock, Command, CommandKind, ManualClock, Observation
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.transport import MemoryHub, MemoryTransport, PendingReply
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.mechanics import Mechanics
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_robot_bridge.simulated.service import SimulatedService
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import Message, RobotClock, ScaleSpeed, StopRobot

LIMITS = sawyer_limits()
_SHARE = 0.5
_STILL = 0.01
_STEP_S = 2e-3
_STANDS_S = 0.15


@final
class WatchedArm(Mechanics):
    """The simulated arm, and the worst that it did.

    Attributes:
        worst: By name and by the mode that the servo was in: speed and acceleration over the
            robot's limits, and how far beyond the end of a range, rad (negative: before it).
        slowed: Highest deceleration by its limit since it was last set to 0.
        time_s: Of the arm.
        moved_s: When it moved last, at more than 1 % of a limit.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self.servo = arm.servo
        self.worst: dict[tuple[str, str], float] = {}
        self.slowed = self.time_s = self.moved_s = 0.0

    @property
    @override
    def position(self) -> Array:
        return self._arm.position

    @property
    @override
    def velocity(self) -> Array:
        return self._arm.velocity

    @property
    @override
    def object_pose(self) -> Array | None:
        return self._arm.object_pose

    @override
    def put_object(self, pose: Array) -> None:
        self._arm.put_object(pose)

    @override
    def drive(self) -> Array:
        return self._arm.drive()

    @override
    def step(self, h: float) -> None:
        before = self._arm.velocity
        self._arm.step(h)
        if h <= 0.0:
            return
        q, v = self._arm.position, self._arm.velocity
        a = (v - before) / h
        self.time_s += h
        if (np.abs(v) >= _STILL * LIMITS.velocity).any():
            self.moved_s = self.time_s
        past = np.maximum(LIMITS.lower - q, q - LIMITS.upper).max()
        self._note("speed", np.abs(v / LIMITS.velocity).max())
        self._note("acceleration", np.abs(a / LIMITS.acceleration).max())
        self._note("past_end_rad", past)
        slowing = np.where(a * v < 0.0, np.abs(a) / LIMITS.acceleration, 0.0)
        self.slowed = max(self.slowed, float(slowing.max()))

    def _note(self, name: str, value: float) -> None:
        key = (name, str(self.servo.kind))
        self.worst[key] = max(self.worst.get(key, -np.inf), float(value))


@final
class Waits(Clock):
    """The clock of a bridge that may wait for its robot, which goes on meanwhile."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @override
    def now_ns(self) -> int:
        return self._rig.clock.now_ns()

    @override
    def utc_ns(self) -> int:
        return self._rig.clock.utc_ns()

    @override
    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._rig.clock.sleep_until_ns(deadline_ns)
        self._rig.robot.step()


@final
class Rig:
    """Driver, bridge and robot in one thread; the clock moves when told to."""

    def __init__(self, folder: Path, control_hz: float, seed: int, share: float = _SHARE) -> None:
        self.clock, hub = ManualClock(10**9), MemoryHub()
        self.watched: list[WatchedArm] = []
        config = BridgeConfig(
            name="bridge",
            clock=RobotClock.WALL,
            control_hz=control_hz,
            recordings=str(folder),
            velocity_share=share,
        )
        self.config = config
        transport = MemoryTransport(hub, name="bridge", clock=self.clock)
        sawyer = SimulatedSawyer(transport, self.clock, robot_clock=RobotClock.WALL)
        self.bridge = BridgeService(config, sawyer, transport, Waits(self))
        robot = SimulatedRobot(READY, seed=seed, mechanics=self._watch)
        self.robot = SimulatedService(
            SimulatedConfig(name="robot", clock=RobotClock.WALL),
            robot,
            MemoryTransport(hub, name="robot", clock=self.clock),
            self.clock,
        )
        self._driver = MemoryTransport(hub, name="driver", clock=self.clock)
        self.observations = self._driver.subscribe("robot/observation")
        self.bridge_lives = True
        self.number = 0
        self.pass_time(2.0 / control_hz)

    def ask(self, key: str, message: Message) -> None:
        """Sends something else."""
        self._driver.request(key, message, timeout_s=1.0)

    @property
    def arm(self) -> WatchedArm:
        """The arm."""
        return self.watched[0]

    def _watch(self, position: Array, effects: tuple[HiddenEffect, ...], cell: Cell) -> Mechanics:
        self.watched.append(WatchedArm(Arm(position, effects, cell)))
        return self.watched[0]

    def pass_time(self, seconds: float) -> None:
        """Lets time pass for all, in steps of at most two milliseconds."""
        steps = math.ceil(seconds / _STEP_S - 1e-9)
        for _ in range(steps):
            self.clock.advance_s(seconds / steps)
            self._work()

    def _work(self) -> None:
        for _ in range(8):
            worked = self.robot.step()
            if self.bridge_lives:
                worked |= self.bridge.step()
            if not worked:
                return

    def close_bridge(self) -> None:
        """Closes the bridge, which is stepped no more after that."""
        self.bridge.close()
        self.bridge_lives = False

    def send(
        self, kind: CommandKind, values: Array, *, number: int | None = None, age_s: float = 0.0
    ) -> PendingReply:
        """Sends one command."""
        command = Command(
            kind=kind,
            joint_names=JOINT_NAMES,
            values=values,
            stamp_ns=self.clock.utc_ns() - round(age_s * 1e9),
            number=self.number if number is None else number,
        )
        self.number += number is None
        return self._driver.request("robot/command", command, timeout_s=1.0)

    def newest(self) -> Observation | None:
        """Returns the newest observation that the driver sees."""
        seen = self.observations.latest()
        return seen if isinstance(seen, Observation) else None


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
)


def hostility(rng: np.random.Generator, way: str, kind: CommandKind | None) -> Hostility:
    """Returns one way to be hostile; of a kind of command, or of all mixed."""
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


def attack(rig: Rig, commands: int, rng: np.random.Generator) -> Counter[str]:
    """Sends hostile commands; returns how many of each way."""
    sent: Counter[str] = Counter()
    period_s = rig.config.period_ns * 1e-9
    kinds: list[CommandKind | None] = [*CommandKind, None]
    while sum(sent.values()) < commands:
        way = str(rng.choice(WAYS))
        one = hostility(rng, way, kinds[int(rng.integers(len(kinds)))])
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
    rig = Rig(folder, float(rng.choice([20.0, 50.0, 100.0, 200.0])), seed, share=0.6)
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


def commit() -> str:
    """Returns what this ran on."""
    words = ("git", "rev-parse", "--short", "HEAD")
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()


def attack_lines(folder: Path, commands: int, control_hz: float, seed: int) -> list[str]:
    """Attacks at one rate; returns rows of a table."""
    rig = Rig(folder, control_hz, seed)
    began_s = time.monotonic()
    sent = attack(rig, commands, np.random.default_rng([seed, int(control_hz)]))
    took_s, worst = time.monotonic() - began_s, rig.arm.worst
    print(f"{control_hz:g} Hz: {dict(sent)}, {took_s:.0f} s", flush=True)
    return [
        f"| {control_hz:g} | {sum(sent.values()):,} | {kind} | {worst['speed', kind]:.3f} | "
        f"{worst['acceleration', kind]:.3f} | {worst['past_end_rad', kind]:.3f} |"
        for kind in map(str, CommandKind)
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


def main() -> None:
    """Attacks, stops, and writes what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, default=20_000, help="in all, over four rates")
    parser.add_argument("--tries", type=int, default=3, help="of each stop, or 0")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    seed, began_s, ran_on = arguments.seed, time.monotonic(), commit()
    with tempfile.TemporaryDirectory() as folder:
        attacks = [
            line
            for share, control_hz in ((0.1, 20.0), (0.2, 50.0), (0.3, 100.0), (0.4, 200.0))
            for line in attack_lines(
                Path(folder), round(share * arguments.commands), control_hz, seed
            )
        ]
        stops = stop_lines(Path(folder), arguments.tries, seed)
    text = "\n".join(
        (
            f"Commit {ran_on}, seed {seed}, {time.monotonic() - began_s:.0f} s.",
            "",
            "| Hz | commands | mode | speed / limit | acceleration / limit | rad past an end |",
            "|---|---|---|---|---|---|",
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
