"""What an actor that was told nothing about its environment learns from the run it joins."""

from __future__ import annotations

import logging

import msgspec
from msgspec.structs import replace

from gfm.core import Clock, ConfigError, UnreachableError
from gfm.envs.registry import EnvironmentSettings
from gfm.transport import Transport, ask
from gfm_actor.config import ActorConfig
from gfm_wire import EnvironmentRequest, RunEnvironment

_KEY = "run/environment"
_TRY_S = 2.0
_PAUSE_NS, _SAY_NS = 200_000_000, 10_000_000_000

_log = logging.getLogger(__name__)


def complete(config: ActorConfig, transport: Transport, clock: Clock) -> ActorConfig:
    """Returns the settings, with the run's environment where none was described.

    Waits for the learner as long as it takes: there is nothing to do before there are weights, and
    an environment of one's own would not be the one that is learned for.

    Raises:
        RefusedError: the run learns for another environment.
        ConfigError: the run's settings do not go with this actor's, or cannot be understood.
    """
    if config.environment == EnvironmentSettings():
        config = replace(config, environment=_environment(config, transport, clock))
        config.check_lengths()
    return config


def _environment(config: ActorConfig, transport: Transport, clock: Clock) -> EnvironmentSettings:
    answer = _ask(config, transport, clock)
    _log.info("the run's environment: %s", answer.settings)
    try:
        return msgspec.json.decode(answer.settings, type=EnvironmentSettings)
    except msgspec.DecodeError as exc:
        raise ConfigError(f"the learner's environment settings: {exc}") from exc


def _ask(config: ActorConfig, transport: Transport, clock: Clock) -> RunEnvironment:
    request = EnvironmentRequest(name=config.env)
    said_ns = clock.now_ns()
    while True:
        try:
            answer = ask(transport, _KEY, request, timeout_s=_TRY_S, clock=clock)
        except UnreachableError:
            answer = None
        if isinstance(answer, RunEnvironment):
            return answer
        if clock.now_ns() - said_ns >= _SAY_NS:
            said_ns = clock.now_ns()
            _log.warning("waiting for a learner to tell its environment")
        clock.sleep_until_ns(clock.now_ns() + _PAUSE_NS)
