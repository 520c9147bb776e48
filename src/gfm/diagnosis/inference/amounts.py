"""The numbers of effects that a fit may change, as a vector and back, and their bounds.

Shape letters: P free parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.effects import Parameter as EffectParameter

#: A parameter this close to its bound, as a share of the allowed range, has not been found.
AT_BOUND = 1e-3


def free_parameters(effects: Sequence[EffectInstance]) -> list[tuple[int, str]]:
    """Returns the parameters that are fitted; a number of periods is found by search instead."""
    return [(i, p.name) for i, instance in enumerate(effects) for p in _free(instance)]


def _free(instance: EffectInstance) -> list[EffectParameter]:
    return [p for p in instance.effect.parameters if p.name not in instance.effect.fixed]


def rough_below(effects: Sequence[EffectInstance]) -> Array:
    """Returns the shares of themselves over which derivatives by amounts are taken, shape (P,)."""
    return np.array([p.rough_below for instance in effects for p in _free(instance)])


def at_bound(instance: EffectInstance) -> bool:
    """Returns whether a fitted parameter is none, or ran into its bound: any beyond would do."""
    return any(_is_at_bound(instance, parameter) for parameter in _free(instance))


def _is_at_bound(instance: EffectInstance, parameter: EffectParameter) -> bool:
    value, (low, high) = (
        instance.values[parameter.name],
        _ends(instance, parameter, parameter.lower),
    )
    near = max(AT_BOUND * min(high - low, abs(value) + 1e-9), parameter.least)
    return min(abs(value - low), abs(high - value)) < near or abs(value) < parameter.least


def acting(effects: Sequence[EffectInstance]) -> tuple[EffectInstance, ...]:
    """Returns the effects of which there is something: a fit may end with none of one."""
    return tuple(e for e in effects if not _is_none(e))


def _is_none(instance: EffectInstance) -> bool:
    first = instance.effect.parameters[0]
    value = instance.values[first.name]
    either_way = first.least > 0.0 and abs(value) <= first.least
    return either_way or (first.lower == 0.0 and value == 0.0)


def amounts(effects: Sequence[EffectInstance]) -> Array:
    """Returns the values of the free parameters, shape (P,)."""
    return np.array([effects[i].values[name] for i, name in free_parameters(effects)])


def with_amounts(effects: Sequence[EffectInstance], vector: Array) -> tuple[EffectInstance, ...]:
    """Returns effects with other values of their free parameters, shape (P,)."""
    values = [dict(instance.values) for instance in effects]
    for (i, name), value in zip(free_parameters(effects), vector, strict=True):
        values[i][name] = float(value)
    return tuple(replace(e, values=v) for e, v in zip(effects, values, strict=True))


def bounds_of(effects: Sequence[EffectInstance]) -> tuple[Array, Array]:
    """Returns the least and the largest value of every free parameter, shape (P,) each."""
    both = [_ends(e, p, e.least.get(p.name, p.lower)) for e in effects for p in _free(e)]
    return np.array([low for low, _ in both]), np.array([high for _, high in both])


def _ends(instance: EffectInstance, parameter: EffectParameter, low: float) -> tuple[float, float]:
    """Returns `low` and the largest value of a parameter, or the largest size to either side."""
    most = instance.most.get(parameter.name, np.inf)
    return max(low, -most), min(parameter.upper, most)
