"""Where the missing torque lies: on which joint, and in which region of the joint's state.

Time is cut into thirds by a signal (slow, middling and fast; low, middle and high; weakly and
strongly driven). If the missing torque did not care, each third would have a third of its energy.

Shape letters: B blocks, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.evidence.adequacy import JointAdequacy
from gfm.diagnosis.evidence.torques import Signals

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


def localisation(
    adequacy: Sequence[JointAdequacy], missing: Array, signals: Signals
) -> tuple[JointRegions, ...]:
    """Returns where what the nominal model lacks lies, joint by joint.

    Args:
        adequacy: What both models leave on J joints.
        missing: Torque that the nominal model lacks, N m, shape (B, J).
        signals: Of the motion.
    """
    ratios = np.array([(one.before.ratio, one.after.ratio) for one in adequacy])
    before, after = (_shares(np.where(s > NOISE, s - 1.0, 0.0)) for s in ratios.T**2)
    by = {
        "speed": np.abs(signals.velocity),
        "position": signals.position,
        "drive": np.abs(signals.drive),
    }
    return tuple(
        JointRegions(
            joint=one.joint,
            misfit_share=float(before[j]),
            misfit_share_after=float(after[j]),
            energy={key: energy_by(missing[:, j], signal[:, j]) for key, signal in by.items()},
        )
        for j, one in enumerate(adequacy)
    )


def energy_by(torque: Array, signal: Array) -> tuple[float, ...]:
    """Returns the shares of a torque's energy in the thirds of time by a signal, (B,) each."""
    order = np.argsort(signal, kind="stable")
    parts = np.array_split(torque[order] ** 2, THIRDS)
    return tuple(float(share) for share in _shares(np.array([part.sum() for part in parts])))


def _shares(amounts: Array) -> Array:
    total = float(amounts.sum())
    return np.asarray(amounts / total if total > 0.0 else np.zeros_like(amounts))
