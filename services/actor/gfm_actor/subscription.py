"""The newest policy, and how long ago the learner was last heard of."""

from __future__ import annotations

import logging
from typing import final

from gfm.core import BadInputError, Clock, EnvironmentSpec, UnreachableError, Weights
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.presence import Presence
from gfm.transport import PendingReply, Transport
from gfm_wire import Message, WeightsRequest

_PAUSE_NS = 200_000_000

_log = logging.getLogger(__name__)


@final
class PolicySubscription:
    """Follows `weights`, and asks `weights/current` until there are any.

    Versions go forwards only, with one exception: where nothing was heard for longer than the
    limit, an older version is taken too. A learner that came back from an older checkpoint would
    otherwise wait for actors that wait for it.

    Attributes:
        policy: The newest policy; None before the first.
        version: Its version; -1 before the first.
        rejected: Weights that were of no use here.
    """

    def __init__(
        self, spec: EnvironmentSpec, transport: Transport, clock: Clock, *, max_age_s: float
    ) -> None:
        self.policy: GaussianPolicy | None = None
        self.version = -1
        self.rejected = 0
        self._spec = spec
        self._transport = transport
        self._clock = clock
        self._max_age_s = max_age_s
        self._learner = Presence("learner", clock)
        self._heard_ns = clock.now_ns()
        self._broadcasts = transport.subscribe("weights")
        self._asked: PendingReply | None = None
        self._ask_ns = clock.now_ns()

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
            RefusedError: the learner learns for another environment.
        """
        message = self._broadcasts.latest()
        if message is not None:
            self._learner.heard()
        if message is None and (self.policy is None or self.is_stale):
            message = self._ask()
        if isinstance(message, Weights):
            self._take(message)

    def _ask(self) -> Message | None:
        if self._asked is None:
            if self._clock.now_ns() < self._ask_ns:
                return None
            request = WeightsRequest(spec_digest=self._spec.digest)
            self._asked = self._transport.request("weights/current", request, timeout_s=2.0)
        try:
            answer = self._asked.poll()
        except UnreachableError as error:
            self._learner.lost(error)
            self._asked = None
            self._ask_ns = self._clock.now_ns() + _PAUSE_NS
            return None
        if answer is not None:
            self._learner.heard()
            self._asked = None
            self._ask_ns = self._clock.now_ns() + _PAUSE_NS
        return answer

    def _take(self, weights: Weights) -> None:
        if weights.spec_digest != self._spec.digest:
            self._reject(f"they are for spec {weights.spec_digest}, not {self._spec.digest}")
        elif weights.version == self.version:
            self._heard_ns = self._clock.now_ns()
        elif weights.version > self.version or self.is_stale:
            self._adopt(weights)

    def _adopt(self, weights: Weights) -> None:
        try:
            policy = GaussianPolicy.from_weights(weights)
        except (BadInputError, ValueError) as error:
            self._reject(str(error))
            return
        sizes = policy.observation_size, policy.action_size
        if sizes != (self._spec.policy_size, self._spec.action_size):
            self._reject(f"they map {sizes[0]} observations to {sizes[1]} actions")
            return
        if weights.version < self.version:
            _log.warning("weights went back from %d to %d", self.version, weights.version)
        self.policy, self.version = policy, weights.version
        self._heard_ns = self._clock.now_ns()

    def _reject(self, reason: str) -> None:
        self.rejected += 1
        _log.warning("rejected weights: %s", reason)
