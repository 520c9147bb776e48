"""Joints without a drive: a pendulum on a cart. They are joints whose drive is switched off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco

from gfm.core import CommandKind, Trajectory


def passive_joints(spec: mujoco.MjSpec, recording: Trajectory) -> tuple[str, ...]:
    """Returns the joints of a recording that no command names and no actuator of `spec` drives."""
    driven = {actuator.name for actuator in spec.actuators}
    return tuple(name for name in recording.uncommanded if name not in driven)


def with_idle_drives(
    specs: Mapping[CommandKind, mujoco.MjSpec], recordings: Sequence[Trajectory]
) -> tuple[dict[CommandKind, mujoco.MjSpec], list[Trajectory]]:
    """Returns models in which every recorded joint has a drive, and recordings that say which rest.

    Added drives exert nothing, and their recordings say that they are switched off: what looks at
    every joint's drive needs no exception for joints without one.
    """
    idle = [passive_joints(specs[r.command_kind], r) for r in recordings]
    changed = {kind: spec.copy() for kind, spec in specs.items()}
    for spec in changed.values():
        driven = {actuator.name for actuator in spec.actuators}
        for name in sorted({n for names in idle for n in names} - driven):
            _add_idle_drive(spec, name)
    off = [
        replace(r, servo_gain={**r.servo_gain, **dict.fromkeys(names, 0.0)}) if names else r
        for r, names in zip(recordings, idle, strict=True)
    ]
    return changed, off


def _add_idle_drive(spec: mujoco.MjSpec, joint: str) -> None:
    drive = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    drive.gaintype, drive.gainprm[0] = mujoco.mjtGain.mjGAIN_FIXED, 0.0
