"""New weights are tried before anybody acts with them.

Shape letters: O observation size, A action size.
"""

from __future__ import annotations

import numpy as np

from gfm.core import ACTION_LIMIT, BadInputError, EnvironmentSpec, GfmError, Weights
from gfm.rl.policy_numpy import GaussianPolicy

_ROWS = 16


def usable_policy(weights: Weights, spec: EnvironmentSpec) -> GaussianPolicy:
    """Returns the policy that weights describe, where it acts sensibly on fixed observations.

    These are always the same: at rest, at one and at minus one everywhere, and drawn around zero.

    Raises:
        BadInputError: the tensors make no policy for this environment, or its actions there are not
            finite or far outside of what an environment takes.
    """
    rng = np.random.default_rng(0)
    observation = rng.standard_normal((_ROWS, spec.policy_size), dtype=np.float32)
    observation[:3] = [[0.0], [1.0], [-1.0]]
    try:
        with np.errstate(all="ignore"):  # what comes of it is judged below
            policy = GaussianPolicy.from_weights(weights)
            sizes = policy.observation_size, policy.action_size
            action, log_prob = policy.sample(observation, rng)
    except (GfmError, ValueError, KeyError, TypeError, IndexError) as exc:
        raise BadInputError(f"they make no policy: {' '.join(str(exc).split())}") from exc
    if sizes != (spec.policy_size, spec.action_size) or action.shape != (_ROWS, spec.action_size):
        raise BadInputError(
            f"they map {sizes[0]} observations to {sizes[1]} actions, expected {spec.policy_size} "
            f"and {spec.action_size}"
        )
    if not (np.isfinite(action).all() and np.isfinite(log_prob).all()):
        raise BadInputError("their actions on the probe are not finite")
    if (largest := float(np.abs(action).max())) > ACTION_LIMIT:
        raise BadInputError(
            f"their actions on the probe reach {largest:g}, expected at most {ACTION_LIMIT:g}"
        )
    return policy
