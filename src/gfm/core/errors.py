"""Every error that this project raises on purpose.

GfmError
  BadInputError          what the user gave cannot be used: one line, exit status 2
    ConfigError          a setting, or two that contradict each other
    UnknownNameError     a joint, effect, environment ... that does not exist; lists those that do
    RecordingError       a recording: file, topic, field, what was expected
  ShapeError             an array whose shape is not the promised one
  WireError              a message of the wrong schema, version, type, shape or size
  UnreachableError       no answer within the deadline
  LostError              a connection that broke, or is not there yet
  RefusedError           the other side answered, and said no
  StaleWeightsError      the policy is older than the configured limit
  ProcessDiedError       a process that should be running has ended

The classes write their messages from facts: what was got, what was expected, what exists.
"""

from __future__ import annotations

from collections.abc import Iterable


class GfmError(Exception):
    """Root of the tree; catching it catches everything raised on purpose."""


class BadInputError(GfmError):
    """What the user gave cannot be used."""


class ConfigError(BadInputError):
    """A setting is out of range or contradicts another one."""


class UnknownNameError(BadInputError):
    """A name that does not exist, with those that do."""

    def __init__(self, kind: str, name: str, available: Iterable[str]) -> None:
        listed = ", ".join(sorted(available)) or "none"
        super().__init__(f"unknown {kind} {name!r}; available: {listed}")


class RecordingError(BadInputError):
    """A recording that cannot be used: where, what was got, what was expected."""

    def __init__(self, where: str, problem: str, expected: str) -> None:
        super().__init__(f"{where}: {problem}; expected {expected}")


class ShapeError(GfmError):
    """An array whose shape is not the promised one."""

    def __init__(self, name: str, got: tuple[int, ...], expected: str) -> None:
        super().__init__(f"{name} has shape {got}, expected {expected}")


class WireError(GfmError):
    """A message body that is refused; `reason` is the word under which it is counted."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


class UnreachableError(GfmError):
    """No answer within the deadline."""

    def __init__(self, peer: str, waited_s: float) -> None:
        super().__init__(f"no answer from {peer} within {waited_s:.1f} s")


class LostError(GfmError):
    """A connection that broke, or is not there yet: to whom, and why."""

    def __init__(self, peer: str, why: str) -> None:
        super().__init__(f"no connection to {peer}: {why}")


class RefusedError(GfmError):
    """The other side answered, and said no."""


class StaleWeightsError(GfmError):
    """The policy is older than the configured limit."""

    def __init__(self, age_s: float, limit_s: float) -> None:
        super().__init__(f"weights are {age_s:.1f} s old, limit {limit_s:.1f} s")


class ProcessDiedError(GfmError):
    """A process that should be running has ended; tells its last words."""

    def __init__(self, name: str, status: int, log: object, last_lines: Iterable[str]) -> None:
        words = "".join(f"\n  {line}" for line in last_lines)
        super().__init__(f"{name} ended with status {status}; log: {log}{words}")
        self.status = status
