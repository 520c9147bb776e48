"""What is said of an input with which one goes on: findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gfm.core import Trajectory

#: In the place of a recording's name: said of all of them together.
EVERYWHERE = "all recordings"


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

    recording: str = EVERYWHERE
    joint: str | None = None
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


def findings(
    recording: Trajectory,
    what: str,
    of: float | Mapping[int, float],
    unit: str,
    consequence: str,
    *,
    doubtful: bool = True,
) -> list[Finding]:
    """Returns a finding about a recording, or the same about some of its joints, by number."""
    values = of if isinstance(of, Mapping) else {None: of}
    return [
        Finding(
            recording=recording.name,
            joint=None if j is None else recording.joint_names[j],
            what=what,
            value=float(value),
            unit=unit,
            consequence=consequence,
            doubtful=doubtful,
        )
        for j, value in values.items()
    ]
