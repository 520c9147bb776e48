"""The pictures that show an effect in the data.

Shape letters: T measurements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.output.result import EvidencePlot, Series
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance
from gfm.signals.torque_domain import torque_views, without_law
from gfm.signals.torques import TorqueView, joined

#: Points of a cloud at most.
MOST_POINTS = 1500
#: Amounts at which a profile is looked at; the one in the middle is the fitted one.
PROFILE_POINTS = 9
#: Label of what rollouts leave.
MISFIT = "error of rollouts in noise floors [1]"
#: Speed from which a joint moves: several times that at which the sign of one is blurred.
MOVING_RAD_S = 0.05
#: Labels of the signals over which laws are drawn.
AXES = {
    "velocity": ("velocity [rad/s]", "missing torque [N m]"),
    "position": ("position [rad]", "missing torque [N m]"),
    "drive": ("size of the drive torque [N m]", "missing torque against the motion [N m]"),
}


def law_plots(
    instances: Sequence[EffectInstance], problem: Problem, recordings: Sequence[Trajectory]
) -> list[EvidencePlot]:
    """Returns a picture of every effect that is a force of position, velocity and drive.

    It shows the torque that the model lacks with all effects in it but this one (a partial
    residual), against what the law depends on, with the fitted law over it.
    """
    lawful = [one for one in instances if one.has_law]
    if not lawful:
        return []
    view, left = torque_left(instances, problem, recordings)
    beside = ", the other effects in it" if len(instances) > 1 else ""
    return [_law_plot(one, view, left, beside) for one in lawful]


def torque_left(
    instances: Sequence[EffectInstance], problem: Problem, recordings: Sequence[Trajectory]
) -> tuple[TorqueView, Array]:
    """Returns recordings seen as torques, and the torque that the model with `instances` lacks.

    The latter in N m, shape (T of all, J): needed by inverse dynamics along the smoothed motion,
    minus what the drives gave, the measured effort where there is one.
    """
    view = joined(torque_views(problem, recordings, without_law(instances)))
    return view, reduce(np.subtract, map(view.law, instances), view.missing)


def _law_plot(instance: EffectInstance, view: TorqueView, left: Array, beside: str) -> EvidencePlot:
    name, signal = instance.joints[0], instance.effect.seen_over
    joint = view.joints.index(name)
    law = view.law(instance)[:, joint]
    missing = left[:, joint] + law
    axis = getattr(view, signal)[:, joint]
    if signal == "drive":
        # Friction that grows with the load acts against the motion, whichever way the drive pushes;
        # at rest it is whatever holds.
        velocity = view.velocity[:, joint]
        axis, missing, law = (
            one[np.abs(velocity) > MOVING_RAD_S]
            for one in (np.abs(axis), -np.sign(velocity) * missing, -np.sign(velocity) * law)
        )
    order = np.argsort(axis)
    keep = order[:: max(len(order) // MOST_POINTS, 1)]
    what = instance.effect.name.replace("_", " ")
    return EvidencePlot(
        title=f"{what} on {name}: torque that the model lacks without it{beside}",
        effect=instance.effect.name,
        joint=name,
        x_label=AXES[signal][0],
        y_label=AXES[signal][1],
        series=(
            Series(label="measured", x=axis[keep], y=missing[keep], style="points"),
            Series(label="fitted law", x=axis[keep], y=law[keep], style="line"),
        ),
    )


def profile_plots(
    instances: Sequence[EffectInstance], problem: Problem, rare: Problem | None = None
) -> list[EvidencePlot]:
    """Returns a picture of every other effect: what rollouts leave if its amount is another one.

    All else stays as fitted. From none of it to twice the amount; from half of it where none of it
    is not zero (a gain, a stiffness, a limit). What takes off has none: no model has less than
    nothing.

    Args:
        instances: What was found.
        problem: In which rollouts are compared, outliers bounded as in the fit.
        rare: The same for what acts now and then only: segments in which it acts; None where
            all are alike.
    """
    plots = []
    for place, instance in enumerate(instances):
        if instance.has_law or instance.takes_off:
            continue
        first = instance.effect.parameters[0]
        low = 0.0 if first.lower <= 0.0 else 0.5
        amounts = instance.values[first.name] * np.linspace(low, 2.0 - low, PROFILE_POINTS)
        amounts = np.clip(amounts, first.lower, first.upper)
        values = [{**instance.values, first.name: amount} for amount in amounts.tolist()]
        others = [replace(instance, values=one) for one in values]
        sets = [(*instances[:place], other, *instances[place + 1 :]) for other in others]
        looked_at = problem if rare is None or not instance.effect.intermittent else rare
        left = np.sqrt(np.mean(looked_at.residuals(sets) ** 2, axis=1))
        middle = slice(PROFILE_POINTS // 2, PROFILE_POINTS // 2 + 1)
        where = instance.joints[0] if len(instance.joints) == 1 else ""
        name = instance.effect.name.replace("_", " ")
        plots.append(
            EvidencePlot(
                title=f"{name}{f' on {where}' if where else ''}: what other amounts would leave",
                effect=instance.effect.name,
                joint=where,
                x_label=f"{first.name.replace('_', ' ')} [{first.unit}]",
                y_label=MISFIT,
                series=(
                    Series(label="all else as fitted", x=amounts, y=left, style="line"),
                    Series(label="fitted", x=amounts[middle], y=left[middle], style="points"),
                ),
            )
        )
    return plots


def error_plot(
    joint: int, problem: Problem, before: Sequence[Array], after: Sequence[Array]
) -> EvidencePlot:
    """Returns one joint's position error over time on the first segments, before and after."""
    name, segments = problem.joints[joint], problem.segments
    first = [i for i, s in enumerate(segments) if s.recording == segments[0].recording]
    starts = np.cumsum([0.0, *(segments[i].time_s[-1] for i in first[:-1])])
    time_s = [segments[i].time_s + start for i, start in zip(first, starts, strict=True)]
    lines = (("nominal model", before), ("corrected model", after))
    return EvidencePlot(
        title=f"{name}: position error of open-loop rollouts on held-out data",
        effect="",
        joint=name,
        x_label="time [s]",
        y_label="measured minus predicted position [rad]",
        series=tuple(
            Series(
                label=label,
                x=np.concatenate(time_s),
                y=np.concatenate([errors[i][:, joint] for i in first]),
                style="line",
            )
            for label, errors in lines
        ),
    )
