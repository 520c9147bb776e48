"""What the run learns for, as the learner says: only that may enter."""

from __future__ import annotations

import logging
from contextlib import suppress
from typing import final

from gfm.core import Clock, EnvironmentSpec, RefusedError
from gfm.service.question import Question
from gfm.transport import Transport
from gfm_wire import EnvironmentRequest, RunEnvironment

_log = logging.getLogger(__name__)


@final
class ExpectedEnvironment:
    """Asks the learner until it has answered, and again where that is in doubt.

    Attributes:
        spec: Of the run's environment; None while it is not known.
    """

    def __init__(
        self, transport: Transport, clock: Clock, spec: EnvironmentSpec | None = None
    ) -> None:
        self.spec = spec
        self._question = Question(transport, clock, "run/environment", "learner")

    def doubt(self) -> None:
        """Asks again: somebody learns for something else than was answered."""
        self.spec = None

    def poll(self) -> None:
        """Takes in the answer, or asks."""
        if self.spec is not None:
            return
        with suppress(RefusedError):  # not understood: asked again
            answer = self._question.poll(EnvironmentRequest(name=""))
            if answer is not None and isinstance(answer[0], RunEnvironment):
                self.spec = answer[0].spec
                _log.info("the run learns for %s", self.spec)
