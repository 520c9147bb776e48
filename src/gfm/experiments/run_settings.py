"""What `gfm run` may be told; apart from the run, so that a bad setting is refused at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gfm.api.folders import check_new_folder
from gfm.core import ConfigError


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """What a run may be told.

    Attributes:
        folder: Gets everything; must be new or empty.
        seed: Of everything random.
        hidden_effect: What the simulated robot hides: random, none, or a name.
        skip_gfm: Leave out learning generalized forces.
        skip_task: Leave out the loop on a task.
        actors: Actor processes.
        budget_s: For the whole run; learning takes what the rest leaves.
        motion_s: Length of each motion.
        models: MJCF files of the nominal arm, one per kind of command; empty for the published one.
    """

    folder: Path
    seed: int = 0
    hidden_effect: str = "random"
    skip_gfm: bool = False
    skip_task: bool = False
    actors: int = 2
    budget_s: float = 570.0
    motion_s: float = 12.0
    models: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        ranges = {
            "seed": (0, 2**31),
            "actors": (1, 64),
            "budget_s": (30.0, 86400.0),
            "motion_s": (4.0, 120.0),
        }
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ConfigError(f"{name} is {value:g}, expected {least:g} to {most:g}")
        check_new_folder(self.folder)
