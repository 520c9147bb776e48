"""Who may enter, and how much may be carried out: what is well formed is not yet welcome."""

from __future__ import annotations

import re
from typing import ClassVar

from gfm.core import (
    PRIORITY_LIMIT,
    EnvironmentSpec,
    GfmError,
    RefusedError,
    Sequence,
    implausible,
)
from gfm_wire import SampleRequest

_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


class NotTakenError(RefusedError):
    """A message that is not taken; `reason` is the word under which it is counted."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


class NotNowError(GfmError):
    """A sequence that is not stored now, but may be later; `counter` is the word for it."""

    counter: ClassVar[str]


class NoRoomError(NotNowError):
    """The disk has no room for it."""

    counter = "no_room"


class HeldBackError(NotNowError):
    """The learner has not yet taken enough samples of those before it."""

    counter = "held_back"


def check_sequence(sequence: Sequence, spec: EnvironmentSpec, steps: int | None) -> None:
    """Returns where a sequence can have come from the run's environment.

    Args:
        sequence: What somebody wants to insert.
        spec: Of the run's environment.
        steps: Transitions that it must have; None takes any number.

    Raises:
        NotTakenError: it cannot, or its sender's name is none.
    """
    if not _NAME.fullmatch(sequence.actor):
        raise NotTakenError(
            "name",
            f"actor is {sequence.actor!r:.80}, expected 1 to 64 letters, digits, dots, dashes or _",
        )
    check_digest(sequence.spec_digest, spec)
    if steps is not None and len(sequence.reward) != steps:
        raise NotTakenError("shape", f"{len(sequence.reward)} transitions, expected {steps}")
    if reason := implausible(sequence, spec):
        raise NotTakenError("range", reason)


def check_digest(got: str, spec: EnvironmentSpec) -> None:
    """Returns where a digest is that of the run's environment.

    Raises:
        NotTakenError: it is another one.
    """
    if got != spec.digest:
        raise NotTakenError("spec", f"spec_digest is {got!r:.40}, expected {spec.digest!r}")


def check_request(request: SampleRequest, spec: EnvironmentSpec, most: int) -> None:
    """Returns where a batch of that size and environment can be given, and priorities be taken.

    Args:
        request: What somebody asks for.
        spec: Of the run's environment.
        most: Sequences that a batch may have.

    Raises:
        NotTakenError: it cannot.
    """
    if request.batch_size > most:
        raise NotTakenError("size", f"batch_size is {request.batch_size}, expected at most {most}")
    if request.spec_digest:
        check_digest(request.spec_digest, spec)
    if (told := len(request.seen)) > most:
        raise NotTakenError("size", f"{told} priorities, expected at most {most}")
    if told and not 0.0 <= request.priority.min() <= request.priority.max() <= PRIORITY_LIMIT:
        span = f"{request.priority.min():g} to {request.priority.max():g}"
        raise NotTakenError("range", f"priority spans {span}, expected 0 to {PRIORITY_LIMIT:g}")
