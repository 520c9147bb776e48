"""The newest policy, and how long ago the learner was last heard of."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import final

from gfm.core import BadInputError, Clock, EnvironmentSpec, RefusedError, Weights
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.question import Question
from gfm.service.refusals import Refusals
from gfm.transport import Transport
from gfm_actor.probe import usable_policy
from gfm_wire import Stamp, WeightsRequest

LEAP = 1_000_000
"""Versions that a broadcast may be ahead of the one before; more is asked about first."""

_log = logging.getLogger(__name__)


@final
class PolicySubscription:
    """Follows `weights`, and asks `weights/current` about whatever does not continue what it has.

    A broadcast is believed where it continues what the learner itself has answered: same life,
    same connection, same architecture, a version not before and not far beyond the current one.
    Everything else is a rumour, about which the learner is asked: first weights, those of a learner
    that was started again, and those of a stranger. Its answer counts. It is refused where it is of
    an older life than the one that is followed, unless nothing was heard of that one for longer
    than the limit: a clock may have been set back.

    Attributes:
        policy: The newest policy; None before the first.
        life: The learner's life that it is from; -1 before the first.
        version: Its version; -1 before the first.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        transport: Transport,
        clock: Clock,
        refusals: Refusals,
        *,
        run: str,
        max_age_s: float,
        settings: Mapping[str, str] | None = None,
    ) -> None:
        self.policy: GaussianPolicy | None = None
        self.life = -1
        self.version = -1
        self._spec = spec
        self._refusals = refusals
        self._run = run
        self._request = WeightsRequest(spec_digest=spec.digest, settings=settings or {})
        self._clock = clock
        self._max_age_s = max_age_s
        self._question = Question(transport, clock, "weights/current", "learner")
        self._followed: tuple[str, int] = ("", -1)
        self._architecture = ""
        self._heard_ns = clock.now_ns()
        self._broadcasts = transport.subscribe("weights")
        self._rumour = False

    @property
    def age_s(self) -> float:
        """Time since these weights were last confirmed by the learner."""
        return (self._clock.now_ns() - self._heard_ns) * 1e-9

    @property
    def is_stale(self) -> bool:
        """Whether the policy is older than the limit."""
        return self.age_s > self._max_age_s

    def poll(self) -> None:
        """Takes the newest weights that have come.

        Raises:
            RefusedError: the learner learns for another environment, or one with other settings,
            and never had weights for us.
        """
        message = self._broadcasts.latest()
        if isinstance(message, Weights):
            self._hear(message, self._broadcasts.stamp)
        wanted = self.policy is None or self._rumour or self.is_stale
        if wanted or self._question.is_under_way:
            self._ask()

    def _hear(self, weights: Weights, stamp: Stamp) -> None:
        if not self._concerns(weights, stamp):
            return
        continues = (
            (stamp.sender, stamp.epoch) == self._followed
            and weights.life == self.life
            and weights.architecture == self._architecture
            and 0 <= weights.version - self.version <= LEAP
        )
        if not continues:
            self._rumour = True
        else:
            self._take(weights, stamp)

    def _ask(self) -> None:
        try:
            answered = self._question.poll(self._request)
        except RefusedError:
            if self.policy is None:
                raise
            return
        if answered is not None:
            self._rumour = False
            answer, stamp = answered
            if isinstance(answer, Weights) and self._concerns(answer, stamp):
                self._believe(answer, stamp)

    def _believe(self, weights: Weights, stamp: Stamp) -> None:
        if weights.life < self.life and not self.is_stale:
            self._refuse("life", stamp, f"they are of life {weights.life}, before {self.life}")
            return
        if weights.life < self.life or (
            weights.life == self.life and weights.version < self.version
        ):
            _log.warning(
                "the learner went back from version %d of life %d to version %d of life %d",
                *(self.version, self.life, weights.version, weights.life),
            )
        self._take(weights, stamp)

    def _concerns(self, weights: Weights, stamp: Stamp) -> bool:
        """Returns whether weights are meant for this run and environment at all."""
        if weights.run != self._run:
            self._refuse("run", stamp, f"they are of run {weights.run!r:.80}, not {self._run!r}")
        elif weights.spec_digest != self._spec.digest:
            other = f"spec {weights.spec_digest!r:.40}"
            self._refuse("spec", stamp, f"they are for {other}, not {self._spec.digest!r}")
        else:
            return True
        return False

    def _take(self, weights: Weights, stamp: Stamp) -> None:
        """Adopts weights that are usable; a repeated version is a sign of life."""
        source = stamp.sender, stamp.epoch
        known = (source, weights.life, weights.version) == (
            self._followed,
            self.life,
            self.version,
        )
        if not known:
            try:
                self.policy = usable_policy(weights, self._spec)
            except BadInputError as error:
                self._refuse("policy", stamp, f"version {weights.version}: {error}")
                return
            self.life, self.version = weights.life, weights.version
            self._followed, self._architecture = source, weights.architecture
        self._heard_ns = self._clock.now_ns()

    def _refuse(self, reason: str, stamp: Stamp, detail: str) -> None:
        self._refusals.add(reason, stamp.sender, f"weights: {detail}")
