"""What the diagnosis makes of samples that another simulator made: one line per case.

    python benchmarks/samples.py --data ../shared/data/simulated --out runs/samples

Every folder holds `model.xml`, `rec_*.mcap`, `heldout/*.mcap` and `truth.json`. Cases are diagnosed
one after the other; one whose report is there already is not diagnosed again.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import time
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnosis import run_python
from known_truth.score import Score, in_words, score

#: What known_truth calls a case by the number of hidden effects.
_CATEGORIES = ("none", "single", "pair")
#: A constant torque on a joint with dry friction, under either name.
_SAME_TORQUE = {
    "asymmetric_friction": "torque_offset",
    "torque_offset": "asymmetric_friction",
}
_PLANE_AXIS = (0.0, 1.0, 0.0)


def whole_truth(sample: Mapping[str, Any], model: Path) -> dict[str, Any]:
    """Returns a sample's truth with what `known_truth.score` asks of one.

    That is: which other names physics cannot tell from each effect, and which parameters no motion
    shows.
    """
    joints, planar = hinges(model)
    effects = [
        effect
        | {"equals": equals(effect, joints[0], planar), "unseen": _unseen(effect["effect"], planar)}
        for effect in sample["effects"]
    ]
    return {
        "name": sample["id"],
        "setup": sample["robot"],
        "category": _CATEGORIES[min(len(effects), 2)],
        "effects": effects,
    }


def hinges(model: Path) -> tuple[list[str], bool]:
    """Returns the joints of a model in their order, and whether all turn about the horizontal y."""
    found = list(ET.parse(model).iter("joint"))
    named = [joint for joint in found if "name" in joint.attrib]
    axes = {tuple(float(x) for x in j.get("axis", "0 0 1").split()) for j in named}
    return [joint.attrib["name"] for joint in named], axes == {_PLANE_AXIS}


def equals(effect: Mapping[str, Any], first: str, planar: bool) -> list[dict[str, Any]]:
    """Returns what physics cannot tell from an effect, as `known_truth.truth` has it."""
    name, joints = effect["effect"], effect["joints"]
    if name in _SAME_TORQUE:
        return [{"effect": _SAME_TORQUE[name], "joints": joints}]
    if planar and name == "gravity_direction":
        return [{"effect": "encoder_offset", "joints": [first]}]
    if planar and name == "encoder_offset" and joints == [first]:
        return [{"effect": "gravity_direction", "joints": []}]
    return []


def _unseen(name: str, planar: bool) -> list[str]:
    hidden = {"gravity_direction": ["tilt_x"], "payload": ["com_y"]}
    return hidden.get(name, []) if planar else []


def diagnose(case: Path, out: Path, limit_s: float) -> None:
    """Diagnoses a case, unless its report is there, in a process of its own."""
    if (out / "made.json").exists():
        return
    recordings = [str(path) for path in sorted(case.glob("rec_*.mcap"))]
    held_out = [str(path) for path in sorted(case.glob("heldout/*.mcap"))]
    words = ["diagnose", *recordings, "--model", str(case / "model.xml"), "--out", str(out)]
    words += ["--holdout", *held_out] if held_out else []
    out.parent.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    status = run_python(["-m", "gfm.cli", *words], out.with_suffix(".log"), limit_s, {})
    if status == 0:
        (out / "made.json").write_text(json.dumps({"wall_s": time.monotonic() - began}))


def scored(case: Path, out: Path) -> Score | None:
    """Returns the score of a case; None where it has no report."""
    if not (out / "made.json").exists():
        return None
    sample = json.loads((case / "truth.json").read_text())
    report = json.loads((out / "report.json").read_text())
    wall_s = json.loads((out / "made.json").read_text())["wall_s"]
    return score(whole_truth(sample, case / "model.xml"), report, wall_s)


def names_right(one: Score) -> bool:
    """Returns whether all that is hidden was named, where it is, and nothing else."""
    first = (one.effect and one.joint) or one.hidden == in_words([])
    return first and one.complete and one.surplus == 0


def line(one: Score, floor: float) -> str:
    """Returns a line about a case.

    Args:
        one: Its score.
        floor: What the true simulator itself leaves, rad: the unit of the errors.
    """
    mark = "right" if names_right(one) else "WRONG"
    errors = f"{one.before / floor:.2f} -> {one.after / floor:.2f} floors"
    return (
        f"{mark} {one.name}: hidden {one.hidden}; named {one.named}; {one.verdict}; {errors}; "
        f"{one.wall_s:.0f} s"
    )


def told(case: Path, out: Path) -> str:
    """Returns a line about a case, also where it has no report."""
    one = scored(case, out)
    if one is None:
        return f"WRONG {case.name}: no report, see {out.with_suffix('.log')}"
    return line(one, json.loads((case / "truth.json").read_text())["noise_floor"])


def main() -> None:
    """Diagnoses the samples one by one and prints what came of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data/simulated"))
    parser.add_argument("--out", type=Path, default=Path("runs/samples"), metavar="DIR")
    parser.add_argument("--only", default="*", metavar="GLOB", help="only cases of that name")
    parser.add_argument("--limit", type=float, default=240.0, metavar="S", help="for each case")
    asked = parser.parse_args()
    cases = [path.parent for path in sorted(asked.data.glob("*/truth.json"))]
    for case in cases:
        if fnmatch.fnmatch(case.name, asked.only):
            out = asked.out / case.name
            diagnose(case, out, asked.limit)
            print(told(case, out), flush=True)


if __name__ == "__main__":
    main()
