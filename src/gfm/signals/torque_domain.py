"""Recordings seen as torques: what no rollout is needed for.

Along the measured motion the model's inverse dynamics say which torque was needed and its own drive
law which torque was there; the rest is missing. What an effect would add to it is its law (of a
force, or of what a drive gives) where it has one, and else the change that it makes to what is
missing when it is put into the model. Both are averaged over short blocks: that takes the noise of
differentiated positions off, and, being linear, leaves the relation between them as it is.

Shape letters: T measurements of a recording, B blocks of all recordings, J joints.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import Protocol

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.effects import EffectInstance, Key
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.signals.smoothing import smooth_states
from gfm.signals.torques import States, TorqueView, joined, torque_view
from gfm.sim.plant import Plant

#: Length of a block, s: short beside a motion, long beside the noise of accelerations.
BLOCK_S = 0.1
#: Speed from which on a block counts as motion, rad/s: three times the width over which the laws of
#: dry friction change sign. At rest such a friction is whatever holds the joint, and no law says
#: how much that is: an offset or a weak drive would always explain it better.
MOVES_RAD_S = 3.0 * SIGN_WIDTH_RAD_S
#: Factor by which two amounts differ at most that are compared: what is farther says no more.
FARTHEST = 10.0
#: Measurements per second, and of all recordings together, that are looked at: more take time and
#: say the same.
RATE_HZ, MOST_SAMPLES = 100.0, 6000


class _Noise(Protocol):
    @property
    def position(self) -> Array:
        """Standard deviation by joint, rad, shape (J,)."""
        ...


class Modelled(Protocol):
    """A robot with its models by kind of command, and the noise of its sensors."""

    @property
    def joints(self) -> tuple[str, ...]:
        """All that are measured, J of them."""
        ...

    @property
    def specs(self) -> Mapping[CommandKind, mujoco.MjSpec]:
        """The nominal models."""
        ...

    @property
    def noise(self) -> _Noise:
        """Of the sensors."""
        ...

    def plants(self, effects: Sequence[EffectInstance]) -> Mapping[CommandKind, Plant]:
        """Returns the models with effects in them."""
        ...


def torque_views(
    problem: Modelled,
    recordings: Sequence[Trajectory],
    effects: Sequence[EffectInstance] = (),
) -> list[TorqueView]:
    """Returns every recording seen as torques under the nominal model with `effects` in it."""
    plants = problem.plants(effects)
    return [torque_view(plants[recording.command_kind], recording) for recording in recordings]


@dataclass(frozen=True, kw_only=True)
class TorqueDomain:
    """Recordings as torques under one nominal model.

    Attributes:
        problem: Whose model it is.
        recordings: What is looked at of them.
    """

    problem: Modelled
    recordings: tuple[Trajectory, ...]
    _told: dict[Hashable, Array] = field(default_factory=dict)

    @cached_property
    def view(self) -> TorqueView:
        """All recordings as torques under the nominal model, drives as the model has them."""
        return self._seen(())

    @cached_property
    def _states(self) -> list[States]:
        """Smooth states of each recording."""
        return [smooth_states(one.time_s, one.position) for one in self.recordings]

    @property
    def duration_s(self) -> float:
        """Of all recordings together."""
        return sum(recording.duration_s for recording in self.recordings)

    @property
    def period_s(self) -> float:
        """From one measurement to the next, of the slowest recording."""
        return max(recording.period_s for recording in self.recordings)

    def view_with(self, effects: Sequence[EffectInstance]) -> TorqueView:
        """Returns all recordings as torques under the model with `effects` in it."""
        return self._seen(effects) if effects else self.view

    def _seen(self, effects: Sequence[EffectInstance]) -> TorqueView:
        plants, rows = self.problem.plants(effects), zip(self.recordings, self._states, strict=True)
        return joined([torque_view(plants[one.command_kind], one, own) for one, own in rows])

    def missing(self, effects: Sequence[EffectInstance] = ()) -> Array:
        """Returns the torque that the model with `effects` lacks, block means, N m, (B, J)."""
        left = self.view_with(without_law(effects)).missing
        return self.blocks(reduce(np.subtract, map(self.view.added, effects), left))

    def response(self, instance: EffectInstance) -> Array:
        """Returns the torque that an effect adds along the motion, block means, N m, (B, J).

        Zero for a motor apart from its link: no inverse dynamics of the measured joints has it.
        """
        key = (instance.key, *sorted(instance.values.items()))
        if key not in self._told:
            self._told[key] = self.blocks(self._response(instance))
        return self._told[key]

    def _response(self, instance: EffectInstance) -> Array:
        if instance.in_closed_form or instance.effect.separates_motor:
            return self.view.added(instance)
        return self.view.missing - self.view_with([instance]).missing

    def disagreement(self, effects: Sequence[EffectInstance]) -> dict[Key, float]:
        """Returns by how much amounts of effects are not those that the missing torque tells.

        The logarithm of the factor between the two, times the share of the torque that the effect
        explains beside the others, while its joints move: what explains little says little.
        """
        moving = self.moving()
        missing, told = moving * self.missing(), {e.key: moving * self.response(e) for e in effects}
        figures = {}
        for one in effects:
            joints = self.touched(one)
            columns = {key: torque[:, joints].ravel() for key, torque in told.items()}
            own = columns.pop(one.key)
            share, factor = regressed(missing[:, joints].ravel(), own, list(columns.values()))
            apart = abs(np.log(np.clip(factor, 1.0 / FARTHEST, FARTHEST)))
            figures[one.key] = share * float(apart)
        return figures

    @cached_property
    def noise(self) -> Array:
        """What sensor noise makes of a missing torque, block means, N m RMS, shape (J,)."""
        shaken = [self._shaken(i, recording) for i, recording in enumerate(self.recordings)]
        change = joined(torque_views(self.problem, shaken)).missing - self.view.missing
        return np.asarray(np.sqrt(np.mean(self.blocks(change) ** 2, axis=0)) + 1e-12)

    def _shaken(self, number: int, recording: Trajectory) -> Trajectory:
        noise = np.random.default_rng(number).standard_normal(recording.position.shape)
        return replace(recording, position=recording.position + self.problem.noise.position * noise)

    @cached_property
    def signals(self) -> dict[str, Array]:
        """Everything that a missing torque may go with, block means, shape (B, J) each."""
        changes = [np.gradient(r.held_command, r.time_s, axis=0) for r in self.recordings]
        along = {
            "position": self.view.position,
            "velocity": self.view.velocity,
            "sign_of_velocity": np.sign(self.view.velocity),
            "drive": self.view.drive,
            "command_change": np.concatenate(changes),
        }
        return {name: self.blocks(rows) for name, rows in along.items()}

    def moving(self) -> Array:
        """Returns 1 where a joint moves in a block and 0 where it rests, shape (B, J)."""
        return (np.abs(self.blocks(self.view.velocity)) > MOVES_RAD_S).astype(float)

    def touched(self, instance: EffectInstance) -> list[int]:
        """Returns the numbers of the joints on which an effect acts: all, for one of the robot."""
        return [self.problem.joints.index(name) for name in instance.joints or self.problem.joints]

    def of_each(self, rows: Array) -> list[tuple[Trajectory, Array]]:
        """Returns each recording with its own of rows at the measurements of all."""
        ends = np.cumsum([len(recording.position) for recording in self.recordings])
        return list(zip(self.recordings, np.split(rows, ends[:-1]), strict=True))

    def blocks(self, rows: Array) -> Array:
        """Returns the block means of rows at the measurements, (T of all, J), shape (B, J)."""
        return np.concatenate(
            [block_means(own, recording) for recording, own in self.of_each(rows)]
        )


def without_law(effects: Sequence[EffectInstance]) -> list[EffectInstance]:
    """Returns those of `effects` that inverse dynamics have to be told of: without a law."""
    return [e for e in effects if not e.has_law and not e.effect.separates_motor]


def regressed(torque: Array, own: Array, others: Sequence[Array]) -> tuple[float, float]:
    """Returns which share of a torque a column explains beside others, and with which factor.

    Args:
        torque: shape (N,).
        own: The column, shape (N,).
        others: What both are freed of first, shape (N,) each.
    """
    if others:
        basis = np.stack(others, axis=1)
        both = np.stack([torque, own], axis=1)
        torque, own = (both - basis @ np.linalg.lstsq(basis, both, rcond=1e-6)[0]).T
    power, size = float(torque @ torque), float(own @ own)
    if power <= 0.0 or size <= 0.0:
        return 0.0, 0.0
    along = float(own @ torque)
    return along**2 / (size * power), along / size


def torque_domain(
    problem: Modelled, recordings: Sequence[Trajectory], samples: int = MOST_SAMPLES
) -> TorqueDomain:
    """Returns so many measurements of recordings at most as torques under a problem's model."""
    share = samples // len(recordings)
    looked_at = tuple(_looked_at(recording, share) for recording in recordings)
    return TorqueDomain(problem=problem, recordings=looked_at)


def _looked_at(recording: Trajectory, samples: int) -> Trajectory:
    """Returns the first measurements of a recording, thinned (and smoothed before) where dense."""
    stride = max(int(RATE_HZ**-1 / recording.period_s + 1e-6), 1)
    keep = slice(0, samples * stride, stride)
    smooth = recording.position
    if stride > 1:
        smooth = smooth_states(recording.time_s, recording.position)[0]
    return replace(
        recording,
        stamp_ns=recording.stamp_ns[keep],
        position=smooth[keep],
        velocity=None,
        effort=None,
    )


def block_means(rows: Array, recording: Trajectory) -> Array:
    """Returns the means over whole blocks of a recording's rows (T, J), shape (B, J)."""
    length = max(round(BLOCK_S / recording.period_s), 1)
    count = max(len(rows) // length, 1)
    whole = rows[: count * length]
    return np.asarray(whole.reshape(count, -1, rows.shape[1]).mean(axis=1))
