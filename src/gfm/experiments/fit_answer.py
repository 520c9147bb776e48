"""What came of a fit, and how it is told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gfm.experiments.fit_judge import Judged


@final
@dataclass(frozen=True, kw_only=True)
class Fit:
    """Forces that were learned, and what they are worth on recordings that were held out.

    Attributes:
        joint_names: Of the recordings, J of them.
        noise: Of each joint's measured position, rad, J of them.
        before: What the model leaves: root mean square errors of positions in rollouts, rad.
        after: The same with the forces.
        detail: What was kept, and what learning added to it, in words.
        forces: Their file: a diagnosis names them, training and evaluation act under them.
        report: File of all figures, fit.json.
    """

    joint_names: tuple[str, ...]
    noise: tuple[float, ...]
    before: Judged
    after: Judged
    detail: str
    forces: Path
    report: Path

    def __repr__(self) -> str:
        return f"<Fit: {self.before.overall:.3g} rad before, {self.after.overall:.3g} after>"


def print_fit(fit: Fit, console: Console) -> None:
    """Prints what is left without the forces and with them, and where they are."""
    floor = float(np.sqrt(np.mean(np.square(fit.noise))))
    rows = [("all joints", fit.before.overall, fit.after.overall, floor)]
    rows += zip(fit.joint_names, fit.before.joints, fit.after.joints, fit.noise, strict=True)
    table = Table(title="Held-out position error (rad, RMSE of open-loop rollouts)")
    for name in ("joint", "nominal", "with the forces", "noise"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for name, *figures in rows:
        table.add_row(str(name), *(f"{float(figure):.3g}" for figure in figures))
    if fit.before.pushed and fit.after.pushed:
        for key, unit in (("place_m", "m"), ("yaw_rad", "rad")):
            both = (getattr(one.pushed, key) for one in (fit.before, fit.after))
            name = f"object, {key.partition('_')[0]} ({unit})"
            table.add_row(name, *(f"{figure:.3g}" for figure in both), "")
    console.print(table)
    console.print(Text(fit.detail))
    for written in (fit.forces, fit.report):
        console.print(Text(str(written)), soft_wrap=True)
