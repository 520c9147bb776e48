"""What the simulated Sawyer may be told."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from gfm.core import ConfigError
from gfm.service import ServiceConfig
from gfm_robot_bridge.simulated.hidden import check_choice, needs_object


class SimulatedConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the simulated robot.

    Attributes:
        clock: lockstep: time passes only in exchanges, as fast as the machine can. wall: it
            passes by itself.
        hidden_effect: What the robot has beyond its nominal model: an effect's name, `random` for
            any one, several joined by `+`, or `none`.
        task: For which task it has a tool in its hand, a basket and an object in front of it:
            `position`, `pose` or `none`.
        seed: Of the hidden effect and of the sensors' noise.
        sealed: File to write what is hidden to; empty writes none.
        period_s: Between two sensor reports.
    """

    clock: Literal["lockstep", "wall"] = "lockstep"
    hidden_effect: str = "none"
    task: Literal["none", "position", "pose"] = "none"
    seed: int = 0
    sealed: str = ""
    period_s: float = 0.01

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice(self.hidden_effect)
        if self.task == "none" and needs_object(self.hidden_effect):
            raise ConfigError(
                f"hidden_effect is {self.hidden_effect} and task none, expected task position or "
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
