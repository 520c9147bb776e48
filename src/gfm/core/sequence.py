"""What actors send and the learner learns from.

Shape letters: T transitions of a sequence, B sequences of a batch, O observation size, A action
size.
"""

from __future__ import annotations

import hashlib
import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array32, check_shapes
from gfm.core.errors import ConfigError

SEQUENCE_ARRAYS = ("observation", "action", "reward", "discount", "log_prob")
"""The fields of a Sequence, and of a Batch, that are arrays of its transitions."""

SEQUENCE_LENGTH = 10
"""Transitions of a sequence, where nobody says otherwise."""


@dataclass(frozen=True, kw_only=True)
class EnvironmentSpec:
    """What an environment takes and gives. Actions are in [-1, 1].

    Attributes:
        name: The environment's registered name.
        observation_size: O.
        action_size: A.
        privileged_size: Of the observation, so many last numbers are for the critic alone: what is
            known in training, but not where the policy acts.
        reward_limit: No reward is larger than this, in size.
        observation_limit: No number of an observation is larger than this, in size.
    """

    name: str
    observation_size: int
    action_size: int
    privileged_size: int = 0
    reward_limit: float = 1e4
    observation_limit: float = 1e6

    def __post_init__(self) -> None:
        for name in ("reward_limit", "observation_limit"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected a positive number")

    @property
    def policy_size(self) -> int:
        """Of the observation, so many first numbers are what the policy sees."""
        return self.observation_size - self.privileged_size

    @property
    def digest(self) -> str:
        """A short hash: two sides that compare it agree on what they exchange."""
        sizes = f"{self.observation_size}/{self.action_size}/{self.privileged_size}"
        text = f"{self.name}/{sizes}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """T consecutive transitions of one environment instance, never across a reset.

    Attributes:
        actor: Who made it.
        epoch: Tells lives of the same actor name apart (start time); it has no order.
        number: Counts the sequences of one actor and epoch from 0, so that gaps show.
        weights_life: Weights.life of the policy that acted.
        weights_version: Weights.version of the policy that acted.
        spec_digest: EnvironmentSpec.digest of the environment.
        observation: shape (T + 1, O).
        action: In [-1, 1] up to exploration noise, as sampled, shape (T, A).
        reward: shape (T,).
        discount: 0 where the episode terminated, 1 elsewhere, also at a time limit, shape (T,).
        log_prob: Of `action` under the policy that acted, shape (T,).
    """

    actor: str
    epoch: int
    number: int
    weights_life: int
    weights_version: int
    spec_digest: str
    observation: Array32
    action: Array32
    reward: Array32
    discount: Array32
    log_prob: Array32

    def __post_init__(self) -> None:
        steps = len(self.reward)
        check_shapes(
            vars(self),
            {
                "observation": (steps + 1, *self.observation.shape[1:2]),
                "action": (steps, *self.action.shape[1:2]),
                "discount": (steps,),
                "log_prob": (steps,),
            },
        )

    @property
    def checksum(self) -> int:
        """Of its arrays, by `arrays_checksum`."""
        return arrays_checksum(getattr(self, name) for name in SEQUENCE_ARRAYS)


def arrays_checksum(arrays: Iterable[NDArray[Any]]) -> int:
    """Returns the CRC-32 of arrays, one after the other, in C order."""
    checksum = 0
    for array in arrays:
        checksum = zlib.crc32(array.tobytes(), checksum)
    return checksum


@dataclass(frozen=True, kw_only=True)
class Batch:
    """B sequences, sampled by the replay service.

    Attributes:
        spec_digest: EnvironmentSpec.digest that all of them carry.
        index: Which sequences they are: counted as they arrived at the replay service, shape (B,).
        probability: With which each was drawn, more than 0, shape (B,).
        weights_life: Weights.life of the policy that acted, shape (B,).
        weights_version: Weights.version of the policy that acted, shape (B,).
        observation: shape (B, T + 1, O).
        action: shape (B, T, A).
        reward: shape (B, T).
        discount: shape (B, T).
        log_prob: shape (B, T).
    """

    spec_digest: str
    index: NDArray[np.int64]
    probability: Array32
    weights_life: NDArray[np.int64]
    weights_version: NDArray[np.int64]
    observation: Array32
    action: Array32
    reward: Array32
    discount: Array32
    log_prob: Array32

    def __post_init__(self) -> None:
        batch, steps = self.reward.shape
        check_shapes(
            vars(self),
            {
                "index": (batch,),
                "probability": (batch,),
                "weights_life": (batch,),
                "weights_version": (batch,),
                "observation": (batch, steps + 1, *self.observation.shape[2:3]),
                "action": (batch, steps, *self.action.shape[2:3]),
                "discount": (batch, steps),
                "log_prob": (batch, steps),
            },
        )
