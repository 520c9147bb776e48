"""A ring of equally long sequences in memory that is reserved once.

Shape letters: N sequences that fit, B sequences of a batch, T transitions, O observation size,
A action size.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core import Batch, RefusedError, Sequence

FIELDS = ("observation", "action", "reward", "discount", "log_prob")


@final
class SequenceBuffer:
    """Keeps the newest sequences that fit; the first one fixes the shapes of all."""

    def __init__(self, capacity_bytes: int) -> None:
        self._capacity_bytes = capacity_bytes
        self._arrays: dict[str, NDArray[np.float32]] = {}
        self._weights_version = np.zeros(0, np.int64)
        self._inserted = 0
        self._spec_digest = ""

    def __len__(self) -> int:
        return min(self._inserted, self.capacity)

    @property
    def capacity(self) -> int:
        """N; 0 before the first sequence."""
        return len(self._weights_version)

    @property
    def spec_digest(self) -> str:
        """The one that all sequences carry; empty before the first."""
        return self._spec_digest

    @property
    def used_bytes(self) -> int:
        """Memory that holds sequences."""
        return len(self) * int(sum(array[0].nbytes for array in self._arrays.values()))

    def insert(self, sequence: Sequence) -> None:
        """Stores a sequence, over the oldest one where the ring is full.

        Raises:
            RefusedError: its environment or its shapes are not those of the first sequence.
        """
        if not self._arrays:
            self._reserve(sequence)
        self._check(sequence)
        slot = self._inserted % self.capacity
        for name, array in self._arrays.items():
            array[slot] = getattr(sequence, name)
        self._weights_version[slot] = sequence.weights_version
        self._inserted += 1

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Returns `batch_size` sequences, drawn uniformly with replacement."""
        slots = rng.integers(len(self), size=batch_size)
        arrays = {name: array[slots] for name, array in self._arrays.items()}
        return Batch(
            spec_digest=self._spec_digest, weights_version=self._weights_version[slots], **arrays
        )

    def _reserve(self, sequence: Sequence) -> None:
        each = sum(getattr(sequence, name).nbytes for name in FIELDS)
        capacity = self._capacity_bytes // each if len(sequence.reward) else 0
        if capacity == 0:
            raise RefusedError(
                f"a sequence of {len(sequence.reward)} transitions and {each} bytes, expected at "
                f"least one transition and at most {self._capacity_bytes} bytes"
            )
        self._arrays = {
            name: np.empty((capacity, *getattr(sequence, name).shape), np.float32)
            for name in FIELDS
        }
        self._weights_version = np.zeros(capacity, np.int64)
        self._spec_digest = sequence.spec_digest

    def _check(self, sequence: Sequence) -> None:
        if sequence.spec_digest != self._spec_digest:
            raise RefusedError(
                f"spec_digest is {sequence.spec_digest!r:.40}, expected {self._spec_digest!r}"
            )
        for name, array in self._arrays.items():
            got, expected = getattr(sequence, name).shape, array.shape[1:]
            if got != expected:
                raise RefusedError(f"{name} has shape {got}, expected {expected}")
