"""Drives the simulated arm through the robot bridge, and has it stopped in every way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bridge_rig import LIMITS, Rig, Setting

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.sawyer import READY
from gfm_wire import ScaleSpeed, StopRobot

_STANDS_S = 0.15
#: Share of the speed limits that is allowed: a little more than half, so that from half of the
#: limit can be stopped at all.
ALLOWED = 0.6
#: N m s/rad, by which torques follow a speed.
_FOLLOWS = 15.0
_MIDDLE = 0.5 * (LIMITS.lower + LIMITS.upper)

CAUSES = (
    "driver silent",
    "stopped by request",
    "scaled to zero",
    "cameras lost",
    "bridge closed",
    "bridge killed",
)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """What came of one stop: s until the arm was still, highest deceleration by its limit."""

    time_s: float
    slowed: float


def stop_once(folder: Path, kind: CommandKind, share: float, cause: str, seed: int) -> Stop:
    """Drives all joints at a share of their speed limits, and has that stopped."""
    rng = np.random.default_rng([seed, 17])
    # It knows no geometry, which would keep some from getting that fast.
    control_hz = float(rng.choice([20.0, 50.0, 100.0, 200.0]))
    setting = Setting(control_hz=control_hz, share=ALLOWED, guarded=False, judged=False)
    rig = Rig(folder, setting, seed)
    drive = _driving(rig, kind, share, rng, needs_object=cause == "cameras lost")
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


def speeds(share: float) -> Array:
    """Returns a share of every speed limit, away from the nearer end of its range, rad/s, (7,)."""
    return np.asarray(share * LIMITS.velocity * np.where(_MIDDLE < READY, -1.0, 1.0))


def commanded(kind: CommandKind, target: Array, speed: Array, velocity: Array) -> Array:
    """Returns what keeps the joints at a speed, shape (7,).

    Args:
        kind: What is commanded.
        target: Where they shall be next, rad.
        speed: Theirs, rad/s.
        velocity: As it was measured, rad/s.
    """
    match kind:
        case CommandKind.POSITION:
            return target
        case CommandKind.VELOCITY:
            return speed
        case CommandKind.EFFORT:
            return _FOLLOWS * (speed - velocity)


def _driving(
    rig: Rig, kind: CommandKind, share: float, rng: np.random.Generator, *, needs_object: bool
) -> Callable[[], None]:
    """Returns what sends the next command of a motion at constant speed."""
    speed = speeds(share) * np.where(rng.random(7) < 0.3, -1.0, 1.0)
    period_s = rig.config.period_ns * 1e-9
    target = rig.arm.position

    def drive() -> None:
        nonlocal target
        target = target + speed * period_s
        seen = rig.newest()
        velocity = np.zeros(7) if seen is None else seen.velocity
        rig.track()
        rig.send(kind, commanded(kind, target, speed, velocity), needs_object=needs_object)
        rig.pass_time(period_s)

    return drive


def _stop(rig: Rig, cause: str) -> bool:
    """Has the robot stopped; returns whether its driver goes on meanwhile."""
    match cause:
        case "stopped by request":
            rig.ask("robot/stop", StopRobot(reason="tried"))
        case "scaled to zero":
            rig.ask("robot/speed", ScaleSpeed(scale=0.0))
        case "cameras lost":
            rig.object_is_seen = False
            rig.track()
        case "bridge killed":
            rig.bridge_lives = False
        case "bridge closed":
            rig.close_bridge()
    return cause in ("scaled to zero", "cameras lost")
