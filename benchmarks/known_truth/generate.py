"""Finds the sizes of effects, simulates cases, and writes what a user would have: files.

A size is drawn for each effect, then made stronger or weaker until it changes the motion by enough
to be found (at least five times the sensor noise) and not by so much that nothing else is seen.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from known_truth.another_hand import Work, by_another_hand
from known_truth.draft import TRIED, Draft, draft
from known_truth.mjcf import mjcf
from known_truth.plans import Plan
from known_truth.recordings import Sensors, write_recording
from known_truth.run import STEP_S, Course, Run
from known_truth.simulation import simulate
from known_truth.truth import truth

#: Robots simulated side by side.
_BATCH = 320
#: How much of each recording is tried, s.
_TRIED_S = 5.0
#: Torque, in units of the most that the robot takes with nothing hidden, beyond which its loop is
#: unstable: nobody records that.
_RUNAWAY = 3.0


def generate(plans: Sequence[Plan], folder: Path, discrepancy: float | None = None) -> None:
    """Writes the cases that are not there yet: `cases/NAME`, and what they hide, `truth/NAME.json`.

    What is judged is told of the first alone.

    Args:
        plans: The cases.
        folder: Where they are written.
        discrepancy: Of another hand, in units of the sensor noise; None for the own hand.
    """
    for plan in plans:
        _check_hand(folder / "truth" / f"{plan.name}.json", discrepancy)
    missing = [plan for plan in plans if not (folder / "truth" / f"{plan.name}.json").exists()]
    builds = dict.fromkeys(plan.setup.robot.joints for plan in missing)
    for build in builds:
        drafts = [draft(plan) for plan in missing if plan.setup.robot.joints == build]
        for some in _portions(drafts):
            _find_sizes(some)
            if drawn := [one for one in some if not one.given_up]:
                _write_all(drawn, _works(drawn, discrepancy), folder)


def _check_hand(file: Path, discrepancy: float | None) -> None:
    """Refuses to take a case for another hand's."""
    truth = json.loads(file.read_text()) if file.exists() else {}
    made = truth.get("discrepancy", {}).get("asked")
    if truth and made != discrepancy:
        raise ValueError(f"{file} is by {_hand(made)}, asked for is {_hand(discrepancy)}")


def _hand(discrepancy: float | None) -> str:
    if discrepancy is None:
        return "the own hand"
    return f"another hand with discrepancy {discrepancy:g}"


def _portions(drafts: Sequence[Draft]) -> Iterator[list[Draft]]:
    """Yields drafts that can be simulated side by side."""
    portion: list[Draft] = []
    for one in drafts:
        if portion and sum(len(d.runs) for d in portion) + len(one.runs) > _BATCH:
            yield portion
            portion = []
        portion.append(one)
    if portion:
        yield portion


def _find_sizes(drafts: Sequence[Draft]) -> None:
    """Finds sizes for all effects of all drafts, in rounds."""
    while open_ := [one for one in drafts if not one.complete]:
        _simulate_nominal([one for one in open_ if not one.nominal])
        candidates = [one.candidate() for one in open_]
        runs = [
            replace(run, hidden=(candidate,))
            for one, candidate in zip(open_, candidates, strict=True)
            for run in _beginnings(one)
        ]
        courses = iter(simulate(runs))
        for one, candidate in zip(open_, candidates, strict=True):
            one.judge(candidate, _signal(one, list(islice(courses, len(one.nominal)))))


def _simulate_nominal(drafts: Sequence[Draft]) -> None:
    """Simulates what robots would do with nothing hidden."""
    courses = iter(simulate([run for one in drafts for run in _beginnings(one)]) if drafts else [])
    for one in drafts:
        one.nominal = list(islice(courses, len(_beginnings(one))))


def _beginnings(one: Draft) -> list[Run]:
    """Returns the beginnings of the recordings on which sizes are tried.

    A loop that is closed over torques may be unstable in one motion and not in another: all of them
    are tried.
    """
    end = round(_TRIED_S / STEP_S)
    runs = one.runs if "effort" in one.plan.setup.kinds else one.runs[:TRIED]
    return [replace(r, measured_at=r.measured_at[r.measured_at <= end]) for r in runs]


def _signal(one: Draft, courses: Sequence[Course]) -> float:
    """Returns the RMS change of the joint that changes most, in units of the sensor noise.

    Infinite where the robot's loop is unstable.
    """
    pairs = list(zip(courses, one.nominal, strict=True))
    if any(np.abs(a.effort).max() > _RUNAWAY * np.abs(b.effort).max() for a, b in pairs):
        return float("inf")
    change = np.concatenate([a.position - b.position for a, b in pairs[:TRIED]])
    return float(np.sqrt(np.mean(change**2, axis=0)).max() / one.sensors.position_std)


def _works(drafts: Sequence[Draft], discrepancy: float | None) -> Sequence[Work | None]:
    return [None] * len(drafts) if discrepancy is None else by_another_hand(drafts, discrepancy)


def _write_all(drafts: Sequence[Draft], works: Sequence[Work | None], folder: Path) -> None:
    runs = [
        work.runs if work else [replace(run, hidden=tuple(one.found)) for run in one.runs]
        for one, work in zip(drafts, works, strict=True)
    ]
    courses = iter(simulate([run for each in runs for run in each]))
    for one, work, each in zip(drafts, works, runs, strict=True):
        sensors = work.sensors if work else one.sensors
        _write_case(one, each, list(islice(courses, len(each))), sensors, folder)
        hidden = folder / "truth" / f"{one.plan.name}.json"
        hidden.parent.mkdir(exist_ok=True)
        told = truth(one) | (work.told() if work else {"hand": "own"})
        hidden.write_text(json.dumps(told, indent=1) + "\n")


def _write_case(
    one: Draft, runs: Sequence[Run], courses: Sequence[Course], sensors: Sensors, folder: Path
) -> None:
    place = folder / "cases" / one.plan.name
    rng = np.random.default_rng([one.plan.seed, 2])
    for name, run, course in zip(one.names, runs, courses, strict=True):
        write_recording(place / f"{name}.mcap", run, course, sensors, rng)
    for kind in one.plan.setup.kinds:
        (place / f"model_{kind}.xml").write_text(mjcf(one.robot, kind))
