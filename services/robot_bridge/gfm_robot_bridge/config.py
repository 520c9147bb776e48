"""What the robot bridge may be told."""

from __future__ import annotations

from typing import Literal

from gfm.core import ConfigError
from gfm.service import ServiceConfig


class BridgeConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the robot bridge.

    Attributes:
        robot: sim: the simulated Sawyer in another process; mirror: a stand-in in this one.
        clock: lockstep: the robot's time passes with every command, as fast as the machine can;
            wall: in real time, with a watchdog. As the robot's own setting.
        control_hz: Commands per second of robot time.
        recordings: Folder for recordings.
        position_margin_rad: How far from the ends of the joint ranges commands stay.
        velocity_share: Share of the robot's velocity limits that is allowed.
        command_age_s: A command stamped longer ago is refused (wall clock only). 0.2 s is how long
            the robot itself waits: what is older was made for another state of the arm.
        lease_s: Silence after which another driver may take the robot: longer than a driver needs
            between two motions, short enough for a person to wait for.
        watchdog_periods: Silence after which the robot is made to hold (wall clock only).
    """

    robot: Literal["sim", "mirror"] = "sim"
    clock: Literal["lockstep", "wall"] = "lockstep"
    control_hz: float = 50.0
    recordings: str = "recordings"
    position_margin_rad: float = 0.05
    velocity_share: float = 0.5
    command_age_s: float = 0.2
    lease_s: float = 5.0
    watchdog_periods: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        ranges = {
            "control_hz": (1.0, 200.0),
            "position_margin_rad": (0.0, 0.5),
            "velocity_share": (0.01, 1.0),
            "command_age_s": (0.01, 10.0),
            "lease_s": (0.5, 60.0),
            "watchdog_periods": (2, 100),
        }
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ConfigError(f"{name} is {value}, expected {least} to {most}")

    @property
    def period_ns(self) -> int:
        """Between two commands."""
        return round(1e9 / self.control_hz)
