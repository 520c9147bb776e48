"""Paper question 1: what each model of the arm predicts, for several hidden effects and seeds.

    python benchmarks/joint_control.py --out runs/joint_control

Every run is a whole `gfm run`: nominal model, gain and damping identified by SLSQP, generalized
forces alone, the named effect, and both together, on held-out recordings. Runs whose report is
already there are not repeated. The robot is a simulated one, written apart from the diagnosis.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from effects_10_seeds import commit, places, report_of, words_of

import gfm

DOCS = Path(__file__).parents[1] / "docs"
PAGE, FIGURE = DOCS / "results" / "joint_control.md", DOCS / "images" / "joint_control.svg"
EFFECTS = ("cogging_torque", "coulomb_friction", "joint_spring")
MODELS = {
    "nominal": "nominal",
    "identified": "SLSQP",
    "hybrid": "GFM",
    "corrected": "named effect",
    "corrected_hybrid": "effect + GFM",
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run.

    Attributes:
        effect: Asked for.
        seed: Of the run.
        hidden: Effects and joints.
        named: The same of what was named.
        errors: Held-out position RMSE by model, rad.
        floor: Sensor noise, rad.
        kept: What was kept of the generalized forces, in words.
        wall_s: Of the run.
    """

    effect: str
    seed: int
    hidden: str
    named: str
    errors: dict[str, float]
    floor: float
    kept: str
    wall_s: float


def run_once(effect: str, seed: int, minutes: float, folder: Path) -> Case:
    """Runs the loop, unless its report is there, and returns what it found."""
    words = ("--skip-task", "--seed", str(seed), "--hidden-effect", effect)
    words += ("--budget-minutes", str(minutes))
    report = report_of(words, folder)
    rows = {row["model"]: row for row in report["comparison"]["models"]}
    return Case(
        effect=effect,
        seed=seed,
        hidden=words_of(places(report["revealed"]["hidden"])),
        named=words_of(places(report["diagnosis"]["effects"])),
        errors={model: row["overall"] for model, row in rows.items()},
        floor=report["comparison"]["noise_floor"],
        kept=rows["hybrid"]["detail"].split(":")[0].split(";")[0],
        wall_s=sum(phase["seconds"] for phase in report["system"]["phases"]),
    )


def table(cases: Sequence[Case]) -> str:
    """Returns one line per run."""
    lines = [
        f"| hidden | seed | named | {' | '.join(MODELS.values())} | GFM / nominal | time |",
        "|---" * (len(MODELS) + 5) + "|",
    ]
    for one in cases:
        errors = [f"{one.errors[m]:.3g}" if m in one.errors else "–" for m in MODELS]
        lines.append(
            f"| {one.hidden} | {one.seed} | {one.named} | {' | '.join(errors)} "
            f"| {one.errors['hybrid'] / one.errors['nominal']:.2f} | {one.wall_s:.0f} s |"
        )
    return "\n".join(lines)


def draw(cases: Sequence[Case], path: Path) -> None:
    """Draws every run's errors, a column of points for each effect."""
    figure, axes = plt.subplots(1, len(EFFECTS), figsize=(9.0, 3.2), sharey=True)
    for ax, effect in zip(axes, EFFECTS, strict=True):
        of_it = [one for one in cases if one.effect == effect]
        for one in of_it:
            values = [1e3 * one.errors.get(model, np.nan) for model in MODELS]
            ax.plot(values, "o-", color="#0072b2", alpha=0.6, markersize=4, linewidth=0.8)
            ax.axhline(1e3 * one.floor, color="#999999", linewidth=0.8, linestyle=":")
        ax.set_title(effect.replace("_", " "), fontsize=10)
        ax.set_yscale("log")
        ax.set_xticks(range(len(MODELS)), list(MODELS.values()), rotation=35, ha="right")
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("held-out position RMSE, mrad")
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def page(cases: Sequence[Case], words: str) -> str:
    """Returns the tables as Markdown."""
    halved = sum(one.errors["hybrid"] <= 0.5 * one.errors["nominal"] for one in cases)
    below = sum(one.errors["hybrid"] < one.errors["identified"] for one in cases)
    learned = sum(one.kept.startswith("warm start refined") for one in cases)
    return f"""# Joint control: nominal, identified, learned, named, and named with learned

Simulated Sawyer, driven and recorded through the services; position RMSE (rad) of open-loop
rollouts over four held-out recordings (multisine, position and velocity mode), initial states
fitted, all models alike; sensor noise {cases[0].floor:.2g} rad. "SLSQP": gain and damping of
every joint, the paper's baseline. "GFM": generalized forces alone, no named effect in their model.
"Effect + GFM": forces for what the corrected model leaves, by the warm start. Written by

    {words}

with gfm {gfm.__version__} at commit {commit()}, {time.strftime("%Y-%m-%d")}, Python
{platform.python_version()}, MuJoCo {version("mujoco")}, {platform.machine()}.

![held-out error of every model](../images/joint_control.svg)

{table(cases)}

- GFM at most half of the nominal error: {halved} of {len(cases)}; below SLSQP: {below}.
- Reinforcement learning improved on the warm start in {learned} runs; else that is kept.
- A dash: nothing was named, so that there was nothing to put forces beside.
"""


def main() -> None:
    """Runs everything and writes page and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/joint_control"), metavar="DIR")
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    parser.add_argument("--budget-minutes", type=float, default=9.5, help="of each run")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    asked = parser.parse_args()
    cases = []
    for effect in EFFECTS:
        for seed in range(asked.seeds):
            folder = asked.out / f"{effect}-{seed}"
            cases.append(run_once(effect, seed, asked.budget_minutes, folder))
            print(cases[-1], flush=True)
    draw(cases, FIGURE if asked.page == PAGE else asked.page.with_suffix(".svg"))
    words = " ".join(["python benchmarks/joint_control.py", *sys.argv[1:]])
    asked.page.write_text(page(cases, words), encoding="utf-8")


if __name__ == "__main__":
    main()
