"""Takes sequences, acknowledges them, and hands out batches."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import RefusedError, Sequence, Status
from gfm.service import Service, make_status
from gfm.transport import Request, Transport
from gfm_replay.arrivals import Arrivals
from gfm_replay.buffer import SequenceBuffer
from gfm_replay.config import ReplayConfig
from gfm_replay.files import RingFiles
from gfm_wire import NotReady, SampleRequest, SequenceAck

_INSERTS_PER_STEP = 64


@final
class ReplayService(Service):
    """Serves `replay/insert` and `replay/sample`.

    A Sequence is answered by a SequenceAck, a SampleRequest by a Batch or by NotReady.
    """

    def __init__(
        self, config: ReplayConfig, transport: Transport, rng: np.random.Generator
    ) -> None:
        self._config = config
        self._rng = rng
        self._files = RingFiles(Path(config.folder)) if config.folder else None
        self._buffer = SequenceBuffer(config.capacity_mib * 2**20, self._files)
        if self._files is not None:
            self._files.restore_random(rng)
        self._arrivals = Arrivals()
        self._inserts = transport.serve("replay/insert")
        self._samples = transport.serve("replay/sample")
        self._counters: Counter[str] = Counter(batches=0, duplicates=0, given_up=0)
        self._note = "waiting for the first sequence"

    @override
    def step(self) -> bool:
        worked = False
        for _ in range(_INSERTS_PER_STEP):
            if (request := self._inserts.receive()) is None:
                break
            self._answer_insert(request)
            worked = True
        if (request := self._samples.receive()) is not None:
            self._answer_sample(request)
            worked = True
        return worked

    @override
    def status(self) -> Status:
        buffer = self._buffer
        return make_status(
            "replay",
            self._config.name,
            counters={
                **self._counters,
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
    def close(self) -> None:
        """Keeps the random state beside the sequences, where these are kept in files."""
        if self._files is not None:
            self._files.save_random(self._rng)

    def _answer_insert(self, request: Request) -> None:
        if not isinstance(request.message, Sequence):
            self._refuse(request, f"got {type(request.message).__name__}, expected Sequence")
            return
        try:
            ack = self._insert(request.message)
        except RefusedError as error:
            self._refuse(request, str(error))
            return
        request.reply(ack)

    def _insert(self, sequence: Sequence) -> SequenceAck:
        life = self._arrivals.life(sequence.actor, sequence.epoch)
        if life.has(sequence.number):
            self._counters["duplicates"] += 1
        else:
            self._buffer.insert(sequence)
            self._counters["given_up"] += life.add(sequence.number)
        return SequenceAck(actor=sequence.actor, epoch=sequence.epoch, cursor=life.cursor)

    def _answer_sample(self, request: Request) -> None:
        wanted = request.message
        if not isinstance(wanted, SampleRequest):
            self._refuse(request, f"got {type(wanted).__name__}, expected SampleRequest")
            return
        not_ready = self._not_ready(wanted.batch_size)
        if not_ready is not None:
            self._note = not_ready.reason
            request.reply(not_ready)
            return
        if wanted.spec_digest not in ("", self._buffer.spec_digest):
            self._refuse(
                request,
                f"spec_digest is {wanted.spec_digest!r:.40}, expected {self._buffer.spec_digest!r}",
            )
            return
        request.reply(self._buffer.sample(wanted.batch_size, self._rng))
        self._counters["batches"] += 1
        self._note = "handing out batches"

    def _not_ready(self, batch_size: int) -> NotReady | None:
        """Returns what keeps the next batch from being handed out, or None."""
        inserted, sampled = self._buffer.inserted, self._buffer.sampled
        limit = self._config.max_samples_per_insert
        needed = self._config.min_size
        if limit is not None:
            needed = max(needed, math.ceil((sampled + batch_size) / limit))
        if inserted >= needed:
            return None
        reason = f"the learner waits for actors: {inserted} of {needed} sequences have arrived"
        return NotReady(reason=reason, inserted=inserted, needed=needed)

    def _refuse(self, request: Request, reason: str) -> None:
        self._counters["rejected_messages"] += 1
        self._note = f"refused a message: {reason}"
        request.refuse(reason)
