"""The policy that actors act with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

from gfm.core.checks import Array32


@dataclass(frozen=True, kw_only=True)
class Weights:
    """One version of the policy's parameters; run, life, version and architecture identify it.

    Attributes:
        version: Learner updates so far; never goes backwards within a life.
        created_ns: UTC, when the learner made it.
        spec_digest: EnvironmentSpec.digest that the policy was built for.
        tensors: Parameters by name.
        run: The run that they were learned in; empty in a file that was made outside of any.
        life: Of the learner that made them: when it was started, UTC ns, and larger than that of
            the checkpoint it went on from. Lives are ordered; a resumed learner begins a new one.
    """

    version: int
    created_ns: int
    spec_digest: str
    tensors: Mapping[str, Array32]
    run: str = ""
    life: int = 0

    @property
    def architecture(self) -> str:
        """A short hash of the names and shapes: two sides that compare it agree on the network."""
        text = ";".join(f"{name}{self.tensors[name].shape}" for name in sorted(self.tensors))
        return hashlib.sha256(text.encode()).hexdigest()[:16]
