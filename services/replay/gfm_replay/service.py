"""Takes sequences, acknowledges them, and hands out batches."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Batch, Clock, EnvironmentSpec, Sequence, Status
from gfm.service import Service, make_status
from gfm.service.rates import Rates
from gfm.service.refusals import Refusals
from gfm.service.turns import Turns
from gfm.transport import Request, Transport
from gfm_replay.arrivals import OUT_OF_ORDER, Arrivals
from gfm_replay.buffer import SequenceBuffer
from gfm_replay.config import ReplayConfig
from gfm_replay.door import (
    HeldBackError,
    NotNowError,
    NotTakenError,
    check_request,
    check_sequence,
)
from gfm_replay.expected import ExpectedEnvironment
from gfm_replay.journal import Journal, Kept
from gfm_wire import MAX_BYTES, NotReady, SampleRequest, SequenceAck

_INSERTS_PER_STEP = 64
_ENVELOPE_BYTES = 4096
_LONGEST_LINE = OUT_OF_ORDER  # no actor has more unacknowledged
_BUSY = NotReady(reason="you ask more than is answered: too many questions wait, or came at once")


@final
class ReplayService(Service):
    """Serves `replay/insert` and `replay/sample`.

    A Sequence is answered by a SequenceAck, a SampleRequest by a Batch or by NotReady. Before the
    learner has said what the run learns for, sequences wait unanswered and are sent again.
    """

    def __init__(
        self, config: ReplayConfig, transport: Transport, clock: Clock, rng: np.random.Generator
    ) -> None:
        self._config = config
        self._rng = rng
        self._journal = Journal(Path(config.folder)) if config.folder else None
        kept = None if self._journal is None else self._journal.open()
        self._buffer = SequenceBuffer(
            config.capacity_mib * 2**20,
            self._journal,
            kept,
            priority_exponent=config.priority_exponent,
        )
        self._arrivals = Arrivals()
        spec = None if kept is None else self._restore(kept)
        self._expected = ExpectedEnvironment(transport, clock, spec)
        self._refusals = Refusals()
        inserts, samples = transport.serve("replay/insert"), transport.serve("replay/sample")
        self._inserts, self._samples = (
            Turns(
                server,
                self._refusals,
                Rates(clock, config.most_per_s),
                longest=_LONGEST_LINE,
                busy=_BUSY,
            )
            for server in (inserts, samples)
        )
        self._counters: Counter[str] = Counter(
            batches=0, duplicates=0, given_up=0, no_room=0, held_back=0
        )
        self._note = "waiting for the first sequence"

    def _restore(self, kept: Kept) -> EnvironmentSpec:
        """Goes on where an earlier process ended; returns what its run learned for."""
        for actor, epoch, life in kept.lives():
            self._arrivals.put(actor, epoch, life)
        if kept.random is not None:
            self._rng.bit_generator.state = kept.random
        return kept.layout.spec

    @override
    def step(self) -> bool:
        self._expected.poll()
        worked = self._take_inserts()
        if (request := self._samples.receive()) is not None:
            self._answer_sample(request)
            worked = True
        return worked

    def _take_inserts(self) -> bool:
        if (spec := self._expected.spec) is None:
            return False
        for taken in range(_INSERTS_PER_STEP):
            if (request := self._inserts.receive()) is None:
                return taken > 0
            self._answer_insert(request, spec)
        return True

    @override
    def status(self) -> Status:
        buffer = self._buffer
        return make_status(
            "replay",
            self._config.name,
            counters={
                **self._counters,
                **self._refusals.counters,
                "replay_sequences": buffer.inserted,
                "replay_steps": buffer.inserted * buffer.steps,
                "samples": buffer.sampled,
            },
            gauges={
                "replay_stored_sequences": len(buffer),
                "replay_capacity_sequences": buffer.capacity,
                "replay_used_bytes": buffer.used_bytes,
                "samples_per_insert": buffer.sampled / max(buffer.inserted, 1),
                "actors_heard": len(self._arrivals),
            },
            note=self._note,
        )

    @override
    def lasting(self) -> frozenset[str]:
        kept = ("replay_sequences", "replay_steps", "samples")
        return frozenset(kept if self._journal is not None else ())

    @override
    def close(self) -> None:
        if self._journal is not None:
            self._journal.close()

    def _answer_insert(self, request: Request, spec: EnvironmentSpec) -> None:
        try:
            sequence = request.message
            if not isinstance(sequence, Sequence):
                raise NotTakenError("kind", f"got {type(sequence).__name__}, expected Sequence")
            check_sequence(sequence, spec, self._config.sequence_length)
            request.reply(self._insert(sequence, spec))
        except NotNowError as error:
            self._counters[error.counter] += 1
            request.reply(self._not_yet(str(error), 0))
        except NotTakenError as error:
            self._refuse(request, error)

    def _insert(self, sequence: Sequence, spec: EnvironmentSpec) -> SequenceAck:
        actor, epoch, number = sequence.actor, sequence.epoch, sequence.number
        life = self._arrivals.life(actor, epoch, number)
        if number < life.floor:
            raise NotTakenError(
                "late", f"sequence {number} of {actor}, expected none before {life.floor}"
            )
        if life.has(number):
            self._counters["duplicates"] += 1
        else:
            self._check_pace()
            self._buffer.insert(sequence, life, spec)
            self._counters["given_up"] += life.add(number)
        return SequenceAck(actor=actor, epoch=epoch, number=number, cursor=life.cursor)

    def _check_pace(self) -> None:
        """Raises HeldBackError where one more sequence would leave too few samples for each."""
        least, buffer = self._config.min_samples_per_insert, self._buffer
        if least is None:
            return
        counted = buffer.inserted + 1 - self._config.min_size
        if (needed := math.ceil(least * counted)) > buffer.sampled:
            raise HeldBackError(
                f"the actors wait for the learner: {buffer.sampled} of {needed} samples are taken"
            )

    def _answer_sample(self, request: Request) -> None:
        try:
            wanted = request.message
            if not isinstance(wanted, SampleRequest):
                raise NotTakenError("kind", f"got {type(wanted).__name__}, expected SampleRequest")
            request.reply(self._batch(wanted))
        except NotTakenError as error:
            self._refuse(request, error)

    def _batch(self, wanted: SampleRequest) -> Batch | NotReady:
        if (spec := self._expected.spec) is None:
            return self._not_yet("the learner has not said what the run learns for", 0)
        if wanted.spec_digest != spec.digest and not self._buffer.inserted:
            self._expected.doubt()
        check_request(wanted, spec, self._largest_batch)
        self._buffer.learned(wanted.seen, wanted.priority)
        inserted, sampled = self._buffer.inserted, self._buffer.sampled
        limit = self._config.max_samples_per_insert
        needed = self._config.min_size
        if limit is not None:
            needed = max(needed, math.ceil((sampled + wanted.batch_size) / limit))
        if inserted < needed:
            waits = f"the learner waits for actors: {inserted} of {needed} sequences have arrived"
            return self._not_yet(waits, needed)
        self._counters["batches"] += 1
        self._note = "handing out batches"
        batch = self._buffer.sample(wanted.batch_size, self._rng)
        if self._journal is not None:
            try:
                self._journal.note(self._buffer.sampled, self._rng)
            except OSError as error:
                self._note = f"where sampling stands is not on disk: {error.strerror or error}"
        return batch

    @property
    def _largest_batch(self) -> int:
        """Sequences of one batch, at most."""
        most, buffer = self._config.max_batch_size, self._buffer
        if not buffer.capacity:
            return most
        return min(most, buffer.capacity, (MAX_BYTES - _ENVELOPE_BYTES) // buffer.sequence_bytes)

    def _not_yet(self, reason: str, needed: int) -> NotReady:
        self._note = reason
        return NotReady(reason=reason, inserted=self._buffer.inserted, needed=needed)

    def _refuse(self, request: Request, error: NotTakenError) -> None:
        self._refusals.add(error.reason, request.stamp.sender, str(error))
        self._note = self._refusals.note
        request.refuse(str(error))
