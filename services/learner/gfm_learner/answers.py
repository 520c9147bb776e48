"""What the learner can be asked: its weights, and what it learns for."""

from __future__ import annotations

from pathlib import Path
from typing import final

import msgspec

from gfm.core import Clock, EnvironmentSpec, Weights
from gfm.envs.registry import EnvironmentSettings
from gfm.policies import forces_path
from gfm.service.environment_words import difference, environment_words
from gfm.service.rates import Rates
from gfm.service.refusals import Refusals
from gfm.service.turns import Turns
from gfm.transport import Request, Transport
from gfm_learner.config import LearnerConfig
from gfm_wire import EnvironmentRequest, RunEnvironment, WeightsRequest

_LONGEST_LINE = 16
"""Questions that one sender may have waiting: everybody asks again only after an answer."""

_MOST_PER_S = 20.0
"""Of one sender and kind: whoever asks again pauses for a fifth of a second."""


@final
class Answers:
    """Serves `weights/current` and `run/environment`."""

    def __init__(
        self,
        config: LearnerConfig,
        spec: EnvironmentSpec,
        transport: Transport,
        refusals: Refusals,
        clock: Clock,
    ) -> None:
        self._spec = spec
        self._settings = environment_words(config.env, config.environment)
        self._refusals = refusals
        self._environment = RunEnvironment(
            name=config.env, settings=_with_absolute_paths(config.environment), spec=spec
        )
        weights, environment = (
            Turns(transport.serve(key), refusals, Rates(clock, _MOST_PER_S), longest=_LONGEST_LINE)
            for key in ("weights/current", "run/environment")
        )
        self._weights_server, self._environment_server = weights, environment

    def poll(self, weights: Weights) -> bool:
        """Answers one question of each kind; returns whether there was any."""
        weights_request = self._weights_server.receive()
        if weights_request is not None:
            self._answer(weights_request, weights, self._reason_against_weights(weights_request))
        request = self._environment_server.receive()
        if request is not None:
            self._answer(request, self._environment, self._reason_against_environment(request))
        return weights_request is not None or request is not None

    def _answer(
        self, request: Request, answer: Weights | RunEnvironment, reason: str | None
    ) -> None:
        if reason is None:
            request.reply(answer)
        else:
            self._refusals.add("question", request.stamp.sender, reason)
            request.refuse(reason)

    def _reason_against_weights(self, request: Request) -> str | None:
        wanted, spec = request.message, self._spec
        if not isinstance(wanted, WeightsRequest):
            return f"got {type(wanted).__name__}, expected WeightsRequest"
        if wanted.spec_digest not in ("", spec.digest):
            return (
                f"the asker's environment has digest {wanted.spec_digest:.40}; this learner learns "
                f"for {spec.name} with {spec.observation_size} observations and "
                f"{spec.action_size} actions, digest {spec.digest}"
            )
        differs = difference(wanted.settings, self._settings) if wanted.settings else ""
        return f"the asker's environment has other settings: {differs}" if differs else None

    def _reason_against_environment(self, request: Request) -> str | None:
        wanted = request.message
        if not isinstance(wanted, EnvironmentRequest):
            return f"got {type(wanted).__name__}, expected EnvironmentRequest"
        if wanted.name in ("", self._environment.name):
            return None
        return f"this run learns for {self._environment.name}, the asker for {wanted.name:.40}"


def _with_absolute_paths(settings: EnvironmentSettings) -> str:
    """Returns the settings as JSON that means the same in any working directory."""
    ensemble = tuple(str(forces_path(path).resolve()) for path in settings.control.ensemble)
    ranges = settings.control.ranges and str(Path(settings.control.ranges).resolve())
    absolute = msgspec.structs.replace(
        settings,
        control=msgspec.structs.replace(settings.control, ensemble=ensemble, ranges=ranges),
        models={kind: str(Path(path).resolve()) for kind, path in settings.models.items()},
        recordings=tuple(str(Path(path).resolve()) for path in settings.recordings),
    )
    return msgspec.json.encode(absolute).decode()
