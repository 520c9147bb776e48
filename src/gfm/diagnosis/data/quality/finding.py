"""What is said of an input with which one goes on: findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import SupportsIndex

from gfm.core import Trajectory


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One property of a recording that was measured, and what follows from it.

    Attributes:
        recording: Name of the recording.
        joint: Whose signal it is; None where it is the whole recording's.
        what: The property, in a few words that are the same for all recordings.
        value: In `unit`.
        unit: As shown; empty for pure numbers.
        consequence: What it means for a diagnosis, or what to do about it: one clause.
        doubtful: Whether it puts results in doubt; else it is good to know.
        spread: Standard deviation of the value, where it was measured several times.
    """

    recording: str
    joint: str | None
    what: str
    value: float
    unit: str
    consequence: str
    doubtful: bool = True
    spread: float | None = None

    @property
    def words(self) -> str:
        """The finding in one line, without the recording's name."""
        where = "" if self.joint is None else f"{self.joint}: "
        give = "" if self.spread is None else f" ± {self.spread:.2g}"
        amount = f"{self.value:.3g}{give} {self.unit}".rstrip()
        return f"{where}{self.what} {amount} ({self.consequence})"


def finding(
    recording: Trajectory,
    what: str,
    value: float,
    unit: str,
    consequence: str,
    *,
    joint: SupportsIndex | None = None,
    doubtful: bool = True,
) -> Finding:
    """Returns a finding about a recording, or one of its joints by its number."""
    return Finding(
        recording=recording.name,
        joint=None if joint is None else recording.joint_names[joint],
        what=what,
        value=float(value),
        unit=unit,
        consequence=consequence,
        doubtful=doubtful,
    )
