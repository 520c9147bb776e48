"""Held-out recordings seen as torques: the evidence that no rollout is needed for.

Along the measured motion the model's inverse dynamics say which torque was needed and its own drive
law which torque was there; the rest is missing. What an effect would add to it is its law where it
has one in closed form, and else the change that it makes to what is missing when it is put into the
model. Both are averaged over short blocks: that takes the noise of differentiated positions off,
and, being linear, leaves the relation between them as it is.

Shape letters: T measurements of a recording, B blocks of all recordings, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.signals import smooth_states
from gfm.diagnosis.search.candidates import TorqueView, torque_view
from gfm.effects import EffectInstance
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.sim.plant import Plant, make_plant

#: Length of a block, s: short beside a motion, long beside the noise of accelerations.
BLOCK_S = 0.1
#: Speed from which on a block counts as motion, rad/s: three times the width over which the laws of
#: dry friction change sign. At rest such a friction is whatever holds the joint, and no law says
#: how much that is: an offset or a weak drive would always explain it better.
MOVES_RAD_S = 3.0 * SIGN_WIDTH_RAD_S
#: Measurements per second, and of all recordings together, that are looked at: more take time and
#: say the same.
RATE_HZ, MOST_SAMPLES = 100.0, 6000


@dataclass(frozen=True, kw_only=True)
class Signals:
    """Block means of everything that a missing torque may go with, shape (B, J) each."""

    position: Array
    velocity: Array
    sign_of_velocity: Array
    drive: Array
    command_change: Array


@dataclass(frozen=True, kw_only=True)
class TorqueDomain:
    """Recordings as torques under one nominal model.

    Attributes:
        specs: The model by kind of command.
        joints: The measured joints.
        given: Effects of the model that its specs cannot say.
        recordings: What is looked at of them.
        views: Each of them as torques under the nominal model, drives as the model has them.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    joints: tuple[str, ...]
    given: tuple[EffectInstance, ...]
    recordings: tuple[Trajectory, ...]
    views: tuple[TorqueView, ...]

    def missing(self, effects: Sequence[EffectInstance] = ()) -> Array:
        """Returns the torque that the model with `effects` lacks, block means, N m, (B, J)."""
        others = self.in_model(effects)
        views = self.views_with(others)
        left = self.blocks([view.missing for view in views])
        for instance in effects:
            if (law := self.law(instance)) is not None:
                left -= self.blocks(law)
        return left

    def response(self, instance: EffectInstance) -> Array:
        """Returns the torque that an effect adds along the motion, block means, N m, (B, J).

        Zero for a motor apart from its link: no inverse dynamics of the measured joints has it.
        """
        law = self.law(instance)
        if law is not None:
            return self.blocks(law)
        if instance.effect.separates_motor:
            return np.zeros_like(self.missing())
        with_it = self.blocks([view.missing for view in self.views_with([instance])])
        return self.missing() - with_it

    def signals(self) -> Signals:
        """Returns the motion, what drives it and how commands change."""
        changes = [_command_change(recording) for recording in self.recordings]
        velocities = [view.velocity for view in self.views]
        return Signals(
            position=self.blocks([view.position for view in self.views]),
            velocity=self.blocks(velocities),
            sign_of_velocity=self.blocks([np.sign(velocity) for velocity in velocities]),
            drive=self.blocks([view.drive for view in self.views]),
            command_change=self.blocks(changes),
        )

    def moving(self) -> Array:
        """Returns 1 where a joint moves in a block and 0 where it rests, shape (B, J)."""
        velocity = self.blocks([view.velocity for view in self.views])
        return (np.abs(velocity) > MOVES_RAD_S).astype(float)

    def touched(self, instance: EffectInstance) -> list[int]:
        """Returns the numbers of the joints on which an effect acts: all, for one of the robot."""
        return [self.joints.index(name) for name in instance.joints] or list(
            range(len(self.joints))
        )

    def in_model(self, effects: Sequence[EffectInstance]) -> list[EffectInstance]:
        """Returns those of `effects` that inverse dynamics have to be told of: without a law."""
        return [e for e in effects if self.law(e) is None and not e.effect.separates_motor]

    def plants(self, effects: Sequence[EffectInstance]) -> dict[CommandKind, Plant]:
        """Returns the model with `effects` in it by kind of command."""
        return _plants(self.specs, self.joints, (*self.given, *effects), self.recordings)

    def views_with(self, effects: Sequence[EffectInstance]) -> tuple[TorqueView, ...]:
        """Returns the recordings as torques under the model with `effects` in it."""
        if not effects:
            return self.views
        return _views(self.specs, self.joints, (*self.given, *effects), self.recordings)

    def law(self, instance: EffectInstance) -> list[Array] | None:
        """Returns an effect's law in closed form along the motions, shape (T, J) each, if any."""
        if not instance.joints or len(instance.joints) > 2:
            return None
        places = [self.joints.index(name) for name in instance.joints]
        rows = []
        for view in self.views:
            motion = view.motion(places[0], places[1] if len(places) == 2 else None)
            torque = instance.effect.torque(motion, instance.values)
            if torque is None:
                return None
            row = np.zeros_like(view.missing)
            row[:, places[0]] = torque
            if len(places) == 2:
                row[:, places[1]] = -torque
            rows.append(row)
        return rows

    def blocks(self, rows: Sequence[Array]) -> Array:
        """Returns the block means of rows at the measurements, (T, J) each, shape (B, J)."""
        return np.concatenate(
            [block_means(row, r) for row, r in zip(rows, self.recordings, strict=True)]
        )


def torque_domain(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    given: Sequence[EffectInstance] = (),
) -> TorqueDomain:
    """Returns recordings as torques under the model `specs`, beside which `given` stands."""
    joints = recordings[0].joint_names
    share = MOST_SAMPLES // len(recordings)
    looked_at = tuple(_looked_at(recording, share) for recording in recordings)
    return TorqueDomain(
        specs=specs,
        joints=joints,
        given=tuple(given),
        recordings=looked_at,
        views=_views(specs, joints, given, looked_at),
    )


def _views(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    joints: Sequence[str],
    effects: Sequence[EffectInstance],
    recordings: Sequence[Trajectory],
) -> tuple[TorqueView, ...]:
    plants = _plants(specs, joints, effects, recordings)
    return tuple(torque_view(plants[recording.command_kind], recording) for recording in recordings)


def _plants(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    joints: Sequence[str],
    effects: Sequence[EffectInstance],
    recordings: Sequence[Trajectory],
) -> dict[CommandKind, Plant]:
    kinds = {recording.command_kind for recording in recordings}
    return {kind: make_plant(specs[kind], joints, effects) for kind in kinds}


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


def _command_change(recording: Trajectory) -> Array:
    """Returns the rate of the commands in force at the measurements, shape (T, J)."""
    return np.asarray(np.gradient(recording.held_command, recording.time_s, axis=0))


def block_means(rows: Array, recording: Trajectory) -> Array:
    """Returns the means over whole blocks of a recording's rows (T, J), shape (B, J)."""
    period_s = recording.period_s
    length = max(round(BLOCK_S / period_s), 1)
    count = max(len(rows) // length, 1)
    whole = rows[: count * length]
    return np.asarray(whole.reshape(count, -1, rows.shape[1]).mean(axis=1))
