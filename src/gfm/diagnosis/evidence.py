"""The pictures that show an effect in the data.

Shape letters: T measurements.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.candidates import TorqueView
from gfm.diagnosis.problem import Problem
from gfm.diagnosis.result import EvidencePlot, Series
from gfm.effects import EffectInstance

#: Points of a cloud at most.
MOST_POINTS = 1500
#: Labels of the signals over which laws are drawn.
AXES = {
    "velocity": "velocity [rad/s]",
    "position": "position [rad]",
    "drive": "drive torque [N m]",
}


def force_plot(
    instance: EffectInstance,
    others: Sequence[EffectInstance],
    problem: Problem,
    views: Sequence[TorqueView],
) -> EvidencePlot | None:
    """Returns the missing torque against what the law depends on, with the fitted law over it.

    What the other accepted forces explain is taken off first. None for an effect that is no force
    of position, velocity and drive.
    """
    joint, other = _indices(instance, problem)
    laws = [view.motion(joint, other) for view in views]
    fitted = [instance.effect.torque(motion, instance.values) for motion in laws]
    if any(part is None for part in fitted):
        return None
    law = np.concatenate([part for part in fitted if part is not None])
    missing = np.concatenate([view.missing[:, joint] for view in views])
    missing = missing - _explained(others, joint, problem, views)
    label, axis = _axis(instance, views, joint)
    order = np.argsort(axis)
    keep = order[:: max(len(order) // MOST_POINTS, 1)]
    name = instance.effect.name.replace("_", " ")
    return EvidencePlot(
        title=f"{name} on {instance.joints[0]}: torque that the nominal model lacks",
        effect=instance.effect.name,
        joint=instance.joints[0],
        x_label=label,
        y_label="missing torque [N m]",
        series=(
            Series(label="measured", x=axis[keep], y=missing[keep], style="points"),
            Series(label="fitted law", x=axis[keep], y=law[keep], style="line"),
        ),
    )


def _indices(instance: EffectInstance, problem: Problem) -> tuple[int, int | None]:
    if not instance.joints:
        return 0, None
    places = [problem.joints.index(name) for name in instance.joints]
    return places[0], places[1] if len(places) == 2 else None


def _explained(
    others: Sequence[EffectInstance], joint: int, problem: Problem, views: Sequence[TorqueView]
) -> Array:
    total = np.zeros(sum(len(view.missing) for view in views))
    for instance in others:
        first, second = _indices(instance, problem)
        if first != joint or not instance.joints:
            continue
        parts = [
            instance.effect.torque(view.motion(first, second), instance.values) for view in views
        ]
        if all(part is not None for part in parts):
            total += np.concatenate([part for part in parts if part is not None])
    return total


def _axis(instance: EffectInstance, views: Sequence[TorqueView], joint: int) -> tuple[str, Array]:
    signal = instance.effect.seen_over
    return AXES[signal], np.concatenate([getattr(v, signal)[:, joint] for v in views])


def error_plot(
    joint: int, problem: Problem, before: Sequence[Array], after: Sequence[Array]
) -> EvidencePlot:
    """Returns one joint's position error over time on the first segments, before and after."""
    name = problem.joints[joint]
    recording = problem.segments[0].recording
    first = [i for i, s in enumerate(problem.segments) if s.recording == recording]
    time_s, offset = [], 0.0
    for i in first:
        time_s.append(problem.segments[i].time_s + offset)
        offset += float(problem.segments[i].time_s[-1])
    stamps = np.concatenate(time_s)
    return EvidencePlot(
        title=f"{name}: position error of open-loop rollouts on held-out data",
        effect="",
        joint=name,
        x_label="time [s]",
        y_label="measured minus predicted position [rad]",
        series=tuple(
            Series(
                label=label,
                x=stamps,
                y=np.concatenate([e[i][:, joint] for i in first]),
                style="line",
            )
            for label, e in (("nominal model", before), ("corrected model", after))
        ),
    )


def misfit_plot(problem: Problem, before: Sequence[Array], after: Sequence[Array]) -> EvidencePlot:
    """Returns every joint's held-out RMSE in units of its noise, before and after."""
    numbers = np.arange(len(problem.joints), dtype=float)
    return EvidencePlot(
        title="Held-out position error of every joint, in units of its sensor noise",
        effect="",
        joint="",
        x_label="joint [number in the chain]",
        y_label="RMSE / noise [1]",
        series=tuple(
            Series(label=label, x=numbers, y=rmse(e) / problem.noise.position, style="points")
            for label, e in (("nominal model", before), ("corrected model", after))
        ),
    )


def rmse(errors: Sequence[Array]) -> Array:
    """Returns the root mean square of errors of shape (T, J) by joint, shape (J,)."""
    return np.asarray(np.sqrt(np.mean(np.concatenate(list(errors)) ** 2, axis=0)))
