"""Whether signals can be in the units that they claim: rad, rad/s, N m, s.

Each check objects only where another unit explains what nothing else does.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import mujoco
import numpy as np

from gfm.api.objections.objection import Objection
from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.signals.channels import FOLLOWS, velocity_ratios
from gfm.signals.smoothing import correlation, slope, smooth_states
from gfm.sim.kinematics import along
from gfm.sim.plant import Plant

#: Joint states come tens to thousands of times a second; what lies outside is another unit.
LEAST_RATE_HZ, MOST_RATE_HZ = 1.0, 10_000.0
DEGREES = 180.0 / np.pi
#: How far a ratio may lie from a unit's factor. Commands are followed loosely: a servo may give
#: way, or overshoot.
NEAR, LOOSELY = 1.2, 2.5
#: No robot joint with a position servo is as fast (an ungeared drive reaches 40), rad/s.
MOST_RAD_S = 60.0
#: No joint that carries something beside its axis winds itself up like this, rad.
MOST_SPAN_RAD = 8.0 * np.pi
#: A body is beside the axis when its centre of mass is, by so much, m.
BESIDE_M = 0.01
#: Rise of the kinetic energy, as a multiple of what was put in, that no error of a model's masses
#: explains. Robots of which the models are right show 0.01 to 0.5, in degrees up to 70.
MOST_ENERGY = 10.0
#: Less kinetic energy than this is noise, J.
LEAST_ENERGY_J = 1e-3


def absurd_rate(recording: Trajectory) -> Objection | None:
    """Objects to stamps in another unit than they claim."""
    rate_hz = 1.0 / recording.period_s
    if LEAST_RATE_HZ <= rate_hz <= MOST_RATE_HZ:
        return None
    return Objection(
        where="stamps of the measurements",
        problem=f"{rate_hz:.3g} measurements per second",
        expected=f"{LEAST_RATE_HZ:.0f} to {MOST_RATE_HZ:.0f} (milliseconds or nanoseconds taken "
        "for seconds? give the unit in the import mapping: time.scale)",
    )


def beyond_range(recording: Trajectory, plant: Plant) -> Objection | None:
    """Objects to positions far outside the joint's range that fit into it as degrees."""
    model = plant.model
    for j, name in enumerate(recording.joint_names):
        joint = model.joint(name)
        if not model.jnt_limited[joint.id]:
            continue
        low, high = model.jnt_range[joint.id]
        q, span = recording.position[:, j], high - low
        inside = (q > low - span) & (q < high + span)
        if np.ptp(q) <= 1.5 * span and inside.mean() > 0.9:
            continue
        reach = float(q[np.abs(q).argmax()])
        in_degrees = low - span < reach / DEGREES < high + span
        hint = " (degrees? scale them by 0.0174533)" if in_degrees else " (another unit or joint?)"
        return Objection(
            where=f"position of {name}",
            problem=f"reaches {reach:.3g}, the model's joint {low:.3g} to {high:.3g} rad",
            expected=f"rad{hint}",
        )
    return None


def wound_up(recording: Trajectory, plant: Plant) -> Objection | None:
    """Objects to servo-driven links that turn or race as none does, where no range tells."""
    if recording.command_kind is CommandKind.EFFORT:
        return None
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    for j in np.flatnonzero(_carries_beside_axis(plant)):
        span = float(np.ptp(recording.position[:, j]))
        fastest = float(np.percentile(np.abs(speed[:, j]), 99.0))
        if span > MOST_SPAN_RAD or fastest > MOST_RAD_S:
            return Objection(
                where=f"position of {recording.joint_names[j]}",
                problem=f"spans {span:.3g} at up to {fastest:.3g} per second",
                expected="rad and seconds (degrees? scale them by 0.0174533)",
            )
    return None


def _carries_beside_axis(plant: Plant) -> Array:
    """Returns which joints are hinges whose load does not just spin about them, shape (J,)."""
    model, data = plant.model, mujoco.MjData(plant.model)
    mujoco.mj_forward(model, data)
    answers = []
    for dof in plant.dof:
        joint = model.dof_jntid[dof]
        hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        arm = data.subtree_com[model.jnt_bodyid[joint]] - data.xanchor[joint]
        beside = np.linalg.norm(np.cross(arm, data.xaxis[joint])) > BESIDE_M
        answers.append(bool(hinge and beside))
    return np.array(answers)


def command_ratio(recording: Trajectory) -> Objection | None:
    """Objects to a servo that answers in other units than it is told."""
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    answer = {CommandKind.POSITION: recording.position, CommandKind.VELOCITY: speed}
    signal = answer.get(recording.command_kind)
    if signal is None:
        return None
    command = recording.held_command
    for j, name in enumerate(recording.joint_names):
        if correlation(signal[:, j], command[:, j]) < FOLLOWS:
            continue
        ratio = float(slope(signal[:, j], command[:, j]))
        if _is(ratio, DEGREES, LOOSELY) or _is(ratio, 1.0 / DEGREES, LOOSELY):
            degrees = "measurements" if ratio > 1.0 else "commands"
            return Objection(
                where=f"{recording.command_kind} of {name}",
                problem=f"is {ratio:.3g} times its command",
                expected=f"both in rad (are the {degrees} in degrees?)",
            )
    return None


def velocity_ratio(recording: Trajectory) -> Objection | None:
    """Objects to velocities that are no derivative of the positions."""
    for j, ratio in velocity_ratios(recording).items():
        if _is(ratio, -1.0, NEAR):
            problem, expected = "has the opposite sign of the position's slope", "the same sign"
        elif _is(ratio, DEGREES, NEAR) or _is(ratio, 1.0 / DEGREES, NEAR):
            one = "velocities" if ratio > 1.0 else "positions"
            problem = f"is {ratio:.3g} times the position's slope"
            expected = f"rad and rad/s (are the {one} in degrees?)"
        elif any(_is(ratio, 10.0**p, NEAR) for p in (-9, -6, -3, 3, 6, 9)):
            problem = f"is {ratio:.3g} times the position's slope"
            expected = "stamps in seconds (milliseconds, microseconds or nanoseconds taken for it?)"
        else:
            continue
        where = f"velocity of {recording.joint_names[j]}"
        return Objection(where=where, problem=problem, expected=expected)
    return None


def surplus_energy(recording: Trajectory, plant: Plant) -> Objection | None:
    """Objects to a motion that gains far more energy than drive and weight can give it.

    For known torques only: measured, or commanded. Judged where the kinetic energy rises most:
    in degrees it rises 3283 times as much, for 57 times the work; stamps in other units show
    likewise.
    """
    commanded = recording.command_kind is CommandKind.EFFORT
    effort = recording.held_command if commanded else recording.effort
    if effort is None:
        return None
    q, v, _ = smooth_states(recording.time_s, recording.position)
    potential, kinetic = np.array([data.energy.copy() for data in along(plant, q, v)]).T
    power = np.abs(effort * v).sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(power[:-1] * np.diff(recording.time_s))])
    top = int(np.argmax(kinetic - np.minimum.accumulate(kinetic)))
    bottom = int(np.argmin(kinetic[: top + 1]))
    risen, given = kinetic[top] - kinetic[bottom], work[top] - work[bottom] + np.ptp(potential)
    if risen < max(MOST_ENERGY * given, LEAST_ENERGY_J):
        return None
    return Objection(
        where="positions, stamps and torques",
        problem=f"motion gains {risen / given:.2g} times the energy that drives and weight give",
        expected="rad, seconds and N m (positions in degrees? scale them by 0.0174533)",
    )


def _is(ratio: float, factor: float, within: float) -> bool:
    return 1.0 / within < ratio / factor < within
