"""Whether what a model leaves is noise, joint by joint; what it goes with if not, and when.

The last is told of the missing torque, by regions of a joint's state. Time is cut into thirds by a
signal (slow, middling and fast; low, middle and high; weakly and strongly driven). If the torque
did not care, each third would have a third of its energy.

Shape letters: T measurements of a segment, B blocks, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.signals.smoothing import correlation
from gfm.signals.torque_domain import TorqueDomain

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

THIRDS = 3
#: Share of the energy in one third of the time from which on it is said to lie there: twice what
#: it would have if the torque did not care.
CONCENTRATED = 0.6
#: Share of the robot's misfit from which on it is asked where a joint's lies.
MATTERS = 0.02
#: Mean squared error of a joint, in units of the noise, up to which it is noise.
NOISE = 1.5
#: Thirds of the time by each signal, in words, and whether its sign counts.
REGIONS = {
    "speed": ("at low speed", "at middling speed", "at high speed"),
    "position": ("at low angles", "at middle angles", "at high angles"),
    "drive": ("under low drive torque", "under middling drive torque", "under high drive torque"),
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
    domain: TorqueDomain,
    effects: Sequence[EffectInstance],
    errors: tuple[Sequence[Array], Sequence[Array]],
) -> tuple[JointAdequacy, ...]:
    """Returns what the nominal model and that with `effects` leave, joint by joint.

    Args:
        domain: The recordings as torques.
        effects: What corrects the model.
        errors: Position errors of rollouts before and after, per segment, rad, (T, J) each.
    """
    joints, missing = domain.problem.joints, (domain.missing(), domain.missing(effects))
    both = [
        [_residual(domain, j, *left) for j in range(len(joints))]
        for left in zip(errors, missing, strict=True)
    ]
    return tuple(
        JointAdequacy(joint=name, before=before, after=after)
        for name, before, after in zip(joints, *both, strict=True)
    )


def _residual(
    domain: TorqueDomain, joint: int, errors: Sequence[Array], missing: Array
) -> Residual:
    own, noise = [error[:, joint] for error in errors], domain.problem.noise.position[joint]
    ratio = float(np.sqrt(np.mean(np.concatenate(own) ** 2)) / noise)
    slow = slow_share(own)
    told = {n: correlation(missing[:, joint], domain.signals[n][:, joint]) for n in WORDS}
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


@dataclass(frozen=True, kw_only=True)
class JointRegions:
    """Where one joint's residual lies under the nominal model.

    Attributes:
        joint: Name.
        misfit_share: Of the robot's squared held-out position error above the noise, in units of
            each joint's noise, before the correction.
        misfit_share_after: The same of what the corrected model leaves; 0 where that is noise.
        energy: Shares of the missing torque's energy in the thirds of time by each of `REGIONS`,
            before the correction.
    """

    joint: str
    misfit_share: float
    misfit_share_after: float
    energy: dict[str, tuple[float, ...]]

    @property
    def words(self) -> str:
        """Where the energy is concentrated, in one line; empty where it is spread, or little."""
        if self.misfit_share < MATTERS:
            return ""
        return " and ".join(
            f"{100.0 * max(shares):.0f} % {REGIONS[name][int(np.argmax(shares))]}"
            for name, shares in self.energy.items()
            if max(shares) >= CONCENTRATED
        )


def localisation(domain: TorqueDomain, left: Sequence[JointAdequacy]) -> tuple[JointRegions, ...]:
    """Returns where what the nominal model lacks lies, joint by joint.

    Args:
        domain: The recordings as torques.
        left: What both models leave on each joint.
    """
    missing, signals = domain.missing(), domain.signals
    ratios = np.array([(one.before.ratio, one.after.ratio) for one in left])
    before, after = (_shares(np.where(s > NOISE, s - 1.0, 0.0)) for s in ratios.T**2)
    by = {
        "speed": np.abs(signals["velocity"]),
        "position": signals["position"],
        "drive": np.abs(signals["drive"]),
    }
    return tuple(
        JointRegions(
            joint=one.joint,
            misfit_share=float(before[j]),
            misfit_share_after=float(after[j]),
            energy={key: energy_by(missing[:, j], signal[:, j]) for key, signal in by.items()},
        )
        for j, one in enumerate(left)
    )


def energy_by(torque: Array, signal: Array) -> tuple[float, ...]:
    """Returns the shares of a torque's energy in the thirds of time by a signal, (B,) each."""
    order = np.argsort(signal, kind="stable")
    parts = np.array_split(torque[order] ** 2, THIRDS)
    return tuple(float(share) for share in _shares(np.array([part.sum() for part in parts])))


def _shares(amounts: Array) -> Array:
    total = float(amounts.sum())
    return np.asarray(amounts / total if total > 0.0 else np.zeros_like(amounts))
