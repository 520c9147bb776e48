"""From a model and a question to motions that a robot can take: shaped, checked, made smaller.

First, a room is looked for, ranges of all joints at once in which nothing touches; then every
motion is shaped in it and checked along its whole path. Where a check fails, the side of the joints
to blame is made smaller (or, for torques of the motion, everything slower) and the motion is made
again.

Shape letters: N control periods, J joints, M moving joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError
from gfm.core.checks import Array
from gfm.excitation.blind_spots import BlindSpot
from gfm.excitation.foresight import unseen
from gfm.excitation.limits import RobotLimits
from gfm.excitation.motion import Motion, Purpose, Tracking, minimum_jerk
from gfm.excitation.programme import FAMILIES, Family, families_for, shown_by
from gfm.excitation.room import Room, find_room, mask
from gfm.excitation.safety import SafetyCheck
from gfm.excitation.shapes import move_s, within

#: How often a motion is made smaller before it is given up.
_TRIES = 80
#: A motion over less shows nothing, rad.
_LEAST_MOTION = 1e-3
#: Held-out motions keep to this share of the room: what is beyond has not been seen.
_HELDOUT_SHARE = 0.8
#: Torques hold a joint on its reference with this angular frequency, 1/s, at most, and this share
#: of critical damping.
_TRACKING_RAD_S, _TRACKING_DAMPING = 8.0, 0.7


@dataclass(frozen=True, kw_only=True)
class Request:
    """What is asked for.

    Attributes:
        effects: To be shown, by name; empty for all.
        kinds: How the motions are commanded: all of them for every kind.
        seconds: Length of each motion, without the way from and to where it begins.
        period_s: Between two commands.
        seed: Of phases, postures and orders.
    """

    effects: tuple[str, ...] = ()
    kinds: tuple[CommandKind, ...]
    seconds: float = 20.0
    period_s: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value, least, most in (
            ("seconds", self.seconds, 8.0, 600.0),
            ("period_s", self.period_s, 0.002, 0.1),
            ("seed", self.seed, 0, 2**31),
        ):
            if not least <= value <= most:
                raise ConfigError(f"{name} is {value:g}, expected {least:g} to {most:g}")


@dataclass(frozen=True, kw_only=True)
class JointReach:
    """What one joint does in one motion.

    Attributes:
        joint: Its name.
        lowest: rad.
        highest: rad.
        speed: Largest, rad/s.
        acceleration: Largest, rad/s^2.
        torque: Largest that the drive needs by the model, N m.
        torque_share: Of what motions may use; None where the model has no limit.
    """

    joint: str
    lowest: float
    highest: float
    speed: float
    acceleration: float
    torque: float
    torque_share: float | None


@dataclass(frozen=True, kw_only=True)
class PlannedMotion:
    """A motion that the robot can take, by its model.

    Attributes:
        motion: The reference.
        family: Its kind.
        torque: That the drives need along it, N m, shape (N, J).
        reach: What each moving joint does in it.
        notes: How it differs from what was wanted, and why.
    """

    motion: Motion
    family: Family
    torque: Array
    reach: tuple[JointReach, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Motions to record.

    Attributes:
        request: What was asked for.
        limits: Of the robot; motions begin and end at `start`, the room's middle.
        room: Ranges of all joints at once in which the robot can rest, touching nothing.
        motions: Training first.
        blind_spots: What is asked for and these motions could not show, as far as one can foresee.
        notes: What to know before a robot moves, in words.
    """

    request: Request
    limits: RobotLimits
    room: Room
    motions: tuple[PlannedMotion, ...]
    blind_spots: tuple[BlindSpot, ...]
    notes: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Of all motions together."""
        return sum(len(m.motion.position) * m.motion.period_s for m in self.motions)


def make_plan(
    model: mujoco.MjModel, limits: RobotLimits, request: Request, *, clearance_m: float = 0.01
) -> Plan:
    """Returns motions that show what is asked for and that the model allows.

    Args:
        model: Of the robot and what stands around it.
        limits: What the robot may do.
        request: What is asked for.
        clearance_m: Distance to keep from everything.

    Raises:
        ConfigError: something touches where motions begin, or no motion is possible.
    """
    check = SafetyCheck(model, limits, clearance_m=clearance_m)
    room, notes = find_room(check, limits)
    # One way there instead of one in every motion.
    limits = replace(limits, start=room.middle)
    check = SafetyCheck(model, limits, clearance_m=clearance_m)
    planner = _Planner(check, limits, request)
    motions: list[PlannedMotion] = []
    for kind in request.kinds:
        for family in families_for(request.effects):
            planned = planner.planned(room, family, kind)
            if isinstance(planned, str):
                notes.append(planned)
            else:
                motions.append(planned)
    training = [one for one in motions if one.family.purpose is Purpose.TRAINING]
    if not training:
        raise ConfigError("; ".join(["no motion is possible", *notes]))
    strange = [effect for effect in request.effects if not shown_by(effect)]
    if strange:
        notes.append(f"no motion is there for {', '.join(strange)}: all of them are proposed")
    if not check.sees_geometry:
        notes.insert(
            0,
            "the moving links have no geometry that can collide: nothing is known of what the "
            "robot would touch. Look at every motion before it is driven.",
        )
    return Plan(
        request=request,
        limits=limits,
        room=room,
        motions=tuple(sorted(motions, key=lambda one: one.family.purpose is Purpose.HELDOUT)),
        blind_spots=unseen([(m.motion, m.torque) for m in training], limits, request.effects),
        notes=(*notes, *limits.notes),
    )


@final
class _Planner:
    """Makes motions for one request."""

    def __init__(self, check: SafetyCheck, limits: RobotLimits, request: Request) -> None:
        self._check, self._limits, self._request = check, limits, request

    def planned(self, room: Room, family: Family, kind: CommandKind) -> PlannedMotion | str:
        """Returns a motion that passes every check, or why there is none."""
        reasons: list[str] = []
        for _ in range(_TRIES):
            path = self._path(room, family, kind)
            fault = self._check.fault(path, self._request.period_s)
            if fault is None and np.ptp(path, axis=0).max() < _LEAST_MOTION:
                reasons.append("nothing would move: the drives are too weak, or the time too short")
                break
            if fault is None:
                return self._found(path, family, kind, reasons[:1])
            reasons.append(fault.words)
            room = room.smaller(self._limits, fault)
            if room.exhausted(self._limits):
                break
        return f"{family.label} ({kind}) is left out: {reasons[-1]}"

    def _path(self, room: Room, family: Family, kind: CommandKind) -> Array:
        """Returns the way to the middle of the room, the shape there, and the way back, (N, J)."""
        limits, period_s = self._limits, self._request.period_s
        share = _HELDOUT_SHARE if family.purpose is Purpose.HELDOUT else 1.0
        ranges, moving = room.ranges(limits, share), mask(limits)
        numbers = FAMILIES.index(family), list(CommandKind).index(kind)
        rng = np.random.default_rng([self._request.seed, *numbers])
        time_s = np.arange(0.0, self._request.seconds, period_s)
        shape = within(ranges, time_s, family.shape(ranges, time_s, rng))
        way = ranges.center - limits.start[moving]
        duration_s = max(1.1 * move_s(ranges, way), period_s)
        passed = minimum_jerk(np.arange(0.0, duration_s, period_s) / duration_s)
        lead = limits.start[moving] + passed[:, np.newaxis] * way
        path = np.tile(limits.start, (2 * len(lead) + len(shape), 1))
        path[:, moving] = np.concatenate([lead, ranges.center + shape, lead[::-1]])
        return path

    def _found(
        self, path: Array, family: Family, kind: CommandKind, reasons: Sequence[str]
    ) -> PlannedMotion:
        torque = self._check.torque(path, self._request.period_s)
        motion = Motion(
            name=f"{family.purpose}_{kind}_{family.label}_seed{self._request.seed}",
            purpose=family.purpose,
            kind=kind,
            joint_names=self._limits.joint_names,
            period_s=self._request.period_s,
            position=path,
            tracking=self._tracking(torque) if kind is CommandKind.EFFORT else None,
        )
        return PlannedMotion(
            motion=motion,
            family=family,
            torque=torque,
            reach=_reach(self._limits, motion, torque),
            notes=tuple(f"made smaller or slower: at first, {reason}" for reason in reasons),
        )

    def _tracking(self, torque: Array) -> Tracking:
        frequency = min(_TRACKING_RAD_S, 0.2 / self._request.period_s)
        inertia = self._check.inertia(self._limits.start)
        return Tracking(
            torque=torque,
            stiffness=frequency**2 * inertia,
            damping=2.0 * _TRACKING_DAMPING * frequency * inertia,
        )


def _reach(limits: RobotLimits, motion: Motion, torque: Array) -> tuple[JointReach, ...]:
    speed = np.diff(motion.position, axis=0) / motion.period_s
    acceleration = np.diff(speed, axis=0) / motion.period_s
    rows = []
    for name in limits.moving:
        j = limits.joint_names.index(name)
        needed = float(np.abs(torque[:, j]).max())
        known = bool(np.isfinite(limits.effort[j]))
        rows.append(
            JointReach(
                joint=name,
                lowest=float(motion.position[:, j].min()),
                highest=float(motion.position[:, j].max()),
                speed=float(np.abs(speed[:, j]).max()),
                acceleration=float(np.abs(acceleration[:, j]).max()),
                torque=needed,
                torque_share=needed / float(limits.effort[j]) if known else None,
            )
        )
    return tuple(rows)
