"""What can have come from an environment and a policy at all, and what cannot.

A message may be well formed and still harm whoever believes it: one reward of 1e30 makes a learner
diverge. The ranges are those of the environment's specification; the policy's own are here.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array32
from gfm.core.sequence import Batch, EnvironmentSpec, Sequence

ACTION_LIMIT = 1e3
"""Sampled actions lie about [-1, 1]; no policy of use explores this far outside, in size."""

LOG_PROB_LIMIT = 1e5
"""A log density of some dozens of actions stays far below, in size."""

PRIORITY_LIMIT = 1e6
"""By more than this no critic of use errs."""


def implausible(data: Sequence | Batch, spec: EnvironmentSpec) -> str:
    """Returns which values cannot have come from the environment, in words; empty where all can.

    Args:
        data: One sequence, or a batch of them.
        spec: Of the environment that they are said to come from.
    """
    for name, size in (("observation", spec.observation_size), ("action", spec.action_size)):
        shape = getattr(data, name).shape
        if shape[-1] != size:
            return f"{name} has shape {shape}, expected {size} in the last place"
    limits = {
        "observation": spec.observation_limit,
        "action": ACTION_LIMIT,
        "reward": spec.reward_limit,
        "log_prob": LOG_PROB_LIMIT,
    }
    for name, limit in limits.items():
        if not (largest := _largest(getattr(data, name))) <= limit:
            return f"{name} reaches {largest:g}, expected at most {limit:g}"
    discount = data.discount
    if discount.size and not (discount.min() >= 0.0 and discount.max() <= 1.0):
        return f"discount spans {discount.min():g} to {discount.max():g}, expected 0 to 1"
    return ""


def _largest(values: Array32) -> float:
    return float(np.abs(values).max(initial=0.0))
