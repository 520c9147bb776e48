"""How a fit of generalized forces went: the learner's metrics and the measured errors as curves."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gfm.report import CurveGroup, TrainingCurve

#: Metrics of the learner that are drawn: their words and their panel.
_CURVES = {
    "reward_mean": ("mean reward of a batch", CurveGroup.REWARD),
    "critic_loss": ("critic", CurveGroup.LOSS),
    "policy_loss": ("policy", CurveGroup.LOSS),
    "kl_mean_relative": ("mean, in units of its limit", CurveGroup.KL),
    "kl_stddev_relative": ("stddev, in units of its limit", CurveGroup.KL),
}


def metric_rows(folder: Path) -> list[dict[str, float]]:
    """Returns what the learner wrote so far; a row that is being written is left out."""
    path = folder / "metrics.jsonl"
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [json.loads(line) for line in lines if line.endswith("\n")]


def learning_curves(
    rows: Sequence[Mapping[str, float]], began_utc_s: float
) -> tuple[TrainingCurve, ...]:
    """Returns the learner's metrics over the time since `began_utc_s`; nothing without rows."""
    if not rows:
        return ()
    times = np.array([row["time_s"] for row in rows]) - began_utc_s
    steps = np.array([float(row["learner_step"]) for row in rows])
    return tuple(
        TrainingCurve(
            label=label,
            group=group,
            unit="",
            wall_clock_s=times,
            learner_steps=steps,
            value=np.array([row[name] for row in rows]),
        )
        for name, (label, group) in _CURVES.items()
    )


def error_curves(
    points: Sequence[tuple[float, int, float]], without_forces: float, unit: str
) -> tuple[TrainingCurve, ...]:
    """Returns the training error of the policy, and that without any forces beside it.

    Args:
        points: Time s, learner steps and error of each measured policy.
        without_forces: The error of none.
        unit: Of the errors.
    """
    times, steps, errors = np.array(points, np.float64).reshape(-1, 3).T
    values = {
        "with the forces, training recordings": errors,
        "without forces": np.full_like(errors, without_forces),
    }
    return tuple(
        TrainingCurve(
            label=label,
            group=CurveGroup.ERROR,
            unit=unit,
            wall_clock_s=times,
            learner_steps=steps,
            value=value,
        )
        for label, value in values.items()
    )
