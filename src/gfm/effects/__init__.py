"""One small class per physical law that a model may lack."""

from gfm.effects.effect import (
    Effect,
    EffectInstance,
    Key,
    Motion,
    Parameter,
    Placed,
    ProbeGroup,
    Scales,
    Scope,
    Values,
)
from gfm.effects.registry import effect_library, find_effect

__all__ = [
    "Effect",
    "EffectInstance",
    "Key",
    "Motion",
    "Parameter",
    "Placed",
    "ProbeGroup",
    "Scales",
    "Scope",
    "Values",
    "effect_library",
    "find_effect",
]
