"""Whether `gfm run` names what the simulated robot hides: random effects, and none, over seeds.

    python benchmarks/effects_10_seeds.py --out runs/effects

Every run is a whole `gfm run --skip-gfm --skip-task` with services and recordings of its own. Runs
whose report is already there are not repeated, so that a run that failed (its log lies beside its
folder) can be looked into and made again. The robot is a simulated one, written apart from the
diagnosis.
"""

from __future__ import annotations

import argparse
import json
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gfm

REPORT = Path(__file__).parents[1] / "docs" / "results" / "run_random_effects.md"
#: What held-out errors after the correction may be, in noise floors.
MOST_FLOORS = 1.5


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One run.

    Attributes:
        seed: Of the run.
        asked: random or none.
        hidden: Effect and joints, the one that was asked for first.
        named: The same of what was named, strongest first.
        verdict: In one word.
        before: Held-out position RMSE of the nominal model, rad.
        after: The same of the corrected model, rad.
        floor: Sensor noise, rad.
        wall_s: Of the whole run.
    """

    seed: int
    asked: str
    hidden: tuple[tuple[str, tuple[str, ...]], ...]
    named: tuple[tuple[str, tuple[str, ...]], ...]
    verdict: str
    before: float
    after: float
    floor: float
    wall_s: float

    @property
    def name_right(self) -> bool:
        """Whether the first hidden effect was named, and nothing that is not there."""
        there, named = [n for n, _ in self.hidden], [n for n, _ in self.named]
        return set(named) <= set(there) and all(name in named for name in there[:1])

    @property
    def joint_right(self) -> bool:
        """Whether that holds of effects together with their joints."""
        return set(self.named) <= set(self.hidden) and all(
            one in self.named for one in self.hidden[:1]
        )

    @property
    def close_enough(self) -> bool:
        """Whether the error after the correction is near the noise floor."""
        return self.after <= MOST_FLOORS * self.floor


def run_once(seed: int, asked: str, folder: Path) -> Outcome:
    """Runs the loop, unless its report is there, and returns what it found."""
    words = ("--skip-gfm", "--skip-task", "--seed", str(seed), "--hidden-effect", asked)
    return outcome(seed, asked, report_of(words, folder))


def report_of(flags: Sequence[str], folder: Path) -> dict[str, Any]:
    """Returns the report of `gfm run` with these flags, made unless it is there."""
    if not (folder / "report.json").exists():
        shutil.rmtree(folder, ignore_errors=True)
        log = folder.with_suffix(".log")
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("w") as out:
            subprocess.run(
                [sys.executable, "-m", "gfm.cli", "run", *flags, "--out", str(folder)],
                stdout=out,
                stderr=subprocess.STDOUT,
                check=True,
            )
    report: dict[str, Any] = json.loads((folder / "report.json").read_text())
    return report


def outcome(seed: int, asked: str, report: dict[str, Any]) -> Outcome:
    """Returns what a run's report says."""
    diagnosis = report["diagnosis"]
    return Outcome(
        seed=seed,
        asked=asked,
        hidden=places(report["revealed"]["hidden"]),
        named=places(diagnosis["effects"]),
        verdict=diagnosis["verdict"],
        before=diagnosis["error"]["before"],
        after=diagnosis["error"]["after"],
        floor=diagnosis["error"]["noise_floor"],
        wall_s=sum(phase["seconds"] for phase in report["system"]["phases"]),
    )


def places(effects: Sequence[dict[str, Any]]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Returns the effects with their joints, in the order of names of joints."""
    return tuple((one["effect"], tuple(sorted(one["joints"]))) for one in effects)


def words_of(effects: Sequence[tuple[str, tuple[str, ...]]]) -> str:
    """Returns effects as a table cell."""
    listed = (f"{n} ({joints_of(j)})" if j else n for n, j in effects)
    return "<br>".join(listed) or "nothing"


def joints_of(joints: tuple[str, ...]) -> str:
    """Returns joints in few words."""
    short = [joint.removeprefix("right_") for joint in joints]
    return ", ".join(short) if len(short) < 7 else "all joints"


def table(outcomes: Sequence[Outcome]) -> str:
    """Returns one line per run."""
    lines = [
        "| seed | hidden | verdict | named | effect | joint | before (rad) | after (rad) "
        "| after / floor | time (s) |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in outcomes:
        right = ["yes" if right else "**no**" for right in (one.name_right, one.joint_right)]
        lines.append(
            f"| {one.seed} | {words_of(one.hidden)} | {one.verdict} | {words_of(one.named)} "
            f"| {right[0]} | {right[1]} | {one.before:.3g} | {one.after:.3g} "
            f"| {one.after / one.floor:.2f} | {one.wall_s:.0f} |"
        )
    return "\n".join(lines)


def page(outcomes: Sequence[Outcome]) -> str:
    """Returns the results as Markdown."""
    hiding = [one for one in outcomes if one.asked != "none"]
    clean = [one for one in outcomes if one.asked == "none"]
    return f"""# Does `gfm run` name what the robot hides?

Simulated Sawyer, driven and recorded through the services; its hidden effect is drawn from the seed
and sealed until the verdict. Written by

    python benchmarks/effects_10_seeds.py

with gfm {gfm.__version__} at commit {commit()}, {time.strftime("%Y-%m-%d")}, Python
{platform.python_version()}, MuJoCo {version("mujoco")}, {platform.machine()}. "effect" and "joint":
the hidden effect is named (and put on its joints), and nothing else is that is not there. Errors
are position RMSE of open-loop rollouts of the held-out recordings.

- Right effect: {sum(one.name_right for one in hiding)} of {len(hiding)}; effect and joint:
  {sum(one.joint_right for one in hiding)} of {len(hiding)}.
- Held-out error after the correction at most {MOST_FLOORS} noise floors:
  {sum(one.close_enough for one in hiding)} of {len(hiding)}.
- Nothing hidden: verdict no_gap and nothing named in
  {sum(one.verdict == "no_gap" and not one.named for one in clean)} of {len(clean)}.

## A random effect

{table(hiding)}

## No effect

{table(clean)}
"""


def commit() -> str:
    """Returns the commit of the code, with a mark where files differ from it."""
    answer = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude", "*"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parent,
    )
    return answer.stdout.strip() or "unknown"


def main() -> None:
    """Runs everything and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/effects"), metavar="DIR")
    parser.add_argument("--seeds", type=int, default=10, metavar="N")
    parser.add_argument("--page", type=Path, default=REPORT, metavar="FILE")
    arguments = parser.parse_args()
    outcomes = []
    for asked in ("random", "none"):
        for seed in range(arguments.seeds):
            one = run_once(seed, asked, arguments.out / f"{asked}-{seed}")
            outcomes.append(one)
            print(
                f"{asked} {seed}: hidden {words_of(one.hidden)}, named {words_of(one.named)}, "
                f"{one.verdict}, after/floor {one.after / one.floor:.2f}, {one.wall_s:.0f} s",
                flush=True,
            )
    arguments.page.parent.mkdir(parents=True, exist_ok=True)
    arguments.page.write_text(page(outcomes), encoding="utf-8")


if __name__ == "__main__":
    main()
