"""Hostile commands to the robot bridge, in many ways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from bridge_geometry import TARGETS, Geometry
from bridge_rig import LIMITS, Rig

from gfm.core import CommandKind
from gfm.core.checks import Array


@dataclass(kw_only=True)
class Hostility:
    """A way to be hostile for a while.

    Attributes:
        kind: Of its commands; None: another one each time.
        values: From the time since it began and the arm's position, what is commanded.
        number: What is added to the next number.
        age_s: How old the stamps are.
        burst: Commands per period.
        share: Which share of the speed limits the next command asks for.
    """

    kind: CommandKind | None
    values: Callable[[float, Array], Array]
    number: int = 0
    age_s: float = 0.0
    burst: int = 1
    share: Callable[[], float] = lambda: 1.0


#: Of the speed limits, in the steps in which a driver may change its mind; and what is no share.
_SHARES, _NO_SHARES = (1.0, 0.5, 0.05, 1e-3, 1e-9), (np.nan, np.inf, -1.0, 0.0, 2.0)


def shares(rng: np.random.Generator) -> Callable[[], float]:
    """Returns what a driver asks for: all there is, or another share each time."""
    if rng.random() < 0.5:
        return lambda: 1.0
    return lambda: float(rng.choice(_NO_SHARES if rng.random() < 0.05 else _SHARES))


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

    burst = int(rng.choice([1, 1, 1, 5]))
    found = Hostility(kind=kind, values=values, burst=burst, share=shares(rng))
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

    burst = int(rng.choice([1, 1, 1, 5]))
    return Hostility(kind=kind, values=values, burst=burst, share=shares(rng))


def attack(rig: Rig, commands: int, rng: np.random.Generator) -> Counter[str]:
    """Sends hostile commands until so many are sent, or a person has to reset the robot.

    Returns:
        How many of each way.
    """
    sent: Counter[str] = Counter()
    period_s = rig.config.period_ns * 1e-9
    kinds: list[CommandKind | None] = [*CommandKind, None]
    while sum(sent.values()) < commands and not rig.waits_for_reset:
        way = str(rng.choice(WAYS))
        one = hostility(rng, way, kinds[int(rng.integers(len(kinds)))], rig.geometry)
        rig.number = 0
        for step in range(int(rng.uniform(0.2, 3.0) / period_s)):
            for _ in range(one.burst):
                kind = one.kind or list(CommandKind)[int(rng.integers(3))]
                number = max(rig.number + one.number, 1) if one.number and step % 2 else None
                values = one.values(step * period_s, rig.arm.position)
                age_s = one.age_s if step % 3 else 0.0
                rig.send(kind, values, number=number, age_s=age_s, share=one.share())
                sent[way] += 1
            rig.pass_time(period_s)
    return sent
