"""What the diagnosis makes of robots that others recorded: imported, diagnosed, held out.

    python benchmarks/measured.py --data ../shared/data/measured --set xl330 --set double_pendulum

Every set is imported with `gfm import` and diagnosed with `gfm diagnose`; the figures in which
others state their results are then computed from the effects in its report. A set whose report is
already there is not diagnosed again.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from effects_10_seeds import commit

import gfm
from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.evidence import torque_left
from gfm.diagnosis.problem import WHOLE, Problem, make_problem
from gfm.effects import EffectInstance
from gfm.experiments.inputs import load_specs, read_recordings
from gfm.service.effects_file import read_effects

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "results" / "measured_data.md"


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A set of recordings.

    Attributes:
        files: Tables to import, as patterns below the data folder.
        model: MJCF, below the project.
        mapping: Columns of the tables.
        held_out: Parts of the names of what is held out.
        figure: In words, what `measure` gives.
        measure: From the held-out errors, per stretch (T, J) in rad.
    """

    files: tuple[str, ...]
    model: str
    mapping: str
    held_out: tuple[str, ...]
    figure: str
    measure: Callable[[Sequence[Array]], str]


def absolute(errors: Sequence[Array]) -> str:
    """Returns the mean absolute error."""
    return f"{np.mean(np.abs(np.concatenate(errors))):.4f}"


def medians(errors: Sequence[Array]) -> str:
    """Returns the median over stretches of each joint's RMSE."""
    rmse = [np.sqrt(np.mean(one**2, axis=0)) for one in errors]
    return " / ".join(f"{value:.4f}" for value in np.median(rmse, axis=0))


def overall(errors: Sequence[Array]) -> str:
    """Returns the RMSE of everything."""
    return f"{np.sqrt(np.mean(np.concatenate(errors) ** 2)):.4f}"


RIGS = {
    "xl330": Rig(
        files=("bam_xl330/raw/*.json.gz",),
        model="models/xl330_pendulum.xml",
        mapping="models/mappings/xl330.toml",
        held_out=("kp200_",),
        figure="position MAE of whole runs, rad",
        measure=absolute,
    ),
    "double_pendulum": Rig(
        files=("dfki_double_pendulum/C1_*.csv.gz",),
        model="models/double_pendulum_c1.xml",
        mapping="models/mappings/double_pendulum.toml",
        held_out=("154220", "154548", "tvlqr"),
        figure="median position RMSE of 0.5 s rollouts, shoulder / elbow, rad",
        measure=medians,
    ),
    "so101": Rig(
        files=("so101/*_control.csv.gz", "so101/*_state_motor.csv.gz"),
        model="so101/model.xml",
        mapping="models/mappings/so101.toml",
        held_out=("random_waypoints", "pick_place", "figure_eight", "slow_precision"),
        figure="position RMSE of whole runs, rad",
        measure=overall,
    ),
}


def command(*words: object) -> None:
    """Runs one of gfm's commands."""
    subprocess.run([sys.executable, "-m", "gfm.cli", *map(str, words)], check=True)


def find_model(rig: Rig, data: Path) -> Path:
    """Returns the rig's model: the project's own, or that which came with the data."""
    own = ROOT / rig.model
    return own if own.exists() else data / rig.model


def section(name: str, data: Path, out: Path) -> str:
    """Imports, diagnoses and measures one set; returns its part of the page."""
    rig, folder = RIGS[name], out / name
    model = find_model(rig, data)
    tables = sorted(path for pattern in rig.files for path in data.glob(pattern))
    if not tables:
        raise SystemExit(f"{data}: no {' or '.join(rig.files)} there")
    if not (folder / "recordings").exists():
        command("import", *tables, "--mapping", ROOT / rig.mapping, "--out", folder / "recordings")
    recordings = sorted((folder / "recordings").glob("*.mcap"))
    held = [path for path in recordings if any(part in path.name for part in rig.held_out)]
    training = [path for path in recordings if path not in held]
    began = time.monotonic()
    report = folder / "diagnosis" / "report.json"
    if not report.exists():
        told = ("--model", model, "--out", report.parent, "--holdout", *held)
        command("diagnose", *training, *told)
        seconds = f"{time.monotonic() - began:.0f} s"
        (folder / "made").write_text(f"diagnosed in {seconds} at commit {commit()}")
    return written(name, rig, model, report, held, (folder / "made").read_text())


def written(name: str, rig: Rig, model: Path, report: Path, held: Sequence[Path], made: str) -> str:
    """Returns a set's part of the page."""
    specs, effects = load_specs([model]), read_effects(report)
    recordings = read_recordings(held)
    problem = make_problem(specs, recordings, windows_s=WHOLE)
    measured = replace(problem, state_basis=tuple(basis[:, :0] for basis in problem.state_basis))
    document = json.loads(report.read_text())
    error = document["error"]
    return f"""## {name}

{document["sentence"]}

| {rig.figure} | nominal | corrected |
|---|---|---|
{line("initial state fitted (two numbers per joint and rollout)", rig, problem, effects)}
{line("initial state as measured", rig, measured, effects)}
{torque_table(problem, recordings, effects)}
Verdict {document["verdict"]}; position RMSE {error["before"]:.4f} -> {error["after"]:.4f} rad,
sensor noise {error["noise_floor"]:.2g} rad; {len(held)} held-out recordings; {made}.

{effects_table(document)}
"""


def line(words: str, rig: Rig, problem: Problem, effects: Sequence[EffectInstance]) -> str:
    """Returns a row with the figure of the nominal and the corrected model."""
    both = [rig.measure(problem.position_errors(chosen)) for chosen in ((), effects)]
    return f"| {words} | {both[0]} | {both[1]} |"


def torque_table(
    problem: Problem, recordings: Sequence[Trajectory], effects: Sequence[EffectInstance]
) -> str:
    """Returns how far inverse dynamics are from the measured torques; nothing without those."""
    if any(recording.effort is None for recording in recordings):
        return ""
    rows = []
    for one in recordings:
        both = (_sizes(torque_left(chosen, problem, [one])) for chosen in ((), effects))
        rows.append(f"| {one.name} | {' | '.join(both)} |")
    return "\n".join(
        [
            "",
            f"| torque, MAE, {' / '.join(problem.joints)}, N m | nominal | corrected |",
            "|---|---|---|",
            *rows,
            "",
        ]
    )


def _sizes(torque: Array) -> str:
    return " / ".join(f"{value:.4f}" for value in np.abs(torque).mean(axis=0))


def effects_table(document: dict[str, list[dict[str, object]]]) -> str:
    """Returns what was named, with confidence."""
    rows = ["| effect | joints | parameters | confidence |", "|---|---|---|---|"]
    for effect in document["effects"]:
        amounts = ", ".join(
            f"{key} {one['value']:.4g} {one['unit']}" for key, one in effect["parameters"].items()
        )
        rows.append(
            f"| {effect['effect']} | {', '.join(effect['joints'])} | {amounts} "
            f"| {effect['confidence']} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Diagnoses the sets that are asked for and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    parser.add_argument("--set", action="append", choices=sorted(RIGS), dest="sets")
    parser.add_argument("--out", type=Path, default=Path("runs/measured"), metavar="DIR")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    arguments = parser.parse_args()
    names = arguments.sets or ["xl330", "double_pendulum"]
    sections = [section(name, arguments.data, arguments.out) for name in names]
    arguments.page.parent.mkdir(parents=True, exist_ok=True)
    sets = " ".join(f"--set {name}" for name in names)
    arguments.page.write_text(
        f"""# Robots that others recorded

Recorded on hardware; the models have ideal joints. Splits are fixed. The diagnosis never reads what
is held out, but these figures were seen while its search was developed. Written by

    python benchmarks/measured.py --data DIR {sets}

with gfm {gfm.__version__}, {time.strftime("%Y-%m-%d")}, Python {platform.python_version()}, MuJoCo
{version("mujoco")}, {platform.machine()}.

"""
        + "\n".join(sections),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
