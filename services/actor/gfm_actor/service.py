"""Acts in many instances of one environment and sends what happened to the replay service."""

from __future__ import annotations

from collections import Counter, deque
from typing import final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import ACTION_LIMIT, LOG_PROB_LIMIT, Clock, EnvironmentSpec, Sequence, Status
from gfm.core.checks import Array32
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service import Service, make_status
from gfm.service.environment_words import environment_words
from gfm.service.ledger import make_ledger
from gfm.service.refusals import Refusals
from gfm.transport import Transport
from gfm_actor.assembler import Acted, Assembler, Segment
from gfm_actor.config import ActorConfig
from gfm_actor.outbox import Outbox
from gfm_actor.subscription import PolicySubscription

_RECENT_EPISODES = 200
_DRAIN_POLL_NS = 1_000_000


@final
class ActorService(Service):
    """Follows `weights` and asks `replay/insert`.

    It acts only with weights that are not too old, and only while its unacknowledged sequences fit
    into their window.
    """

    def __init__(
        self,
        config: ActorConfig,
        env: BatchedEnvironment,
        transport: Transport,
        clock: Clock,
        rng: np.random.Generator,
    ) -> None:
        self._config = config
        self._env = env
        self._clock = clock
        self._rng = rng
        self._epoch = clock.utc_ns()
        self._refusals = Refusals()
        self._policy = PolicySubscription(
            env.spec,
            transport,
            clock,
            self._refusals,
            run=config.run,
            max_age_s=config.max_weights_age_s,
            settings=environment_words(config.env, config.environment),
        )
        self._outbox = Outbox(
            transport,
            clock,
            self._refusals,
            window=config.window,
            timeout_s=config.timeout_s,
            ledger=make_ledger(config.ledger, config.name, self._epoch),
        )
        self._assembler = Assembler(env.spec, env.num_envs, config.sequence_length)
        self._observation = env.reset()
        self._return = np.zeros(env.num_envs)
        self._returns: deque[float] = deque(maxlen=_RECENT_EPISODES)
        self._counters: Counter[str] = Counter(env_steps=0, episodes=0, unusable_steps=0)
        self._next_ns = clock.now_ns()
        self._note = "starting"

    @override
    def step(self) -> bool:
        self._outbox.poll()
        self._policy.poll()
        policy = self._policy.policy
        self._note = self._reason_to_wait()
        if policy is None or self._note or self._clock.now_ns() < self._next_ns:
            return False
        self._pace()
        self._act(policy)
        return True

    @override
    def status(self) -> Status:
        outbox, gauges = (
            self._outbox,
            {
                "weights_version": float(self._policy.version),
                "weights_age_s": self._policy.age_s,
                "sequences_unacknowledged": float(len(self._outbox)),
            },
        )
        gauges |= self._env.gauges()
        if self._returns:
            gauges["episode_return_mean"] = float(np.mean(self._returns))
        return make_status(
            "actor",
            self._config.name,
            counters={
                **self._counters,
                "sequences_sent": outbox.sent,
                "sequences_acked": outbox.acked,
                "sequences_resent": outbox.resent,
                "sequences_refused": outbox.refused,
                "lost_steps": self._assembler.lost_steps,
                "replays_changed": outbox.replays,
                **self._refusals.counters,
            },
            gauges=gauges,
            note=self._note or outbox.note or "acting",
        )

    @override
    def close(self) -> None:
        """Waits a moment for what is unacknowledged: an acknowledged sequence is in replay."""
        deadline_ns = self._clock.now_ns() + round(self._config.drain_s * 1e9)
        self._outbox.poll()
        while len(self._outbox) and self._clock.now_ns() < deadline_ns:
            self._clock.sleep_until_ns(self._clock.now_ns() + _DRAIN_POLL_NS)
            self._outbox.poll()

    def _reason_to_wait(self) -> str:
        """Returns why not to act now, in words; empty if there is no reason."""
        if self._policy.policy is None:
            return "waiting for the learner's first weights"
        if self._policy.is_stale:
            return (
                f"waiting for the learner: weights are {self._policy.age_s:.0f} s old, "
                f"limit {self._config.max_weights_age_s:.0f} s"
            )
        if not self._outbox.has_room(self._env.num_envs):
            waiting = f"waiting for replay to acknowledge {len(self._outbox)} sequences"
            return self._outbox.note or waiting
        return ""

    def _pace(self) -> None:
        if self._config.max_steps_per_s is not None:
            period_ns = round(self._env.num_envs / self._config.max_steps_per_s * 1e9)
            self._next_ns = max(self._next_ns + period_ns, self._clock.now_ns() - period_ns)

    def _act(self, policy: GaussianPolicy) -> None:
        self._env.set_progress(self._policy.version)
        seen = self._observation[:, : self._env.spec.policy_size]
        with np.errstate(all="ignore"):  # what comes of it is judged below
            action, log_prob = policy.sample(seen, self._rng)
        decided = _is_decided(action, log_prob)
        action[~decided] = 0.0
        transition = self._env.step(action)
        valid = decided & _is_usable(transition, self._env.spec)
        acted = Acted(
            observation=self._observation,
            action=action,
            log_prob=log_prob,
            weights_life=self._policy.life,
            weights_version=self._policy.version,
        )
        for segment in self._assembler.add(acted, transition, valid):
            self._outbox.send(self._numbered(segment))
        self._count(transition, valid)
        over = np.flatnonzero(transition.ended | ~valid)
        self._observation = self._env.reset(over) if len(over) else transition.observation

    def _numbered(self, segment: Segment) -> Sequence:
        return Sequence(
            actor=self._config.name,
            epoch=self._epoch,
            number=self._outbox.sent,
            spec_digest=self._env.spec.digest,
            **vars(segment),
        )

    def _count(self, transition: Transition, valid: NDArray[np.bool_]) -> None:
        self._return += np.where(valid, transition.reward, 0.0)
        self._returns.extend(self._return[transition.ended & valid])
        self._return[transition.ended | ~valid] = 0.0
        self._counters["env_steps"] += len(valid)
        self._counters["episodes"] += int((transition.ended & valid).sum())
        self._counters["unusable_steps"] += int((~valid).sum())


def _is_decided(action: Array32, log_prob: Array32) -> NDArray[np.bool_]:
    """Returns where actions and their densities are ones that replay would take."""
    decided: NDArray[np.bool_] = (np.abs(action) <= ACTION_LIMIT).all(axis=1) & (
        np.abs(log_prob) <= LOG_PROB_LIMIT
    )
    return decided


def _is_usable(transition: Transition, spec: EnvironmentSpec) -> NDArray[np.bool_]:
    """Returns where a step is within the environment's ranges, which NaN never is."""
    usable: NDArray[np.bool_] = (
        (np.abs(transition.observation) <= spec.observation_limit).all(axis=1)
        & (np.abs(transition.reward) <= spec.reward_limit)
        & np.isfinite(transition.discount)
    )
    return usable
