"""What the simulated Sawyer may be told."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from gfm.core import ConfigError
from gfm.service import ServiceConfig
from gfm_robot_bridge.simulated.hidden import GivenEffect, check_choice, given, needs_object
from gfm_wire import RobotClock, Role


class SimulatedConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the simulated robot.

    Attributes:
        engine: What moves it: mujoco, with an integrator of its own, or drake.
        clock: wall: time passes by itself. lockstep: only in exchanges, as fast as the machine can.
            As the bridge's own setting.
        hidden_effect: What the robot has beyond its nominal model: an effect's name, `random` for
            any one, several joined by `+`, or `none`.
        hidden: Effects that the robot has beyond its nominal model, with amounts, in place of
            `hidden_effect`.
        task: For which task it has a tool in its hand, a basket and an object in front of it:
            `position`, `pose` or `none`.
        seed: Of the hidden effect and of the sensors' noise.
        sealed: File to write what is hidden to; empty writes none.
        period_s: Between two sensor reports.
    """

    role: ClassVar[Role] = Role.ROBOT

    engine: Literal["mujoco", "drake"] = "mujoco"
    clock: RobotClock = RobotClock.WALL
    hidden_effect: str = "none"
    hidden: tuple[GivenEffect, ...] = ()
    task: Literal["none", "position", "pose"] = "none"
    seed: int = 0
    sealed: str = ""
    period_s: float = 0.01

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice(self.hidden_effect)
        if self.hidden and self.hidden_effect != "none":
            raise ConfigError(
                f"hidden_effect is {self.hidden_effect} and hidden has {len(self.hidden)} effects, "
                "expected one of them"
            )
        effects = [*self.hidden_effect.split("+"), *(one.effect for one in given(self.hidden))]
        if self.task == "none" and needs_object(effects):
            raise ConfigError(
                f"hidden effects are {', '.join(effects)} and task none, expected task position or "
                "pose: there is no object to hide it in"
            )
        if not 0.001 <= self.period_s <= 0.1:
            raise ConfigError(f"period_s is {self.period_s}, expected 0.001 to 0.1")
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}, expected at least 0")

    @property
    def sealed_path(self) -> Path | None:
        """Where to write what is hidden, or None."""
        return Path(self.sealed) if self.sealed else None

    @property
    def choice(self) -> str:
        """What was asked to be hidden, in words."""
        return "+".join(one.effect for one in self.hidden) or self.hidden_effect
