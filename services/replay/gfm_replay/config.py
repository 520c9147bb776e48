"""What the replay service may be told."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from gfm.core import ConfigError
from gfm.service import ServiceConfig
from gfm_wire import Role


class ReplayConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the replay service.

    Attributes:
        capacity_mib: Memory for sequences; the oldest make room for new ones.
        min_size: Sequences that must have been accepted before the first batch.
        max_samples_per_insert: Sequences handed out per sequence accepted, at most; beyond that
            the learner waits for the actors. None does not limit it.
        min_samples_per_insert: The same, at least; below that the actors wait for the learner.
            The first `min_size` sequences do not count for it. None does not limit it.
        priority_exponent: How much more often those are drawn about which the learner errs more:
            with 1 in proportion to its error, with 0 all alike. What it said of them is not kept
            on disk: after a restart all are alike until it has said so anew.
        most_per_s: Questions of each kind that one sender may ask in a second; as many at once. An
            actor that nothing holds back sends a few hundred sequences.
        max_batch_size: Sequences of one batch, at most; nor more than the capacity, nor than fit
            into one message.
        sequence_length: Transitions that every sequence must have; None takes what the first has.
        seed: Of the choice of sequences.
        folder: Where sequences are kept in files, for this process and those after it; empty keeps
            them in memory.
    """

    role: ClassVar[Role] = Role.REPLAY

    capacity_mib: int = 256
    min_size: int = 64
    max_samples_per_insert: float | None = None
    min_samples_per_insert: float | None = None
    priority_exponent: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    most_per_s: Annotated[float, Meta(ge=1.0)] = 2000.0
    max_batch_size: int = 4096
    sequence_length: int | None = None
    seed: int = 0
    folder: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("capacity_mib", "min_size", "max_batch_size"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected at least 1")
        for name in ("max_samples_per_insert", "min_samples_per_insert"):
            if (limit := getattr(self, name)) is not None and not limit > 0:
                raise ConfigError(f"{name} is {limit}, expected more than 0")
        self._check_band()

    def _check_band(self) -> None:
        """Refuses bounds between which learner and actors could wait for one another.

        Both wait where the largest batch would lead beyond one bound, and one more sequence below
        the other. The room between the bounds grows with what has arrived, so that the beginning
        decides: `min_size` sequences, none of which counts for the lower bound.
        """
        least, most = self.min_samples_per_insert, self.max_samples_per_insert
        if least is None or most is None:
            return
        if least > most:
            raise ConfigError(
                f"min_samples_per_insert is {least:g} and max_samples_per_insert is {most:g}, "
                "expected no more than that"
            )
        if self.max_batch_size > (fits := most * self.min_size - least):
            raise ConfigError(
                f"max_batch_size is {self.max_batch_size}, expected at most {max(fits, 0.0):g} "
                f"with {least:g} to {most:g} samples per insert and min_size {self.min_size}: "
                "learner and actors could wait for one another"
            )
