"""What the diagnosis makes of robots whose truth is known: cases, scores, tables.

    python benchmarks/diagnosis.py --out runs/known_truth
    python benchmarks/diagnosis.py --out runs/known_truth_other --hand other --discrepancy 3.0

Cases are drawn from a seed, simulated by `known_truth` (which shares nothing with gfm: own
dynamics, own integrator, own files) and diagnosed by the command that a user has. Cases whose
report is already there are not diagnosed again.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import platform
import random
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path

from effects_10_seeds import commit
from known_truth import page
from known_truth.arms import arm_plans
from known_truth.generate import generate
from known_truth.plans import Plan, plans, unforeseen_plans
from known_truth.score import Score, score
from peer import PEERS

import gfm

PAGES = Path(__file__).parents[1] / "docs" / "results"
#: Where pages go, by whose hand simulated.
PAGE = {"own": PAGES / "known_truth.md", "other": PAGES / "known_truth_other_hand.md"}
#: Of the three robots that are drawn anew for each case, and of published arms.
PLANS = {"drawn": plans, "arms": arm_plans, "unforeseen": unforeseen_plans}
#: What they are.
ROBOTS = {
    "drawn": """Three robots: a servo pendulum, a planar arm of two joints, a spatial arm
of seven. Each is drawn anew: lengths, masses, gains, motions, sizes of effects.""",
    "unforeseen": """Four of the usual robots, with laws that were not there while the search was
built: friction of grease that warms up, a magnet's detent, drag of moving air, a drive whose iron
saturates, a drive that is stronger one way.""",
    "arms": """Five arms in the numbers of their published models: UR5e, Panda, Kinova Gen3 and
SO-ARM100 under position commands, Unitree Z1 under torques. Motions and sizes of effects are
drawn.""",
}
#: What another hand's discrepancy changes, in units of the sensor noise.
DISCREPANCY = 3.0
#: A diagnosis that takes longer is broken off, s; and a peer.
LIMIT_S, PEER_LIMIT_S = 1800, 600
PEER = Path(__file__).with_name("peer.py")
PEER_PACKAGES = Path(__file__).parents[1] / "build" / "peers"
#: Seven joints take peers that roll out with every parameter too long.
PEER_SETUPS = ("pendulum_position", "planar_effort", "planar_position")


def diagnose(name: str, folder: Path) -> None:
    """Diagnoses a case, unless its report is there or it was left out, in a process of its own."""
    case, out = folder / "cases" / name, folder / "diagnoses" / name
    if (out / "report.json").exists() or not case.exists():
        return
    recordings = [str(path) for path in sorted(case.glob("train_*.mcap"))]
    held_out = [str(path) for path in sorted(case.glob("held_*.mcap"))]
    models = [word for path in sorted(case.glob("*.xml")) for word in ("--model", str(path))]
    words = ["diagnose", *recordings, *models, "--out", str(out), "--holdout", *held_out]
    began = time.monotonic()
    out.parent.mkdir(parents=True, exist_ok=True)
    status = run_python(["-m", "gfm.cli", *words], out.with_suffix(".log"), LIMIT_S, {})
    if status:
        print(f"{name}: gfm diagnose ended with status {status}, see {out}.log")
        return
    made = {"wall_s": time.monotonic() - began, "commit": commit()}
    (out / "made.json").write_text(json.dumps(made))


def ask(peer: str, name: str, folder: Path) -> None:
    """Asks a peer about a case, unless it was asked; where it fails its log lies beside."""
    out = folder / "peers" / peer / f"{name}.json"
    log, made = out.with_suffix(".log"), out.with_suffix(".made")
    if not log.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        case = str(folder / "cases" / name)
        words = [str(PEER), "--peer", peer, "--case", case, "--out", str(out)]
        began = time.monotonic()
        run_python(words, log, PEER_LIMIT_S, {"PYTHONPATH": str(PEER_PACKAGES)})
        made.write_text(str(time.monotonic() - began))


def peer_scored(peer: str, name: str, folder: Path) -> Score | None:
    """Returns the score of what a peer says; None where it has no answer."""
    out = folder / "peers" / peer / f"{name}.json"
    made = out.with_suffix(".made")
    if not (out.exists() and made.exists()):
        return None
    truth = json.loads((folder / "truth" / f"{name}.json").read_text())
    report = json.loads(out.read_text())
    # In a peer's favour: whatever physics cannot tell apart counts as right.
    report["suspects"] = [effect | {"reason": "equal"} for effect in truth["effects"]]
    return score(truth, report, float(made.read_text()))


def run_python(words: Sequence[str], log: Path, limit_s: float, more: dict[str, str]) -> int:
    """Runs Python with one thread and returns its exit status; that of a kill if it takes long."""
    with log.open("w") as out:
        try:
            return subprocess.run(
                [sys.executable, *words],
                stdout=out,
                stderr=subprocess.STDOUT,
                check=False,
                timeout=limit_s,
                env=os.environ | {"OMP_NUM_THREADS": "1"} | more,
            ).returncode
        except subprocess.TimeoutExpired:
            out.write(f"broken off after {limit_s:.0f} s\n")
            return -9


def scored(name: str, folder: Path) -> Score | None:
    """Returns the score of a case; None where it has no report."""
    report = folder / "diagnoses" / name / "report.json"
    made = report.with_name("made.json")
    if not made.exists():
        return None
    truth = json.loads((folder / "truth" / f"{name}.json").read_text())
    return score(truth, json.loads(report.read_text()), json.loads(made.read_text())["wall_s"])


def complete(count: int, planned: int) -> str:
    """Returns how many cases there are, and what that means."""
    if count == planned:
        return f"All {planned} cases."
    return f"INCOMPLETE: {count} of {planned} cases, the first in a random order, were run."


def made_at(name: str, folder: Path) -> str:
    """Returns the commit at which a case was diagnosed."""
    made = json.loads((folder / "diagnoses" / name / "made.json").read_text())
    return str(made["commit"])


def chosen(arguments: argparse.Namespace) -> list[Plan]:
    """Returns the cases that are asked for: those of that name, and of these so many, spread."""
    listed = PLANS[arguments.robots](arguments.seed)
    matching = [plan for plan in listed if fnmatch.fnmatch(plan.name, arguments.only)]
    if arguments.cases is None or arguments.cases >= len(matching):
        return matching
    step = len(matching) / arguments.cases
    return [matching[int(i * step)] for i in range(arguments.cases)]


def planted(arguments: argparse.Namespace) -> float | None:
    """Returns what another hand's discrepancy is to change; None for the own hand."""
    if arguments.hand == "own":
        return None
    return DISCREPANCY if arguments.discrepancy is None else float(arguments.discrepancy)


def simulated_by(discrepancy: float | None) -> str:
    """Returns how the robots were simulated: by the own hand, or by another."""
    if discrepancy is None:
        return """own integrator (implicit midpoint, 0.5 ms; dry friction as impulses),
own encoders, noise and clocks."""
    return f"""by another hand than the one that found the sizes: explicit
midpoint at 0.25 ms (dry friction as impulses), samples and commands off the grid of 0.5 ms, stamps
with 30 us of noise, gears whose ripple changes the motion by a sensor noise at most, and on every
joint a smooth random torque of position, speed and slow time that no effect of the vocabulary can
say: by itself it changes the motion by about {discrepancy:g} sensor noises (RMS over joints in
open-loop segments of 0.5 s). "Floor" is here what a right model leaves at
best: noise and that together."""


def document(
    scores: Sequence[Score],
    planned: int,
    peers: Mapping[str, Sequence[Score]],
    words: str,
    commits: Sequence[str],
    discrepancy: float | None = None,
    robots: str = "drawn",
) -> str:
    """Returns the page with all tables."""
    wrong = [one for one in scores if page.is_wrong(one)]
    return f"""# Robots whose truth is known

{complete(len(scores), planned)} {ROBOTS[robots]}
They are simulated apart from everything that judges them: own rigid-body dynamics,
{simulated_by(discrepancy)} Diagnosed by `gfm diagnose`, which is given
recordings and nominal model only. Written by

    {words}

with gfm {gfm.__version__} at commit {commit()}, {time.strftime("%Y-%m-%d")}, Python
{platform.python_version()}, MuJoCo {version("mujoco")}, {platform.machine()}. Diagnosed at commits
{", ".join(commits)}. Two shared cores, busy with other jobs: times are upper bounds.

Sizes of effects are drawn again, and another joint is taken, until the motion changes by 5 to 2000
times the sensor noise: what cannot be seen is not asked for (except where excitation is poor on
purpose). Seed 0 was looked at while the diagnosis and the settings of the peers were worked on;
other seeds were not.

A name is right if it is that of the hidden effect, or of one that physics cannot tell from it, with
the hidden one listed beside it as its equal. "Claimed": with a confidence above 0.5, and not told
with one that is there.

## All of it

{page.summary(scores)}

## Beside others

{page.beside(scores, peers)}

## By robot

{page.by_setup(scores)}

## By effect

{page.by_effect(scores)}

## Cases that did not go as they should

{page.cases(wrong)}

## All cases

{page.cases(scores)}
"""


def main() -> None:
    """Generates, diagnoses, scores and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/known_truth"), metavar="DIR")
    parser.add_argument("--hand", choices=("own", "other"), default="own", help="that simulates")
    parser.add_argument(
        "--discrepancy", type=float, metavar="NOISES", help=f"of another hand ({DISCREPANCY:g})"
    )
    parser.add_argument("--robots", choices=tuple(PLANS), default="drawn")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--cases", type=int, metavar="N", help="only so many, spread over all")
    parser.add_argument("--only", default="*", metavar="GLOB", help="only cases of that name")
    parser.add_argument("--peers", action="store_true", help="ask peers about the same recordings")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="diagnoses side by side")
    parser.add_argument(
        "--score-only", action="store_true", help="run nothing: score what is there"
    )
    parser.add_argument("--page", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    if arguments.hand == "own" and arguments.discrepancy is not None:
        parser.error("--discrepancy is another hand's: give --hand other, too")
    discrepancy = planted(arguments)
    cases = chosen(arguments)
    if not arguments.score_only:
        # What is broken off has run a random sample.
        in_turn = random.Random(arguments.seed).sample(cases, len(cases))
        generate(in_turn, arguments.out, discrepancy)
        with ThreadPoolExecutor(arguments.jobs) as pool:
            for name in pool.map(lambda plan: _told(plan.name, arguments.out), in_turn):
                print(name, flush=True)
    scores = [one for plan in cases if (one := scored(plan.name, arguments.out))]
    if arguments.peers and not arguments.score_only:
        _ask_all(cases, arguments.out)
    answers = {
        peer: [s for plan in cases if (s := peer_scored(peer, plan.name, arguments.out))]
        for peer in PEERS
    }
    commits = sorted({made_at(one.name, arguments.out) for one in scores})
    words = shlex.join(["python", "benchmarks/diagnosis.py", *sys.argv[1:]])
    file = arguments.page or PAGE[arguments.hand]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(
        document(scores, len(cases), answers, words, commits, discrepancy, arguments.robots),
        encoding="utf-8",
    )


def _ask_all(cases: Sequence[Plan], folder: Path) -> None:
    for plan in cases:
        for peer in PEERS if plan.setup.name in PEER_SETUPS else ():
            ask(peer, plan.name, folder)
            one = peer_scored(peer, plan.name, folder)
            print(f"{peer}: {plan.name}: {one.named if one else 'no answer'}", flush=True)


def _told(name: str, folder: Path) -> str:
    """Diagnoses a case and returns a line about it."""
    diagnose(name, folder)
    one = scored(name, folder)
    if one is None:
        return f"{name}: no report"
    mark = "WRONG" if page.is_wrong(one) else "right"
    return (
        f"{mark} {name}: hidden {one.hidden}; named {one.named}; {one.verdict}, "
        f"after/floor {one.after / one.floor:.2f}, {one.wall_s:.0f} s"
    )


if __name__ == "__main__":
    main()
