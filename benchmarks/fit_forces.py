"""Fitting generalized forces: error against wall-clock time, from the warm start and from nothing.

    python benchmarks/fit_forces.py --out runs/fit_forces

A simulated Sawyer with a hidden effect is driven twice through `gfm run`'s motions (twelve training
recordings, eight held-out ones). Then, on the same services and the same problem: the warm start
(inverse dynamics, regressed) refined by MPO, on five and on ten trajectories, and MPO from a policy
that has learned nothing, as in the paper. What is there already is not repeated.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from effects_10_seeds import commit

import gfm
from gfm.core import MonotonicClock
from gfm.diagnosis.correction import model_pair
from gfm.diagnosis.problem import measure_noise
from gfm.excitation.motion import Purpose
from gfm.excitation.waypoints import motions
from gfm.experiments.drive import drive, sawyer_ranges
from gfm.experiments.fit import FitInputs, ForceFit, force_model
from gfm.experiments.inputs import read_recordings
from gfm.experiments.joint_control import JointControlTest, make_test
from gfm.experiments.run import KINDS, nominal_arm
from gfm.launch import (
    ProcessSpec,
    Supervisor,
    SystemSpec,
    free_endpoint,
    replay_process,
    robot_processes,
)
from gfm.report import ModelKind
from gfm.report.files import model_texts, write_texts

DOCS = Path(__file__).parents[1] / "docs"
PAGE, FIGURE = DOCS / "results" / "fit_forces.md", DOCS / "images" / "fit_forces.svg"
ROUNDS, SNAPSHOT_S = 2, 15.0
#: Ways to fit: in words, trajectories, and whether the policy begins regressed.
WAYS = {
    "warm_5": ("warm start, 5 trajectories", 5, True),
    "warm_10": ("warm start, 10 trajectories", 10, True),
    "cold_5": ("from nothing, 5 trajectories", 5, False),
    "cold_10": ("from nothing, 10 trajectories", 10, False),
}


@dataclass(frozen=True, kw_only=True)
class Point:
    """A policy on its way.

    Attributes:
        time_s: Since the fit began, the regression included.
        step: Of the learner.
        training: Open-loop position RMSE on the recordings it is fitted to, rad.
        held_out: The same on others.
    """

    time_s: float
    step: int
    training: float
    held_out: float


def system(folder: Path, *processes: ProcessSpec) -> Supervisor:
    """Returns services of their own."""
    spec = SystemSpec(run="fit", endpoint=free_endpoint(), processes=processes)
    return Supervisor(spec, folder / "logs")


def record(folder: Path, effect: str, seed: int) -> dict[Purpose, list[Path]]:
    """Drives the robot, unless it was driven, and returns the recordings in order of time."""
    found = folder / "driven.json"
    if not found.exists():
        target = ("--recordings", str((folder / "recordings").absolute()))
        robot = ("--hidden-effect", effect, "--seed", str(seed))
        with system(folder, *robot_processes(target, robot)) as running:
            running.start()
            driven = [
                (str(one.purpose), str(one.path))
                for k in range(ROUNDS)
                for one in drive(
                    running.transport, MonotonicClock(), motions(sawyer_ranges(), seed=k)
                )
            ]
        found.write_text(json.dumps(driven))
    rows = json.loads(found.read_text())
    return {kind: [Path(path) for p, path in rows if p == str(kind)] for kind in Purpose}


def fit(inputs: FitInputs, test: JointControlTest, seconds: float) -> list[Point]:
    """Fits forces for so long and returns the policies on the way."""
    clock = MonotonicClock()
    began_ns = clock.now_ns()
    begun = ForceFit(inputs, clock)
    before_s = (clock.now_ns() - began_ns) * 1e-9
    with system(inputs.folder, replay_process()) as running:
        running.start()
        begun.start(running)
        while begun.time_s + before_s < seconds:
            due_s = begun.time_s + SNAPSHOT_S
            while begun.time_s < due_s:
                running.check()
                begun.wait()
            begun.snapshot(running)
    fitted = begun.finish()
    points = []
    for one in fitted.snapshots:
        forces = force_model(fitted.problem, one.weights)
        errors = test.hybrid_errors(ModelKind.HYBRID, forces, fitted.problem.model, "")
        points.append(
            Point(
                time_s=before_s + one.time_s,
                step=one.weights.version,
                training=one.error,
                held_out=errors.overall,
            )
        )
    return points


def kept(path: Path, make: object) -> list[Point]:
    """Returns what the file holds; makes it where it is not there."""
    if not path.exists():
        assert callable(make)
        points = make()
        path.write_text(json.dumps([asdict(one) for one in points]))
    return [Point(**row) for row in json.loads(path.read_text())]


def draw(curves: dict[str, list[Point]], nominal: float, floor: float, path: Path) -> None:
    """Draws held-out error against time."""
    figure, ax = plt.subplots(figsize=(7.0, 3.4))
    colours = {"warm_5": "#56b4e9", "warm_10": "#0072b2", "cold_5": "#e69f00", "cold_10": "#d55e00"}
    for name, points in curves.items():
        x, y = [one.time_s for one in points], [1e3 * one.held_out for one in points]
        ax.plot(x, y, "o-", markersize=3, linewidth=1.0, color=colours[name], label=WAYS[name][0])
    ax.axhline(1e3 * nominal, color="#333333", linewidth=0.8, label="nominal model")
    ax.axhline(1e3 * floor, color="#999999", linewidth=0.8, linestyle=":", label="sensor noise")
    ax.set(xlabel="wall-clock time, s", ylabel="held-out position RMSE, mrad", yscale="log")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def row(name: str, points: Sequence[Point], nominal: float) -> str:
    """Returns a fit's line: where it began, the best by training error, and where it ended."""
    best, last = min(points, key=lambda one: one.training), points[-1]
    cells = [f"{one.held_out:.3g} ({one.time_s:.0f} s)" for one in (points[0], best, last)]
    ratio = best.held_out / nominal
    return f"| {WAYS[name][0]} | {' | '.join(cells)} | {last.step} | {ratio:.2f} |"


def main() -> None:
    """Records, fits and writes page and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/fit_forces"), metavar="DIR")
    parser.add_argument("--effect", default="coulomb_friction")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=300.0, help="of each fit")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    paths = record(asked.out, asked.effect, asked.seed)
    training = read_recordings(paths[Purpose.TRAINING])
    arm, noise = nominal_arm(()), measure_noise(training)
    test = make_test(arm.specs, read_recordings(paths[Purpose.HELDOUT]), noise)
    nominal = test.model_errors(ModelKind.NOMINAL, (), "").overall
    floor = float(np.sqrt(np.mean(noise.position**2)))
    models = {}
    for kind in KINDS:
        texts = model_texts(f"sawyer_{kind}", model_pair(arm.specs[kind], ()))
        models[kind] = write_texts((asked.out / "models").absolute(), texts)[0]
    curves = {}
    for name, (_, count, warm) in WAYS.items():
        inputs = FitInputs(
            models=models,
            recordings=tuple(paths[Purpose.TRAINING][:count]),
            folder=(asked.out / name).absolute(),
            seed=asked.seed,
            actors=1,
            warm=warm,
        )
        curves[name] = kept(
            asked.out / f"{name}.json",
            lambda inputs=inputs: fit(inputs, test, asked.seconds),
        )
        print(row(name, curves[name], nominal), flush=True)
    draw(curves, nominal, floor, FIGURE)
    words = " ".join(["python benchmarks/fit_forces.py", *sys.argv[1:]])
    lines = [row(name, points, nominal) for name, points in curves.items()]
    PAGE.write_text(
        f"""# Fitting generalized forces: with the warm start, and from nothing

Simulated Sawyer with {asked.effect} (seed {asked.seed}); position RMSE (rad) of open-loop rollouts
over eight held-out recordings, initial states fitted; nominal model {nominal:.3g}, sensor noise
{floor:.2g}. Both ways act through the same services on the same problem (joints, limits, periods);
times count from the first look at the recordings. "Best": by the training error, which is what a
fit keeps. Written by

    {words}

with gfm {gfm.__version__} at commit {commit()}, {time.strftime("%Y-%m-%d")}, Python
{platform.python_version()}, MuJoCo {version("mujoco")}, {platform.machine()}.

![held-out error against time](../images/fit_forces.svg)

| way | at first | best | at the end | learner steps | best / nominal |
|---|---|---|---|---|---|
{chr(10).join(lines)}
""",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
