"""What a robot may do, as far as its model says; defaults elsewhere, and a note that says so.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, UnknownNameError
from gfm.core.checks import Array
from gfm.sim.drive_names import driven_joints

#: Share of a velocity limit in the model that is used: drives follow badly at their limit, and a
#: bridge, which allows half of it by default, should have nothing to change.
SPEED_SHARE = 0.45
#: Where a model has no velocity limit: of a hinge, rad/s, and of a slide, m/s.
DEFAULT_SPEED, SLIDE_SPEED = 1.0, 0.1
#: Full speed is reached in no less than this time, s, and with no more than this, rad/s^2.
FULL_SPEED_S, MOST_ACCELERATION = 0.1, 10.0
#: A hinge without a range is moved so far from the pose, rad.
DEFAULT_REACH = 0.5
#: Distance to the ends of a range: at least so much, rad, and a share of it.
MARGIN_RAD, MARGIN_SHARE = 0.05, 0.03
#: Share of a torque limit that a motion may need.
EFFORT_SHARE = 0.9
#: Stands for all joints in what is asked for.
ALL = ""


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """What is asked for beyond what the model says.

    Attributes:
        pose: Keyframe in which motions begin and end; by default the first, or the model's zero.
        joints: Those that move; by default all.
        ranges: Lowest and highest position by joint, rad.
        speed: By joint, or for `ALL`, rad/s.
        acceleration: By joint, or for `ALL`, rad/s^2.
    """

    pose: str | None = None
    joints: tuple[str, ...] = ()
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    speed: Mapping[str, float] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RobotLimits:
    """Where and how fast motions may go; arrays have shape (J,).

    Attributes:
        joint_names: All driven joints, in the order of every array.
        moving: Which of them move.
        start: Where motions begin and end, rad.
        lower: With the margin, rad.
        upper: With the margin, rad.
        speed: rad/s.
        acceleration: rad/s^2.
        effort: Torque that a motion may need, N m; infinite where the model has no limit.
        notes: What the model did not say, in words.
    """

    joint_names: tuple[str, ...]
    moving: tuple[str, ...]
    start: Array
    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    effort: Array
    notes: tuple[str, ...]


def robot_limits(
    models: Mapping[CommandKind, mujoco.MjModel], wishes: Wishes | None = None
) -> RobotLimits:
    """Returns what the robot that the models stand for may do.

    Args:
        models: One for each kind of command that its actuators take; of the same robot.
        wishes: What is asked for beyond that.

    Raises:
        UnknownNameError: a joint or a pose that does not exist.
        ConfigError: a range or a limit that cannot be, or a slide without a range.
    """
    wishes = wishes or Wishes()
    model = next(iter(models.values()))
    names = driven_joints(model)
    _check_names(models, names, wishes)
    notes: list[str] = []
    start = _start(model, names, wishes.pose)
    lower, upper = _ranges(models, names, start, wishes, notes)
    speed = _speed(models, names, wishes, notes)
    usual = np.minimum(speed / FULL_SPEED_S, MOST_ACCELERATION)
    return RobotLimits(
        joint_names=names,
        moving=wishes.joints or names,
        start=start,
        lower=lower,
        upper=upper,
        speed=speed,
        acceleration=_asked("acceleration", names, wishes.acceleration, usual),
        effort=EFFORT_SHARE * _effort(models, names, notes),
        notes=tuple(notes),
    )


def _check_names(
    models: Mapping[CommandKind, mujoco.MjModel], names: tuple[str, ...], wishes: Wishes
) -> None:
    for kind, model in models.items():
        driven = set(driven_joints(model))
        if driven != set(names):
            listed = ", ".join(sorted(driven)), ", ".join(sorted(names))
            raise ConfigError(f"the {kind} model drives {listed[0]}, another one {listed[1]}")
    for name in (*wishes.joints, *wishes.ranges, *wishes.speed, *wishes.acceleration):
        if name not in (*names, ALL):
            raise UnknownNameError("joint", name, names)


def _start(model: mujoco.MjModel, names: tuple[str, ...], pose: str | None) -> Array:
    keys = [model.key(i).name for i in range(model.nkey)]
    if pose is not None and pose not in keys:
        raise UnknownNameError("keyframe", pose, keys)
    qpos = model.qpos0
    if keys:
        qpos = model.key_qpos[keys.index(pose) if pose is not None else 0]
    return np.array([qpos[model.joint(name).qposadr[0]] for name in names])


def _ranges(
    models: Mapping[CommandKind, mujoco.MjModel],
    names: tuple[str, ...],
    start: Array,
    wishes: Wishes,
    notes: list[str],
) -> tuple[Array, Array]:
    lower, upper = np.empty(len(names)), np.empty(len(names))
    unlimited = []
    for j, name in enumerate(names):
        given = wishes.ranges.get(name) or _model_range(models, name)
        if given is None:
            unlimited.append(name)
            given = (start[j] - DEFAULT_REACH, start[j] + DEFAULT_REACH)
            margin = 0.0
        else:
            width = given[1] - given[0]
            margin = min(max(MARGIN_RAD, MARGIN_SHARE * width), 0.25 * width)
        lower[j], upper[j] = given[0] + margin, given[1] - margin
        if not lower[j] <= start[j] <= upper[j]:
            raise ConfigError(
                f"joint {name} begins at {start[j]:.4g}, expected {lower[j]:.4g} to {upper[j]:.4g} "
                "(its range and a margin): name a keyframe with --pose, or a range with --range"
            )
    if unlimited:
        notes.append(
            f"no range in the model: {', '.join(unlimited)}; motions stay within "
            f"{DEFAULT_REACH:g} rad of where they begin (--range says otherwise)"
        )
    return lower, upper


def _model_range(
    models: Mapping[CommandKind, mujoco.MjModel], name: str
) -> tuple[float, float] | None:
    """Returns the range of a joint, no wider than that of its position commands."""
    found = []
    for kind, model in models.items():
        joint, actuator = model.joint(name), model.actuator(name)
        if model.jnt_limited[joint.id]:
            found.append(model.jnt_range[joint.id])
        if kind is CommandKind.POSITION and model.actuator_ctrllimited[actuator.id]:
            found.append(model.actuator_ctrlrange[actuator.id])
    if not found and _slides(next(iter(models.values())), name):
        raise ConfigError(f"joint {name} slides without a range; expected --range {name}=LO:HI")
    if not found:
        return None
    return float(max(one[0] for one in found)), float(min(one[1] for one in found))


def _slides(model: mujoco.MjModel, name: str) -> bool:
    return bool(model.jnt_type[model.joint(name).id] == mujoco.mjtJoint.mjJNT_SLIDE)


def _speed(
    models: Mapping[CommandKind, mujoco.MjModel],
    names: tuple[str, ...],
    wishes: Wishes,
    notes: list[str],
) -> Array:
    model = next(iter(models.values()))
    usual = np.array([SLIDE_SPEED if _slides(model, one) else DEFAULT_SPEED for one in names])
    servo = models.get(CommandKind.VELOCITY)
    unknown = []
    for j, name in enumerate(names):
        if servo is not None and servo.actuator_ctrllimited[servo.actuator(name).id]:
            limit = servo.actuator_ctrlrange[servo.actuator(name).id]
            usual[j] = SPEED_SHARE * min(abs(limit[0]), abs(limit[1]))
        elif name not in wishes.speed and ALL not in wishes.speed:
            unknown.append(name)
    if unknown:
        notes.append(
            f"no velocity limit in the model: {', '.join(unknown)}; motions take at most "
            f"{DEFAULT_SPEED:g} rad/s, slides {SLIDE_SPEED:g} m/s (--max-velocity says otherwise)"
        )
    return _asked("velocity", names, wishes.speed, usual)


def _asked(what: str, names: tuple[str, ...], asked: Mapping[str, float], usual: Array) -> Array:
    """Returns what is asked for, joint by joint, and what is usual for the others."""
    values = np.array(
        [asked.get(name, asked.get(ALL, one)) for name, one in zip(names, usual, strict=True)]
    )
    if not ((values > 0.0) & np.isfinite(values)).all():
        worst = names[int(np.argmin((values > 0.0) & np.isfinite(values)))]
        raise ConfigError(f"{what} of {worst} is {values.min():g}, expected more than 0")
    return values


def _effort(
    models: Mapping[CommandKind, mujoco.MjModel], names: tuple[str, ...], notes: list[str]
) -> Array:
    """Returns the largest torque of every drive, N m; infinite where no model limits it."""
    effort = np.array([min(drive_limit(m, name) for m in models.values()) for name in names])
    unknown = [name for name, limit in zip(names, effort, strict=True) if np.isinf(limit)]
    if unknown:
        notes.append(f"no torque limit in the model, so none was kept to: {', '.join(unknown)}")
    return effort


def drive_limit(model: mujoco.MjModel, name: str) -> float:
    """Returns the largest torque of a joint's drive, N m; infinite where the model has no limit."""
    joint, actuator = model.joint(name).id, model.actuator(name).id
    gear = abs(float(model.actuator_gear[actuator, 0]))
    limits = [np.inf]
    if model.actuator_forcelimited[actuator]:
        limits.append(gear * np.abs(model.actuator_forcerange[actuator]).min())
    motor = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    if motor and model.actuator_ctrllimited[actuator]:
        reach = np.abs(model.actuator_ctrlrange[actuator]).min()
        limits.append(gear * abs(model.actuator_gainprm[actuator, 0]) * reach)
    if model.jnt_actfrclimited[joint]:
        limits.append(np.abs(model.jnt_actfrcrange[joint]).min())
    return float(min(limits))
