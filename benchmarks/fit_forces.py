"""Fitting generalized forces: error against wall-clock time, from the warm start and from nothing.

    python benchmarks/fit_forces.py --out runs/fit_forces

A simulated Sawyer with a hidden effect is driven twice through `gfm run`'s motions (twelve training
recordings, eight held-out ones). Then `gfm fit` learns forces on five and on ten of them, beginning
with inverse dynamics and with a policy that has learned nothing, as in the paper. What is there
already is not repeated.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from effects_10_seeds import commit

import gfm
from gfm.core import MonotonicClock
from gfm.diagnosis.output.correction import model_pair
from gfm.excitation.motion import Purpose
from gfm.excitation.waypoints import motions
from gfm.experiments.drive import drive, sawyer_ranges
from gfm.experiments.run import KINDS, nominal_arm
from gfm.launch import (
    LOCKSTEP,
    Supervisor,
    own_system,
    robot_processes,
    router_process,
)
from gfm.report.files import model_texts, write_texts
from gfm_wire import Role

DOCS = Path(__file__).parents[1] / "docs"
PAGE, FIGURE = DOCS / "results" / "fit_forces.md", DOCS / "images" / "fit_forces.svg"
ROUNDS = 2


@dataclass(frozen=True, kw_only=True)
class Way:
    """A way to fit.

    Attributes:
        title: In words.
        count: Trajectories.
        flags: Of `gfm fit`.
        colour: In the figure.
    """

    title: str
    count: int
    flags: tuple[str, ...]
    colour: str


NOTHING = ("--from-nothing",)
WAYS = {
    "warm_5": Way(title="warm start, 5 trajectories", count=5, flags=(), colour="#56b4e9"),
    "warm_10": Way(title="warm start, 10 trajectories", count=10, flags=(), colour="#0072b2"),
    "cold_5": Way(title="from nothing, 5 trajectories", count=5, flags=NOTHING, colour="#e69f00"),
    "cold_10": Way(
        title="from nothing, 10 trajectories", count=10, flags=NOTHING, colour="#d55e00"
    ),
}


def record(folder: Path, effect: str, seed: int) -> dict[Purpose, list[str]]:
    """Drives the robot, unless it was driven, and returns the recordings in order of time."""
    rounds = [drive_round(folder / f"round_{k}", effect, seed, k) for k in range(ROUNDS)]
    rows = [row for one in rounds for row in one]
    return {kind: [path for purpose, path in rows if purpose == str(kind)] for kind in Purpose}


def drive_round(folder: Path, effect: str, seed: int, motion_seed: int) -> list[tuple[str, str]]:
    """Drives all motions once, unless they were, and returns purpose and path of each."""
    found = folder / "driven.json"
    if not found.exists():
        target = ("--recordings", str((folder / "recordings").absolute()), *LOCKSTEP)
        robot = ("--hidden-effect", effect, "--seed", str(seed), *LOCKSTEP)
        processes = (router_process(), *robot_processes(target, robot))
        system = own_system("drive", folder, processes)
        with Supervisor(system, folder / "logs") as running:
            running.start()
            chosen = motions(sawyer_ranges(), seed=motion_seed)
            with system.address.open(Role.DRIVER, name="drive") as driver:
                driven = [
                    (str(one.purpose), str(one.path))
                    for one in drive(driver, MonotonicClock(), chosen)
                ]
        found.write_text(json.dumps(driven))
    return [(purpose, path) for purpose, path in json.loads(found.read_text())]


def write_models(folder: Path) -> list[Path]:
    """Writes the arm as published, a file per kind of command."""
    arm = nominal_arm(())
    return [
        write_texts(folder, model_texts(f"sawyer_{kind}", model_pair(arm.specs[kind], ())))[0]
        for kind in KINDS
    ]


def fit(
    way: Way,
    paths: dict[Purpose, list[str]],
    models: list[Path],
    minutes: float,
    seed: int,
    out: Path,
) -> dict[str, Any]:
    """Fits forces, unless they are there, and returns the report."""
    if not (out / "fit.json").exists():
        words = ["fit", *paths[Purpose.TRAINING][: way.count], *way.flags]
        words += [word for model in models for word in ("--model", str(model))]
        words += ["--minutes", str(minutes), "--seed", str(seed), "--out", str(out)]
        words += ["--holdout", *paths[Purpose.HELDOUT]]
        subprocess.run([sys.executable, "-m", "gfm.cli", *words], check=True)
    report: dict[str, Any] = json.loads((out / "fit.json").read_text())
    return report


def draw(reports: dict[str, dict[str, Any]], path: Path) -> None:
    """Draws held-out error against time."""
    figure, ax = plt.subplots(figsize=(7.0, 3.4))
    for name, report in reports.items():
        x = [point["time_s"] for point in report["curve"]]
        y = [1e3 * point["held_out"] for point in report["curve"]]
        way = WAYS[name]
        ax.plot(x, y, "o-", markersize=3, linewidth=1.0, color=way.colour, label=way.title)
    first = next(iter(reports.values()))
    nominal, floor = 1e3 * first["models"][0]["overall"], 1e3 * first["noise_floor"]
    ax.axhline(nominal, color="#333333", linewidth=0.8, label="nominal model")
    ax.axhline(floor, color="#999999", linewidth=0.8, linestyle=":", label="sensor noise")
    ax.set(xlabel="wall-clock time, s", ylabel="held-out position RMSE, mrad", yscale="log")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def row(name: str, report: dict[str, Any]) -> str:
    """Returns a fit's line: where it began, what it kept, and where it ended."""
    curve, nominal = report["curve"], report["models"][0]["overall"]
    best = min(curve, key=lambda point: point["training"])
    cells = [f"{p['held_out']:.3g} ({p['time_s']:.0f} s)" for p in (curve[0], best, curve[-1])]
    ratio, steps = best["held_out"] / nominal, curve[-1]["learner_step"]
    return f"| {WAYS[name].title} | {' | '.join(cells)} | {steps} | {ratio:.2f} |"


def page(reports: dict[str, dict[str, Any]], effect: str, seed: int) -> str:
    """Returns the results as Markdown."""
    first = next(iter(reports.values()))
    rows = "\n".join(row(name, report) for name, report in reports.items())
    return f"""# Fitting generalized forces: with the warm start, and from nothing

Simulated Sawyer with {effect} (seed {seed}); position RMSE (rad) of open-loop rollouts over eight
held-out recordings, initial states fitted; nominal model {first["models"][0]["overall"]:.3g},
sensor noise {first["noise_floor"]:.2g}. All fits act through the same services on the same problem
(joints, limits, periods); times count from the first look at the recordings. "Kept": the best by
the error on the recordings that are fitted. Written by

    {" ".join(["python benchmarks/fit_forces.py", *sys.argv[1:]])}

with gfm {gfm.__version__} at commit {commit()}, {time.strftime("%Y-%m-%d")}, Python
{platform.python_version()}, MuJoCo {version("mujoco")}, {platform.machine()}.

![held-out error against time](../images/fit_forces.svg)

| way | at first | kept | at the end | learner steps | kept / nominal |
|---|---|---|---|---|---|
{rows}
"""


def main() -> None:
    """Records, fits and writes page and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/fit_forces"), metavar="DIR")
    parser.add_argument("--effect", default="coulomb_friction")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=4.0, help="of learning in each fit")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    paths = record(asked.out, asked.effect, asked.seed)
    models = write_models(asked.out / "models")
    reports = {}
    for name, way in WAYS.items():
        reports[name] = fit(way, paths, models, asked.minutes, asked.seed, asked.out / name)
        print(row(name, reports[name]), flush=True)
    draw(reports, FIGURE)
    PAGE.write_text(page(reports, asked.effect, asked.seed), encoding="utf-8")


if __name__ == "__main__":
    main()
