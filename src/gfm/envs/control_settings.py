"""What makes a control task harder than it is, or easier: one struct per experiment."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from gfm.core import ConfigError
from gfm.envs.sensing import Sensing

Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class Curriculum(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A gain on the commanded velocities that comes down as learning goes on.

    The paper goes from 6 to 1 in unit steps every 1000 episodes. Here a stage lasts a number of
    learner steps: the one count that every actor knows, that grows with the episodes of all of
    them, and that survives a restart.

    Attributes:
        gains: Of the stages, one after the other; the last one stays.
        stage_steps: Learner steps per stage.
    """

    gains: Annotated[tuple[float, ...], Meta(min_length=1)] = (1.0,)
    stage_steps: Annotated[int, Meta(ge=1)] = 5000

    def __post_init__(self) -> None:
        if not all(gain > 0.0 for gain in self.gains):
            raise ConfigError(f"curriculum gains are {list(self.gains)}, expected positive numbers")

    def gain(self, learner_steps: int) -> float:
        """Returns the gain after so many learner steps."""
        return self.gains[min(learner_steps // self.stage_steps, len(self.gains) - 1)]


class ControlSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the control tasks may be told beyond the models.

    Attributes:
        curriculum: The gain on the commanded velocities.
        perturbation: Random generalized forces, drawn anew every control period up to this share of
            the force limits: a baseline that the paper compares with.
        randomisation: Each episode draws masses, friction, damping and servo gains between 1 / (1 +
            this) and 1 + this times the model's; another baseline.
        ranges: File that a diagnosis of several sets of recordings wrote (ranges.toml): each
            episode draws the amounts of the named effects from it, in the model that was
            diagnosed, which `models` has to name.
        variants: How many such models are drawn once, for episodes to choose from.
        ensemble: Generalized force models, files or names of some that come with gfm; each episode
            draws one of them.
        sensing: How well the robot measures what a policy sees; exactly by default.
    """

    curriculum: Curriculum = Curriculum()
    perturbation: Share = 0.0
    randomisation: Annotated[float, Meta(ge=0.0, le=4.0)] = 0.0
    ranges: str = ""
    variants: Annotated[int, Meta(ge=1)] = 64
    ensemble: tuple[str, ...] = ()
    sensing: Sensing | None = None

    def __post_init__(self) -> None:
        if self.ranges and self.randomisation > 0.0:
            raise ConfigError(
                f"ranges is {self.ranges} and randomisation {self.randomisation}, expected one of "
                "them"
            )
