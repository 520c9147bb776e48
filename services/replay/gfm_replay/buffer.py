"""A ring of equally long sequences in memory, reserved once, and on disk where that is wanted.

Shape letters: N sequences that fit, B sequences of a batch, T transitions, O observation size,
A action size.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from gfm.core import SEQUENCE_ARRAYS, Batch, ConfigError, EnvironmentSpec, Sequence
from gfm.core.checks import Array32
from gfm_replay.arrivals import Life
from gfm_replay.door import NoRoomError, NotTakenError
from gfm_replay.journal import Journal, Kept
from gfm_replay.priorities import Priorities
from gfm_replay.records import Layout

LABELS = ("weights_life", "weights_version")


@final
class SequenceBuffer:
    """Keeps the newest sequences that fit; the first one fixes the shapes of all.

    Attributes:
        inserted: Sequences stored so far, those that made room for others among them.
        sampled: Sequences handed out so far.
    """

    def __init__(
        self,
        capacity_bytes: int,
        journal: Journal | None = None,
        kept: Kept | None = None,
        *,
        priority_exponent: float = 0.0,
    ) -> None:
        """Makes a buffer.

        Args:
            capacity_bytes: Of the sequences, at most.
            journal: Where to keep them on disk; nowhere by default.
            kept: What the journal holds already.
            priority_exponent: Of `Priorities`; 0 draws all alike.

        Raises:
            ConfigError: the journal was made for another capacity.
        """
        self.inserted = 0
        self.sampled = 0
        self._capacity_bytes = capacity_bytes
        self._journal = journal
        self._priority_exponent = priority_exponent
        self._priorities: Priorities | None = None
        self._arrays: dict[str, NDArray[Any]] = {}
        self._spec_digest = ""
        self._stored = 0
        self._next = 0
        if kept is not None:
            self._take(kept)

    def __len__(self) -> int:
        return self._stored

    @property
    def capacity(self) -> int:
        """N; 0 before the first sequence."""
        return len(self._arrays["reward"]) if self._arrays else 0

    @property
    def steps(self) -> int:
        """T; 0 before the first sequence."""
        return len(self._arrays["reward"][0]) if self._arrays else 0

    @property
    def used_bytes(self) -> int:
        """Memory that holds sequences."""
        return len(self) * self.sequence_bytes

    @property
    def sequence_bytes(self) -> int:
        """Of one sequence; 0 before the first."""
        return sum(int(self._arrays[name][0].nbytes) for name in SEQUENCE_ARRAYS if self._arrays)

    def insert(self, sequence: Sequence, life: Life, spec: EnvironmentSpec) -> None:
        """Stores a sequence, over the oldest one where the ring is full.

        Args:
            sequence: Of the environment `spec`.
            life: That it belongs to, before it is added.
            spec: Of the run's environment.

        Raises:
            NotTakenError: its shapes are not those of the first sequence.
            NoRoomError: the disk has no room for it now.
        """
        try:
            if not self._arrays:
                self._reserve(sequence, spec)
            self._check(sequence)
            if self._journal is not None:
                self._journal.append(self.inserted + 1, sequence, life)
        except OSError as exc:
            raise NoRoomError(f"the sequences' folder: {exc.strerror or exc}") from exc
        for name, array in self._arrays.items():
            array[self._next] = getattr(sequence, name)
        if self._priorities is not None:
            self._priorities.add(np.array([self._next]))
        self._next = (self._next + 1) % self.capacity
        self._stored = min(self._stored + 1, self.capacity)
        self.inserted += 1

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Returns `batch_size` sequences, drawn with replacement: all alike, or by priority."""
        if self._priorities is None:
            age = rng.integers(len(self), size=batch_size)
            slots = (self._next - 1 - age) % self.capacity
            probability = np.full(batch_size, 1.0 / len(self))
        else:
            slots, probability = self._priorities.draw(batch_size, rng)
            age = (self._next - 1 - slots) % self.capacity
        arrays = {name: np.asarray(array[slots]) for name, array in self._arrays.items()}
        self.sampled += batch_size
        return Batch(
            spec_digest=self._spec_digest,
            index=self.inserted - age,
            probability=probability.astype(np.float32),
            **arrays,
        )

    def learned(self, seen: NDArray[np.int64], priority: Array32) -> None:
        """Takes in how much a learner errs about sequences; those that are gone do not count.

        Args:
            seen: Batch.index of each, shape (K,).
            priority: At least 0, shape (K,).
        """
        if self._priorities is None:
            return
        age = self.inserted - seen
        here = (age >= 0) & (age < len(self))
        slots = (self._next - 1 - age[here]) % self.capacity
        self._priorities.update(slots, priority[here])

    def _reserve(self, sequence: Sequence, spec: EnvironmentSpec) -> None:
        steps = len(sequence.reward)
        each = sum(getattr(sequence, name).nbytes for name in SEQUENCE_ARRAYS)
        capacity = self._capacity_bytes // each if steps else 0
        if capacity == 0:
            raise NotTakenError(
                "shape",
                f"a sequence of {steps} transitions and {each} bytes, expected at least one "
                f"transition and at most {self._capacity_bytes} bytes",
            )
        layout = Layout(spec=spec, steps=steps, capacity=capacity)
        if self._journal is not None:
            self._journal.make(layout)
        self._allocate(layout)

    def _allocate(self, layout: Layout) -> None:
        fields: Mapping[str, Any] = layout.dtype.fields or {}
        self._spec_digest = layout.spec.digest
        self._arrays = {
            name: np.empty((layout.capacity, *fields[name][0].shape), fields[name][0].base)
            for name in (*SEQUENCE_ARRAYS, *LABELS)
        }
        if self._priority_exponent > 0.0:
            self._priorities = Priorities(layout.capacity, self._priority_exponent)

    def _take(self, kept: Kept) -> None:
        self._allocate(kept.layout)
        fitting = self._capacity_bytes // self.sequence_bytes
        if self.capacity != fitting:
            raise ConfigError(
                f"the journal has room for {self.capacity} sequences of {self.sequence_bytes} "
                f"bytes, expected {fitting}: it was made with another capacity_mib"
            )
        count = len(kept.records)
        for name, array in self._arrays.items():
            array[:count] = kept.records[name]
        self.inserted = int(kept.records["index"].max(initial=0))
        self.sampled = kept.sampled
        self._stored, self._next = count, count % self.capacity
        if self._priorities is not None and count:
            self._priorities.add(np.arange(count))

    def _check(self, sequence: Sequence) -> None:
        for name in SEQUENCE_ARRAYS:
            got, expected = getattr(sequence, name).shape, self._arrays[name].shape[1:]
            if got != expected:
                raise NotTakenError("shape", f"{name} has shape {got}, expected {expected}")
