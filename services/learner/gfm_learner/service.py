"""Learns from batches of the replay service and broadcasts the policy."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import Batch, Clock, GfmError, Status, Weights
from gfm.recording.weights_file import write_weights
from gfm.rl.learner import Stats, learner_step
from gfm.rl.learner_state import policy_tensors
from gfm.service import Service, make_status
from gfm.service.metrics import MetricsSink
from gfm.service.refusals import Refusals
from gfm.transport import Transport
from gfm_learner.answers import Answers
from gfm_learner.batches import BatchSource
from gfm_learner.checkpoint import CHECKPOINT, POLICY, Progress, save_checkpoint
from gfm_learner.config import LearnerConfig

_log = logging.getLogger(__name__)


class LearningDivergedError(GfmError):
    """A loss is not finite any more; the last checkpoint is from before."""

    def __init__(self, step: int, losses: Mapping[str, float]) -> None:
        listed = ", ".join(f"{name} is {value}" for name, value in losses.items())
        super().__init__(f"learning diverged at step {step}: {listed}, expected finite numbers")


@final
class LearnerService(Service):
    """Asks `replay/sample`, publishes `weights`, serves `weights/current` and `run/environment`.

    Weights are those of the target policy (see `gfm.rl.learner_state.policy_tensors`). They are
    published at the start, whenever the targets change, and as a heartbeat.
    """

    def __init__(
        self,
        config: LearnerConfig,
        progress: Progress,
        transport: Transport,
        clock: Clock,
        metrics: MetricsSink,
    ) -> None:
        self._config = config
        self._progress = progress
        self._transport = transport
        self._clock = clock
        self._metrics = metrics
        self._healthy = True
        self._failed_saves = 0
        self._life = max(clock.utc_ns(), progress.past_life + 1)
        self._refusals = Refusals()
        self._batches = BatchSource(
            transport,
            clock,
            self._refusals,
            progress.spec,
            batch_size=config.batch_size,
            prefetch=config.prefetch,
            timeout_s=config.timeout_s,
        )
        self._answers = Answers(config, progress.spec, transport, self._refusals, clock)
        self._weights = self._make_weights()
        self._published_ns: int | None = None
        self._saved_ns = clock.now_ns()
        self._row_began = (clock.now_ns(), progress.state.steps)
        self._gauges: dict[str, float] = {}

    @property
    def weights(self) -> Weights:
        """The newest weights that were published, or are about to be."""
        return self._weights

    @override
    def step(self) -> bool:
        self._publish_when_due()
        worked = self._answers.poll(self._weights)
        if self._finished:
            return worked
        batch = self._batches.poll()
        if batch is None:
            return worked
        self._learn(batch)
        self._save_when_due()
        return True

    @override
    def status(self) -> Status:
        return make_status(
            "learner",
            self._config.name,
            counters={
                "learner_steps": self._progress.state.steps,
                "batches_unanswered": self._batches.unanswered,
                "batches_refused": self._batches.refused,
                "checkpoints_failed": self._failed_saves,
                **self._refusals.counters,
            },
            gauges={"weights_version": float(self._weights.version), **self._gauges},
            note=self._note,
        )

    @override
    def lasting(self) -> frozenset[str]:
        return frozenset({"learner_steps"})

    @override
    def close(self) -> None:
        """Saves, unless what would be saved is broken."""
        if self._healthy:
            self._save()
        self._metrics.close()

    @property
    def _finished(self) -> bool:
        limit = self._config.max_steps
        return limit is not None and self._progress.state.steps >= limit

    @property
    def _note(self) -> str:
        if self._finished:
            return f"done: {self._config.max_steps} steps; serving weights"
        return self._batches.note or "learning"

    def _learn(self, batch: Batch) -> None:
        progress, config = self._progress, self._config
        state, stats, error = learner_step(
            progress.state,
            batch,
            config.learning,
            progress.generator,
            importance_exponent=config.importance_exponent,
        )
        self._progress = replace(progress, state=state)
        self._check_finite(stats)
        self._batches.learned(batch, error)
        if state.steps % config.learning.target_period == 0 or self._finished:
            self._weights = self._make_weights()
            self._publish()
        if state.steps % config.metrics_every == 0 or self._finished:
            self._record(batch, stats)

    def _check_finite(self, stats: Stats) -> None:
        losses = {name: float(stats[name]) for name in ("critic_loss", "policy_loss")}
        if not all(math.isfinite(loss) for loss in losses.values()):
            self._healthy = False
            raise LearningDivergedError(self._progress.state.steps, losses)

    def _record(self, batch: Batch, stats: Stats) -> None:
        now_ns, steps = self._clock.now_ns(), self._progress.state.steps
        began_ns, began_steps = self._row_began
        own = batch.weights_life == self._life
        row = {name: float(value) for name, value in stats.items()} | {
            "reward_mean": float(batch.reward.mean()),
            "terminal_share": float((batch.discount == 0.0).mean()),
            "earlier_life_share": float(1.0 - own.mean()),
            **_staleness(steps, batch.weights_version[own]),
            "learner_steps_per_s": (steps - began_steps) / max((now_ns - began_ns) * 1e-9, 1e-9),
        }
        self._row_began = now_ns, steps
        self._gauges = row
        self._metrics.write(steps, self._clock.utc_ns() * 1e-9, row)

    def _make_weights(self) -> Weights:
        return Weights(
            version=self._progress.state.steps,
            created_ns=self._clock.utc_ns(),
            spec_digest=self._progress.spec.digest,
            tensors=policy_tensors(self._progress.state),
            run=self._config.run,
            life=self._life,
        )

    def _publish_when_due(self) -> None:
        heartbeat_ns = self._config.heartbeat_s * 1e9
        if self._published_ns is None or self._clock.now_ns() - self._published_ns >= heartbeat_ns:
            self._publish()

    def _publish(self) -> None:
        self._transport.publish("weights", self._weights)
        self._published_ns = self._clock.now_ns()

    def _save_when_due(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns - self._saved_ns >= self._config.checkpoint_period_s * 1e9 or self._finished:
            self._save()
            self._saved_ns = now_ns

    def _save(self) -> None:
        """Writes checkpoint and policy; learning goes on where the disk takes nothing."""
        if not self._config.checkpoint_dir:
            return
        folder = Path(self._config.checkpoint_dir)
        try:
            save_checkpoint(folder / CHECKPOINT, self._config, self._progress, self._life)
            write_weights(folder / POLICY, self._make_weights())
        except OSError as error:
            self._failed_saves += 1
            steps, reason = self._progress.state.steps, error.strerror or error
            _log.error("no checkpoint of step %d: %s: %s", steps, folder, reason)


def _staleness(steps: int, versions: NDArray[np.int64]) -> dict[str, float]:
    """Returns how old the policies that acted are; nothing where none is of this life.

    Args:
        steps: Learner steps so far.
        versions: Of the policies of this life, one per sequence.
    """
    if not len(versions):
        return {}
    staleness = np.maximum(steps - 1 - versions, 0)
    return {
        "staleness_mean_steps": float(staleness.mean()),
        "staleness_max_steps": float(staleness.max()),
    }
