"""Amounts that both witnesses bear out: open-loop rollouts, and the measured torques.

A model that stays far from its recordings is wrong in more than its amounts, and each witness is
bent by that in a way of its own: rollouts add up what is wrong over time, and the torque that is
missing at every moment does not. Where torques were measured, amounts are then those at which both
together leave least, each in units of what it leaves when rollouts alone decide.

Shape letters: N numbers of the rollouts' residual, B blocks of all recordings, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.signals import smooth_states
from gfm.diagnosis.evidence.plots import torque_left
from gfm.diagnosis.evidence.torques import MOVES_RAD_S, RATE_HZ, block_means
from gfm.diagnosis.inference.fitting import Fit, fit, measured
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance


@dataclass(frozen=True, kw_only=True)
class Witnesses:
    """Rollouts and measured torques as one least-squares problem.

    Attributes:
        rollouts: Open-loop predictions of the recordings.
        recordings: Whose torques were measured.
        moving: 1 where a joint moves in a block and 0 where it rests, shape (B, J): what a dry
            friction is at rest, no law says.
        units: Of the rollouts' residual, and of each joint's torque, N m, shape (1 + J,).
    """

    rollouts: Problem
    recordings: tuple[Trajectory, ...]
    moving: Array
    units: Array

    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns what each candidate leaves of both, weighted alike, (candidates, N + B J)."""
        rollouts = self.rollouts.residuals(candidates)
        torques = np.stack([self.torques(effects).ravel() for effects in candidates])
        both = rollouts / self.units[0], torques
        return np.concatenate([one / np.sqrt(one.shape[1]) for one in both], axis=1)

    def torques(self, effects: Sequence[EffectInstance]) -> Array:
        """Returns the torque that the model with `effects` lacks, in its units, shape (B, J)."""
        left = [torque_left(effects, self.rollouts, [one]) for one in self.recordings]
        blocks = [block_means(*pair) for pair in zip(left, self.recordings, strict=True)]
        return np.asarray(self.moving * np.concatenate(blocks) / self.units[1:])

    def differences(self, effects: Sequence[EffectInstance]) -> Array:
        """Returns the changes of amounts over which derivatives are taken, shape (P,)."""
        return self.rollouts.differences(effects)

    def coarse(self) -> Witnesses:
        """Returns the problem with rollouts by fast integration."""
        return replace(self, rollouts=self.rollouts.coarse())


def borne_out(problem: Problem, recordings: Sequence[Trajectory], fitted: Fit) -> Fit:
    """Returns the effects with the amounts at which both witnesses together leave least.

    As they are where torques were not measured, or no inverse dynamics of the measured joints has
    an effect: a motor apart from its link, a surface that is touched.

    Args:
        problem: Rollouts to which the effects were fitted.
        recordings: All recordings of the problem.
        fitted: By rollouts alone.
    """
    unheard = any(e.effect.separates_motor or e.effect.only_in_stretches for e in fitted.effects)
    if unheard or not fitted.effects or any(one.effort is None for one in recordings):
        return fitted
    both = _witnesses(problem, recordings, fitted)
    return measured(problem, fit(both, fitted.effects).effects)


def _witnesses(problem: Problem, recordings: Sequence[Trajectory], fitted: Fit) -> Witnesses:
    """Returns both witnesses, in units of what `fitted` leaves."""
    thinned = tuple(_thinned(one) for one in recordings)
    speeds = [block_means(smooth_states(r.time_s, r.position)[1], r) for r in thinned]
    moving = (np.abs(np.concatenate(speeds)) > MOVES_RAD_S).astype(float)
    alike = Witnesses(
        rollouts=problem,
        recordings=thinned,
        moving=moving,
        units=np.ones(1 + len(problem.joints)),
    )
    torque = np.sqrt(np.mean(alike.torques(fitted.effects) ** 2, axis=0))
    resting = torque == 0.0
    units = np.concatenate([[np.sqrt(fitted.cost)], np.where(resting, 1.0, torque)])
    return replace(alike, units=units)


def _thinned(recording: Trajectory) -> Trajectory:
    """Returns a recording with fewer measurements, smoothed before, where they are dense."""
    period_s = float(np.median(np.diff(recording.time_s)))
    stride = max(int(1.0 / (RATE_HZ * period_s) + 1e-6), 1)
    position = smooth_states(recording.time_s, recording.position)[0]
    return replace(
        recording,
        stamp_ns=recording.stamp_ns[::stride],
        position=position[::stride],
        velocity=None,
        effort=uniform_filter1d(recording.effort, stride, axis=0)[::stride],
    )
