"""A ring of equally long sequences in memory, or in files, that is reserved once.

Shape letters: N sequences that fit, B sequences of a batch, T transitions, O observation size,
A action size.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from gfm.core import Batch, ConfigError, Sequence
from gfm_replay.door import NotTakenError
from gfm_replay.files import RingFiles

FIELDS = ("observation", "action", "reward", "discount", "log_prob")
LABELS = ("weights_life", "weights_version")


@final
class SequenceBuffer:
    """Keeps the newest sequences that fit; the first one fixes the shapes of all.

    There is one slot more than sequences are kept, and the one that is written next is never handed
    out: wherever a process that keeps files ends, every sequence that counts is whole.
    """

    def __init__(self, capacity_bytes: int, files: RingFiles | None = None) -> None:
        """Makes an empty buffer, or opens the one that `files` hold.

        Args:
            capacity_bytes: Of the sequences, at most.
            files: Where to keep them; in memory by default.

        Raises:
            BadInputError: what the files hold is damaged.
            ConfigError: they were made for another capacity.
        """
        self._capacity_bytes = capacity_bytes
        self._files = files
        self._arrays: dict[str, NDArray[Any]] = {}
        self._counts: NDArray[np.int64] = np.zeros(2, np.int64)
        self._spec_digest = ""
        if files is not None and files.exist:
            self._open(files)

    def __len__(self) -> int:
        return min(self.inserted, self.capacity)

    @property
    def capacity(self) -> int:
        """N; 0 before the first sequence."""
        return len(self._arrays["reward"]) - 1 if self._arrays else 0

    @property
    def inserted(self) -> int:
        """Sequences stored so far, those that made room for others among them."""
        return int(self._counts[0])

    @property
    def sampled(self) -> int:
        """Sequences handed out so far."""
        return int(self._counts[1])

    @property
    def steps(self) -> int:
        """T; 0 before the first sequence."""
        return len(self._arrays["reward"][0]) if self._arrays else 0

    @property
    def spec_digest(self) -> str:
        """The one that all sequences carry; empty before the first."""
        return self._spec_digest

    @property
    def used_bytes(self) -> int:
        """Memory that holds sequences."""
        return len(self) * self.sequence_bytes

    @property
    def sequence_bytes(self) -> int:
        """Of one sequence; 0 before the first."""
        return sum(int(self._arrays[name][0].nbytes) for name in FIELDS if self._arrays)

    def insert(self, sequence: Sequence) -> None:
        """Stores a sequence, over the oldest one where the ring is full.

        Raises:
            NotTakenError: its environment or its shapes are not those of the first sequence.
        """
        if not self._arrays:
            self._reserve(sequence)
        self._check(sequence)
        slot = self.inserted % (self.capacity + 1)
        for name, array in self._arrays.items():
            array[slot] = getattr(sequence, name)
        self._counts[0] += 1

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Returns `batch_size` sequences, drawn uniformly with replacement."""
        age = rng.integers(len(self), size=batch_size)
        slots = (self.inserted - 1 - age) % (self.capacity + 1)
        arrays = {name: np.asarray(array[slots]) for name, array in self._arrays.items()}
        self._counts[1] += batch_size
        return Batch(spec_digest=self._spec_digest, **arrays)

    def _reserve(self, sequence: Sequence) -> None:
        each = sum(getattr(sequence, name).nbytes for name in FIELDS)
        capacity = self._capacity_bytes // each if len(sequence.reward) else 0
        if capacity == 0:
            raise NotTakenError(
                "shape",
                f"a sequence of {len(sequence.reward)} transitions and {each} bytes, expected at "
                f"least one transition and at most {self._capacity_bytes} bytes",
            )
        shapes = {name: (capacity + 1, *getattr(sequence, name).shape) for name in FIELDS}
        shapes |= dict.fromkeys(LABELS, (capacity + 1,))
        self._spec_digest = sequence.spec_digest
        if self._files is None:
            self._arrays = {name: np.empty(shape, _dtype(name)) for name, shape in shapes.items()}
        else:
            dtypes = {name: _dtype(name) for name in shapes}
            self._arrays, self._counts = self._files.make(self._spec_digest, shapes, dtypes)

    def _open(self, files: RingFiles) -> None:
        self._spec_digest, self._arrays, self._counts = files.open((*FIELDS, *LABELS))
        each = sum(self._arrays[name][0].nbytes for name in FIELDS)
        if self.capacity != self._capacity_bytes // each:
            raise ConfigError(
                f"{files.folder} has room for {self.capacity} sequences of {each} bytes, expected "
                f"{self._capacity_bytes // each}: it was made with another capacity_mib"
            )

    def _check(self, sequence: Sequence) -> None:
        for name in FIELDS:
            got, expected = getattr(sequence, name).shape, self._arrays[name].shape[1:]
            if got != expected:
                raise NotTakenError("shape", f"{name} has shape {got}, expected {expected}")


def _dtype(name: str) -> type[np.generic]:
    return np.int64 if name in LABELS else np.float32
