"""Whether a learner that was started again acts on a probe as the one before it did."""

from __future__ import annotations

from pathlib import Path
from typing import final

import numpy as np

from gfm.core import BadInputError, Weights
from gfm.core.checks import Array32
from gfm.recording.weights_file import read_weights
from gfm.rl.policy_numpy import GaussianPolicy

_ROWS = 16


@final
class Resumes:
    """Listens to a learner's weights, and compares the first of every life after the first.

    After each checkpoint a learner writes the policy of that moment beside it. What the next life
    says first must act as that file does: same version, same actions on a probe, bit for bit.

    Attributes:
        alike: Lives that began so.
        otherwise: Lives that began with another version, or acted otherwise.
        unknown: Lives before which there was no policy to compare with: none yet, one of before
            the checkpoint (the learner died between the two), or written over already.
    """

    def __init__(self, policy: Path) -> None:
        """Listens.

        Args:
            policy: The learner's file.
        """
        self.alike = self.otherwise = self.unknown = 0
        self._policy = policy
        self._life = -1

    def hear(self, weights: Weights) -> None:
        """Takes in weights that the learner published."""
        began_anew, self._life = weights.life > self._life >= 0, max(weights.life, self._life)
        if not began_anew:
            return
        try:
            before = read_weights(self._policy)
        except BadInputError:
            before = None
        if before is None or before.life >= weights.life or before.version < weights.version:
            self.unknown += 1
        elif before.version == weights.version and acts_alike(before, weights):
            self.alike += 1
        else:
            self.otherwise += 1


def acts_alike(one: Weights, other: Weights) -> bool:
    """Returns whether two policies sample the same actions with the same densities."""
    pairs = zip(_acts(one), _acts(other), strict=True)
    return all(np.array_equal(ours, theirs) for ours, theirs in pairs)


def _acts(weights: Weights) -> tuple[Array32, Array32]:
    policy, rng = GaussianPolicy.from_weights(weights), np.random.default_rng(0)
    probe = rng.standard_normal((_ROWS, policy.observation_size), dtype=np.float32)
    return policy.sample(probe, rng)
