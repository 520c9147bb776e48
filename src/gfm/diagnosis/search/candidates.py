"""Where each effect could act, and how large its probes are there.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import Effect, EffectInstance, Key, Scales, Scope, Values
from gfm.effects.effect import sign
from gfm.signals.smoothing import rms
from gfm.signals.torques import TorqueView, joined
from gfm.sim.plant import Plant, make_plant

#: Orders of a cogging torque that are looked for, per revolution of the joint.
COGGING_ORDERS = range(2, 101)
#: How many of them are taken to the rollouts, with a spring beside them and without.
COGGING_KEPT = 3
#: Distances from the last link's origin at which points of it may touch something, along its axes,
#: and postures in which they are looked at.
REACHES_M, POSTURES = (0.05, 0.1, 0.2), 5000
#: Periods that the motion has to cover, so that it is seen to repeat: one alone is any curve.
LEAST_PERIODS = 1.25
#: Percentiles of sizes: one that a few command steps, where effort and motion disagree, do not set,
#: and the largest but for a few moments.
TYPICAL, PEAK = 80.0, 99.5


@dataclass(frozen=True, kw_only=True)
class Place:
    """An effect somewhere: a candidate.

    Attributes:
        effect: The law.
        joints: Where it acts.
        scales: Typical sizes of the signals there, on the first of its joints.
        least: Amounts, less than none, that would take off all that the model itself says there.
        most: Largest sizes of amounts there, to either side, see `most_amounts`.
    """

    effect: Effect
    joints: tuple[str, ...]
    scales: Scales
    least: Mapping[str, float] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)

    @property
    def key(self) -> Key:
        """What makes two candidates the same."""
        return self.effect.name, self.joints

    @property
    def probes(self) -> list[list[EffectInstance]]:
        """Small amounts of the effect there, in groups: see `Effect.probes`."""
        return [[self.instance(v) for v in group] for group in self.effect.probes(self.scales)]

    def instance(self, values: Values) -> EffectInstance:
        """Returns the effect there, in some amount."""
        return EffectInstance(
            effect=self.effect,
            joints=self.joints,
            values=values,
            least=self.least,
            most=self.most,
        )


def places(
    effect: Effect,
    joints: Sequence[str],
    scales: Sequence[Scales],
    driven: Sequence[str] | None = None,
    *,
    pushing: bool = False,
) -> list[Place]:
    """Returns every place where an effect can act on a robot with these joints.

    Args:
        effect: Which one.
        joints: All joints that are measured.
        scales: Of each joint's signals.
        driven: Those that have a drive; all, if None.
        pushing: Whether the robot moves an object, and so feels what pushing it takes.
    """
    if effect.scope is Scope.OBJECT and not pushing:
        return []
    own = dict(zip(joints, scales, strict=True))
    if effect.needs_drive and driven is not None:
        joints = driven
    where: dict[Scope, Iterable[tuple[str, ...]]] = {
        Scope.JOINT: [(name,) for name in joints],
        Scope.PAIR: combinations(joints, 2),
        Scope.LAST: [tuple(joints[-1:])],
    }
    everywhere = tuple(joints) if effect.shares_joints else ()
    return [
        Place(effect=effect, joints=there, scales=own[there[0]] if there else scales[0])
        for there in where.get(effect.scope, [everywhere])
    ]


def joint_scales(problem: Problem, views: Sequence[TorqueView]) -> list[Scales]:
    """Returns the typical sizes of every joint's signals."""
    plant = make_plant(next(iter(problem.specs.values())), problem.joints)
    data = mujoco.MjData(plant.model)
    mujoco.mj_forward(plant.model, data)
    inertia = np.zeros((plant.model.nv, plant.model.nv))
    mujoco.mj_fullM(plant.model, data, inertia)
    every = joined(views)
    excess = np.percentile(np.abs(every.missing), TYPICAL, axis=0)
    peaks = (np.percentile(np.abs(one), PEAK, axis=0) for one in (every.needed, every.served))
    excess, peak, servo = np.maximum([excess, *peaks], 1e-6).tolist()
    return [
        Scales(
            torque_nm=rms([view.drive[:, j] - view.drive[:, j].mean() for view in views]),
            excess_nm=excess[j],
            velocity_rad_s=max(rms([every.velocity[:, j]]), 1e-3),
            position_rad=max(0.5 * float(np.ptp(every.position[:, j])), 1e-3),
            peak_nm=peak[j],
            servo_nm=servo[j],
            inertia=float(inertia[dof, dof]),
            cogging_per_revolution=cogging_orders(every, j),
            lowest_m=_lowest_points(plant, every.position) if j == len(plant.dof) - 1 else (),
        )
        for j, dof in enumerate(plant.dof)
    ]


def _lowest_points(plant: Plant, postures: Array) -> tuple[tuple[float, float, float, float], ...]:
    """Returns points of the last link, and the least height of each: x, y, z, height, in m."""
    model, data = plant.model, mujoco.MjData(plant.model)
    link = int(model.dof_bodyid[plant.dof[-1]])
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    points = np.concatenate([np.zeros((1, 3)), *(reach * axes for reach in REACHES_M)])

    lowest = np.full(len(points), np.inf)
    for posture in postures[:: max(len(postures) // POSTURES, 1)]:
        data.qpos[plant.qpos] = posture
        mujoco.mj_kinematics(model, data)
        upward = data.xmat[link].reshape(3, 3)[2]
        lowest = np.minimum(lowest, data.xpos[link, 2] + points @ upward)
    rows = zip(points.tolist(), lowest.tolist(), strict=True)
    return tuple((x, y, z, height) for (x, y, z), height in rows)


def cogging_orders(view: TorqueView, joint: int) -> tuple[int, ...]:
    """Returns the orders of a cogging torque that stand out in one joint's missing torque.

    Sines of the angle are weighed by what they explain beside friction laws: those that are best
    beside a spring, too, and those without (over about a period, most of a sine is a slope). Orders
    of whose period the motion covers too little are left out.
    """
    q, v, r = (signal[:, joint] for signal in (view.position, view.velocity, view.missing))
    friction = [np.ones_like(q), v, sign(v, 0.01)]
    span = float(np.ptp(q))
    orders = [order for order in COGGING_ORDERS if order * span >= 2.0 * np.pi * LEAST_PERIODS]
    kept: dict[int, None] = {}
    for smooth in ([*friction, q], friction):
        basis = np.linalg.qr(np.stack(smooth, axis=1))[0]
        rest = without(r, basis)
        powers = {order: _power(order * q, rest, basis) for order in orders}
        best = sorted(powers, key=lambda order: -powers[order])
        kept |= dict.fromkeys(best[:COGGING_KEPT])
    return tuple(kept)


def _power(angle: Array, rest: Array, basis: Array) -> float:
    """Returns the sum of squares of `rest` that sines of an angle explain beside a basis."""
    waves = without(np.stack([np.sin(angle), np.cos(angle)], axis=1), basis)
    fitted = waves @ np.linalg.lstsq(waves, rest, rcond=None)[0]
    return float(fitted @ fitted)
