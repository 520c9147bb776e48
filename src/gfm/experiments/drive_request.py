"""What `gfm drive` is asked for: a policy, a robot, and how often."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gfm.api.provenance import sha256
from gfm.core import ConfigError
from gfm.envs.matching_task import RADIAL_GOALS
from gfm_wire import SetPayload


@dataclass(frozen=True, kw_only=True)
class DriveRequest:
    """What is asked for.

    Attributes:
        task: Name of the environment.
        policy: Of a file, or of a folder that holds one; by default the one that comes with gfm.
        model: MJCF by which the tool is placed; None for the nominal cell.
        robot: Which simulated robot, one of `gfm.launch.spec.ENGINES`.
        hidden_effect: Of the simulated robot.
        robot_config: Its settings as a TOML file; None for the default ones.
        real_time: Whether its time passes by itself.
        connect: Router of a run whose robot to drive; empty to start a simulated one.
        run_name: Name of that run.
        certs: Folder of certificates by which it speaks; empty for those of `gfm up`, where there
            are any.
        goals: The first so many are tried.
        trials: Attempts per goal.
        payload: What the robot is told that it carries, while it is driven; None for nothing.
        seed: Of robot and starts.
        out: Folder for results and recordings.
    """

    task: str
    out: Path
    policy: Path | None = None
    model: Path | None = None
    robot: str = "sim"
    hidden_effect: str = "none"
    robot_config: Path | None = None
    real_time: bool = False
    connect: str = ""
    run_name: str = "default"
    certs: str = ""
    goals: int = RADIAL_GOALS
    trials: int = 5
    payload: SetPayload | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.goals <= RADIAL_GOALS:
            raise ConfigError(f"--goals is {self.goals}, expected 1 to {RADIAL_GOALS}")
        if self.trials < 1:
            raise ConfigError(f"--trials is {self.trials}, expected at least 1")
        if self.payload is not None and self.payload.problem:
            raise ConfigError(f"--payload: {self.payload.problem}")
        started = {
            "--robot": self.robot != "sim",
            "--hidden-effect": self.hidden_effect != "none",
            "--robot-config": self.robot_config is not None,
            "--real-time": self.real_time,
        }
        for flag, given in started.items():
            if self.connect and given:
                raise ConfigError(
                    f"{flag} and --connect: expected one of them, what runs has its settings"
                )

    @property
    def clock(self) -> str:
        """What lets the robot's time pass."""
        return "wall" if self.real_time else "lockstep"

    def about(self, policy: Path) -> dict[str, object]:
        """Returns the settings that attempts of one folder have in common.

        Args:
            policy: File of the policy that is tried.
        """
        return {
            "task": self.task,
            "policy": sha256(policy),
            "model": sha256(self.model) if self.model else "",
            "robot": f"{self.run_name} at {self.connect}" if self.connect else self.robot,
            "hidden_effect": self.hidden_effect,
            "robot_config": sha256(self.robot_config) if self.robot_config else "",
            "clock": self.clock,
            "payload": None if self.payload is None else str(self.payload),
            "seed": self.seed,
        }
