"""Batches from the replay service, asked for ahead so that learning need not wait for them."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core import (
    PRIORITY_LIMIT,
    Batch,
    Clock,
    EnvironmentSpec,
    RefusedError,
    UnreachableError,
    implausible,
)
from gfm.core.checks import Array32
from gfm.service.presence import Presence
from gfm.service.refusals import Refusals
from gfm.transport import PendingReply, Transport
from gfm_wire import Message, NotReady, SampleRequest

_KEY = "replay/sample"
_PAUSE_NS = 20_000_000


@final
class BatchSource:
    """Keeps a few questions for batches under way; gives only batches that are what was asked for.

    Attributes:
        note: What is being waited for, in words; empty while batches flow.
        unanswered: Questions that got no answer in time.
        refused: Questions that were refused.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        refusals: Refusals,
        spec: EnvironmentSpec,
        *,
        batch_size: int,
        prefetch: int,
        timeout_s: float,
    ) -> None:
        self.note = "asking for the first batch"
        self.unanswered = 0
        self.refused = 0
        self._transport = transport
        self._clock = clock
        self._refusals = refusals
        self._spec = spec
        self._batch_size = batch_size
        self._prefetch = prefetch
        # Each question tells of one batch. What got lost was a hint, and a later one replaces it.
        self._errors: deque[tuple[NDArray[np.int64], Array32]] = deque(maxlen=prefetch + 1)
        self._timeout_s = timeout_s
        self._replay = Presence("replay", clock)
        self._pending: deque[PendingReply] = deque()
        self._resume_ns = clock.now_ns()

    def poll(self) -> Batch | None:
        """Returns a batch, or None while there is none; asks for further ones."""
        batch = self._receive()
        if self._clock.now_ns() >= self._resume_ns:
            while len(self._pending) < self._prefetch:
                self._pending.append(self._ask())
        return batch

    def learned(self, batch: Batch, error: Array32) -> None:
        """Tells replay by the next question how much the learner erred about each sequence.

        Args:
            batch: What was learned from.
            error: At least 0, shape (B,).
        """
        self._errors.append((batch.index, np.minimum(error, PRIORITY_LIMIT)))

    def _ask(self) -> PendingReply:
        request = SampleRequest(batch_size=self._batch_size, spec_digest=self._spec.digest)
        if self._errors:
            seen, error = self._errors.popleft()
            request = replace(request, seen=seen, priority=error)
        return self._transport.request(_KEY, request, timeout_s=self._timeout_s)

    def _receive(self) -> Batch | None:
        if not self._pending:
            return None
        try:
            answer = self._pending[0].poll()
        except UnreachableError as error:
            self.unanswered += 1
            self._replay.lost(error)
            self._pause(f"waiting for replay: {error}")
            return None
        except RefusedError as error:
            self.refused += 1
            self._replay.heard()
            self._pause(f"replay refused to give a batch: {error}")
            return None
        if answer is None:
            return None
        self._replay.heard()
        if isinstance(answer, NotReady):
            self._pause(answer.reason)
            return None
        if reason := self._reason_against(answer):
            self._refusals.add("batch", self._pending[0].stamp.sender, reason)
            self._pause(self._refusals.note)
            return None
        self._pending.popleft()
        self.note = ""
        assert isinstance(answer, Batch)
        return answer

    def _reason_against(self, answer: Message) -> str:
        """Returns why an answer is not the batch that was asked for; empty where it is."""
        if not isinstance(answer, Batch):
            return f"replay answered {type(answer).__name__}, expected Batch"
        if answer.spec_digest != self._spec.digest:
            return f"a batch for spec {answer.spec_digest!r:.40}, expected {self._spec.digest!r}"
        size, wanted = len(answer.reward), self._batch_size
        if size != wanted or not answer.reward.size:
            return f"a batch of shape {answer.reward.shape}, expected {wanted} sequences"
        if not 0.0 < answer.probability.min() <= answer.probability.max() <= 1.0:
            span = f"{answer.probability.min():g} to {answer.probability.max():g}"
            return f"a batch drawn with probabilities of {span}, expected more than 0 to 1"
        return implausible(answer, self._spec)

    def _pause(self, note: str) -> None:
        self._pending.popleft()
        self.note = note
        self._resume_ns = self._clock.now_ns() + _PAUSE_NS
