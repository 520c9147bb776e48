"""How a whole system learns: sums over its services, row by row, also across restarts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from gfm.core import Status
from gfm.experiments.fit_curves import metric_rows
from gfm.experiments.train_config import RunFolder
from gfm.service.metrics import FolderMetrics

_COUNTERS = ("env_steps", "episodes", "unusable_steps")
_GAUGES = ("episode_return_mean", "success_rate", "tracking_rmse_rad", "curriculum_gain")


@final
class SystemCurves:
    """Writes rows to `metrics.jsonl` and TensorBoard in the run's folder.

    Services go on counting where those before them ended; here no sum falls, also while one of them
    is away.

    Attributes:
        life: Starts of this run before this one.
        learner_steps: Of the newest row.
    """

    def __init__(self, folder: RunFolder) -> None:
        rows = metric_rows(folder.progress)
        last = rows[-1] if rows else {}
        self.life = int(last.get("life", -1)) + 1
        self.learner_steps = 0
        self._sums = {name: last.get(name, 0.0) for name in _COUNTERS}
        self._sink = FolderMetrics(folder.progress)
        self._at: tuple[float, float, float] | None = None

    def add(self, statuses: Sequence[Status], time_s: float) -> Mapping[str, float]:
        """Writes and returns one row.

        Args:
            statuses: Of all services that answered.
            time_s: Since 1970-01-01 UTC.
        """
        steps = max((s.counters.get("learner_steps", 0) for s in statuses), default=0)
        for name, before in self._sums.items():
            self._sums[name] = max(before, sum(s.counters.get(name, 0) for s in statuses))
        row = dict(self._sums)
        row |= _means(statuses)
        row |= self._rates(time_s, steps, row["env_steps"])
        row["life"] = self.life
        self._sink.write(int(steps), time_s, row)
        self.learner_steps = int(steps)
        return {"learner_step": float(steps), **row}

    def close(self) -> None:
        """Ends; everything written is on disk."""
        self._sink.close()

    def _rates(self, time_s: float, steps: float, env_steps: float) -> dict[str, float]:
        before, self._at = self._at, (time_s, steps, env_steps)
        if before is None or time_s <= before[0]:
            return {}
        passed_s = time_s - before[0]
        return {
            "learner_steps_per_s": (steps - before[1]) / passed_s,
            "env_steps_per_s": (env_steps - before[2]) / passed_s,
        }


def _means(statuses: Sequence[Status]) -> dict[str, float]:
    """Returns the actors' gauges, averaged over those that have them."""
    means = {}
    for name in _GAUGES:
        values = [status.gauges[name] for status in statuses if name in status.gauges]
        if values:
            means[name] = float(np.mean(values))
    return means


def in_words(row: Mapping[str, float], learner_steps: int) -> str:
    """Returns a row in one line."""
    shown = {
        "episode_return_mean": "return {:.1f}",
        "success_rate": "success {:.0%}",
        "tracking_rmse_rad": "tracking error {:.4f} rad",
        "curriculum_gain": "gain {:.3g}",
        "env_steps": "{:,.0f} environment steps",
    }
    parts = [form.format(row[name]) for name, form in shown.items() if name in row]
    return ", ".join([f"step {row['learner_step']:,.0f} of {learner_steps:,}", *parts])
