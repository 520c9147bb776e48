"""Closes the loop on a task with several robots, and writes the table of what came of it.

    python benchmarks/campaigns.py --parts build/campaigns

Every campaign is one `gfm transfer`, in a folder that is named by all that it is asked for: what is
there is not made again, and what was broken off goes on. One that fails does not keep the others
from being made. What the robots hide lies in `benchmarks/robots`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from effects_10_seeds import joints_of
from parts import Part, commits, done_parts

from gfm.experiments.policy_flags import TREATMENTS
from gfm.experiments.sealed import unseal

HERE = Path(__file__).parent
ROBOTS = HERE / "robots"


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """One `gfm transfer`.

    Attributes:
        robot: What is hidden, the name of a file in `ROBOTS`.
        treatments: What is done to the policy.
        task: What is tried.
        engine: sim or drake.
        minutes: For the search of the diagnosis.
        seed: Of robot, starts and training.
    """

    robot: str
    treatments: tuple[str, ...]
    task: str = "position"
    engine: str = "sim"
    minutes: float = 10.0
    seed: int = 0

    @property
    def words(self) -> list[str]:
        """Returns the flags of `gfm transfer`, all but the folder."""
        return [
            *("--task", self.task, "--robot", self.engine),
            *("--robot-config", str(self._config), "--minutes", f"{self.minutes:g}"),
            *("--seed", str(self.seed), "--treatments", *self.treatments),
        ]

    @property
    def name(self) -> str:
        """Returns a name that no other settings have."""
        asked = json.dumps([*vars(self).values()]).encode() + self._config.read_bytes()
        digest = hashlib.sha256(asked).hexdigest()[:8]
        return f"{self.task}-{self.engine}-{self.robot}-{self.seed}-{digest}"

    @property
    def _config(self) -> Path:
        return ROBOTS / f"{self.robot}.toml"


def campaigns(seeds: int) -> list[Campaign]:
    """Returns all of them, those with the first seed first."""
    placed, told = ("placed",), ("told",)
    return [
        Campaign(**asked, seed=seed)
        for seed in range(seeds)
        for asked in (
            {"robot": "offset_j1_0.05", "treatments": (*placed, "nominal", "randomised")},
            {"robot": "offset_j3_0.06", "treatments": placed},
            {"robot": "payload_0.6", "treatments": (*told, "adapted", "nominal", "randomised")},
            {"robot": "payload_1.0", "treatments": told},
            {"robot": "offset_j1_0.04_payload_0.6", "treatments": told},
            {"robot": "nothing", "treatments": (*placed, "adapted")},
            {"robot": "offset_j1_0.04", "treatments": placed, "engine": "drake"},
            {"robot": "payload_0.6", "treatments": told, "engine": "drake"},
            {"robot": "offset_j1_0.04_payload_0.6", "treatments": told, "engine": "drake"},
            {"robot": "offset_j1_0.04", "treatments": placed, "task": "pose"},
            {"robot": "payload_0.6", "treatments": told, "task": "pose"},
            {"robot": "offset_j1_0.04_payload_0.6", "treatments": told, "task": "pose"},
        )
    ]


def made(campaign: Campaign, folder: Path) -> Part:
    """Closes the loop, and returns what the campaign's files say.

    Raises:
        CalledProcessError: that did not come to its end; the log beside the folder says why.
    """
    words = ("transfer", *campaign.words, "--out", str(folder))
    with log_of(folder).open("a") as out:
        subprocess.run(
            [sys.executable, str(HERE / "one_process.py"), *words],
            stdout=out,
            stderr=subprocess.STDOUT,
            check=True,
        )
    return summary(campaign, folder)


def log_of(folder: Path) -> Path:
    """Returns where a campaign's words are kept."""
    return folder.with_name(f"{folder.name}.log")


def failed(asked: Mapping[str, Campaign], parts: Path) -> list[str]:
    """Makes what is not made yet, and returns which of it did not come to its end."""
    names = []
    for name, campaign in asked.items():
        try:
            done_parts(parts, [name], lambda _, one=campaign: made(one, parts / one.name))
        except subprocess.CalledProcessError:
            names.append(name)
    return names


def summary(campaign: Campaign, folder: Path) -> Part:
    """Returns what came of a campaign that is whole."""
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    hidden = unseal(folder / "before" / "sealed.json")
    before = report["before"]
    return {
        "task": campaign.task,
        "engine": campaign.engine,
        "seed": campaign.seed,
        "hidden": [
            effect_words(one.effect, one.joints, {n: p.value for n, p in one.parameters.items()})
            for one in hidden
        ],
        "named": [named_words(one) for one in report["diagnosis"]["effects"]],
        "robot_min": (report["air_s"] + sum(one["time_s"] for one in before["attempts"])) / 60.0,
        "reached": {"as it came": reached(before)}
        | {name: reached(one) for name, one in report["after"].items()},
    }


def named_words(effect: Mapping[str, Any]) -> str:
    """Returns what a diagnosis named, with its confidence."""
    amounts = {name: one["value"] for name, one in effect["parameters"].items()}
    said = effect_words(effect["effect"], effect["joints"], amounts)
    return f"{said}, {effect['confidence']:.2f}"


def effect_words(effect: str, joints: Sequence[str], amounts: Mapping[str, float]) -> str:
    """Returns an effect with its place and amounts; units are those of docs/effects.md."""
    place = f" ({joints_of(joints)})" if joints else ""
    return f"{effect}{place} " + ", ".join(f"{name} {x:.4g}" for name, x in amounts.items())


def reached(evaluation: Mapping[str, Any]) -> str:
    """Returns attempts that succeeded, with Wilson's interval."""
    success = evaluation["success"]
    low, high = success["ci95"]
    return f"{success['reached']} of {success['of']} ({low:.0%} to {high:.0%})"


def page(parts: Mapping[str, Part], planned: int) -> str:
    """Returns the results as Markdown."""
    policies = ("as it came", *TREATMENTS)
    lines = [
        f"| task | robot | seed | hides | named | {' | '.join(policies)} | robot minutes |",
        "|---" * (6 + len(policies)) + "|",
    ]
    for one in parts.values():
        cells = [one["task"], one["engine"], one["seed"]]
        cells += ["<br>".join(one[effects]) or "nothing" for effects in ("hidden", "named")]
        cells += [one["reached"].get(policy, "") for policy in policies]
        lines.append("| " + " | ".join(map(str, cells)) + f" | {one['robot_min']:.1f} |")
    table = "\n".join(lines)
    return f"""# Campaigns

Written by `python benchmarks/campaigns.py`: {len(parts)} of {planned} campaigns, at
{commits(parts)}. Reached: of five attempts at each of ten goals, with 95 % intervals (Wilson).
Named: with amounts and confidence. Robot minutes: what the attempts as it came took, ten
or more of which were given to the diagnosis, and motions of the arm by itself.

{table}
"""


def main() -> None:
    """Makes what is not made yet, and writes the page; exits with 1 where something failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=Path, default=Path("build/campaigns"), metavar="DIR")
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    parser.add_argument(
        "--only", default="", metavar="WORDS", help="campaigns with this in their name"
    )
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="(default: campaigns.md in --parts)"
    )
    arguments = parser.parse_args()
    asked = {one.name: one for one in campaigns(arguments.seeds)}
    chosen = {name: one for name, one in asked.items() if arguments.only in name}
    left = failed(chosen, arguments.parts)
    parts = done_parts(arguments.parts, [*asked], None)
    text = page(parts, len(asked))
    (arguments.page or arguments.parts / "campaigns.md").write_text(text, encoding="utf-8")
    for name in left:
        print(f"{name} did not come to its end, see {log_of(arguments.parts / name)}")
    sys.exit(1 if left else 0)


if __name__ == "__main__":
    main()
