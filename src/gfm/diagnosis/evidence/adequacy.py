"""Whether what a model leaves is noise, joint by joint; and what it goes with where it is not.

Shape letters: T measurements of a segment, B blocks, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.data.signals import correlation
from gfm.diagnosis.evidence.torques import Signals

#: RMS error, in noise floors, that is as small as noise.
ADEQUATE_RATIO = 1.25
#: Autocorrelation of neighbours up to which a residual is as uneven as noise. It is the share of
#: its power that changes slowly: a tenth of it is a third of the noise's size.
WHITE = 0.1
#: Correlation from which on a missing torque is said to go with a signal. Signals as slow as a
#: motion have some dozens of independent values in a recording: chance reaches 0.3, not 0.5.
GOES_WITH = 0.5
#: What it may go with, in words.
WORDS = {
    "position": "the position",
    "velocity": "the velocity",
    "sign_of_velocity": "the sign of the velocity",
    "drive": "the drive's torque",
    "command_change": "changes of the command",
}


@dataclass(frozen=True, kw_only=True)
class Residual:
    """What a model leaves on one joint of held-out recordings.

    Attributes:
        ratio: RMS of the position error in noise floors.
        slow: Correlation of neighbouring errors: the share of their power that changes slowly.
        white: Whether that is no more than noise has.
        correlations: Of the missing torque with each of `WORDS`.
        goes_with: The strongest of them, where the error is no noise and it is strong enough.
    """

    ratio: float
    slow: float
    white: bool
    correlations: dict[str, float]
    goes_with: str | None

    @property
    def adequate(self) -> bool:
        """Whether it is as small as noise, or at least as uneven as noise."""
        return self.ratio <= ADEQUATE_RATIO or self.white


@dataclass(frozen=True, kw_only=True)
class JointAdequacy:
    """One joint, under the nominal and the corrected model."""

    joint: str
    before: Residual
    after: Residual

    @property
    def words(self) -> str:
        """What is left, in one line."""
        now = self.after
        if now.adequate:
            return "noise" if now.ratio <= ADEQUATE_RATIO else "noise, larger than it was measured"
        if now.goes_with is None:
            return "structure that goes with no signal of this joint: another joint may cause it"
        return (
            f"goes with {WORDS[now.goes_with]} (correlation {now.correlations[now.goes_with]:+.2f})"
        )


def adequacy(
    joints: Sequence[str],
    noise: Array,
    errors: tuple[Sequence[Array], Sequence[Array]],
    missing: tuple[Array, Array],
    signals: Signals,
) -> tuple[JointAdequacy, ...]:
    """Returns what both models leave, joint by joint.

    Args:
        joints: Names, J of them.
        noise: Of the positions, rad, shape (J,).
        errors: Position errors of rollouts before and after, per segment, rad, (T, J) each.
        missing: Torques that lack before and after, N m, shape (B, J) each.
        signals: What they may go with.
    """
    both = [
        [_residual(j, noise, e, m, signals) for j in range(len(joints))]
        for e, m in zip(errors, missing, strict=True)
    ]
    return tuple(
        JointAdequacy(joint=name, before=before, after=after)
        for name, before, after in zip(joints, *both, strict=True)
    )


def _residual(
    joint: int, noise: Array, errors: Sequence[Array], missing: Array, signals: Signals
) -> Residual:
    own = [error[:, joint] for error in errors]
    ratio = float(np.sqrt(np.mean(np.concatenate(own) ** 2)) / noise[joint])
    slow = slow_share(own)
    told = {n: correlation(missing[:, joint], getattr(signals, n)[:, joint]) for n in WORDS}
    strongest = max(told, key=lambda name: abs(told[name]))
    is_noise = ratio <= ADEQUATE_RATIO or slow <= WHITE
    says = not is_noise and abs(told[strongest]) >= GOES_WITH
    return Residual(
        ratio=ratio,
        slow=slow,
        white=slow <= WHITE,
        correlations=told,
        goes_with=strongest if says else None,
    )


def slow_share(errors: Sequence[Array]) -> float:
    """Returns the correlation of neighbours in segments of errors, shape (T,) each.

    Of the sum of white noise and something slow it is the slow part's share of the power.
    """
    power = sum(float(e @ e) for e in errors)
    return sum(float(e[1:] @ e[:-1]) for e in errors) / power if power > 0.0 else 0.0
