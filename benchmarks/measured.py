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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from effects_10_seeds import commit
from scipy.signal import butter, filtfilt

import gfm
from gfm.api.models import load_specs
from gfm.api.recordings import read_recordings
from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.evidence.plots import torque_left
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect
from gfm.service.effects_file import read_effects

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "results" / "measured_data.md"
#: Up to here torques are compared, model and measurement filtered alike: accelerations that are
#: smoothed say nothing of what is faster.
LOW_PASS_HZ = 10.0
#: How names of recordings end that went on with the servo switched off.
RELEASED = "_released"
#: What `report.json` holds.
Report: TypeAlias = dict[str, Any]
#: Effects by what the model with them is called.
Models: TypeAlias = Mapping[str, Sequence[EffectInstance]]


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
        excited: Part of the names of held-out recordings whose figure is given apart, too.
        published: From the data folder, effects whose amounts others have published.
    """

    files: tuple[str, ...]
    model: str
    mapping: str
    held_out: tuple[str, ...]
    figure: str
    measure: Callable[[Sequence[Array]], str]
    excited: str = ""
    published: Callable[[Path], Sequence[EffectInstance]] = lambda _: ()


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


def authors_friction(data: Path, design: str) -> list[EffectInstance]:
    """Returns a double pendulum's friction as its authors identified it.

    Their law, cf atan(100 v) + b v, is dry friction of cf pi / 2 from a few hundredths of a rad/s
    on. Their masses and inertias are those of the model.
    """
    text = (data / f"dfki_double_pendulum/authors_design_{design}_model_1.0.yml").read_text()
    told = {key: float(value) for key, value in (row.split(":") for row in text.splitlines())}
    friction = []
    for i, joint in enumerate(("shoulder", "elbow"), start=1):
        for name, amount in (
            ("coulomb_friction", {"torque": told[f"cf{i}"] * np.pi / 2.0}),
            ("viscous_friction", {"coefficient": told[f"b{i}"]}),
        ):
            effect = find_effect(name)
            friction.append(EffectInstance(effect=effect, joints=(joint,), values=amount))
    return friction


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
        excited="C1_2023",
        published=partial(authors_friction, design="C.1"),
    ),
    "double_pendulum_a0": Rig(
        files=("dfki_double_pendulum/A0_*.csv.gz",),
        model="models/double_pendulum_a0.xml",
        mapping="models/mappings/double_pendulum.toml",
        held_out=("-11", "-13"),
        figure="median position RMSE of 0.5 s rollouts, shoulder / elbow, rad",
        measure=medians,
        published=partial(authors_friction, design="A.0"),
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


def section(name: str, data: Path, out: Path, minutes: float) -> str:
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
        told = ("--model", model, "--out", report.parent, "--minutes", minutes, "--holdout", *held)
        command("diagnose", *training, *told)
        seconds = f"{time.monotonic() - began:.0f} s"
        (folder / "made").write_text(f"diagnosed in {seconds} at commit {commit()}")
    return written(name, data, model, report, held, (folder / "made").read_text())


def written(
    name: str, data: Path, model: Path, report: Path, held: Sequence[Path], made: str
) -> str:
    """Returns a set's part of the page."""
    rig, specs = RIGS[name], load_specs([model])
    recordings = read_recordings(held)
    problem = prepared(all_segments(specs, recordings, windows_s=WHOLE))
    document = json.loads(report.read_text())
    error = document["error"]
    models = {"nominal": [], "corrected": read_effects(report), "published": rig.published(data)}
    asked = {key: effects for key, effects in models.items() if effects or key == "nominal"}
    return f"""## {name}

{document["sentence"]}

{position_table(rig, problem, recordings, asked)}
{torque_table(problem, recordings, asked)}
Verdict {document["verdict"]}; position RMSE {error["before"]:.4f} -> {error["after"]:.4f} rad,
sensor noise {error["noise_floor"]:.2g} rad; {len(held)} held-out recordings; {made}.

{joint_table(document)}

{effects_table(document)}
"""


def position_table(
    rig: Rig, problem: Problem, recordings: Sequence[Trajectory], models: Models
) -> str:
    """Returns the figure of each model, from initial states as they fit best and as measured."""
    rows = [_heading(rig.figure, models)]
    for apart in dict.fromkeys(("", rig.excited)):
        part = [i for i, s in enumerate(problem.segments) if apart in recordings[s.recording].name]
        fitted = [problem.subset(part).settled(e).position_errors(e) for e in models.values()]
        told = [problem.subset(part).as_measured().position_errors(e) for e in models.values()]
        words = f", {apart}*" if apart else ""
        rows.append(f"| initial state fitted{words} | {' | '.join(map(rig.measure, fitted))} |")
        rows.append(f"| initial state as measured{words} | {' | '.join(map(rig.measure, told))} |")
    if any(recording.name.endswith(RELEASED) for recording in recordings):
        whole = [played_through(problem, recordings, e) for e in models.values()]
        words = "the same, runs played through where the servo is switched off"
        rows.append(f"| {words} | {' | '.join(map(rig.measure, whole))} |")
    return "\n".join(rows)


def played_through(
    problem: Problem, recordings: Sequence[Trajectory], effects: Sequence[EffectInstance]
) -> list[Array]:
    """Returns the errors of runs from beginning to end, per stretch (T, J).

    What was switched off within a run goes on from where the model was then, not from where the
    robot was.
    """
    begun = problem.as_measured()
    errors = begun.position_errors(effects)
    names = [recordings[segment.recording].name for segment in begun.segments]
    for i, name in enumerate(names):
        if not name.endswith(RELEASED):
            continue
        driven = names.index(name.removesuffix(RELEASED))
        before, after = (recordings[begun.segments[k].recording] for k in (driven, i))
        gap_s = 1e-9 * float(after.stamp_ns[0] - before.stamp_ns[-1])
        there = before.position[-2:] - errors[driven][-2:]
        velocity = (there[1] - there[0]) / (before.time_s[-1] - before.time_s[-2])
        gone_on = replace(
            begun.segments[i],
            initial_position=there[1] + gap_s * velocity,
            initial_velocity=velocity,
        )
        part = replace(problem.subset([i]), segments=(gone_on,))
        (errors[i],) = part.as_measured().position_errors(effects)
    return errors


def joint_table(document: Report) -> str:
    """Returns the held-out error of every joint, as the report gives it."""
    joints = document["joints"]
    rows = [_heading("position RMSE, rad", [joint["joint"] for joint in joints])]
    for words, key in (("nominal", "before"), ("corrected", "after")):
        rows.append(f"| {words} | {' | '.join(f'{joint[key]:.4f}' for joint in joints)} |")
    return "\n".join(rows)


def torque_table(problem: Problem, recordings: Sequence[Trajectory], models: Models) -> str:
    """Returns how far inverse dynamics are from the measured torques; nothing without those."""
    if any(recording.effort is None for recording in recordings):
        return ""
    rows = [
        _heading(
            f"torque below {LOW_PASS_HZ:.0f} Hz, MAE, {' / '.join(problem.joints)}, N m", models
        )
    ]
    for one in recordings:
        rate_hz = 1.0 / one.period_s
        low = butter(2, LOW_PASS_HZ, fs=rate_hz)
        left = (filtfilt(*low, torque_left(e, problem, [one])[1], axis=0) for e in models.values())
        rows.append(f"| {one.name} | {' | '.join(_sizes(torque) for torque in left)} |")
    return "\n".join(["", *rows, ""])


def _heading(words: str, models: Iterable[str]) -> str:
    return f"| {words} | {' | '.join(models)} |\n|---|{'---|' * len(models)}"


def _sizes(torque: Array) -> str:
    return " / ".join(f"{value:.4f}" for value in np.abs(torque).mean(axis=0))


def effects_table(document: Report) -> str:
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
    parser.add_argument("--minutes", type=float, default=10.0, help="for each diagnosis")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    arguments = parser.parse_args()
    names = arguments.sets or list(RIGS)
    sections = [section(name, arguments.data, arguments.out, arguments.minutes) for name in names]
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
