"""The policy that actors act with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

from gfm.core.checks import Array32


@dataclass(frozen=True, kw_only=True)
class Weights:
    """One version of the policy's parameters.

    Attributes:
        version: Learner updates so far; never goes backwards.
        created_ns: UTC, when the learner made it.
        spec_digest: EnvironmentSpec.digest that the policy was built for.
        tensors: Parameters by name.
    """

    version: int
    created_ns: int
    spec_digest: str
    tensors: Mapping[str, Array32]

    @property
    def architecture(self) -> str:
        """A short hash of the names and shapes: two sides that compare it agree on the network."""
        text = ";".join(f"{name}{self.tensors[name].shape}" for name in sorted(self.tensors))
        return hashlib.sha256(text.encode()).hexdigest()[:16]
