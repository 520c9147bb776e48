"""Models whose effects have amounts drawn from ranges: a robot as it is from day to day."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.effects import EffectInstance
from gfm.sim.plant import stepping_spec
from gfm.sim.step_laws import acts_at_every_step


@dataclass(frozen=True, kw_only=True)
class EffectRange:
    """An effect whose amounts differ from episode to episode.

    Attributes:
        usual: With its mean amounts.
        low: The least of each amount.
        high: The largest.
    """

    usual: EffectInstance
    low: Mapping[str, float]
    high: Mapping[str, float]

    @property
    def in_model(self) -> bool:
        """Whether MuJoCo expresses all of it, so that every model may have an amount of its own."""
        return self.usual.effect.native and not acts_at_every_step(self.usual)

    def drawn(self, rng: np.random.Generator) -> EffectInstance:
        """Returns the effect with amounts drawn evenly from their ranges."""
        values = {name: rng.uniform(low, self.high[name]) for name, low in self.low.items()}
        return replace(self.usual, values=values)


def with_usual(
    ranges: Sequence[EffectRange], effects: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns what all models share: their effects, and the usual amounts of what is not drawn."""
    return (*effects, *(one.usual for one in ranges if not one.in_model))


@dataclass(frozen=True, kw_only=True)
class DrawnModels:
    """What a robot may be, and what is known of it.

    Attributes:
        usual: With the mean of every range.
        variants: With amounts drawn from them; MjData's layout is the same in all of these.
    """

    usual: mujoco.MjModel
    variants: tuple[mujoco.MjModel, ...]


def drawn_models(
    spec: mujoco.MjSpec,
    ranges: Sequence[EffectRange],
    effects: Sequence[EffectInstance],
    count: int,
    rng: np.random.Generator,
) -> DrawnModels:
    """Returns so many models with amounts drawn from ranges, and the usual one.

    Args:
        spec: The robot.
        ranges: What is drawn, where MuJoCo expresses it.
        effects: What all of them have besides (see `with_usual`).
        count: How many.
        rng: From which is drawn.
    """
    inside = [one for one in ranges if one.in_model]

    def compiled(amounts: Iterable[EffectInstance]) -> mujoco.MjModel:
        return stepping_spec(spec, (*effects, *amounts)).compile()

    return DrawnModels(
        usual=compiled(one.usual for one in inside),
        variants=tuple(compiled(one.drawn(rng) for one in inside) for _ in range(count)),
    )
